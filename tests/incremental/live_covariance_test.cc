#include "inceres/solver/live_covariance.h"

#include <cmath>

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "inceres/solver/covariance.h"
#include "incremental/incremental_bundle.h"
#include "marginal/linear_world.h"
#include "support/dense_oracle.h"
#include "support/test_families.h"
#include "support/values_held.h"

namespace inceres::test {
namespace {

using test::AtValuesHeld;

using Eigen::MatrixXd;

// Every factor that has moved is linearized anew, and the frames are hardly damped: what is held
// after an Update is H at its end, but for the damping of landmarks.
IncrementalOptions Fresh() {
  IncrementalOptions options;
  options.batch_share = 2.0;
  options.relinearization_share = 0.0;
  options.truncation_share = 0.0;
  options.min_damping = options.initial_damping = 1e-15;
  options.function_tolerance = 1e-10;
  return options;
}

LiveCovarianceOptions AsFactored() {
  LiveCovarianceOptions options;
  options.accuracy = CovarianceAccuracy::kAsFactored;
  return options;
}

LiveCovarianceOptions Exact() {
  LiveCovarianceOptions options;
  options.accuracy = CovarianceAccuracy::kExact;
  options.tolerance = 1e-13;
  return options;
}

MatrixXd DenseOf(const LiveCovariance& covariance) {
  MatrixXd dense(covariance.size(), covariance.size());
  for (int i = 0; i < covariance.size(); ++i) {
    for (int j = 0; j < covariance.size(); ++j) {
      dense(i, j) = covariance(i, j);
    }
  }
  return dense;
}

// In units of the standard deviations.
double LargestError(const MatrixXd& actual, const MatrixXd& expected) {
  if (actual.rows() != expected.rows()) {
    return HUGE_VAL;
  }
  const Eigen::VectorXd inverse_deviations = expected.diagonal().cwiseSqrt().cwiseInverse();
  return (inverse_deviations.asDiagonal() * (actual - expected) * inverse_deviations.asDiagonal())
      .cwiseAbs()
      .maxCoeff();
}

// H⁻¹ of all that moves, with what the damping adds to the diagonal of frames and of landmarks.
MatrixXd DenseInverse(const IncrementalSolver& solver, double mu, double lambda) {
  const FactorGraph graph = AtValuesHeld(solver);
  const std::vector<VariableId> moving = MovingVariables(graph);
  MatrixXd H = DenseOracle(graph, moving).H;
  int row = 0;
  for (const VariableId id : moving) {
    const double damping = graph.role(id) == Role::kLandmark ? lambda : mu;
    for (int k = 0; k < graph.TangentSize(id); ++k, ++row) {
      H(row, row) *= 1.0 + damping;
    }
  }
  return H.inverse();
}

MatrixXd JointOfAll(const IncrementalSolver& solver, const LiveCovarianceOptions& options) {
  LiveCovariance covariance;
  const Status status =
      solver.Covariance(MovingVariables(AtValuesHeld(solver)), options, &covariance);
  EXPECT_TRUE(status.ok()) << status.message;
  return DenseOf(covariance);
}

TEST(LiveCovariance, OfFramesIsTheInverseOfTheHessian) {
  for (const ReducedSolverKind kind : {ReducedSolverKind::kAutomatic, ReducedSolverKind::kResumed,
                                       ReducedSolverKind::kDense, ReducedSolverKind::kSparse}) {
    IncrementalOptions options = Fresh();
    options.reduced_solver = kind;
    IncrementalBundle bundle(options, 4);
    bundle.Grow(12, 0, 1);
    ASSERT_EQ(bundle.solver.Update().termination, Termination::kConvergence);
    EXPECT_LT(LargestError(JointOfAll(bundle.solver, AsFactored()),
                           DenseInverse(bundle.solver, 0.0, 0.0)),
              1e-9);
    bundle.Grow(3, 0, 1);
    ASSERT_EQ(bundle.solver.Update().termination, Termination::kConvergence);
    EXPECT_LT(LargestError(JointOfAll(bundle.solver, AsFactored()),
                           DenseInverse(bundle.solver, 0.0, 0.0)),
              1e-9);
    EXPECT_LT(
        LargestError(JointOfAll(bundle.solver, Exact()), DenseInverse(bundle.solver, 0.0, 0.0)),
        1e-9);
  }
}

TEST(LiveCovariance, OfLandmarksToo) {
  IncrementalBundle bundle(Fresh(), 5);
  bundle.Grow(6, 20, 3);
  ASSERT_EQ(bundle.solver.Update().termination, Termination::kConvergence);
  LiveCovariance covariance;
  ASSERT_TRUE(bundle.solver.MarginalCovariance(bundle.landmarks()[3], {}, &covariance).ok());
  EXPECT_EQ(covariance.size(), 3);
  const double lambda = covariance.staleness.landmark_damping;
  EXPECT_GE(lambda, 1e-6);
  EXPECT_EQ(covariance.staleness.num_stale_factors, 0);
  EXPECT_GT(covariance.staleness.largest_pending_step, 0.0);  // less than was worth a step
  EXPECT_LT(LargestError(JointOfAll(bundle.solver, AsFactored()),
                         DenseInverse(bundle.solver, 0.0, lambda)),
            1e-9);
  EXPECT_LT(LargestError(JointOfAll(bundle.solver, Exact()), DenseInverse(bundle.solver, 0.0, 0.0)),
            1e-9);
}

TEST(LiveCovariance, ABlockIsThatOfTheWhole) {
  IncrementalBundle bundle(Fresh(), 6);
  bundle.Grow(7, 15, 3);
  bundle.solver.Update();
  const FactorGraph graph = AtValuesHeld(bundle.solver);
  const std::vector<VariableId> all = MovingVariables(graph);
  for (const LiveCovarianceOptions& options : {LiveCovarianceOptions(), AsFactored(), Exact()}) {
    LiveCovariance whole, pair;
    ASSERT_TRUE(bundle.solver.Covariance(all, options, &whole).ok());
    const VariableId a = bundle.landmarks()[2], b = bundle.frames()[4];
    ASSERT_TRUE(bundle.solver.JointCovariance(a, b, options, &pair).ok());
    ASSERT_EQ(pair.offsets, (std::vector<int>{0, 3, 9}));
    const auto place = [&](int row) {
      const auto at = std::find(all.begin(), all.end(), row < 3 ? a : b) - all.begin();
      return whole.offsets[static_cast<std::size_t>(at)] + (row < 3 ? row : row - 3);
    };
    for (int i = 0; i < 9; ++i) {
      for (int j = 0; j < 9; ++j) {
        const double deviations = std::sqrt(pair(i, i) * pair(j, j));
        EXPECT_NEAR(pair(i, j), whole(place(i), place(j)), 1e-12 * deviations);
      }
    }
  }
}

TEST(LiveCovariance, AfterMarginalization) {
  IncrementalBundle bundle(Fresh(), 3);
  bundle.Grow(6, 14, 3);
  bundle.solver.Update();
  MarginalizationRequest request;
  request.marginalized = {bundle.landmarks()[0], bundle.landmarks()[5]};
  request.dropped = {bundle.landmarks()[7]};
  ASSERT_TRUE(bundle.solver.Marginalize(request, MarginalizationOptions()).status.ok());
  LiveCovariance covariance;
  EXPECT_EQ(bundle.solver.MarginalCovariance(bundle.frames()[3], {}, &covariance).code,
            StatusCode::kInvalidArgument);
  ASSERT_EQ(bundle.solver.Update().termination, Termination::kConvergence);
  ASSERT_TRUE(bundle.solver.MarginalCovariance(bundle.frames()[3], {}, &covariance).ok());
  const std::vector<VariableId> all = MovingVariables(AtValuesHeld(bundle.solver));
  ASSERT_TRUE(bundle.solver.Covariance(all, Exact(), &covariance).ok());
  // A fixed linearization point of a prior is no business of the dense oracle's.
  GraphCovariance expected;
  for (std::size_t k = 0; k < all.size(); ++k) {
    ASSERT_TRUE(expected.Compute(bundle.solver, {{all[k], all[k]}}).ok());
    const int size = covariance.offsets[k + 1] - covariance.offsets[k];
    std::vector<double> block(static_cast<std::size_t>(size * size));
    ASSERT_TRUE(expected.Get(all[k], all[k], block.data()));
    for (int i = 0; i < size; ++i) {
      const int at = covariance.offsets[k] + i;
      EXPECT_NEAR(covariance(at, at), block[static_cast<std::size_t>(i * size + i)],
                  1e-9 * covariance(at, at));
    }
  }
}

// With the damping there usually is, edit by edit.
TEST(LiveCovariance, WithoutDampingIsTheInverseOfTheHessian) {
  for (const ReducedSolverKind kind :
       {ReducedSolverKind::kAutomatic, ReducedSolverKind::kPcg, ReducedSolverKind::kDense}) {
    IncrementalOptions options = Fresh();
    options.min_damping = 1e-8;
    options.initial_damping = 1e-4;
    options.reduced_solver = kind;
    IncrementalBundle bundle(options, 14);
    for (int step = 0; step < 8; ++step) {
      bundle.Grow(2, 0, 1);
      if (step == 4) {
        bundle.RemoveVariable(bundle.frames()[3]);
      }
      bundle.SetConstant(bundle.frames()[1], step % 3 == 1);
      bundle.Apply();
      ASSERT_EQ(bundle.solver.Update().termination, Termination::kConvergence);
      EXPECT_LT(LargestError(JointOfAll(bundle.solver, {}), DenseInverse(bundle.solver, 0.0, 0.0)),
                1e-9);
    }
  }
}

// Old Jacobians and a step left undone: told, and exactly what it is at the values there are.
TEST(LiveCovariance, TellsHowStaleItIs) {
  IncrementalOptions options;
  options.batch_share = 2.0;
  options.relinearization_share = 1e6;
  options.max_num_iterations = 2;
  IncrementalBundle bundle(options, 8);
  bundle.Grow(6, 20, 3);
  bundle.solver.Update();
  LiveCovariance covariance;
  const VariableId frame = bundle.frames()[2];
  ASSERT_TRUE(bundle.solver.MarginalCovariance(frame, AsFactored(), &covariance).ok());
  EXPECT_GT(covariance.staleness.num_stale_factors, 0);
  EXPECT_GT(covariance.staleness.largest_residual_error, 0.0);
  EXPECT_GT(covariance.staleness.frame_damping, 0.0);
  EXPECT_GT(covariance.staleness.damping_error, covariance.staleness.frame_damping);
  EXPECT_LT(covariance.staleness.damping_error, 0.1);
  const MatrixXd expected = DenseInverse(bundle.solver, 0.0, 0.0);
  EXPECT_GT(LargestError(JointOfAll(bundle.solver, AsFactored()), expected), 1e-6);
  EXPECT_LT(LargestError(JointOfAll(bundle.solver, Exact()), expected), 1e-9);
}

// The damping lowers variances, by no more than is told.
TEST(LiveCovariance, TheErrorOfTheDampingIsBounded) {
  IncrementalOptions options = Fresh();
  options.min_damping = options.initial_damping = 1e-4;
  IncrementalBundle bundle(options, 9);
  bundle.Grow(30, 0, 1);
  bundle.solver.Update();
  LiveCovariance damped, exact;
  const std::vector<VariableId> all = MovingVariables(AtValuesHeld(bundle.solver));
  ASSERT_TRUE(bundle.solver.Covariance(all, AsFactored(), &damped).ok());
  ASSERT_TRUE(bundle.solver.Covariance(all, Exact(), &exact).ok());
  for (int i = 0; i < damped.size(); ++i) {
    const double share = 1.0 - damped(i, i) / exact(i, i);
    EXPECT_GT(share, 0.0);
    EXPECT_LE(share, damped.staleness.damping_error);
  }
}

// A chain of ties without priors: the damping would give numbers.
TEST(LiveCovariance, AFreeGaugeIsAStatus) {
  for (const int size : {2, 20, 200}) {
    IncrementalOptions options;
    options.batch_share = 2.0;
    IncrementalSolver solver(options);
    const auto ties = solver.AddFamily(
        std::make_shared<LinearFamily>(3, std::vector<FactorFamily::Slot>{{3, 3}, {3, 3}}));
    GraphEdit edit(solver.graph());
    Random random(static_cast<unsigned>(size));
    std::vector<VariableId> ids;
    for (int i = 0; i < size; ++i) {
      ids.push_back(edit.AddVariable(random.Vector(3).data(), 3, Role::kFrame));
      if (i > 0) {
        MatrixXd A(3, 6);
        A << -MatrixXd::Identity(3, 3), MatrixXd::Identity(3, 3);
        edit.AddFactor(ties, {A, RandomMatrix(&random, 3, 1)}, {ids[ids.size() - 2], ids.back()});
      }
    }
    ASSERT_TRUE(solver.Apply(edit).ok());
    solver.Update();
    for (const LiveCovarianceOptions& covariance_options :
         {LiveCovarianceOptions(), AsFactored(), Exact()}) {
      LiveCovariance covariance;
      const Status status = solver.MarginalCovariance(ids.back(), covariance_options, &covariance);
      EXPECT_EQ(status.code, StatusCode::kSingular) << size;
      EXPECT_NE(status.message.find("gauge"), std::string::npos) << status.message;
      EXPECT_EQ(covariance.size(), 0);
    }
    GraphEdit hold(solver.graph());
    hold.SetConstant(ids[0], true);
    ASSERT_TRUE(solver.Apply(hold).ok());
    solver.Update();
    LiveCovariance covariance;
    const Status held = solver.JointCovariance(ids[0], ids.back(), {}, &covariance);
    ASSERT_TRUE(held.ok()) << held.message;
    EXPECT_EQ(covariance(0, 0), 0.0);
    EXPECT_EQ(covariance(0, 4), 0.0);
    EXPECT_GT(covariance(4, 4), 0.0);
  }
}

// Frames that landmarks alone tie together: each is seen from two that follow each other.
class LandmarkChain {
 public:
  LandmarkChain()
      : solver(IncrementalOptions()),
        views_(solver.AddFamily(
            std::make_shared<LinearFamily>(3, std::vector<FactorFamily::Slot>{{3, 3}, {3, 3}}))) {}

