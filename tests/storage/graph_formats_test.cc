// Formats: types of the user's, what has none, what is nested, and readers that trust nothing.
#include "inceres/storage/graph_formats.h"

#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/problem/ambient_family.h"
#include "inceres/solver/marginalization.h"
#include "inceres/solver/solver.h"
#include "inceres/storage/graph_file.h"

namespace inceres {
namespace {

// x − target, of a user's.
class TargetFamily final : public AmbientFamily<TargetFamily> {
 public:
  using Measurement = double;
  TargetFamily() : AmbientFamily(1, {{1, 1}}) {}
  void Add(double target) { targets.push_back(target); }
  int size() const override { return static_cast<int>(targets.size()); }
  const char* Name() const override { return "target"; }
  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    residuals[0] = parameters[0][0] - targets[static_cast<std::size_t>(i)];
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      jacobians[0][0] = 1.0;
    }
    return true;
  }

  std::vector<double> targets;
};

// ρ(s) = a s, and a line that is stretched.
class SlopeLoss final : public Loss {
 public:
  explicit SlopeLoss(double a) : slope(a) {}
  void Evaluate(double s, double rho[3]) const override {
    rho[0] = slope * s;
    rho[1] = slope;
    rho[2] = 0.0;
  }
  double slope;
};
class StretchedLine final : public Manifold {
 public:
  int AmbientSize() const override { return 1; }
  int TangentSize() const override { return 1; }
  bool Plus(const double* x, const double* delta, double* sum) const override {
    *sum = *x + 2.0 * *delta;
    return true;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    *jacobian = 2.0;
    return true;
  }
};

void Register(GraphFormats* formats) {
  formats->AddFamily<TargetFamily>(
      "test.target",
      [](const TargetFamily& family, GraphWriter* writer) {
        writer->WriteLong(family.size());
        writer->WriteDoubles(family.targets.data(), family.targets.size());
      },
      [](GraphReader* reader) {
        auto family = std::make_shared<TargetFamily>();
        family->targets = reader->ReadVector(reader->ReadCount(8));
        return family;
      });
  formats->AddLoss<SlopeLoss>(
      "test.slope",
      [](const SlopeLoss& loss, GraphWriter* writer) { writer->WriteDouble(loss.slope); },
      [](GraphReader* reader) { return std::make_shared<SlopeLoss>(reader->ReadDouble()); });
  formats->AddManifold<StretchedLine>(
      "test.stretched_line", [](const StretchedLine&, GraphWriter*) {},
      [](GraphReader*) { return std::make_shared<StretchedLine>(); });
}

class UsersTypes : public testing::Test {
 protected:
  UsersTypes() {
    const double start = 10.0;
    const VariableId x =
        graph_.AddVariable(&start, 1, Role::kFrame, std::make_shared<StretchedLine>());
    const auto family = graph_.AddFamily(std::make_shared<TargetFamily>());
    const auto slope = std::make_shared<SlopeLoss>(3.0);
    graph_.AddFactor(family, 1.0, {x}, slope);
    graph_.AddFactor(family, 2.0, {x}, std::make_shared<ScaledLoss>(slope, 2.0));
  }

  FactorGraph graph_;
  std::string bytes_;
};

TEST_F(UsersTypes, AreKeptByFormatsOfTheirs) {
  GraphFormats formats;
  Register(&formats);
  ASSERT_TRUE(SaveGraphToBytes(graph_, formats, &bytes_).ok());
  FactorGraph loaded;
  LoadedFamilies families;
  const Status status = LoadGraphFromBytes(bytes_, formats, &loaded, &families);
  ASSERT_TRUE(status.ok()) << status.message;
  loaded.AddFactor(families.Handle<TargetFamily>(0), 2.0, {0});
  // Weights 3, 6 and 1 on 1, 2 and 2.
  EXPECT_TRUE(Solve(SolverOptions(), &loaded).IsSolutionUsable());
  EXPECT_NEAR(*loaded.Values(0), 1.7, 1e-6);
}

// A cost that depends on nothing.
class ConstantFamily final : public AmbientFamily<ConstantFamily> {
 public:
  ConstantFamily() : AmbientFamily(1, {}) {}
  int size() const override { return 100; }
  const char* Name() const override { return "constant"; }
  bool EvaluateOne(int, const double* const*, double* residuals, double**) const {
    residuals[0] = 1.0;
    return true;
  }
};

