#pragma once

#include <string>

#include "inceres/io/bal.h"
#include "tools/solve/solve_record.h"

namespace inceres::tools {

/// What a page is about: one solve of a BAL problem.
struct BalPageContent {
  std::string title;
  std::string solver;  ///< who solved, in words
  std::string robust;  ///< the loss, as ToString(LossSpec) has it
  int num_threads = 1;
  const BalProblem* before = nullptr;
  const BalProblem* after = nullptr;
  const SolveRecord* record = nullptr;
};

/// A solve as a page to show to a colleague: cameras and points before and after, from above and
/// from the side; the cost over the iterations; a histogram of the reprojection errors before and
/// after; the figures. One HTML document with its style and pictures inside, no script, nothing
/// fetched, for light and dark screens and for phones. Of more than 8,000 points or 1,000 cameras
/// every so many-th is drawn, which the page says: at most 2 MB. Figures are <span data-value>,
/// with the keys of bal_solve's JSON as ids. `before` and `after` have the same sizes and both
/// Validate(), with observations.
std::string BalPageHtml(const BalPageContent& content);

}  // namespace inceres::tools
