// One step from each state that stock Ceres visits, by several configurations of stock Ceres and by
// us, from the same bytes.
//
// Where a whole solve amplifies rounding until stock Ceres no longer agrees with itself, single
// steps still tell a wrong solver from one that rounds differently. The yardstick is stock's
// SPARSE_NORMAL_CHOLESKY: on Ladybug-49 its steps are ten times closer to the exact solution of the
// linear system than those of stock's Schur solvers, which share their elimination and so look
// closer to each other than they are to the truth.
#include <algorithm>
#include <cmath>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "integration/problems.h"
#include "integration/runs.h"
#include "support/ceres_lambdas.h"
#include "support/test_data.h"

namespace inceres::test {
namespace {

constexpr double kBar = 1e-9;
// Where stock Ceres differs from itself by more, in the Gauss-Newton step of Dog-Leg, which is
// hardly damped, and along the gauge.
constexpr double kTimesStock = 10.0;
constexpr double kDoglegCap = 2e-5;
// A damped system on which stock's configurations differ by more than this is singular up to
// rounding: at radii above 1e10.
constexpr double kStockHasNoAnswer = 1e-6;
constexpr Configuration kYardstick{ceres::SPARSE_NORMAL_CHOLESKY};

// A solve by stock Ceres, from some of whose states steps are taken.
struct Walk {
  std::string name;
  Factory make;
  ceres::TrustRegionStrategyType strategy;
  tools::LossSpec loss;
  // of stock Ceres, next to the yardstick; ours gets the options of the first
  std::vector<Configuration> others;
  int num_iterations;
  int all_up_to;  // the states: these, and from there on every sixth
  int least_states;
  std::string data = {};  // of the public data sets, if it needs one
};

void PrintTo(const Walk& walk, std::ostream* stream) {
  *stream << walk.name << (walk.strategy == ceres::DOGLEG ? "_Dogleg" : "_Lm")
          << (walk.loss.kind == tools::LossSpec::Kind::kNone ? "_Squared" : "_Huber");
}

// What a solve was about to step from.
struct State {
  std::vector<double> x;
  double radius;
};

// The first step from a state. Who takes one that changes no digit of the cost, as the last ones
// may, tells nothing else of it.
struct Step {
  double cost;  // after the step, accepted or not
  bool is_told;
  double length;
  double model_decrease;
};

// Empty if the linear system could not be factored.
std::optional<Step> TakeStep(Who who, const Configuration& configuration,
                             ceres::TrustRegionStrategyType strategy, const State& state,
                             Instance* instance) {
  instance->x = state.x;
  ceres::Solver::Options options = ZeroToleranceOptions(strategy, 1);
  options.initial_trust_region_radius = state.radius;
  const ceres::Solver::Summary summary = Solve(who, configuration, options, instance);
  if (summary.iterations.size() ==
      1) {  // a step that changes no digit of the cost ends a solve without tolerances
    EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE) << summary.message;
    return Step{summary.initial_cost, false, 0.0, 0.0};
  }
  if (summary.iterations.size() != 2 || !summary.iterations[1].step_is_valid) {
    return std::nullopt;
  }
  const ceres::IterationSummary& step = summary.iterations[1];
  return Step{step.cost, true, step.step_norm, step.cost_change / step.relative_decrease};
}

double Norm(const std::vector<double>& x) {
  double sum = 0.0;
  for (const double entry : x) {
    sum += entry * entry;
  }
  return std::sqrt(sum);
}

// Largest differences: of the cost after the step and of the decrease the model promised relative
// to the cost, of the step's length relative to that of the state.
struct Difference {
  double cost = 0.0;
  double model_decrease = 0.0;
  double length = 0.0;

  void Include(const Step& a, const Step& b, const State& state) {
    cost = std::max(cost, RelativeDifference(a.cost, b.cost));
    if (!a.is_told || !b.is_told) {
      return;
    }
    model_decrease =
        std::max(model_decrease, std::abs(a.model_decrease - b.model_decrease) / a.cost);
    length = std::max(length, std::abs(a.length - b.length) / Norm(state.x));
  }
};

class LockstepParity : public ::testing::TestWithParam<Walk> {
 protected:
  void SetUp() override {
    if (!GetParam().data.empty() && FindData(GetParam().data).empty()) {
      GTEST_SKIP() << MissingData(GetParam().data);
    }
    instance_ = GetParam().make(GetParam().loss);
    ASSERT_NE(instance_, nullptr);
  }

  // The states of the walk among those that stock Ceres visits.
  std::vector<State> Visit() {
    const Walk& walk = GetParam();
    std::vector<State> seen;
    lambdas::Callback recorder([&](const ceres::IterationSummary& iteration) {
      seen.push_back({instance_->x, iteration.trust_region_radius});
      return ceres::SOLVER_CONTINUE;
    });
    ceres::Solver::Options options = ZeroToleranceOptions(walk.strategy, walk.num_iterations);
    options.update_state_every_iteration = true;
    options.callbacks.push_back(&recorder);
    Solve(Who::kStock, walk.others.front(), options, instance_.get());
    std::vector<State> states;
    for (int k = 0; k < static_cast<int>(seen.size()); ++k) {
      if (k < walk.all_up_to || (k - walk.all_up_to) % 6 == 5) {
        states.push_back(std::move(seen[static_cast<std::size_t>(k)]));
      }
    }
    return states;
  }