TEST(FamiliesWithoutSlots, AreNotSaved) {
  FactorGraph graph;
  const auto family = graph.AddFamily(std::make_shared<ConstantFamily>());
  for (int i = 0; i < 100; ++i) {
    graph.Connect(family, nullptr);
  }
  std::string bytes;
  const Status status = SaveGraphToBytes(graph, GraphFormats(), &bytes);
  EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
  EXPECT_EQ(status.message, "family 0 (constant) has no slots; a factor touches a variable");
}

// Whether they have factors or not.
TEST(FamiliesWithoutSlots, AreNotLoaded) {
  for (const int num_priors : {0, 3}) {
    LinearPrior prior;
    prior.blocks = {{{1.0}, nullptr, 1}};
    prior.J = prior.e0 = {1.0};
    FactorGraph graph;
    graph.AddFamily(std::make_shared<LinearPriorFamily>(prior));
    GraphFormats forging;
    forging.AddFamily<LinearPriorFamily>(
        "inceres.linear_prior",
        [num_priors](const LinearPriorFamily&, GraphWriter* writer) {
          writer->WriteInt(1);   // rows
          writer->WriteLong(0);  // slots
          writer->WriteLong(num_priors);
          for (int k = 0; k < num_priors; ++k) {
            writer->WriteDouble(1.0);
          }
        },
        [](GraphReader*) { return std::shared_ptr<LinearPriorFamily>(); });
    std::string bytes;
    ASSERT_TRUE(SaveGraphToBytes(graph, forging, &bytes).ok());
    FactorGraph loaded;
    const Status status = LoadGraphFromBytes(bytes, GraphFormats(), &loaded);
    EXPECT_EQ(status.code, StatusCode::kIo);
    EXPECT_EQ(status.message, "family 0 (linear prior) has no slots; a factor touches a variable");
  }
}

// A graph of one factor, with this loss.
FactorGraph GraphWith(std::shared_ptr<const Loss> loss) {
  FactorGraph graph;
  const double start = 1.0;
  const VariableId x = graph.AddVariable(&start, 1, Role::kFrame);
  graph.AddFactor(graph.AddFamily(std::make_shared<TargetFamily>()), 1.0, {x}, std::move(loss));
  return graph;
}

// The losses take any number. What a file must not bring is not written either.
TEST(LossesOfWrongParameters, AreNotSaved) {
  GraphFormats formats;
  Register(&formats);
  const auto expect = [&formats](std::shared_ptr<const Loss> loss, const std::string& expected) {
    std::string bytes;
    const Status status = SaveGraphToBytes(GraphWith(std::move(loss)), formats, &bytes);
    EXPECT_EQ(status.ok(), expected.empty()) << status.message;
    EXPECT_NE(status.message.find(expected), std::string::npos) << status.message;
    EXPECT_EQ(bytes.empty(), !expected.empty());
  };
  expect(std::make_shared<HuberLoss>(0.0),
         "loss 0: a scale is 0.000000 but must be positive and finite");
  expect(std::make_shared<SoftLOneLoss>(-1.0), "a scale is -1");
  expect(std::make_shared<CauchyLoss>(HUGE_VAL), "a scale is inf");
  expect(std::make_shared<ArctanLoss>(std::nan("")), "a scale is nan");
  expect(std::make_shared<TukeyLoss>(0.0), "a scale is 0");
  expect(std::make_shared<TolerantLoss>(1.0, 0.0), "a scale is 0");
  expect(std::make_shared<TolerantLoss>(-1.0, 1.0), "a scale is -1");
  expect(std::make_shared<ScaledLoss>(nullptr, -1.0),
         "a weight is -1.000000 but must be finite and not negative");
  expect(std::make_shared<ScaledLoss>(std::make_shared<HuberLoss>(0.0), 1.0), "a scale is 0");
  expect(std::make_shared<ScaledLoss>(nullptr, 0.0), "");
}

TEST(LossesOfWrongParameters, AreNotLoaded) {
  GraphFormats formats, forging;
  Register(&formats);
  Register(&forging);
  forging.AddLoss<ScaledLoss>(
      "inceres.scaled_loss",
      [](const ScaledLoss& loss, GraphWriter* writer) {
        writer->WriteLoss(loss.loss());
        writer->WriteDouble(loss.scale());
      },
      [](GraphReader*) { return std::shared_ptr<ScaledLoss>(); });
  for (const auto& [weight, passes] : {std::pair(0.0, true), std::pair(-1.0, false)}) {
    std::string bytes;
    ASSERT_TRUE(
        SaveGraphToBytes(GraphWith(std::make_shared<ScaledLoss>(nullptr, weight)), forging, &bytes)
            .ok());
    FactorGraph loaded;
    const Status status = LoadGraphFromBytes(bytes, formats, &loaded);
    EXPECT_EQ(status.ok(), passes) << status.message;
    EXPECT_EQ(status.message.find("a weight is -1") != std::string::npos, !passes);
  }
}