  std::vector<VariableId> Add(int num_frames, VariableId before = -1) {
    GraphEdit edit(solver.graph());
    std::vector<VariableId> frames;
    MatrixXd A(3, 6);
    A << -MatrixXd::Identity(3, 3), MatrixXd::Identity(3, 3);
    for (int i = 0; i < num_frames; ++i) {
      const VariableId last = i > 0 ? frames.back() : before;
      frames.push_back(edit.AddVariable(random_.Vector(3).data(), 3, Role::kFrame));
      for (int k = 0; last >= 0 && k < 5; ++k) {
        const VariableId point = edit.AddVariable(random_.Vector(3).data(), 3, Role::kLandmark);
        edit.AddFactor(views_, {A, RandomMatrix(&random_, 3, 1)}, {last, point});
        edit.AddFactor(views_, {A, RandomMatrix(&random_, 3, 1)}, {frames.back(), point});
      }
    }
    EXPECT_TRUE(solver.Apply(edit).ok());
    solver.Update();
    return frames;
  }
  void ExpectFree(VariableId frame) const {
    for (const LiveCovarianceOptions& options : {LiveCovarianceOptions(), AsFactored(), Exact()}) {
      LiveCovariance covariance;
      const Status status = solver.MarginalCovariance(frame, options, &covariance);
      EXPECT_EQ(status.code, StatusCode::kSingular);
      EXPECT_NE(status.message.find("gauge"), std::string::npos) << status.message;
      EXPECT_EQ(covariance.size(), 0);
    }
  }
  void ExpectKnown(VariableId frame) const {
    LiveCovariance covariance, exact;
    ASSERT_TRUE(solver.MarginalCovariance(frame, Exact(), &exact).ok());
    for (const LiveCovarianceOptions& options : {LiveCovarianceOptions(), AsFactored()}) {
      const Status status = solver.MarginalCovariance(frame, options, &covariance);
      ASSERT_TRUE(status.ok()) << status.message;
      // The landmarks keep their damping, which is much of what holds the end of a chain.
      EXPECT_LT(LargestError(DenseOf(covariance), DenseOf(exact)), 0.3);
    }
  }
  void Hold(VariableId frame) {
    GraphEdit edit(solver.graph());
    edit.SetConstant(frame, true);
    EXPECT_TRUE(solver.Apply(edit).ok());
    solver.Update();
  }

