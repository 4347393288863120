// What is wrong with a graph is found, and its culprit named, whether the graph was built so or an
// edit would make it so. An edit that is refused changes nothing.
#include <cmath>
#include <limits>
#include <numeric>

#include <gtest/gtest.h>

#include "inceres/problem/manifolds.h"
#include "problem/graph_to_break.h"

namespace inceres {
namespace {

constexpr auto& kOneToNine = GraphToBreak::kValues;

// fault(to, g) is made in a graph by the same calls as in an edit of one.
template <typename Fault>
void ExpectFault(const Fault& fault, const std::string& expected) {
  GraphToBreak built;
  fault(built.graph, built);
  ExpectInvalid(built.graph.Validate(), expected);
  GraphToBreak edited;
  GraphEdit edit(edited.graph);
  fault(edit, edited);
  ExpectRefused(&edited.graph, edit, expected);
}

template <typename Change>
void ExpectNoFault(const Change& change) {
  GraphToBreak built;
  change(built.graph, built);
  EXPECT_TRUE(built.graph.Validate().ok()) << built.graph.Validate().message;
  GraphToBreak edited;
  GraphEdit edit(edited.graph);
  change(edit, edited);
  const Status status = edited.graph.Apply(edit);
  EXPECT_TRUE(status.ok()) << status.message;
  EXPECT_TRUE(edited.graph.Validate().ok()) << edited.graph.Validate().message;
}

class OddManifold final : public Manifold {
 public:
  explicit OddManifold(int tangent_size) : tangent_size_(tangent_size) {}
  int AmbientSize() const override { return 2; }
  int TangentSize() const override { return tangent_size_; }
  bool Plus(const double*, const double*, double*) const override { return false; }
  bool PlusJacobian(const double*, double*) const override { return false; }