  // One step of each from a state, ours included. False if stock Ceres has no answer to compare
  // with: a configuration could not factor the linear system, or the damping of Levenberg-Marquardt
  // is lost in rounding.
  bool Compare(const State& state) {
    const Walk& walk = GetParam();
    const std::optional<Step> yardstick =
        TakeStep(Who::kStock, kYardstick, walk.strategy, state, instance_.get());
    Difference spread = stock_;
    for (const Configuration& other : walk.others) {
      const std::optional<Step> step =
          TakeStep(Who::kStock, other, walk.strategy, state, instance_.get());
      if (!yardstick.has_value() || !step.has_value() ||
          (walk.strategy != ceres::DOGLEG &&
           RelativeDifference(yardstick->cost, step->cost) > kStockHasNoAnswer)) {
        return false;
      }
      spread.Include(*yardstick, *step, state);
    }
    stock_ = spread;
    const std::optional<Step> our_step =
        TakeStep(Who::kInceres, walk.others.front(), walk.strategy, state, instance_.get());
    EXPECT_TRUE(our_step.has_value()) << "every configuration of stock Ceres has a step here";
    if (our_step.has_value()) {
      ours_.Include(*yardstick, *our_step, state);
    }
    return true;
  }

  std::unique_ptr<Instance> instance_;
  Difference stock_;  // the other configurations against the yardstick
  Difference ours_;   // ours against the yardstick
};

TEST_P(LockstepParity, StepsLikeStock) {
  int num_compared = 0;
  for (const State& state : Visit()) {
    num_compared += Compare(state);
  }
  RecordProperty("states", num_compared);
  RecordProperty("stock_cost_difference", Printed(stock_.cost));
  RecordProperty("cost_difference", Printed(ours_.cost));
  ASSERT_GE(num_compared, GetParam().least_states);
  const auto relative_to_stock = [](double spread) { return std::max(kBar, kTimesStock * spread); };
  const bool dogleg = GetParam().strategy == ceres::DOGLEG;
  EXPECT_LE(ours_.cost, dogleg ? std::min(relative_to_stock(stock_.cost), kDoglegCap) : kBar);
  EXPECT_LE(ours_.model_decrease, dogleg ? relative_to_stock(stock_.model_decrease) : kBar);
  EXPECT_LE(ours_.length, relative_to_stock(stock_.length));
}

const char kLadybug[] = "bal/problem-49-7776-pre.txt";
const char kSphere[] = "pose_graph/sphere.g2o";

Factory LadybugFactory(tools::BalCameraModel model) {
  return [model](const tools::LossSpec& loss) {
    BalProblem bal;
    const Status read = ReadBal(FindData(kLadybug), &bal);
    EXPECT_TRUE(read.ok()) << read.message;
    return MakeBal(bal, model, Gauge::kFree, loss);
  };
}

Factory BundledStreetFactory(tools::BalCameraModel model) {
  return [model](const tools::LossSpec& loss) {
    return MakeBal(BundledBal("street-16-1200-pre.txt"), model, Gauge::kFree, loss);
  };
}

std::vector<Walk> Walks() {
  const Configuration dense_schur{ceres::DENSE_SCHUR, true};
  const Configuration sparse_schur{ceres::SPARSE_SCHUR, true};
  const Configuration automatic_sparse_schur{ceres::SPARSE_SCHUR};
  std::vector<Walk> walks;
  for (const bool quaternion : {false, true}) {
    const auto model =
        quaternion ? tools::BalCameraModel::kQuaternion : tools::BalCameraModel::kAngleAxis;
    const std::string suffix = quaternion ? "_Quaternion" : "_AngleAxis";
    for (const auto strategy : {ceres::LEVENBERG_MARQUARDT, ceres::DOGLEG}) {
      for (const tools::LossSpec& loss : {tools::LossSpec(), Huber(1.0)}) {
        walks.push_back({"Ladybug49" + suffix,
                         LadybugFactory(model),
                         strategy,
                         loss,
                         {dense_schur, sparse_schur},
                         32,
                         8,
                         9,
                         kLadybug});
        walks.push_back({"BundledStreet" + suffix,
                         BundledStreetFactory(model),
                         strategy,
                         loss,
                         {dense_schur, automatic_sparse_schur},
                         20,
                         20,
                         15});
      }
    }
  }
  // From the start of the file stock Ceres differs from itself too much to compare whole solves.
  const Factory sphere = [](const tools::LossSpec& loss) {
    return MakePoseGraph(FindData(kSphere), loss);
  };
  walks.push_back(
      {"Sphere", sphere, ceres::DOGLEG, {}, {automatic_sparse_schur}, 4, 4, 4, kSphere});
  return walks;
}

INSTANTIATE_TEST_SUITE_P(Exact, LockstepParity, ::testing::ValuesIn(Walks()),
                         ::testing::PrintToStringParamName());

}  // namespace
}  // namespace inceres::test