// A Huber loss as a program writes it from now on, with a number before its scale.
void AddOtherHuber(GraphFormats* formats) {
  formats->AddLoss<HuberLoss>(
      "test.huber",
      [](const HuberLoss& loss, GraphWriter* writer) {
        writer->WriteInt(7);
        writer->WriteDouble(loss.a());
      },
      [](GraphReader* reader) {
        EXPECT_EQ(reader->ReadInt(), 7);
        return std::make_shared<HuberLoss>(reader->ReadDouble());
      });
}

TEST(ATypeOfTwoNames, IsReadByBothAndWrittenUnderTheLast) {
  GraphFormats before, now;
  Register(&before);
  Register(&now);
  AddOtherHuber(&now);
  const FactorGraph graph = GraphWith(std::make_shared<HuberLoss>(2.0));
  std::string old_file, new_file;
  ASSERT_TRUE(SaveGraphToBytes(graph, before, &old_file).ok());
  ASSERT_TRUE(SaveGraphToBytes(graph, now, &new_file).ok());
  EXPECT_NE(old_file.find("inceres.huber_loss"), std::string::npos);
  EXPECT_NE(new_file.find("test.huber"), std::string::npos);
  EXPECT_EQ(new_file.find("inceres.huber_loss"), std::string::npos);
  for (const std::string* bytes : {&old_file, &new_file}) {
    FactorGraph loaded;
    const Status status = LoadGraphFromBytes(*bytes, now, &loaded);
    ASSERT_TRUE(status.ok()) << status.message;
    const auto* loss = dynamic_cast<const HuberLoss*>(loaded.loss(0, 0));
    ASSERT_NE(loss, nullptr);
    EXPECT_EQ(loss->a(), 2.0);
  }
  FactorGraph loaded;
  EXPECT_EQ(LoadGraphFromBytes(new_file, before, &loaded).code, StatusCode::kUnavailable);
}

// The format under the name would write an object of another type.
TEST(ATypeWhoseNameAnotherHasTaken, HasNoFormatUntilItIsGivenOne) {
  GraphFormats formats;
  Register(&formats);
  formats.AddLoss<SlopeLoss>(
      "inceres.huber_loss",
      [](const SlopeLoss& loss, GraphWriter* writer) { writer->WriteDouble(loss.slope); },
      [](GraphReader* reader) { return std::make_shared<SlopeLoss>(reader->ReadDouble()); });
  const FactorGraph graph = GraphWith(std::make_shared<HuberLoss>(2.0));
  std::string bytes;
  const Status status = SaveGraphToBytes(graph, formats, &bytes);
  EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
  EXPECT_NE(status.message.find("loss 0 is of a type without a format"), std::string::npos)
      << status.message;
  AddOtherHuber(&formats);
  EXPECT_TRUE(SaveGraphToBytes(graph, formats, &bytes).ok());
}

TEST_F(UsersTypes, WithoutAFormatAreNamedWhenSaved) {
  GraphFormats formats;
  Status status = SaveGraphToBytes(graph_, formats, &bytes_);
  EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
  EXPECT_NE(status.message.find("manifold 0 is of a type without a format"), std::string::npos)
      << status.message;
  EXPECT_NE(status.message.find("StretchedLine"), std::string::npos) << status.message;
  EXPECT_TRUE(bytes_.empty());
}

TEST_F(UsersTypes, WithoutAFormatAreNamedWhenLoaded) {
  GraphFormats formats;
  Register(&formats);
  ASSERT_TRUE(SaveGraphToBytes(graph_, formats, &bytes_).ok());
  FactorGraph loaded;
  const Status status = LoadGraphFromBytes(bytes_, GraphFormats(), &loaded);
  EXPECT_EQ(status.code, StatusCode::kUnavailable);
  EXPECT_EQ(status.message,
            "manifold 0 has the format 'test.stretched_line', which is not known here");
}

