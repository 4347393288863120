#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <vector>

#include <Eigen/Core>

#include "base/executor.h"
#include "linearize/evaluator.h"
#include "linearize/hessian.h"
#include "linearize/incidences.h"
#include "linearize/layout.h"
#include "linearize/product_plan.h"

namespace inceres::test {

/// The parts of the core up to H, put together for one graph as the solver does it, with the
/// Jacobians evaluated.
struct CorePipeline {
  explicit CorePipeline(const FactorGraph& graph, bool eliminate_landmarks = true,
                        int num_threads = 1,
                        std::int64_t quads_per_chunk = internal::LandmarkIncidences::kQuadsPerChunk,
                        internal::JacobianStorage storage = internal::JacobianStorage::kBySlot)
      : executor(num_threads),
        layout(graph, eliminate_landmarks),
        evaluator(graph, layout, executor, storage),
        incidences(evaluator, quads_per_chunk),
        plans(evaluator, incidences),
        hessian(evaluator, incidences, plans) {
    status = evaluator.EvaluateJacobians(/*known_point=*/false, &cost);
    hessian.Accumulate();
  }

  internal::Executor executor;
  internal::Layout layout;
  internal::Evaluator evaluator;
  internal::LandmarkIncidences incidences;
  internal::FramePlans plans;
  internal::Hessian hessian;
  Status status;
  double cost = 0.0;
};

/// C in the pattern of the frame system, with the zeros that are not stored.
inline std::vector<double> FrameHessian(const CorePipeline& core) {
  const BlockPattern& pattern = core.plans.pattern;
  std::vector<double> values(static_cast<std::size_t>(pattern.value_begin.back()), 0.0);
  for (std::size_t k = 0; k < pattern.columns.size(); ++k) {
    if (const double* block = core.hessian.FrameBlock(static_cast<int>(k))) {
      std::copy(block, block + (pattern.value_begin[k + 1] - pattern.value_begin[k]),
                values.begin() + pattern.value_begin[k]);
    }
  }
  return values;
}

/// The symmetric matrix that `values` hold in a pattern.
inline Eigen::MatrixXd ToDense(const BlockPattern& pattern, const double* values) {
  using Block =
      Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>;
  Eigen::MatrixXd dense = Eigen::MatrixXd::Zero(pattern.size(), pattern.size());
  for (int row = 0; row < pattern.num_blocks(); ++row) {
    const auto r = static_cast<std::size_t>(row);
    for (int k = pattern.row_begin[r]; k < pattern.row_begin[r + 1]; ++k) {
      const auto c = static_cast<std::size_t>(pattern.columns[static_cast<std::size_t>(k)]);
      const Block block(values + pattern.value_begin[static_cast<std::size_t>(k)],
                        pattern.block_size(row), pattern.block_size(static_cast<int>(c)));
      dense.block(pattern.offsets[r], pattern.offsets[c], block.rows(), block.cols()) = block;
      dense.block(pattern.offsets[c], pattern.offsets[r], block.cols(), block.rows()) =
          block.transpose();
    }
  }
  return dense;
}

}  // namespace inceres::test