  void AddPrior(VariableId frame) {
    const auto priors = solver.AddFamily(
        std::make_shared<LinearFamily>(3, std::vector<FactorFamily::Slot>{{3, 3}}));
    GraphEdit edit(solver.graph());
    edit.AddFactor(priors, {10.0 * MatrixXd::Identity(3, 3), RandomMatrix(&random_, 3, 1)},
                   {frame});
    EXPECT_TRUE(solver.Apply(edit).ok());
    solver.Update();
  }

  IncrementalSolver solver;

 private:
  FamilyHandle<LinearFamily> views_;
  Random random_{7};
};

// The damping of the landmarks would give numbers.
TEST(LiveCovariance, LandmarksDoNotHoldAFreeGauge) {
  for (const int size : {3, 30}) {
    LandmarkChain chain;
    const std::vector<VariableId> frames = chain.Add(size);
    chain.ExpectFree(frames.back());
    chain.Hold(frames[0]);
    chain.ExpectKnown(frames.back());
  }
}

// The farther a frame is from what holds the gauge, the more of its variance damping takes, and no
// more than is told, of landmarks too.
TEST(LiveCovariance, TheErrorOfTheLandmarksDampingIsBounded) {
  for (const int size : {3, 10, 30, 60}) {
    LandmarkChain chain;
    const std::vector<VariableId> frames = chain.Add(size);
    chain.Hold(frames[0]);
    const std::vector<VariableId> all = MovingVariables(AtValuesHeld(chain.solver));
    const MatrixXd exact = DenseInverse(chain.solver, 0.0, 0.0);
    double worst = 0.0;
    int row = 0;
    for (const VariableId id : all) {
      LiveCovariance undamped;
      ASSERT_TRUE(chain.solver.MarginalCovariance(id, {}, &undamped).ok());
      for (int k = 0; k < undamped.size(); ++k, ++row) {
        const double share = 1.0 - undamped(k, k) / exact(row, row);
        EXPECT_LE(share, undamped.staleness.damping_error) << size;
        worst = std::max(worst, share);
      }
      EXPECT_LT(undamped.staleness.damping_error, 1.0);
    }
    EXPECT_EQ(row, exact.rows());
    LiveCovariance last;
    ASSERT_TRUE(chain.solver.MarginalCovariance(frames.back(), {}, &last).ok());
    EXPECT_LE(last.staleness.damping_error, 1.5 * worst) << size;
    LiveCovariance damped;
    ASSERT_TRUE(chain.solver.MarginalCovariance(frames.back(), AsFactored(), &damped).ok());
    EXPECT_LE(1.0 - damped(0, 0) / last(0, 0) * (1.0 - worst), damped.staleness.damping_error);
  }
}

// Without a free gauge being found, conjugate gradients that do not converge may mean one.
TEST(LiveCovariance, WhatDoesNotConvergeMayNotBeHeld) {
  LandmarkChain chain;
  const std::vector<VariableId> frames = chain.Add(30);
  chain.Hold(frames[0]);
  LiveCovarianceOptions options = Exact();
  options.max_iterations = 1;
  LiveCovariance covariance;
  const Status status = chain.solver.MarginalCovariance(frames.back(), options, &covariance);
  EXPECT_EQ(status.code, StatusCode::kUnavailable);
  EXPECT_NE(status.message.find("next to nothing holds"), std::string::npos) << status.message;
}

// What comes to a graph whose gauge is known to be held may be free by itself.
TEST(LiveCovariance, AnIslandThatComesLaterIsFree) {
  LandmarkChain chain;
  const std::vector<VariableId> frames = chain.Add(40);
  chain.Hold(frames[0]);
  chain.ExpectKnown(frames.back());
  chain.ExpectKnown(chain.Add(1, frames.back()).back());
  chain.ExpectFree(chain.Add(2).back());
}

// A gauge that was found free is looked at again.
TEST(LiveCovariance, APriorThatComesLaterHoldsTheGauge) {
  LandmarkChain chain;
  const std::vector<VariableId> frames = chain.Add(10);
  chain.ExpectFree(frames.back());
  chain.AddPrior(frames[0]);
  chain.ExpectKnown(frames.back());
}

// Nothing is taken out of the graph, and what held it has lost its weight all the same: a new
// factor has pulled it to where its loss counts it as an outlier, and there says nothing itself.
TEST(LiveCovariance, ALossThatTakesAllWeightFreesTheGauge) {
  IncrementalOptions options = Fresh();
  options.min_damping = options.initial_damping = 1e-8;  // rounding is less than 1e-4 of that
  IncrementalSolver solver(options);
  using Slots = std::vector<FactorFamily::Slot>;
  const auto priors = solver.AddFamily(std::make_shared<LinearFamily>(1, Slots{{1, 1}}));
  const auto ties = solver.AddFamily(std::make_shared<LinearFamily>(1, Slots{{1, 1}, {1, 1}}));
  const auto pulls =
      solver.AddFamily(test::ScalarFamily([](double x) { return x < 3.0 ? 10.0 * (3.5 - x) : 0.0; },
                                          [](double x) { return x < 3.0 ? -10.0 : 0.0; }));
  MatrixXd difference(1, 2);
  difference << -1.0, 1.0;
  const double zero = 0.0;
  GraphEdit edit(solver.graph());
  std::vector<VariableId> path;
  for (int i = 0; i < 20; ++i) {
    path.push_back(edit.AddVariable(&zero, 1, Role::kFrame));
    if (i > 0) {
      edit.AddFactor(ties, {difference, MatrixXd::Zero(1, 1)}, {path[i - 1], path[i]});
    }
  }
  edit.AddFactor(priors, {MatrixXd::Identity(1, 1), MatrixXd::Zero(1, 1)}, {path[0]},
                 std::make_shared<TukeyLoss>(1.0));
  ASSERT_TRUE(solver.Apply(edit).ok());
  solver.Update();
  LiveCovariance covariance;
  ASSERT_TRUE(solver.MarginalCovariance(path.back(), AsFactored(), &covariance).ok());

  GraphEdit pull(solver.graph());
  pull.AddFactor(pulls, 0, {path[0]});
  ASSERT_TRUE(solver.Apply(pull).ok());
  ASSERT_NE(solver.Update().termination, Termination::kFailure);
  ASSERT_GT(*solver.Values(path[0]), 3.0);
  EXPECT_EQ(solver.MarginalCovariance(path.back(), AsFactored(), &covariance).code,
            StatusCode::kSingular);
}

// A path that grows by a pose an Update, with a loop now and then.
class GrowingPath {
 public:
  GrowingPath()
      : solver_(PathOptions()),
        ties_(solver_.AddFamily(
            std::make_shared<LinearFamily>(3, std::vector<FactorFamily::Slot>{{3, 3}, {3, 3}}))) {}

