#include "adapters/ceres/read/introspection.h"

#include <algorithm>
#include <atomic>
#include <limits>
#include <string>
#include <thread>
#include <tuple>
#include <vector>

#include <gtest/gtest.h>

#include "adapters/ceres/read/index.h"
#include "adapters/test_problems.h"
#include "support/ceres_manifolds.h"

namespace inceres::internal {
namespace {

using testing::MakeWindow;
using testing::ShapeOnlyCost;
using testing::TestProblem;

const ParameterBlockView& BlockAt(const ProblemView& view, const double* values) {
  return view.block(view.index.Find(values));
}

TEST(PointerIndex, FindsEveryPointerAndNoOther) {
  std::vector<double> memory(5000);
  std::vector<double*> pointers;
  for (std::size_t i = 0; i < memory.size(); i += 3) {
    pointers.push_back(&memory[i]);
  }
  PointerIndex index;
  EXPECT_EQ(index.Find(memory.data()), -1);
  index.Build(pointers);
  for (std::size_t i = 0; i < memory.size(); ++i) {
    EXPECT_EQ(index.Find(&memory[i]), i % 3 == 0 ? static_cast<int>(i / 3) : -1);
  }
}

TEST(PointerIndex, NumbersPointersAsTheyCome) {
  const double memory[3] = {};
  PointerIndex index;
  index.Reserve(3);
  EXPECT_EQ(index.FindOrAdd(memory + 1), 0);
  EXPECT_EQ(index.FindOrAdd(memory), 1);
  EXPECT_EQ(index.FindOrAdd(memory + 1), 0);
  EXPECT_EQ(index.Find(memory + 2), -1);
  index.Renumber({1, 0}, 1);
  EXPECT_EQ(index.Find(memory), 0);
  EXPECT_EQ(index.Find(memory + 1), 1);
  EXPECT_EQ(index.FindOrAdd(memory + 2), 2);
}

// Many are found by way of the residual blocks that touch them, unless some are touched by none.
TEST(Introspection, HasAllOfManyBlocksByAddress) {
  constexpr int kNumBlocks = 5000;
  std::vector<double> values(kNumBlocks + 1);
  ceres::Problem problem;
  for (int i = 0; i < kNumBlocks; ++i) {
    double* const block = &values[static_cast<std::size_t>(i * 3 % kNumBlocks)];  // out of order
    problem.AddResidualBlock(new ShapeOnlyCost(1, {1, 1}), nullptr, block,
                             block == values.data() ? &values[1] : values.data());
  }
  for (const bool has_untouched : {false, true}) {
    if (has_untouched) {
      problem.AddParameterBlock(&values.back(), 1);
    }
    std::vector<double*> expected;
    problem.GetParameterBlocks(&expected);
    const ProblemView view = Introspect(problem);
    ASSERT_EQ(view.blocks.size(), expected.size());
    for (std::size_t b = 0; b < expected.size(); ++b) {
      EXPECT_EQ(view.blocks[b].values, expected[b]);
      EXPECT_EQ(view.index.Find(expected[b]), static_cast<int>(b));
      EXPECT_EQ(view.blocks[b].degree > 0, expected[b] != &values.back());
    }
  }
}

// It notes when two threads ask it at a time.
class AskedByOne final : public manifolds::Manifold {
 public:
  explicit AskedByOne(int tangent_size) : tangent_size_(tangent_size) {}
  int AmbientSize() const override { return 1; }
  int TangentSize() const override {
    together_ = together_ || num_asking_.fetch_add(1) > 0;
    for (int i = 0; i < 100; ++i) {
      std::this_thread::yield();
    }
    --num_asking_;
    return tangent_size_;
  }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override {
    *x_plus_delta = *x + *delta;
    return true;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    std::fill_n(jacobian, tangent_size_, 1.0);
    return true;
  }
  bool Minus(const double*, const double*, double*) const override { return false; }
  bool MinusJacobian(const double*, double*) const override { return false; }
  bool together() const { return together_; }