// A reader that leaves something, takes too much, or makes nothing.
TEST_F(UsersTypes, ReadersThatDoNotFitAreFoundOut) {
  GraphFormats formats;
  Register(&formats);
  ASSERT_TRUE(SaveGraphToBytes(graph_, formats, &bytes_).ok());
  const auto write = [](const TargetFamily&, GraphWriter*) {};
  const auto load = [this](const GraphFormats& with) {
    FactorGraph loaded;
    const Status status = LoadGraphFromBytes(bytes_, with, &loaded);
    EXPECT_EQ(status.code, StatusCode::kIo);
    return status.message;
  };
  formats.AddFamily<TargetFamily>("test.target", write,
                                  [](GraphReader*) { return std::make_shared<TargetFamily>(); });
  EXPECT_EQ(load(formats), "family 0 (test.target): 24 bytes are left over");
  formats.AddFamily<TargetFamily>("test.target", write, [](GraphReader* reader) {
    reader->ReadVector(4);
    return std::make_shared<TargetFamily>();
  });
  EXPECT_EQ(load(formats), "family 0 (test.target): it ends before all of it is read");
  formats.AddFamily<TargetFamily>("test.target", write, [](GraphReader* reader) {
    reader->ReadVector(3);
    return std::shared_ptr<TargetFamily>();
  });
  EXPECT_EQ(load(formats), "family 0 (test.target): nothing was read");
  formats.AddFamily<TargetFamily>("test.target", write, [](GraphReader* reader) {
    reader->Fail("a target that moves");
    return std::shared_ptr<TargetFamily>();
  });
  EXPECT_EQ(load(formats), "family 0 (test.target): a target that moves");
}

TEST(GraphFormats, RefuseObjectsThatAreNestedTooDeeply) {
  std::shared_ptr<const Loss> loss = std::make_shared<HuberLoss>(1.0);
  GraphFormats formats;
  for (int depth = 0; depth < 40; ++depth) {
    FactorGraph graph;
    const double start = 1.0;
    const VariableId x = graph.AddVariable(&start, 1, Role::kFrame);
    const auto family = graph.AddFamily(std::make_shared<TargetFamily>());
    Register(&formats);
    graph.AddFactor(family, 1.0, {x}, loss);
    std::string bytes;
    FactorGraph loaded;
    const Status status = SaveGraphToBytes(graph, formats, &bytes);
    EXPECT_EQ(status.ok(), depth < 16) << depth;
    if (status.ok()) {
      EXPECT_TRUE(LoadGraphFromBytes(bytes, formats, &loaded).ok()) << depth;
    }
    loss = std::make_shared<ScaledLoss>(loss, 2.0);
  }
}

TEST(GraphStream, NumbersAreLittleEndianAndExact) {
  const GraphFormats formats;
  GraphWriter writer(formats);
  writer.WriteInt(0x01020304);
  writer.WriteLong(-2);
  writer.WriteDouble(-0.0);
  writer.WriteDouble(std::nextafter(1.0, 2.0));
  writer.WriteString("name");
  EXPECT_EQ(writer.bytes().substr(0, 4), std::string("\x04\x03\x02\x01", 4));
  GraphReader reader(writer.bytes().data(), writer.bytes().size(), formats);
  EXPECT_EQ(reader.ReadInt(), 0x01020304);
  EXPECT_EQ(reader.ReadLong(), -2);
  EXPECT_TRUE(std::signbit(reader.ReadDouble()));
  EXPECT_EQ(reader.ReadDouble(), std::nextafter(1.0, 2.0));
  EXPECT_EQ(reader.ReadString(), "name");
  EXPECT_TRUE(reader.ok());
  EXPECT_EQ(reader.remaining(), 0u);
  EXPECT_EQ(reader.ReadLong(), 0);
  EXPECT_FALSE(reader.ok());
  EXPECT_EQ(reader.ReadCount(1), 0u) << "after a failure";
}

TEST(GraphStream, RangesAreChecked) {
  const GraphFormats formats;
  GraphWriter writer(formats);
  writer.WriteInt(7);
  writer.WriteLong(3);
  {
    GraphReader reader(writer.bytes().data(), writer.bytes().size(), formats);
    EXPECT_EQ(reader.ReadIntIn(0, 6, "the day"), 0);
    EXPECT_EQ(reader.status().message, "the day is 7, which it cannot be");
  }
  GraphReader reader(writer.bytes().data(), writer.bytes().size(), formats);
  EXPECT_EQ(reader.ReadIntIn(7, 7, "the day"), 7);
  EXPECT_EQ(reader.ReadCount(1), 0u) << "nothing is left for three items";
  EXPECT_FALSE(reader.ok());
}

}  // namespace
}  // namespace inceres
