// A window that slides over a living ceres::Problem, solved by a session and by stock Ceres in
// lockstep.
#include <algorithm>
#include <cmath>
#include <memory>

#include <gtest/gtest.h>

#include "adapters/incremental_window.h"
#include "adapters/session_support.h"
#include "inceres/ceres/session.h"

namespace inceres {
namespace {

using testing::IncrementalWindow;

enum class Landmarks { kChosen, kGiven };

ceres::Solver::Options Options(double function_tolerance) {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.function_tolerance = function_tolerance;
  options.max_num_iterations = 100;
  options.logging_type = ceres::SILENT;
  return options;
}

class SessionWindow : public ::testing::TestWithParam<Landmarks> {
 protected:
  // Solves both windows from the same values and compares. The reference goes to its minimum; the
  // session may stop function_tolerance above it.
  void SolveBoth(const std::string& where) {
    constexpr double kTolerance = 1e-6;
    stock_.SetValues(ours_.Values());
    const double cost_before = ours_.Cost();
    SolveOptions strict;
    strict.strict = true;
    ceres::Solver::Summary ours;
    session_.Solve(Adjusted(Options(kTolerance), ours_), ours_.problem(), &ours, strict, &report_);
    ASSERT_TRUE(ours.IsSolutionUsable()) << where << ": " << ours.message;
    ceres::Solver::Options tight = Adjusted(Options(1e-14), stock_);
    tight.gradient_tolerance = tight.parameter_tolerance = 1e-14;
    ceres::Solver::Summary stock;
    ceres::Solve(tight, stock_.problem(), &stock);
    ASSERT_TRUE(stock.IsSolutionUsable()) << where << ": " << stock.message;
    EXPECT_NEAR(ours.initial_cost, cost_before, 1e-9 * cost_before) << where;
    EXPECT_NEAR(ours.final_cost, ours_.Cost(), 1e-9 * ours_.Cost())
        << where << ": the cost reported is that of what was written";
    EXPECT_LE(std::fabs(ours_.Cost() - stock_.Cost()), kTolerance * stock_.Cost()) << where;
    relinearized_ += report_.update.num_relinearized_factors;
  }

  template <typename Change>
  void Both(Change change) {
    change(&ours_);
    change(&stock_);
  }

  // The same solve by a session that remembers nothing, on a third copy.
  void SolveFromScratch(IncrementalWindow* window) {
    CeresSession fresh{inceres::testing::AlwaysIncremental()};
    SolveReport report;
    ceres::Solver::Summary summary;
    fresh.Solve(Adjusted(Options(1e-6), *window), window->problem(), &summary, {}, &report);
    relinearized_from_scratch_ += report.update.num_relinearized_factors;
  }

  ceres::Solver::Options Adjusted(ceres::Solver::Options options,
                                  const IncrementalWindow& window) const {
    if (GetParam() == Landmarks::kGiven) {
      options.linear_solver_ordering.reset(window.LandmarksFirst());
    }
    return options;
  }

  IncrementalWindow ours_;
  IncrementalWindow stock_;
  CeresSession session_{inceres::testing::AlwaysIncremental()};
  SolveReport report_;
  long relinearized_ = 0;
  long relinearized_from_scratch_ = 0;
};

TEST_P(SessionWindow, EndsWhereStockDoesWithLessWork) {
  IncrementalWindow third;
  const auto all = [&](auto change) {
    Both(change);
    change(&third);
  };
  all([](IncrementalWindow* window) { window->Step(); });
  for (int step = 1; step < 40; ++step) {
    all([](IncrementalWindow* window) { window->Step(); });
    const std::string where = "step " + std::to_string(step);
    SolveBoth(where);
    if (step > 2 * IncrementalWindow::kMaxFrames) {
      EXPECT_GT(report_.changes.num_revalued_variables, 0)
          << where << ": the memory of the oldest frame, used again";
      EXPECT_GT(report_.changes.num_added_factors, 0) << where;
      EXPECT_GT(report_.changes.num_removed_factors, 0) << where;
      EXPECT_GT(report_.changes.num_kept_factors, 2 * report_.changes.num_added_factors) << where;
      EXPECT_LT(report_.changes.num_replaced_factors, report_.changes.num_kept_factors / 10)
          << where;
    }
    SolveFromScratch(&third);
  }
  EXPECT_LT(10 * relinearized_, 7 * relinearized_from_scratch_);
}

TEST_P(SessionWindow, ConstantsComeAndGo) {
  Both([](IncrementalWindow* window) { window->Step(); });
  for (int step = 1; step < 25; ++step) {
    const std::string where = "step " + std::to_string(step);
    Both([](IncrementalWindow* window) { window->Step(), window->SetFrozen(true); });
    SolveBoth(where + ", frozen");
    if (step > 3) {
      EXPECT_GT(report_.changes.num_toggled_constants, 5) << where;
      EXPECT_EQ(report_.num_landmarks, 0) << where;
    }
    Both([](IncrementalWindow* window) { window->SetFrozen(false); });
    SolveBoth(where);
    if (step > 3) {
      EXPECT_EQ(report_.num_landmarks, ours_.num_landmarks()) << where;
    }
  }
}

TEST_P(SessionWindow, ValuesSetByHandAreTakenUp) {
  Both([](IncrementalWindow* window) { window->Step(); });
  for (int step = 1; step < 25; ++step) {
    Both([](IncrementalWindow* window) { window->Step(); });
    SolveBoth("step " + std::to_string(step));
    Both([](IncrementalWindow* window) { window->Nudge(0.02); });
    SolveBoth("step " + std::to_string(step) + ", nudged");
    EXPECT_EQ(report_.changes.num_revalued_variables, 2);
    EXPECT_EQ(report_.changes.num_added_factors + report_.changes.num_removed_factors, 0);
  }
}

TEST_P(SessionWindow, NothingChangedCostsNothing) {
  for (int step = 0; step < 12; ++step) {
    Both([](IncrementalWindow* window) { window->Step(); });
  }
  SolveBoth("first");
  EXPECT_EQ(report_.changes.num_added_factors, ours_.problem()->NumResidualBlocks());
  const std::vector<double> before = ours_.Values();
  SolveBoth("again");
  EXPECT_EQ(report_.changes.num_kept_factors, ours_.problem()->NumResidualBlocks());
  EXPECT_EQ(report_.changes.num_added_factors + report_.changes.num_removed_factors +
                report_.changes.num_replaced_factors,
            0);
  EXPECT_EQ(report_.changes.num_added_variables + report_.changes.num_removed_variables, 0);
  EXPECT_EQ(report_.changes.num_revalued_variables + report_.changes.num_toggled_constants, 0);
  EXPECT_EQ(report_.update.num_relinearized_factors, 0);
  EXPECT_EQ(ours_.Values(), before);
}

INSTANTIATE_TEST_SUITE_P(Landmarks, SessionWindow,
                         ::testing::Values(Landmarks::kChosen, Landmarks::kGiven),
                         [](const auto& instance) {
                           return instance.param == Landmarks::kChosen ? "Chosen" : "Given";
                         });

}  // namespace
}  // namespace inceres
