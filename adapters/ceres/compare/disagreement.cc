#include <algorithm>
#include <sstream>
#include <vector>

#include <ceres/iteration_callback.h>

#include "adapters/ceres/compare/compare_solves.h"
#include "adapters/ceres/compare/second_opinion.h"
#include "src/base/formatted.h"

namespace inceres::internal {
namespace {

using Trace = std::vector<ceres::IterationSummary>;

constexpr int kRowsBefore = 10;
constexpr int kRowsAfter = 20;

std::string HalfRow(const Trace& trace, int k) {
  if (k >= static_cast<int>(trace.size())) {
    return std::string(46, ' ');
  }
  const ceres::IterationSummary& iteration = trace[static_cast<std::size_t>(k)];
  const char* mark = iteration.step_is_successful ? " " : iteration.step_is_valid ? "r" : "i";
  return Formatted("%19.12e %9.2e %9.2e %s    ", iteration.cost, iteration.step_norm,
                   iteration.trust_region_radius, mark);
}

std::string Traces(const CrossCheckResult& result) {
  const Trace& ours = result.ours.iterations;
  const Trace& stock = result.stock.iterations;
  const int rows = static_cast<int>(std::max(ours.size(), stock.size()));
  const int marked = result.first_different_iteration;
  const int begin = std::clamp(marked - kRowsBefore, 0, rows);
  const int end = std::min(rows, begin + kRowsBefore + kRowsAfter);
  std::ostringstream text;
  const std::string half = "               cost    |step|    radius      ";
  text << "  iter  ours " << half.substr(5) << "  stock " << half.substr(6)
       << "(r: rejected, i: invalid)\n";
  for (int k = begin; k < end; ++k) {
    text << Formatted("%c %4d ", k == marked ? '>' : ' ', k) << HalfRow(ours, k) << "  "
         << HalfRow(stock, k) << '\n';
  }
  if (begin > 0 || end < rows) {
    text << "  (of " << rows << " rows)\n";
  }
  return text.str();
}

void DescribeEnd(const char* who, const ceres::Solver::Summary& summary, double seconds,
                 std::ostringstream* text) {
  *text << "  " << who << ": " << summary.iterations.size() << " rows, final cost "
        << summary.final_cost << ", " << ceres::TerminationTypeToString(summary.termination_type)
        << ", " << 1e3 * seconds << " ms (" << summary.message << ")\n";
}

// Nothing if it was not measured.
void DescribeSpread(const CrossCheckResult& result, std::ostringstream* text) {
  if (!result.spread) {
    return;
  }
  const StockSpread& spread = *result.spread;
  *text << "  stock's own linear solvers (" << spread.linear_solvers << ") differ by "
        << spread.cost << " in the final cost, " << spread.parameter << " in a parameter, "
        << spread.iterations << " iterations";
  if (spread.first_different_iteration >= 0) {
    *text << ", from iteration " << spread.first_different_iteration << " on";
  }
  *text << '\n';
}

}  // namespace

std::string DescribeExcuse(const CrossCheckResult& result) {
  const bool by_memory = ExcusedByMemory(result);
  std::ostringstream text;
  text.precision(2);
  text << "inceres: cross-check: ours and stock Ceres differ, but "
       << (by_memory ? result.reason : "no more than stock's own linear solvers do") << '\n';
  for (const std::string& difference : result.within_spread) {
    text << "  " << difference << '\n';
  }
  if (!by_memory && !result.reason.empty()) {
    text << "  " << result.reason << '\n';
  }
  DescribeSpread(result, &text);
  return text.str();
}

std::string DescribeDisagreement(const CrossCheckResult& result) {
  std::ostringstream text;
  text << "inceres: cross-check: ours and stock Ceres disagree\n";
  for (const std::string& violation : result.violations) {
    text << "  " << violation << '\n';
  }
  if (result.first_different_iteration >= 0) {
    text << "  first iteration that differs: " << result.first_different_iteration << '\n';
  }
  text.precision(2);
  DescribeSpread(result, &text);
  const ParameterDifference& worst = result.parameters;
  text.precision(6);
  if (worst.block != nullptr) {
    text.precision(12);
    text << "  parameter that differs most: component " << worst.component << " of block "
         << worst.block << " of size " << worst.size << " (number " << worst.index
         << " of GetParameterBlocks): ours " << worst.ours << ", stock " << worst.stock
         << ", relative difference " << worst.relative << '\n';
  }
  DescribeEnd("ours", result.ours, result.our_seconds, &text);
  DescribeEnd("stock", result.stock, result.stock_seconds, &text);
  text << Traces(result);
  return text.str();
}

}  // namespace inceres::internal