  void Grow() {
    GraphEdit edit(solver_.graph());
    ids_.push_back(edit.AddVariable(random_.Vector(3).data(), 3, Role::kFrame));
    const auto tie = [&](std::size_t from) {
      MatrixXd A(3, 6);
      A << -MatrixXd::Identity(3, 3), 2.0 * MatrixXd::Identity(3, 3);
      edit.AddFactor(ties_, {A, RandomMatrix(&random_, 3, 1)}, {ids_[from], ids_.back()});
    };
    if (ids_.size() == 1) {
      edit.SetConstant(ids_[0], true);
    } else {
      tie(ids_.size() - 2);
    }
    if (ids_.size() % 9 == 0) {
      tie(ids_.size() / 2);
    }
    ASSERT_TRUE(solver_.Apply(edit).ok());
    ASSERT_EQ(solver_.Update().termination, Termination::kConvergence);
  }
  // Of the newest pose, against a dense inverse; counts those for which nothing was factored.
  void LookAtNewest() {
    LiveCovariance newest;
    ASSERT_TRUE(solver_.MarginalCovariance(ids_.back(), {}, &newest).ok());
    num_free_ += newest.staleness.num_factored_frames == 0 ? 1 : 0;
    const MatrixXd inverse = DenseInverse(solver_, 0.0, 0.0);
    EXPECT_LT(LargestError(DenseOf(newest), inverse.bottomRightCorner(3, 3)), 1e-9);
  }
  void LookAtAll() {
    EXPECT_LT(LargestError(JointOfAll(solver_, {}), DenseInverse(solver_, 0.0, 0.0)), 1e-9);
  }
  int num_free() const { return num_free_; }

