// What an Update tells while it works and afterwards: the table of progress, the callback of the
// options, the reports.
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "incremental/incremental_bundle.h"

namespace inceres {
namespace {

using test::IncrementalBundle;

bool Contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

// By the batch solver and by the incremental one.
std::vector<IncrementalOptions> BothWays() {
  IncrementalOptions batch;
  IncrementalOptions incremental;
  incremental.batch_share = 1.0;
  return {batch, incremental};
}

TEST(UpdateProgress, IsATableWithARowAnIteration) {
  for (IncrementalOptions options : BothWays()) {
    std::vector<std::string> lines;
    options.progress = [&lines](const std::string& line) { lines.push_back(line); };
    IncrementalBundle bundle(options);
    for (int update = 0; update < 2; ++update) {
      bundle.Grow(4, 20, 3);
      lines.clear();
      const UpdateSummary summary = bundle.solver.Update();
      ASSERT_EQ(lines.size(), summary.iterations.size() + 1) << "a heading an Update";
      EXPECT_EQ(lines[0], UpdateProgressHeading());
      for (std::size_t k = 0; k < summary.iterations.size(); ++k) {
        EXPECT_EQ(lines[k + 1], ProgressRow(summary.iterations[k]));
      }
      EXPECT_GT(summary.iterations[0].gradient_max_norm, 0.0) << "of who looks on";
    }
  }
}

TEST(UpdateProgress, RowsAreAsWideAsTheHeading) {
  UpdateIteration row;
  row.step = UpdateStep::kLandmarks;
  row.cost_change = -1.0;
  EXPECT_EQ(ProgressRow(row).size(), UpdateProgressHeading().size())
      << UpdateProgressHeading() << "\n"
      << ProgressRow(row);
  EXPECT_TRUE(Contains(ProgressRow(row), "landmarks-"));
  row.step_is_successful = true;
  EXPECT_TRUE(Contains(ProgressRow(row), "landmarks "));
}

TEST(UpdateProgress, WhatIsThrownPassesThroughAndValuesAreThoseOfBefore) {
  for (IncrementalOptions options : BothWays()) {
    bool throws = false;
    options.callback = [&throws](const UpdateIteration& iteration) {
      if (throws && iteration.iteration == 1) {
        throw std::runtime_error("enough");
      }
      return ObserverAction::kContinue;
    };
    IncrementalBundle bundle(options);
    bundle.Grow(6, 30, 3);
    bundle.solver.Update();
    bundle.Grow(2, 10, 3);
    const std::vector<double> start = bundle.Values();
    const double cost = bundle.solver.cost();
    throws = true;
    EXPECT_THROW(bundle.solver.Update(), std::runtime_error);
    EXPECT_EQ(bundle.Values(), start);
    EXPECT_EQ(bundle.solver.cost(), cost);
    throws = false;
    bundle.Grow(1, 5, 3);
    const UpdateSummary summary = bundle.solver.Update();
    EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
    EXPECT_NEAR(summary.final_cost, bundle.FreshMinimum(IncrementalOptions()),
                1e-5 * summary.final_cost);
  }
}

TEST(UpdateReport, BriefIsALineAndFullAPage) {
  IncrementalBundle bundle((IncrementalOptions()));
  bundle.Grow(6, 30, 3);
  const UpdateSummary summary = bundle.solver.Update();
  const std::string brief = summary.BriefReport();
  EXPECT_FALSE(Contains(brief, "\n"));
  EXPECT_TRUE(Contains(brief, "Iterations: " + std::to_string(summary.num_iterations) + " ("));
  EXPECT_TRUE(Contains(brief, "Termination: CONVERGENCE")) << brief;
  std::ostringstream stream;
  stream << summary;
  EXPECT_EQ(stream.str(), brief);
  const std::string full = summary.FullReport();
  for (const char* part : {"Update Summary", "Cost:\n", "Left undone", "Relinearized factors",
                           "Time (in seconds):\n", "Batch solver", "Total"}) {
    EXPECT_TRUE(Contains(full, part)) << part << " is not in\n" << full;
  }
  EXPECT_TRUE(Contains(full, "(" + summary.message + ")\n"));
}

}  // namespace
}  // namespace inceres