 private:
  const int tangent_size_;
  mutable std::atomic<int> num_asking_{0};
  mutable std::atomic<bool> together_{false};
};

TEST(Introspection, AsksManifoldsByOneThread) {
  const AskedByOne one(1);
  std::vector<double> values(5000);
  ceres::Problem::Options options;
  manifolds::Borrow(&options);
  ceres::Problem problem(options);
  for (double& value : values) {
    problem.AddResidualBlock(new ShapeOnlyCost(1, {1}), nullptr, &value);
    manifolds::Set(&problem, &value, const_cast<AskedByOne*>(&one));
  }
  ProblemView view;
  Introspect(problem, &view, /*num_threads=*/2);
  EXPECT_FALSE(one.together());
  EXPECT_EQ(view.reduced.num_parameter_blocks, 5000);
}

// Ceres can solve it; we leave it to Ceres.
TEST(Introspection, MoreDegreesOfFreedomThanValuesAreADefect) {
  double value = 0.0;
  ceres::Problem problem;
  problem.AddResidualBlock(new ShapeOnlyCost(1, {1}), nullptr, &value);
  manifolds::Set(&problem, &value, new AskedByOne(2));
  EXPECT_NE(Introspect(problem).defect.find("more degrees of freedom"), std::string::npos);
}

TEST(Introspection, SeesLocalParameterizations) {
  const auto test = MakeWindow(3, 4, false);
  const ProblemView view = Introspect(test->problem);
  const ParameterBlockView& pose = BlockAt(view, test->blocks[2].data());
  EXPECT_EQ(pose.ambient_size, 7);
  EXPECT_EQ(pose.tangent_size, 6);
  ASSERT_NE(pose.manifold, nullptr);
  double plus_jacobian[42];
  EXPECT_TRUE(PlusJacobianOf(*pose.manifold, pose.values, plus_jacobian));
  EXPECT_TRUE(view.defect.empty()) << view.defect;
}

TEST(Introspection, SeesManifoldsAndTangentSizeZero) {
  TestProblem test;
  double* q = test.Add({1, 0, 0, 0});
  double* frozen = test.Add({1, 2, 3});
  test.problem.AddParameterBlock(q, 4, new manifolds::QuaternionManifold());
  test.problem.AddParameterBlock(frozen, 3, new manifolds::SubsetManifold(3, {0, 1, 2}));
  test.problem.AddResidualBlock(new ShapeOnlyCost(2, {4, 3}), nullptr, q, frozen);
  const ProblemView view = Introspect(test.problem);
  EXPECT_EQ(BlockAt(view, q).tangent_size, 3);
  EXPECT_TRUE(BlockAt(view, q).reduced());
  EXPECT_EQ(BlockAt(view, frozen).tangent_size, 0);
  EXPECT_TRUE(BlockAt(view, frozen).constant);
}

TEST(Introspection, CountsConstantsFixedResidualsAndUnusedBlocks) {
  const auto test = MakeWindow(3, 4, false);
  const ProblemView view = Introspect(test->problem);
  EXPECT_EQ(view.all.num_parameter_blocks, test->problem.NumParameterBlocks());
  EXPECT_EQ(view.all.num_parameters, test->problem.NumParameters());
  EXPECT_EQ(view.all.num_residual_blocks, test->problem.NumResidualBlocks());
  EXPECT_EQ(view.all.num_residuals, test->problem.NumResiduals());
  // Left out: the constant pose, the constant extrinsic, the block nothing touches; the residual
  // block of the extrinsic alone.
  EXPECT_EQ(view.reduced.num_parameter_blocks, view.all.num_parameter_blocks - 3);
  EXPECT_EQ(view.reduced.num_residual_blocks, view.all.num_residual_blocks - 1);
  EXPECT_EQ(view.all.num_effective_parameters, view.all.num_parameters - 4);
  const ParameterBlockView& unused = BlockAt(view, test->blocks.back().data());
  EXPECT_EQ(unused.degree, 0);
  EXPECT_FALSE(unused.reduced());
}

// Whoever says that a problem has none is believed.
TEST(Introspection, BoundsAreNotLookedForWhereThereAreNone) {
  double x[2] = {1.0, 2.0};
  ceres::Problem problem;
  problem.AddParameterBlock(x, 2);
  problem.SetParameterLowerBound(x, 1, 0.0);
  ProblemView view;
  Introspect(problem, &view, 1, /*may_have_bounds=*/false);
  EXPECT_EQ(view.blocks[0].bounds, BoundsKind::kNone);
  Introspect(problem, &view);
  EXPECT_EQ(view.blocks[0].bounds, BoundsKind::kBounded);
}

// Of a problem that several tasks read: with bounds, manifolds and constants, and blocks that
// repeat or do not.
TEST(Introspection, IsTheSameWithSeveralThreads) {
  TestProblem test;
  constexpr int kNumBlocks = 9000;
  std::vector<double*> blocks;
  for (int b = 0; b < kNumBlocks; ++b) {
    blocks.push_back(test.Add({1.0, 0.0, 0.0, 0.5 * b}));
    test.problem.AddParameterBlock(blocks.back(), 4);
    if (b % 7 == 0) {
      manifolds::Set(&test.problem, blocks.back(), new manifolds::QuaternionManifold());
    } else if (b % 5 == 0) {
      test.problem.SetParameterLowerBound(blocks.back(), 3, -1.0 * b);
    }
    if (b % 11 == 0) {
      test.problem.SetParameterBlockConstant(blocks.back());
    }
  }
  for (int k = 0; k < 40000; ++k) {
    const std::vector<double*> touched = {blocks[(k / 3) % kNumBlocks],
                                          blocks[(k * 37 + 1) % kNumBlocks]};
    if (touched[0] != touched[1]) {
      test.problem.AddResidualBlock(new ShapeOnlyCost(1 + k % 2, {4, 4}), nullptr, touched);
    }
  }
  const ProblemView one = Introspect(test.problem);
  EXPECT_EQ(one.defect, "");
  EXPECT_FALSE(one.bounds.empty());
  for (const int num_threads : {2, 4}) {
    ProblemView many;
    Introspect(test.problem, &many, num_threads);
    EXPECT_EQ(many.slots, one.slots);
    EXPECT_EQ(many.bounds, one.bounds);
    EXPECT_EQ(many.defect, one.defect);
    EXPECT_EQ(many.reduced.num_residuals, one.reduced.num_residuals);
    EXPECT_EQ(many.reduced.num_effective_parameters, one.reduced.num_effective_parameters);
    ASSERT_EQ(many.blocks.size(), one.blocks.size());
    for (std::size_t b = 0; b < one.blocks.size(); ++b) {
      const ParameterBlockView &x = one.blocks[b], &y = many.blocks[b];
      EXPECT_EQ(std::tie(x.values, x.manifold, x.ambient_size, x.tangent_size, x.degree),
                std::tie(y.values, y.manifold, y.ambient_size, y.tangent_size, y.degree));
      EXPECT_EQ(std::tie(x.constant, x.bounds), std::tie(y.constant, y.bounds));
      if (x.bounds != BoundsKind::kNone) {
        EXPECT_EQ(x.first_bound, y.first_bound);
        EXPECT_EQ(one.bounds[x.first_bound + 3], -2.0 * x.values[3]);
      }
    }
    EXPECT_EQ(many.ids, one.ids);
    ASSERT_EQ(many.residuals.size(), one.residuals.size());
    for (std::size_t r = 0; r < one.residuals.size(); ++r) {
      const ResidualBlockView &x = one.residuals[r], &y = many.residuals[r];
      EXPECT_EQ(
          std::tie(x.cost, x.num_residuals, x.first_slot, x.num_slots, x.fixed, x.like_previous),
          std::tie(y.cost, y.num_residuals, y.first_slot, y.num_slots, y.fixed, y.like_previous));
    }
  }
}

TEST(Introspection, KeepsProgramOrderOfResiduals) {
  TestProblem test;
  double* x = test.Add({0.0});
  std::vector<const ceres::CostFunction*> costs;
  for (int k = 0; k < 20; ++k) {
    costs.push_back(new ShapeOnlyCost(1, {1}));
    test.problem.AddResidualBlock(const_cast<ceres::CostFunction*>(costs.back()), nullptr, x);
  }
  const ProblemView view = Introspect(test.problem);
  ASSERT_EQ(view.residuals.size(), costs.size());
  for (std::size_t k = 0; k < costs.size(); ++k) {
    EXPECT_EQ(view.residuals[k].cost, costs[k]);
  }
}

TEST(Introspection, SeesWhichResidualBlocksAreLikeTheirNeighbors) {
  TestProblem test;
  double* x = test.Add({0.0});
  double* y = test.Add({0.0});
  const auto add = [&](int num_residuals, const std::vector<double*>& blocks) {
    const std::vector<int> sizes(blocks.size(), 1);
    test.problem.AddResidualBlock(new ShapeOnlyCost(num_residuals, sizes), nullptr, blocks);
  };
  add(1, {x, y});
  add(1, {x, y});
  add(2, {x, y});
  add(2, {y, x});
  add(2, {y});
  add(2, {y, x});
  const ProblemView view = Introspect(test.problem);
  std::vector<bool> like;
  std::vector<int> slots;
  for (const ResidualBlockView& residual : view.residuals) {
    like.push_back(residual.like_previous);
    slots.insert(slots.end(), view.SlotsOf(residual), view.SlotsOf(residual) + residual.num_slots);
  }
  EXPECT_EQ(like, (std::vector<bool>{false, true, false, false, false, false}));
  const int first = slots[0];
  EXPECT_EQ(slots, (std::vector<int>{first, 1 - first, first, 1 - first, first, 1 - first,
                                     1 - first, first, 1 - first, 1 - first, first}));
  EXPECT_EQ(view.block(first).degree, 5);
  EXPECT_EQ(view.block(1 - first).degree, 6);
}

TEST(Introspection, TellsBoundsApart) {
  TestProblem test;
  double* x = test.Add({0.5, 0.5});
  double* y = test.Add({5.0, 0.5});
  double* z = test.Add({0.5});
  double* crossed = test.Add({0.5});
  double* constant = test.Add({0.5});
  test.problem.AddParameterBlock(crossed, 1);
  test.problem.SetParameterLowerBound(crossed, 0, 1.0);
  test.problem.SetParameterUpperBound(crossed, 0, 1.0);
  test.problem.AddParameterBlock(constant, 1);
  test.problem.SetParameterBlockConstant(constant);
  test.problem.SetParameterLowerBound(constant, 0, 1.0);
  test.problem.AddParameterBlock(x, 2);
  test.problem.AddParameterBlock(y, 2);
  test.problem.AddParameterBlock(z, 1);
  test.problem.SetParameterUpperBound(x, 1, 1.0);
  test.problem.SetParameterUpperBound(y, 0, 1.0);
  test.problem.SetParameterLowerBound(z, 0, -std::numeric_limits<double>::infinity());
  const ProblemView view = Introspect(test.problem);
  EXPECT_EQ(BlockAt(view, x).bounds, BoundsKind::kBounded);
  EXPECT_EQ(BlockAt(view, y).bounds, BoundsKind::kBounded) << "a variable may start outside";
  EXPECT_EQ(BlockAt(view, crossed).bounds, BoundsKind::kInfeasible);
  EXPECT_EQ(BlockAt(view, constant).bounds, BoundsKind::kInfeasible);
  const double* lower = view.bounds.data() + BlockAt(view, x).first_bound;
  constexpr double kMax = std::numeric_limits<double>::max();
  EXPECT_EQ(std::vector<double>(lower, lower + 4), (std::vector<double>{-kMax, -kMax, kMax, 1.0}));
  EXPECT_EQ(BlockAt(view, z).bounds, BoundsKind::kNone) << "an infinite bound is none";
}

TEST(Introspection, NamesDefects) {
  {
    TestProblem test;
    double* x = test.Add({1.0, std::numeric_limits<double>::quiet_NaN()});
    test.problem.AddParameterBlock(x, 2);
    EXPECT_NE(Introspect(test.problem).defect.find("not finite"), std::string::npos);
  }
  {
    TestProblem test;
    test.problem.AddResidualBlock(new ShapeOnlyCost(1, {1, 0}), nullptr, test.Add({1.0}),
                                  test.Add({1.0}));
    EXPECT_NE(Introspect(test.problem).defect.find("of size 0 has no values"), std::string::npos);
  }
  ceres::Problem::Options unsafe;
  unsafe.disable_all_safety_checks = true;
  std::vector<double> memory(8, 1.0);
  {
    ceres::Problem problem(unsafe);
    problem.AddResidualBlock(new ShapeOnlyCost(1, {2, 2}), nullptr, memory.data(), memory.data());
    EXPECT_NE(Introspect(problem).defect.find("twice"), std::string::npos);
  }
  for (const int num_slots : {3, 40}) {  // few are compared with each other, many sorted
    ceres::Problem problem(unsafe);
    std::vector<double> values(At(num_slots), 1.0);
    std::vector<double*> blocks;
    for (double& value : values) {
      blocks.insert(blocks.begin(), &value);
    }
    const auto add = [&] {
      problem.AddResidualBlock(new ShapeOnlyCost(1, std::vector<int>(blocks.size(), 1)), nullptr,
                               blocks);
    };
    add();
    add();
    EXPECT_EQ(Introspect(problem).defect, "");
    blocks.back() = blocks[1];
    add();
    const std::string defect = Introspect(problem).defect;
    EXPECT_NE(defect.find("appears twice in residual block 2"), std::string::npos) << defect;
  }
  {
    ceres::Problem problem(unsafe);
    problem.AddResidualBlock(new ShapeOnlyCost(1, {4, 4}), nullptr, memory.data(),
                             memory.data() + 2);
    EXPECT_NE(Introspect(problem).defect.find("overlaps"), std::string::npos);
  }
}

TEST(Introspection, NoticesACostFunctionThatChangedItsSizes) {
  class Mutable : public ShapeOnlyCost {
   public:
    using ShapeOnlyCost::ShapeOnlyCost;
    void Resize(int size) { (*mutable_parameter_block_sizes())[0] = size; }
  };
  TestProblem test;
  auto* cost = new Mutable(1, std::vector<int>{3});
  test.problem.AddResidualBlock(cost, nullptr, test.Add({1, 2, 3}));
  EXPECT_EQ(Introspect(test.problem).defect, "");
  cost->Resize(2);
  EXPECT_NE(Introspect(test.problem).defect.find("another size"), std::string::npos);
}

// Of many blocks sizes are those of cost functions, as long as these have not changed.
TEST(Introspection, NoticesACostFunctionOfManyThatChangedItsSizes) {
  class Mutable : public ShapeOnlyCost {
   public:
    using ShapeOnlyCost::ShapeOnlyCost;
    std::vector<std::int32_t>* sizes() { return mutable_parameter_block_sizes(); }
  };
  constexpr std::size_t kNumBlocks = 5000;
  std::vector<double> values(3 * kNumBlocks);
  ceres::Problem problem;
  Mutable* last = nullptr;
  for (std::size_t b = 0; b < kNumBlocks; ++b) {
    last = new Mutable(1, std::vector<int>{3});
    problem.AddResidualBlock(last, nullptr, &values[3 * b]);
  }
  const ProblemView view = Introspect(problem);
  EXPECT_EQ(view.defect, "");
  EXPECT_EQ(view.blocks.back().ambient_size, 3);
  (*last->sizes())[0] = 2;
  const ProblemView changed = Introspect(problem);
  EXPECT_NE(changed.defect.find("another size"), std::string::npos);
  EXPECT_EQ(changed.blocks.back().ambient_size, 3);
}

}  // namespace
}  // namespace inceres::internal