 private:
  int tangent_size_;
};

TEST(GraphFaults, SizesOfAVariable) {
  ExpectFault([](auto& to, auto&) { to.AddVariable(kOneToNine, 0, Role::kFrame); },
              "variable 5 has ambient size 0");
  ExpectFault([](auto& to, auto&) { to.AddVariable(kOneToNine, -2, Role::kFrame); },
              "variable 5 has ambient size -2");
  const auto on = [](int ambient_size, std::shared_ptr<const Manifold> manifold) {
    return [ambient_size, manifold](auto& to, auto&) {
      to.AddVariable(kOneToNine, ambient_size, Role::kFrame, manifold);
    };
  };
  ExpectFault(on(3, std::make_shared<QuaternionManifold>()),
              "variable 5 has 3 values but its manifold has ambient size 4");
  ExpectFault(on(2, std::make_shared<OddManifold>(-1)), "variable 5 has tangent size -1");
  ExpectFault(on(2, std::make_shared<OddManifold>(3)), "variable 5 has tangent size 3");
}

TEST(GraphFaults, LandmarkTooLarge) {
  ExpectFault([](auto& to, auto&) { to.AddVariable(kOneToNine, 5, Role::kLandmark); },
              "variable 5 is a landmark of tangent size 5");
  ExpectNoFault([](auto& to, auto&) { to.AddVariable(kOneToNine, 5, Role::kFrame); });
  ExpectNoFault([](auto& to, auto&) {
    to.SetConstant(to.AddVariable(kOneToNine, 5, Role::kLandmark), true);
  });
}

TEST(GraphFaults, BorrowedConstants) {
  double borrowed[2] = {1.0, std::nan("")};
  const auto borrow = [](const double* values) {
    return [values](auto& to, auto&) { to.AddBorrowedConstant(values, 2); };
  };
  ExpectFault(borrow(nullptr), "variable 5 is a borrowed constant with a null pointer");
  ExpectFault(borrow(borrowed),
              "variable 5 is a borrowed constant with a value that is not finite");
  borrowed[1] = 2.0;
  ExpectNoFault(borrow(borrowed));
}

TEST(GraphFaults, VariablesThatDoNotExist) {
  ExpectFault(
      [](auto& to, auto& g) {
        to.AddFactor(g.views, {}, {0, 7});
      },
      "factor 3 of blank (variables 0, 7): slot 1 names variable 7, but the graph has 5 "
      "variables");
  ExpectFault(
      [](auto& to, auto& g) {
        to.AddFactor(g.views, {}, {-1, 1});
      },
      "factor 3 of blank (variables -1, 1): slot 0 names variable -1");
}

TEST(GraphFaults, SizesOfASlot) {
  ExpectFault(
      [](auto& to, auto& g) {
        to.AddFactor(g.views, {}, {1, 2});
      },
      "factor 3 of blank (variables 1, 2): slot 0 has ambient size 2 but variable 1 has 3 "
      "values");
  ExpectFault(
      [](auto& to, auto& g) {
        const VariableId borrowed =
            to.AddBorrowedConstant(kOneToNine, 3);  // sizes count all the same
        to.AddFactor(g.turns, {}, {borrowed, 0});
      },
      "factor 0 of blank (variables 5, 0): slot 0 has ambient size 4 but variable 5 has 3 values");
  const auto turn = [](bool constant) {
    return [constant](auto& to, auto& g) {
      const VariableId q = to.AddVariable(kOneToNine, 4, Role::kFrame);
      to.SetConstant(q, constant);
      to.AddFactor(g.turns, {}, {to.AddBorrowedConstant(kOneToNine, 4), q});
    };
  };
  ExpectFault(turn(false),
              "factor 0 of blank (variables 6, 5): slot 1 has tangent size 3 but variable 5 has 4");
  ExpectNoFault(turn(true));  // what does not move needs no manifold
}

TEST(GraphFaults, VariableTwiceInAFactor) {
  ExpectFault(
      [](auto& to, auto& g) {
        to.AddFactor(g.triples, {}, {0, 1, 0});
      },
      "factor 0 of blank (variables 0, 1, 0): slot 2 repeats variable 0");
  ExpectFault(
      [](auto& to, auto& g) {
        to.AddFactor(g.pairs, {}, {1, 1});
      },
      "factor 1 of blank (variables 1, 1): slot 1 repeats variable 1");
}

TEST(GraphFaults, TwoLandmarksInAFactor) {
  const auto connect = [](std::vector<bool> constant) {
    return [constant](auto& to, auto& g) {
      to.AddFactor(g.pairs, {}, {1, 2});
      for (const bool each : constant) {
        to.SetConstant(1, each);
      }
    };
  };
  const char* const expected =
      "factor 1 of blank (variables 1, 2): slot 1 is a second landmark (variable 2)";
  ExpectFault(connect({}), expected);
  ExpectNoFault(connect({true}));  // the state that the calls lead to is what counts
  ExpectFault(connect({true, false}), expected);
}

TEST(GraphFaults, FamilyWithoutResiduals) {
  GraphToBreak g;
  const auto family =
      g.graph.AddFamily(std::make_shared<BlankFamily>(0, std::vector<FactorFamily::Slot>{{2, 2}}));
  ExpectInvalid(g.graph.Validate(), "family 4 (blank) has residual size 0");
  GraphEdit edit(g.graph);
  edit.AddFactor(family, {}, {0});
  ExpectInvalid(g.graph.Apply(edit), "family 4 (blank) has residual size 0");
}

// Tables of a solve have a place for each slot of each factor.
TEST(GraphFaults, FamilyWithoutSlots) {
  GraphToBreak g;
  const auto family = g.Add({});
  ExpectInvalid(g.graph.Validate(), "family 4 (blank) has no slots");
  GraphEdit edit(g.graph);
  edit.AddFactor(family, {}, {});
  ExpectInvalid(g.graph.Apply(edit), "family 4 (blank) has no slots");
  EXPECT_EQ(g.graph.NumFactors(family), 0);
}

// Each with each would take long: the first of two is found by sorting.
TEST(GraphFaults, VariableTwiceInAFactorOfManySlots) {
  constexpr int kSlots = 400;
  GraphToBreak g;
  const auto many = g.Add(GraphToBreak::Slots(kSlots, {1, 1}));
  std::vector<VariableId> ids;
  for (int s = 0; s < kSlots; ++s) {
    ids.push_back(g.graph.AddVariable(kOneToNine, 1, Role::kFrame));
  }
  std::vector<VariableId> twice = ids;
  twice[399] = twice[7];
  twice[310] = twice[2];
  twice[300] = twice[7];
  const std::string expected = ": slot 300 repeats variable " + std::to_string(ids[7]);
  GraphEdit edit(g.graph);
  edit.AddFactor(many, {}, twice);
  ExpectRefused(&g.graph, edit, expected);
  edit.Restart();
  std::vector<VariableId> dangling = twice;
  dangling[299] = 5000;
  edit.AddFactor(many, {}, dangling);
  ExpectRefused(&g.graph, edit, ": slot 299 names variable 5000");
  edit.Restart();
  edit.AddFactor(many, {}, ids);
  EXPECT_TRUE(g.graph.Apply(edit).ok());
  EXPECT_TRUE(g.graph.Validate().ok()) << g.graph.Validate().message;
  g.graph.AddFactor(many, {}, twice);
  ExpectInvalid(g.graph.Validate(), expected);
}

// 46341² is the first square beyond an int.
TEST(GraphFaults, PlusJacobianTooLarge) {
  static const std::vector<double> kMany(1000000, 0.5);
  const auto on = [](int size, std::shared_ptr<const Manifold> manifold) {
    return [size, manifold](auto& to, auto&) {
      to.AddVariable(kMany.data(), size, Role::kFrame, manifold);
    };
  };
  ExpectFault(on(46341, std::make_shared<EuclideanManifold>(46341)),
              "variable 5 has a plus-Jacobian of 46341 x 46341 entries, more than 2^31 - 1");
  ExpectNoFault(on(46340, std::make_shared<EuclideanManifold>(46340)));
  ExpectNoFault(on(46341, nullptr));
  std::vector<int> held(1000000 - 4295);
  std::iota(held.begin(), held.end(), 4295);
  ExpectFault(on(1000000, std::make_shared<SubsetManifold>(1000000, held)),
              "variable 5 has a plus-Jacobian of 1000000 x 4295 entries");
}

int PlaceOf(int factor) {
  return factor;
}

int PlaceOf(FactorId factor) {
  return factor.index;
}

// The measurement would otherwise go into a family that the factor is not of.
TEST(GraphFaults, HandlesThatAreNotOfAFamily) {
  const auto expect = [](const auto& handle_of, const std::string& expected) {
    ExpectFault(
        [&handle_of](auto& to, auto& g) {
          const FamilyHandle<BlankFamily> handle = handle_of(g);
          const int size = handle.family == nullptr ? 0 : handle->size();
          EXPECT_EQ(PlaceOf(to.AddFactor(handle, {}, {0, 1})), -1);
          EXPECT_EQ(handle.family == nullptr ? 0 : handle->size(), size);
          EXPECT_EQ(g.views->size(), 3);
        },
        "AddFactor: " + expected);
  };
  using Handle = FamilyHandle<BlankFamily>;
  const std::string is_not = "family 0 (blank) is not the family of the handle ";
  const GraphToBreak other;
  expect([](auto&) { return Handle(); }, "there is no family -1; the graph has 4");
  expect([](auto&) { return Handle{0, nullptr}; }, is_not + "(which has none)");
  expect([](auto& g) { return Handle{0, g.pairs.family}; }, is_not + "(blank)");
  expect([&other](auto&) { return other.views; }, is_not + "(blank)");
  for (const FamilyId id : {-1, 4, 1 << 30}) {
    const std::string no_family = "there is no family " + std::to_string(id) + "; the graph has 4";
    expect([id](auto& g) { return Handle{id, g.views.family}; }, no_family);
    ExpectFault(
        [id](auto& to, auto&) {
          const VariableId ids[] = {0, 1};
          EXPECT_EQ(PlaceOf(to.Connect(id, ids)), -1);
        },
        "Connect: " + no_family);
  }
}

}  // namespace
}  // namespace inceres