 private:
  static IncrementalOptions PathOptions() {
    IncrementalOptions options;
    options.batch_share = 2.0;
    return options;
  }

  IncrementalSolver solver_;
  FamilyHandle<LinearFamily> ties_;
  Random random_{5};
  std::vector<VariableId> ids_;
  int num_free_ = 0;
};

TEST(LiveCovariance, APoseAlongThePathFactorsNothing) {
  GrowingPath path;
  for (int step = 0; step < 60; ++step) {
    ASSERT_NO_FATAL_FAILURE(path.Grow()) << step;
    if (step > 1) {
      ASSERT_NO_FATAL_FAILURE(path.LookAtNewest()) << step;
      path.LookAtAll();
    }
  }
  EXPECT_GT(path.num_free(), 30);
}

// Its marginal goes along from pose to pose, and the factor follows when something else is asked.
TEST(LiveCovariance, TheNewestPoseTakesNoFactorBetweenLoops) {
  GrowingPath path;
  for (int step = 0; step < 90; ++step) {
    ASSERT_NO_FATAL_FAILURE(path.Grow()) << step;
    if (step > 1) {
      ASSERT_NO_FATAL_FAILURE(path.LookAtNewest()) << step;
    }
  }
  EXPECT_GT(path.num_free(), 50);
  path.LookAtAll();
}

TEST(LiveCovariance, BadRequestsAreNamed) {
  IncrementalBundle bundle(Fresh(), 10);
  LiveCovariance covariance;
  EXPECT_EQ(bundle.solver.MarginalCovariance(0, {}, &covariance).code,
            StatusCode::kInvalidArgument);
  bundle.Grow(4, 6, 3);
  EXPECT_EQ(bundle.solver.MarginalCovariance(0, {}, &covariance).code,
            StatusCode::kInvalidArgument);
  bundle.solver.Update();
  EXPECT_EQ(bundle.solver.MarginalCovariance(99, {}, &covariance).message,
            "variable 99 does not exist");
  EXPECT_EQ(bundle.solver.JointCovariance(0, 0, {}, &covariance).message,
            "variable 0 is asked for twice");
  LiveCovarianceOptions options;
  options.tolerance = 0.0;
  EXPECT_EQ(bundle.solver.MarginalCovariance(0, options, &covariance).message,
            "LiveCovarianceOptions::tolerance = 0 but must be > 0");
  options = {};
  options.max_iterations = 0;
  EXPECT_EQ(bundle.solver.MarginalCovariance(0, options, &covariance).message,
            "LiveCovarianceOptions::max_iterations = 0 but must be >= 1");
  // A landmark seen once.
  const VariableId lonely = bundle.AddLandmark({bundle.frames()[0]});
  bundle.Apply();
  bundle.solver.Update();
  for (const LiveCovarianceOptions& any : {LiveCovarianceOptions(), AsFactored(), Exact()}) {
    const Status status = bundle.solver.MarginalCovariance(lonely, any, &covariance);
    EXPECT_EQ(status.code, StatusCode::kSingular);
    EXPECT_NE(status.message.find("variable " + std::to_string(lonely)), std::string::npos);
  }
}

TEST(LiveCovariance, ConjugateGradientsHaveNoFactor) {
  IncrementalOptions options = Fresh();
  options.reduced_solver = ReducedSolverKind::kPcg;
  IncrementalBundle bundle(options, 11);
  bundle.Grow(4, 6, 3);
  bundle.solver.Update();
  LiveCovariance covariance;
  for (const LiveCovarianceOptions& options_of_factor : {AsFactored(), Exact()}) {
    EXPECT_EQ(bundle.solver.MarginalCovariance(0, options_of_factor, &covariance).code,
              StatusCode::kUnavailable);
  }
}

// The batch solver has ended the Update: S is formed and factored for it, and nothing else changes.
TEST(LiveCovariance, AfterABatchSolve) {
  IncrementalOptions options;
  options.function_tolerance = 1e-12;
  IncrementalBundle bundle(options, 12);
  bundle.Grow(8, 20, 3);
  const UpdateSummary summary = bundle.solver.Update();
  ASSERT_GT(summary.num_batch_iterations, 0);
  EXPECT_LT(LargestError(JointOfAll(bundle.solver, Exact()), DenseInverse(bundle.solver, 0.0, 0.0)),
            1e-9);
  bundle.Grow(1, 2, 3);
  const UpdateSummary next = bundle.solver.Update();
  EXPECT_EQ(next.termination, Termination::kConvergence);
  EXPECT_EQ(next.num_batch_iterations, 0);
}

// The batch solver leaves neither S nor a step: of what is not damped, and of frames and landmarks.
TEST(LiveCovariance, UndampedIsTheFirstThingAskedAfterABatchSolve) {
  IncrementalBundle bundle(IncrementalOptions(), 14);
  bundle.Grow(6, 16, 3);
  ASSERT_GT(bundle.solver.Update().num_batch_iterations, 0);
  const VariableId frame = bundle.frames()[2], landmark = bundle.landmarks()[3];
  LiveCovariance covariance;
  const Status status =
      bundle.solver.JointCovariance(frame, landmark, LiveCovarianceOptions(), &covariance);
  ASSERT_TRUE(status.ok()) << status.message;
  EXPECT_LT(covariance.staleness.largest_pending_step, 1e-3) << "the landmark's own";
  GraphCovariance expected;
  ASSERT_TRUE(expected.Compute(bundle.solver, {{frame, frame}}).ok());
  double block[36];
  ASSERT_TRUE(expected.Get(frame, frame, block));
  for (int k = 0; k < 6; ++k) {
    EXPECT_NEAR(covariance(k, k), block[7 * k], 1e-4 * block[7 * k]);
  }
}

// Same Updates to the last bit, whether or not covariances were asked for in between, and the same
// covariances for any number of threads.
TEST(LiveCovariance, ChangesNothing) {
  std::vector<double> values[3], variances[3];
  for (int run = 0; run < 3; ++run) {
    IncrementalOptions options;
    options.batch_share = 2.0;
    options.num_threads = run == 2 ? 4 : 1;
    IncrementalBundle bundle(options, 13);
    for (int step = 0; step < 6; ++step) {
      bundle.Grow(2, 6, 2);
      bundle.solver.Update();
      LiveCovariance covariance;
      for (const LiveCovarianceOptions& any : {LiveCovarianceOptions(), AsFactored(), Exact()}) {
        if (run > 0) {
          ASSERT_TRUE(
              bundle.solver
                  .JointCovariance(bundle.frames()[1], bundle.landmarks().back(), any, &covariance)
                  .ok());
          variances[run].insert(variances[run].end(), covariance.values.begin(),
                                covariance.values.end());
        }
      }
    }
    values[run] = bundle.Values();
  }
  EXPECT_EQ(values[0], values[1]);
  EXPECT_EQ(values[0], values[2]);
  EXPECT_EQ(variances[1], variances[2]);
}

}  // namespace
}  // namespace inceres::test
