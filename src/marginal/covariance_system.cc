#include "marginal/covariance_system.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "linear/select_solver.h"
#include "linear/small_cholesky.h"

namespace inceres::internal {

CovarianceSystem::CovarianceSystem(const FactorGraph& graph, const std::vector<double>& state,
                                   int num_threads, double max_inflation)
    : graph_(graph),
      max_inflation_(max_inflation),
      executor_(num_threads),
      layout_(graph, /*eliminate_landmarks=*/true),
      evaluator_(graph, layout_, executor_),
      incidences_(evaluator_),
      plans_(evaluator_, incidences_),
      hessian_(evaluator_, incidences_, plans_),
      elimination_(evaluator_, incidences_, plans_, hessian_) {
  evaluator_.points().SetCurrent(state);
}

Status CovarianceSystem::NotDetermined(VariableId id, const char* why) const {
  return Status::Error(StatusCode::kSingular,
                       "variable " + std::to_string(id) + " has no covariance: " + why);
}

Status CovarianceSystem::Factorize() {
  double cost = 0.0;
  Status status = evaluator_.EvaluateJacobians(/*known_point=*/false, &cost);
  if (!status.ok()) {
    return status;
  }
  hessian_.Accumulate();
  status = CheckLandmarks();
  const std::vector<double> no_damping(static_cast<std::size_t>(layout_.size()), 0.0);
  if (status.ok()) {
    status = elimination_.Eliminate(no_damping.data());
  }
  if (!status.ok() || layout_.num_frames == 0) {
    return status;
  }
  solver_ =
      MakeReducedSolver(ReducedSolverKind::kAutomatic, nullptr, plans_.pattern, executor_, &status);
  if (status.ok()) {
    status =
        solver_->Factorize(ReducedMatrix(plans_.pattern, elimination_.S(), no_damping.data()), {});
  }
  if (status.code == StatusCode::kSingular) {
    return Status::Error(
        StatusCode::kSingular,
        "there is no covariance: the gauge is free, or a variable is not determined (" +
            status.message + ")");
  }
  return status.ok() ? CheckGauge() : status;
}

Status CovarianceSystem::CheckLandmarks() {
  const double no_damping[kQuad] = {};
  for (int l = 0; l < layout_.num_landmarks(); ++l) {
    const int size = incidences_.sizes[l];
    double U_inv[4 * kQuad] = {};
    bool determined = InvertCholeskyFactor(size, hessian_.P(l), no_damping, U_inv);
    for (int i = 0; determined && i < size; ++i) {
      double variance = 0.0;
      for (int k = i; k < size; ++k) {
        variance += U_inv[k * kQuad + i] * U_inv[k * kQuad + i];
      }
      determined = variance * hessian_.P(l)[i * kQuad + i] <= max_inflation_;
    }
    if (!determined) {
      return NotDetermined(layout_.variables[layout_.num_frames + l],
                           "the landmark is not determined by its factors");
    }
  }
  return Status::Ok();
}

Eigen::VectorXd CovarianceSystem::DiagonalOfS() const {
  const BlockPattern& pattern = plans_.pattern;
  Eigen::VectorXd diagonal(pattern.size());
  for (int row = 0; row < pattern.num_blocks(); ++row) {
    const double* block = elimination_.S() + pattern.value_begin[pattern.row_begin[row + 1] - 1];
    for (int i = 0; i < pattern.block_size(row); ++i) {
      diagonal[pattern.offsets[row] + i] = block[i * pattern.block_size(row) + i];
    }
  }
  return diagonal;
}

// A Cholesky factor of a singular matrix often exists, thanks to rounding. Then a right-hand side
// with a share along the null space has a huge solution: one of mixed signs, in units of the
// diagonal, has such a share.
Status CovarianceSystem::CheckGauge() {
  const Eigen::VectorXd scale = DiagonalOfS().cwiseSqrt();
  Eigen::MatrixXd probe = scale;
  std::uint32_t bits = 1;
  for (Eigen::Index i = 0; i < probe.size(); ++i) {
    bits = bits * 1664525u + 1013904223u;
    probe(i) *= (bits >> 31) != 0 ? 1.0 : -1.0;
  }
  Eigen::MatrixXd solution;
  const Status status = Solve(probe, &solution);
  if (!status.ok()) {
    return status;
  }
  Eigen::Index largest = 0;
  const double inflation = (scale.array() * solution.col(0).array()).abs().maxCoeff(&largest);
  if (inflation <= max_inflation_) {
    return Status::Ok();
  }
  const auto after = std::upper_bound(plans_.pattern.offsets.begin(), plans_.pattern.offsets.end(),
                                      static_cast<int>(largest));
  return NotDetermined(layout_.variables[after - plans_.pattern.offsets.begin() - 1],
                       "the gauge is free, or what determines it is lost to rounding");
}

Status CovarianceSystem::Solve(const Eigen::MatrixXd& right, Eigen::MatrixXd* left) {
  left->resize(right.rows(), right.cols());
  Status status;
  for (Eigen::Index c = 0; status.ok() && solver_ != nullptr && c < right.cols(); ++c) {
    status = solver_->Solve(right.col(c).data(), {}, {}, left->col(c).data());
  }
  return status.ok() && !left->allFinite()
             ? Status::Error(StatusCode::kSingular,
                             "there is no covariance: a solution is not finite")
             : status;
}

// V −= W P⁻¹ of the landmarks prepared, W = Σ J_cᵀ J_l, in one pass over the factors.
void CovarianceSystem::SubtractW() {
  for (const Linearization& cache : evaluator_.families()) {
    const int num_slots = cache.num_slots;
    const int rows = cache.residual_size;
    for (int i = 0; i < cache.num_factors; ++i) {
      const VariableId* ids = graph_.Variables(cache.id, i);
      const VariableId* landmark = std::find_if(ids, ids + num_slots, [this](VariableId id) {
        return layout_.LandmarkOf(id) >= 0 && columns_.count(id) > 0 &&
               columns_.at(id).X.size() == 0;
      });
      if (landmark == ids + num_slots) {
        continue;
      }
      using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
      const auto jacobian = [&](std::ptrdiff_t s) {
        const SlotJacobians& slot = cache.slots[s];
        return Eigen::Map<const RowMajor, 0, Eigen::OuterStride<>>(
            slot.data + i * slot.factor_stride, rows, slot.columns,
            Eigen::OuterStride<>(slot.row_stride));
      };
      Column& column = columns_.at(*landmark);
      const Eigen::MatrixXd J_l = jacobian(landmark - ids) * column.P_inv;
      for (int s = 0; s < num_slots; ++s) {
        const int frame = layout_.FrameOf(ids[s]);
        if (frame >= 0) {
          column.V.middleRows(layout_.packed_offset[frame], layout_.TangentSize(frame)) -=
              jacobian(s).transpose() * J_l;
        }
      }
    }
  }
}

Status CovarianceSystem::Prepare(const std::vector<VariableId>& ids) {
  for (const VariableId id : ids) {
    Column& column = columns_[id];
    const int size = graph_.TangentSize(id);
    column.V.setZero(layout_.frame_size(), size);
    const int landmark = layout_.LandmarkOf(id);
    if (landmark < 0) {
      column.V.middleRows(layout_.packed_offset[layout_.FrameOf(id)], size).setIdentity();
      continue;
    }
    double U_inv[4 * kQuad] = {};
    const double no_damping[kQuad] = {};
    InvertCholeskyFactor(size, hessian_.P(landmark), no_damping,
                         U_inv);  // as CheckLandmarks has tried
    const Eigen::Map<const Eigen::Matrix<double, 4, kQuad, Eigen::RowMajor>> U(U_inv);
    column.P_inv = U.topLeftCorner(size, size).transpose() * U.topLeftCorner(size, size);
  }
  SubtractW();
  const Eigen::VectorXd diagonal = layout_.num_frames > 0 ? DiagonalOfS() : Eigen::VectorXd();
  for (const VariableId id : ids) {
    Column& column = columns_.at(id);
    const Status status = Solve(column.V, &column.X);
    if (!status.ok()) {
      return status;
    }
    const int frame = layout_.FrameOf(id);
    for (int k = 0; frame >= 0 && k < graph_.TangentSize(id); ++k) {
      const int row = layout_.packed_offset[frame] + k;
      if (!(column.X(row, k) * diagonal[row] <= max_inflation_)) {
        return NotDetermined(id, "what determines it is lost to rounding");
      }
    }
  }
  return Status::Ok();
}

Eigen::MatrixXd CovarianceSystem::Product(VariableId a, VariableId b) const {
  const Column& left = columns_.at(a);
  const Column& right = columns_.at(b);
  Eigen::MatrixXd covariance = left.V.transpose() * right.X;
  if (a == b && left.P_inv.size() > 0) {
    covariance += left.P_inv;
  }
  return covariance;
}

}  // namespace inceres::internal
