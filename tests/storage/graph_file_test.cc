// SaveGraph and LoadGraph: a graph that was loaded is the one that was saved, and goes on like it.
#include "inceres/storage/graph_file.h"

#include <cmath>
#include <filesystem>
#include <memory>
#include <regex>
#include <string>
#include <typeinfo>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/factors/equidistant_reprojection.h"
#include "inceres/factors/imu_factor.h"
#include "inceres/problem/graph_edit.h"
#include "inceres/solver/solver.h"
#include "storage/every_family.h"
#include "support/random_graph.h"
#include "support/temp_dir.h"

namespace inceres {
namespace {

std::string Saved(const FactorGraph& graph) {
  std::string bytes;
  const Status status = SaveGraphToBytes(graph, GraphFormats(), &bytes);
  EXPECT_TRUE(status.ok()) << status.message;
  return bytes;
}

std::vector<double> ValuesOf(const FactorGraph& graph, VariableId id) {
  return {graph.Values(id), graph.Values(id) + graph.AmbientSize(id)};
}

// Whether an object is there, and of which type.
template <typename T>
const std::type_info& TypeOf(const T* object) {
  return object == nullptr ? typeid(void) : typeid(*object);
}

void ExpectSameVariables(const FactorGraph& a, const FactorGraph& b) {
  ASSERT_EQ(a.num_variables(), b.num_variables());
  EXPECT_EQ(a.num_live_variables(), b.num_live_variables());
  for (VariableId id = 0; id < a.num_variables(); ++id) {
    ASSERT_EQ(a.HasVariable(id), b.HasVariable(id)) << id;
    ASSERT_EQ(a.AmbientSize(id), b.AmbientSize(id)) << id;
    if (!a.HasVariable(id)) {
      continue;
    }
    EXPECT_EQ(a.role(id), b.role(id));
    EXPECT_EQ(a.IsConstant(id), b.IsConstant(id)) << id;
    EXPECT_EQ(ValuesOf(a, id), ValuesOf(b, id)) << id;
    EXPECT_EQ(TypeOf(a.manifold(id)), TypeOf(b.manifold(id))) << id;
    EXPECT_EQ(a.bounds(id) == nullptr, b.bounds(id) == nullptr);
    EXPECT_EQ(a.elimination_group(id), b.elimination_group(id));
    if (a.bounds(id) != nullptr && b.bounds(id) != nullptr) {
      EXPECT_EQ(a.bounds(id)->lower, b.bounds(id)->lower);
      EXPECT_EQ(a.bounds(id)->upper, b.bounds(id)->upper);
    }
    ASSERT_EQ(a.PinnedValues(id) == nullptr, b.PinnedValues(id) == nullptr);
    for (int k = 0; a.PinnedValues(id) != nullptr && k < a.AmbientSize(id); ++k) {
      EXPECT_EQ(a.PinnedValues(id)[k], b.PinnedValues(id)[k]);
    }
  }
}

// Residuals of a factor, or nothing if it cannot be evaluated.
std::vector<double> ResidualsOf(const FactorGraph& graph, FamilyId id, int factor) {
  const FactorFamily& family = graph.family(id);
  std::vector<const double*> parameters;
  for (int i = 0; i <= factor; ++i) {
    for (int s = 0; s < family.num_slots(); ++s) {
      const VariableId variable = graph.Variables(id, i)[s];
      parameters.push_back(variable < 0 ? nullptr : graph.Values(variable));
    }
  }
  std::vector<double> residuals(static_cast<std::size_t>(family.residual_size() * (factor + 1)),
                                0.0);
  const bool failed =
      family.Evaluate({factor, factor + 1, parameters.data(), nullptr, residuals.data(), nullptr})
          .failed();
  return failed ? std::vector<double>() : residuals;
}

void ExpectSameFactors(const FactorGraph& a, const FactorGraph& b) {
  ASSERT_EQ(a.num_families(), b.num_families());
  EXPECT_EQ(a.num_factors(), b.num_factors());
  int num_evaluated = 0;
  for (FamilyId id = 0; id < a.num_families(); ++id) {
    ASSERT_EQ(TypeOf(&a.family(id)), TypeOf(&b.family(id)));
    ASSERT_EQ(a.NumFactors(id), b.NumFactors(id));
    EXPECT_EQ(a.NumFreePlaces(id), b.NumFreePlaces(id));
    for (int i = 0; i < a.NumFactors(id); ++i) {
      ASSERT_EQ(a.HasFactor(id, i), b.HasFactor(id, i));
      EXPECT_EQ(TypeOf(a.loss(id, i)), TypeOf(b.loss(id, i)));
      for (int s = 0; s < a.family(id).num_slots(); ++s) {
        EXPECT_EQ(a.Variables(id, i)[s], b.Variables(id, i)[s]);
      }
      if (a.HasFactor(id, i)) {
        const std::vector<double> residuals = ResidualsOf(a, id, i);
        EXPECT_EQ(residuals, ResidualsOf(b, id, i)) << a.DescribeFactor(id, i);
        num_evaluated += residuals.empty() ? 0 : 1;
        double rho_a[3], rho_b[3];
        if (a.loss(id, i) != nullptr) {
          a.loss(id, i)->Evaluate(0.4, rho_a);
          b.loss(id, i)->Evaluate(0.4, rho_b);
          EXPECT_EQ(rho_a[0], rho_b[0]);
          EXPECT_EQ(rho_a[2], rho_b[2]);
        }
      }
    }
  }
  EXPECT_GT(num_evaluated, 15) << "most of them are compared";
}

TEST(GraphFile, GivesBackEverything) {
  FactorGraph graph, loaded;
  test::MakeEverything(&graph);
  const std::string bytes = Saved(graph);
  const Status status = LoadGraphFromBytes(bytes, GraphFormats(), &loaded);
  ASSERT_TRUE(status.ok()) << status.message;
  ExpectSameVariables(graph, loaded);
  ExpectSameFactors(graph, loaded);
  EXPECT_EQ(Saved(loaded), bytes);
}

// The order of a measurement's members, and all else of the format, as it was when the file was
// made. Numbers that a mathematical library had a part in may end in other digits elsewhere.
TEST(GraphFile, AFileOfThisVersionStaysReadable) {
  FactorGraph graph, loaded;
  test::MakeEverything(&graph);
  const Status status = LoadGraph(INCERES_STORAGE_TEST_DIR "/everything_version_1.graph", &loaded);
  ASSERT_TRUE(status.ok()) << status.message;
  ASSERT_EQ(graph.num_families(), loaded.num_families() + test::kNumLaterFamilies);
  for (FamilyId id = 0; id < loaded.num_families(); ++id) {
    ASSERT_EQ(TypeOf(&graph.family(id)), TypeOf(&loaded.family(id)));
    ASSERT_EQ(graph.NumFactors(id), loaded.NumFactors(id));
    for (int i = 0; i < graph.NumFactors(id); ++i) {
      ASSERT_EQ(graph.HasFactor(id, i), loaded.HasFactor(id, i));
      if (!graph.HasFactor(id, i)) {
        continue;
      }
      const std::vector<double> expected = ResidualsOf(graph, id, i);
      const std::vector<double> found = ResidualsOf(loaded, id, i);
      ASSERT_EQ(expected.size(), found.size()) << graph.DescribeFactor(id, i);
      for (std::size_t r = 0; r < found.size(); ++r) {
        EXPECT_NEAR(found[r], expected[r], 1e-9 * (1.0 + std::fabs(expected[r])))
            << graph.DescribeFactor(id, i);
      }
    }
  }
}

// A family that comes to include/inceres/factors needs a format, and a place in MakeEverything.
TEST(GraphFile, HasEveryBuiltInFamily) {
  FactorGraph graph;
  test::MakeEverything(&graph);
  std::string types;
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    types += std::string(TypeOf(&graph.family(id)).name()) + "\n";
  }
  const std::regex declaration("class INCERES_EXPORT (\\w+Family)\\b");
  int num_declared = 0;
  for (const auto& header :
       std::filesystem::directory_iterator(INCERES_SOURCE_DIR "/include/inceres/factors")) {
    const std::string text = test::ReadBytes(header.path().string());
    for (std::sregex_iterator found(text.begin(), text.end(), declaration), end; found != end;
         ++found, ++num_declared) {
      const std::string name = (*found)[1];
      // As the compiler writes it, behind its length.
      EXPECT_NE(types.find(std::to_string(name.size()) + name), std::string::npos) << name;
    }
  }
  EXPECT_GE(num_declared, 19);
}

TEST(GraphFile, GivesBackAFisheyesCamera) {
  FactorGraph graph, loaded;
  test::MakeEverything(&graph);
  LoadedFamilies families;
  ASSERT_TRUE(LoadGraphFromBytes(Saved(graph), GraphFormats(), &loaded, &families).ok());
  const auto handle = families.Handle<EquidistantReprojectionFamily>(
      static_cast<FamilyId>(graph.num_families() - 1));
  ASSERT_NE(handle.family, nullptr);
  const EquidistantCamera& camera = handle->camera();
  EXPECT_EQ((std::vector<double>{camera.f_x, camera.f_y, camera.c_x, camera.c_y, camera.k1,
                                 camera.k2, camera.k3, camera.k4}),
            (std::vector<double>{285.0, 286.0, 424.0, 400.0, -0.007, 0.043, -0.041, 0.0075}));
  EXPECT_EQ(handle->landmark(), LandmarkKind::kHomogeneous);
  EXPECT_EQ(handle->perturbation(), Perturbation::kLeft);
}

// Manifolds and losses that were one object are one again.
TEST(GraphFile, SharedObjectsStayShared) {
  FactorGraph graph, loaded;
  test::MakeEverything(&graph);
  ASSERT_TRUE(LoadGraphFromBytes(Saved(graph), GraphFormats(), &loaded).ok());
  for (VariableId a = 0; a < graph.num_variables(); ++a) {
    for (VariableId b = 0; b < a; ++b) {
      EXPECT_EQ(graph.manifold(a) == graph.manifold(b), loaded.manifold(a) == loaded.manifold(b));
    }
  }
}

// Ids and places that are free are taken by later edits in the same order.
TEST(GraphFile, EditsGoOnAsTheyWouldHave) {
  FactorGraph graph, loaded;
  test::MakeEverything(&graph);
  LoadedFamilies families;
  ASSERT_TRUE(LoadGraphFromBytes(Saved(graph), GraphFormats(), &loaded, &families).ok());
  const double point[] = {4.0, 5.0, 6.0};
  GraphEdit edit(graph), edit_of_loaded(loaded);
  for (int k = 0; k < 5; ++k) {
    const VariableId id = edit.AddVariable(point, 3, Role::kFrame);
    const VariableId id_of_loaded = edit_of_loaded.AddVariable(point, 3, Role::kFrame);
    if (k < 3) {
      EXPECT_EQ(id, id_of_loaded) << "removed ones that the graph owned";
    }
  }
  for (int k = 0; k < 3; ++k) {
    EXPECT_EQ(graph.FreePlace(5, k), loaded.FreePlace(5, k));
  }
  EXPECT_TRUE(loaded.Apply(edit_of_loaded).ok());
  EXPECT_TRUE(loaded.Validate().ok());
  EXPECT_EQ(families.Handle<ImuFactorFamily>(0).id, -1) << "of another type";
  bool found = false;
  for (FamilyId id = 0; id < loaded.num_families(); ++id) {
    const auto handle = families.Handle<ImuFactorFamily>(id);
    found = found || (handle.id == id && handle.family.get() == &loaded.family(id));
  }
  EXPECT_TRUE(found);
}

TEST(GraphFile, ASolveOfTheLoadedGraphHasTheSameBits) {
  test::BundleOptions options;
  options.manifolds = options.constants = options.losses = true;
  options.perturbation = 0.1;
  const auto bundle = test::MakeBundle(options);
  GraphFormats formats;
  formats.AddFamily<test::SmoothFamily>(
      "test.smooth",
      [](const test::SmoothFamily& family, GraphWriter* writer) {
        writer->WriteInt(family.residual_size());
        writer->WriteLong(family.num_slots());
        for (int s = 0; s < family.num_slots(); ++s) {
          writer->WriteInt(family.slot(s).ambient_size);
          writer->WriteInt(family.slot(s).tangent_size);
        }
        writer->WriteLong(family.size());
        for (int i = 0; i < family.size(); ++i) {
          writer->WriteLong(static_cast<std::int64_t>(family.measurement(i).size()));
          writer->WriteDoubles(family.measurement(i).data(), family.measurement(i).size());
        }
      },
      [](GraphReader* reader) {
        const int rows = reader->ReadIntIn(1, 100, "rows");
        std::vector<FactorFamily::Slot> slots(reader->ReadCount(8));
        for (FactorFamily::Slot& slot : slots) {
          slot.ambient_size = reader->ReadIntIn(1, 100, "a size");
          slot.tangent_size = reader->ReadIntIn(0, 100, "a size");
        }
        auto family = std::make_shared<test::SmoothFamily>(rows, slots);
        const std::size_t count = reader->ReadCount(8);
        for (std::size_t i = 0; i < count && reader->ok(); ++i) {
          family->Add(reader->ReadVector(reader->ReadCount(8)));
        }
        return family;
      });
  std::string bytes;
  ASSERT_TRUE(SaveGraphToBytes(bundle->graph(), formats, &bytes).ok());
  FactorGraph loaded;
  const Status status = LoadGraphFromBytes(bytes, formats, &loaded);
  ASSERT_TRUE(status.ok()) << status.message;
  const Summary summary = Solve(SolverOptions(), &bundle->graph());
  const Summary of_loaded = Solve(SolverOptions(), &loaded);
  EXPECT_EQ(summary.final_cost, of_loaded.final_cost);
  EXPECT_EQ(bundle->graph().state(), loaded.state());
}

TEST(GraphFile, GoesThroughFilesPlainAndCompressed) {
  FactorGraph graph;
  test::MakeEverything(&graph);
  const test::TempDir dir;
  for (const char* name : {"a.graph", "a.graph.gz", "a.graph.bz2"}) {
    ASSERT_TRUE(SaveGraph(dir.File(name), graph).ok());
    FactorGraph loaded;
    const Status status = LoadGraph(dir.File(name), &loaded);
    ASSERT_TRUE(status.ok()) << status.message;
    EXPECT_EQ(Saved(loaded), Saved(graph));
  }
  EXPECT_EQ(test::ReadBytes(dir.File("a.graph")), Saved(graph));
  EXPECT_EQ(SaveGraph(dir.File("nowhere/a.graph"), graph).code, StatusCode::kIo);
}

TEST(GraphFile, RefusesToSaveWhatDoesNotValidate) {
  FactorGraph graph;
  graph.AddVariable(nullptr, 2, Role::kFrame);
  std::string bytes = "before";
  EXPECT_EQ(SaveGraphToBytes(graph, GraphFormats(), &bytes).code, StatusCode::kInvalidArgument);
  EXPECT_EQ(bytes, "before");
}

class DamagedFile : public testing::Test {
 protected:
  DamagedFile() {
    test::MakeEverything(&graph_);
    bytes_ = Saved(graph_);
  }
  void ExpectRefused(const std::string& bytes, const std::string& words) {
    const std::string before = Saved(graph_);
    const test::TempDir dir;
    test::WriteBytes(dir.File("a.graph"), bytes);
    LoadedFamilies families;
    const Status status = LoadGraph(dir.File("a.graph"), &graph_, &families);
    EXPECT_EQ(status.code, StatusCode::kIo);
    EXPECT_NE(status.message.find("a.graph: " + words), std::string::npos) << status.message;
    EXPECT_EQ(Saved(graph_), before);
    EXPECT_TRUE(families.families.empty());
  }

  FactorGraph graph_;
  std::string bytes_;
};

TEST_F(DamagedFile, IsNamedByWhatIsWrong) {
  ExpectRefused("", "it is no graph");
  ExpectRefused("INCEREGR", "it is no graph");
  ExpectRefused("x" + bytes_.substr(1), "it is no graph");
  std::string later = bytes_;
  later[8] = 2;
  ExpectRefused(later, "it is of version 2");
  ExpectRefused(bytes_.substr(0, bytes_.size() - 1), "it should have");
  ExpectRefused(bytes_ + "x", "it should have");
  std::string flipped = bytes_;
  flipped[bytes_.size() / 2] = static_cast<char>(flipped[bytes_.size() / 2] ^ 1);
  ExpectRefused(flipped, "its checksum does not match");
  EXPECT_EQ(LoadGraph("/no/such/file", &graph_).code, StatusCode::kIo);
}

}  // namespace
}  // namespace inceres
