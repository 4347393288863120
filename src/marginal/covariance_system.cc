#include "marginal/covariance_system.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "linear/small_cholesky.h"
#include "marginal/null_space.h"

namespace inceres::internal {

// Covariances in three steps (docs/algorithms.md, "Covariance"): the undamped system is factored,
// and refused if it leaves anything open; what pairs need of S⁻¹ is found, entry by entry or by
// solves, whichever is cheaper; and a block is put together from it,
//     cov(a, b) = V_aᵀ S⁻¹ V_b + [a = b is a landmark] P_b⁻¹.
//
// What is delicate is rank. A pivot says little: rounding makes singular matrices definite. So
// three tests ask by how much a variance exceeds the one with all else known: of each landmark for
// known frames, of a probe of the whole gauge, and of each variable that is asked for. A NaN fails
// all of them.

namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// A share of a direction worth naming, and how many of them.
constexpr double kShare = 0.01;
constexpr int kMostShares = 8;
constexpr int kMostDirections = 32;

}  // namespace

CovarianceSystem::CovarianceSystem(const FactorGraph& graph, const std::vector<double>& state,
                                   const CovarianceOptions& options)
    // graph, options and state are the caller's: nothing of them is copied but the values.
    : graph_(graph),
      options_(options),
      executor_(options.num_threads),
      layout_(graph, /*eliminate_landmarks=*/true),
      evaluator_(graph, layout_, executor_),
      incidences_(evaluator_),
      plans_(evaluator_, incidences_),
      hessian_(evaluator_, incidences_, plans_),
      elimination_(evaluator_, incidences_, plans_, hessian_),
      factor_(executor_) {
  evaluator_.points().SetCurrent(state);
}

// The message names one variable and counts directions; who is in them is in deficiency_.
Status CovarianceSystem::NotDetermined(VariableId id, const char* why) {
  FindDirections();
  std::string found = deficiency_.CountDirections();
  if (!found.empty()) {
    found.insert(0, "; ");
  }
  return Status::Error(StatusCode::kSingular,
                       "variable " + std::to_string(id) + " has no covariance: " + why + found);
}

// Once, and only after a failure: it costs a factorization and many solves.
void CovarianceSystem::FindDirections() {
  // by rows S is not formed
  if (diagonal_.size() == 0 || !deficiency_.directions.empty() || by_rows_ != nullptr) {
    return;
  }
  const Eigen::MatrixXd directions =
      FindNullSpace(plans_.pattern, elimination_.S(), diagonal_, 1.0 / options_.max_inflation,
                    // One more than are told, to know whether there are more.
                    kMostDirections + 1, executor_);
  deficiency_.has_more = directions.cols() > kMostDirections;
  for (Eigen::Index c = 0; c < std::min<Eigen::Index>(directions.cols(), kMostDirections); ++c) {
    std::vector<std::pair<VariableId, double>> shares;
    shares.reserve(static_cast<std::size_t>(layout_.num_frames));
    for (int frame = 0; frame < layout_.num_frames; ++frame) {
      // In units of the diagonal of S the direction has length one: shares of all frames add up to
      // one.
      shares.emplace_back(layout_.variables[frame],
                          directions.col(c)
                              .segment(layout_.packed_offset[frame], layout_.TangentSize(frame))
                              .squaredNorm());
    }
    const auto end = std::remove_if(shares.begin(), shares.end(),
                                    [](const auto& share) { return share.second < kShare; });
    shares.erase(end, shares.end());
    // Equal shares stay in the order of the frames.
    std::stable_sort(shares.begin(), shares.end(),
                     [](const auto& a, const auto& b) { return a.second > b.second; });
    shares.resize(std::min<std::size_t>(shares.size(), kMostShares));
    deficiency_.directions.push_back({std::move(shares)});
  }
}

// Landmarks are tested before they are eliminated: one that is open would spoil S, and be blamed on
// a frame.
Status CovarianceSystem::Factorize() {
  double cost = 0.0;
  // Nothing was evaluated at this state before.
  Status status = evaluator_.EvaluateJacobians(/*known_point=*/false, &cost);
  if (!status.ok()) {
    return status;
  }
  // The same from here on without S, in covariance_by_rows.cc.
  if (options_.algorithm == CovarianceAlgorithm::kQr) {
    return FactorizeRows();
  }
  hessian_.Accumulate();
  status = CheckLandmarks();
  // A vector of zeros, since damping is an argument of the elimination and of the factorization.
  const std::vector<double> no_damping(static_cast<std::size_t>(layout_.size()), 0.0);
  if (status.ok()) {
    status = elimination_.Eliminate(no_damping.data());
  }
  if (!status.ok() || layout_.num_frames == 0) {
    return status;
  }
  // Before the factorization: if that fails, directions are looked for in units of it.
  diagonal_ = DiagonalOfS();
  const ReducedMatrix S(plans_.pattern, elimination_.S(), no_damping.data());
  status = factor_.Analyze(S);
  if (status.ok()) {
    status = factor_.Factorize(S, {});
  }
  // A pivot that is not positive: the same as a gauge that the probe finds free, only plainer.
  if (status.code == StatusCode::kSingular) {
    FindDirections();
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
    // U_inv is a lower triangle, rows four apart, and P⁻¹ = U_invᵀ U_inv: the variance of
    // coordinate i is the sum of squares of column i, from row i down.
    double U_inv[4 * kQuad] = {};
    bool determined = InvertCholeskyFactor(size, hessian_.P(l), no_damping, U_inv);
    for (int i = 0; determined && i < size; ++i) {
      double variance = 0.0;
      for (int k = i; k < size; ++k) {
        variance += U_inv[k * kQuad + i] * U_inv[k * kQuad + i];
      }
      // The variance over 1 / P_ii, with all else known: of units that cancel.
      determined = variance * hessian_.P(l)[i * kQuad + i] <= options_.max_inflation;
    }
    if (!determined) {
      deficiency_.landmarks.push_back(layout_.variables[layout_.num_frames + l]);
    }
  }
  return deficiency_.landmarks.empty()
             ? Status::Ok()
             : NotDetermined(deficiency_.landmarks.front(),
                             "the landmark is not determined by its factors");
}

// Of the last block of each row.
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
// In units of √diag(S) the probe has entries of ±1; what is open blows up its share of the
// solution. Signs come from a fixed sequence: the same verdict in each run.
Status CovarianceSystem::CheckGauge() {
  const Eigen::VectorXd scale = diagonal_.cwiseSqrt();
  Eigen::MatrixXd probe = scale;
  std::uint32_t bits = 1;
  for (Eigen::Index i = 0; i < probe.size(); ++i) {
    // Of a linear congruential generator the highest bit is the one to trust.
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
  if (inflation <= options_.max_inflation) {
    return Status::Ok();
  }
  // The frame that the scalar belongs to: the last one that begins at or before it.
  const auto after = std::upper_bound(plans_.pattern.offsets.begin(), plans_.pattern.offsets.end(),
                                      static_cast<int>(largest));
  return NotDetermined(layout_.variables[after - plans_.pattern.offsets.begin() - 1],
                       "the gauge is free, or what determines it is lost to rounding");
}

// Column by column; a solution that overflows is no solution.
Status CovarianceSystem::Solve(const Eigen::MatrixXd& right, Eigen::MatrixXd* left) {
  left->resize(right.rows(), right.cols());
  Status status;
  for (Eigen::Index c = 0; status.ok() && c < right.cols(); ++c) {
    status = factor_.Solve(right.col(c).data(), {}, {}, left->col(c).data());
  }
  return status.ok() && !left->allFinite()
             ? Status::Error(StatusCode::kSingular,
                             "there is no covariance: a solution is not finite")
             : status;
}

// V of a frame is a unit matrix, that of a landmark zero for now.
void CovarianceSystem::MakeColumn(VariableId id) {
  Column& column = columns_[id];
  const int size = graph_.TangentSize(id);
  const int landmark = layout_.LandmarkOf(id);
  if (landmark >= 0 && by_rows_ != nullptr) {
    return MakeColumnByRows(landmark, &column);
  }
  if (landmark < 0) {
    column.frames = {layout_.FrameOf(id)};
  } else {
    // In the order of the incidences; rows of V follow it.
    column.frames.assign(incidences_.frames.begin() + incidences_.begin[landmark],
                         incidences_.frames.begin() + incidences_.begin[landmark + 1]);
  }
  int rows = 0;
  for (const int frame : column.frames) {
    column.rows.push_back(rows);
    rows += layout_.TangentSize(frame);
  }
  column.V.setZero(rows, size);
  if (landmark < 0) {
    column.V.setIdentity();
    return;
  }
  double U_inv[4 * kQuad] = {};
  const double no_damping[kQuad] = {};
  InvertCholeskyFactor(size, hessian_.P(landmark), no_damping,
                       U_inv);  // as CheckLandmarks has tried
  const Eigen::Map<const Eigen::Matrix<double, 4, kQuad, Eigen::RowMajor>> U(U_inv);
  column.P_inv = U.topLeftCorner(size, size).transpose() * U.topLeftCorner(size, size);
}

// V −= W P⁻¹ of the landmarks there are columns of, W = Σ J_cᵀ J_l, in one pass over the factors.
// One pass for all landmarks that are asked for, rather than one for each: factors are not listed
// by landmark here.
void CovarianceSystem::SubtractW() {
  for (const Linearization& cache : evaluator_.families()) {
    const int num_slots = cache.num_slots;
    for (int i = 0; i < cache.num_factors; ++i) {
      const VariableId* ids = graph_.Variables(cache.id, i);
      // A factor has at most one that moves.
      const VariableId* landmark = std::find_if(
          ids, ids + num_slots, [this](VariableId id) { return layout_.LandmarkOf(id) >= 0; });
      // Most factors are of landmarks that nobody asks for.
      const auto wanted = landmark == ids + num_slots ? columns_.end() : columns_.find(*landmark);
      if (wanted == columns_.end()) {
        continue;
      }
      const auto jacobian = [&](std::ptrdiff_t s) {
        const SlotJacobians& slot = cache.slots[s];
        return Eigen::Map<const RowMajor, 0, Eigen::OuterStride<>>(
            slot.data + i * slot.factor_stride, cache.residual_size, slot.columns,
            Eigen::OuterStride<>(slot.row_stride));
      };
      Column& column = wanted->second;
      // P⁻¹ on the landmark's side first: a product of its few columns, for all frames of the
      // factor.
      const Eigen::MatrixXd J_l = jacobian(landmark - ids) * column.P_inv;
      // A factor of a landmark and several frames adds to the rows of each.
      for (int s = 0; s < num_slots; ++s) {
        const int frame = layout_.FrameOf(ids[s]);
        if (frame >= 0) {
          const auto at = std::find(column.frames.begin(), column.frames.end(), frame);
          column.V.middleRows(column.rows[at - column.frames.begin()],
                              layout_.TangentSize(frame)) -= jacobian(s).transpose() * J_l;
        }
      }
    }
  }
}

// Variance times S_kk: over what it would be with all other variables known.
Status CovarianceSystem::CheckVariance(int frame, int k, double variance) {
  return variance * diagonal_[layout_.packed_offset[frame] + k] <= options_.max_inflation
             ? Status::Ok()
             : NotDetermined(layout_.variables[frame], "what determines it is lost to rounding");
}

Status CovarianceSystem::SolveFor(VariableId id) {
  Column& column = columns_.at(id);
  // V as dense columns, of all frames.
  Eigen::MatrixXd right = Eigen::MatrixXd::Zero(layout_.frame_size(), column.V.cols());
  for (std::size_t i = 0; i < column.frames.size(); ++i) {
    const int frame = column.frames[i];
    right.middleRows(layout_.packed_offset[frame], layout_.TangentSize(frame)) =
        column.V.middleRows(column.rows[i], layout_.TangentSize(frame));
  }
  Status status = Solve(right, &column.X);
  const int frame = layout_.FrameOf(id);
  // V of a frame is the unit matrix, so that the diagonal of X has its variances. A landmark was
  // tested for known frames, and its frames by the gauge.
  for (int k = 0; frame >= 0 && status.ok() && k < graph_.TangentSize(id); ++k) {
    status = CheckVariance(frame, k, column.X(layout_.packed_offset[frame] + k, k));
  }
  return status;
}

// Takes the entries of S⁻¹ where L has any; then all variances are at hand, and each is tested.
Status CovarianceSystem::InvertFactor() {
  inverse_ = std::make_unique<SelectedInverse>(factor_, plans_.pattern, executor_);
  Status status;
  for (int frame = 0; frame < layout_.num_frames; ++frame) {
    for (int k = 0; status.ok() && k < layout_.TangentSize(frame); ++k) {
      status = CheckVariance(frame, k, inverse_->Diagonal(frame, k));
    }
  }
  return status;
}

// Every frame of one with every frame of the other: frames that share nothing are mostly not among
// the entries.
bool CovarianceSystem::IsSelected(const Column& a, const Column& b) const {
  return inverse_ != nullptr && std::all_of(a.frames.begin(), a.frames.end(), [&](int i) {
           return std::all_of(b.frames.begin(), b.frames.end(),
                              [&](int j) { return inverse_->Has(i, j); });
         });
}

// One solution a pair is enough: that of the variable with more of the pairs that need one.
Status CovarianceSystem::SolveForPairs(const GraphCovariance::Pairs& pairs) {
  GraphCovariance::Pairs open;
  std::map<VariableId, int> count;
  for (const auto& [a, b] : pairs) {
    if (!IsSelected(columns_.at(a), columns_.at(b))) {
      open.emplace_back(a, b);
      ++count[a];
      ++count[b];
    }
  }
  Status status;
  for (const auto& [a, b] : open) {
    // A solution that an earlier pair needed serves this one as well.
    if (status.ok() && columns_.at(a).X.size() == 0 && columns_.at(b).X.size() == 0) {
      status = SolveFor(count[a] > count[b] ? a : b);
    }
  }
  return status;
}

// Columns V of all variables first, whose sizes tell what solves would cost.
Status CovarianceSystem::Prepare(const GraphCovariance::Pairs& pairs) {
  double wanted_columns = 0.0;
  bool wants_landmarks = false;
  for (const auto& pair : pairs) {
    for (const VariableId id : {pair.first, pair.second}) {
      if (columns_.count(id) == 0) {
        MakeColumn(id);
        wanted_columns += graph_.TangentSize(id);
        wants_landmarks = wants_landmarks || layout_.LandmarkOf(id) >= 0;
      }
    }
  }
  // By rows MakeColumn has all of V already.
  if (wants_landmarks && by_rows_ == nullptr) {
    SubtractW();
  }
  // Landmarks alone: their covariances are P⁻¹.
  if (layout_.num_frames == 0) {
    return Status::Ok();
  }
  Status status;
  // A solve goes through the entries of L twice, forwards and backwards.
  if (SelectedInverse::PredictedFlops(factor_.tree()) <
      2.0 * factor_.PredictedEntries() * wanted_columns) {
    status = InvertFactor();
  }
  return status.ok() ? SolveForPairs(pairs) : status;
}

// V_aᵀ X_b: only the rows of frames that V_a touches.
Eigen::MatrixXd CovarianceSystem::FromSolution(const Column& a, const Column& b) const {
  Eigen::MatrixXd product = Eigen::MatrixXd::Zero(a.V.cols(), b.V.cols());
  for (std::size_t i = 0; i < a.frames.size(); ++i) {
    const int rows = layout_.TangentSize(a.frames[i]);
    product += a.V.middleRows(a.rows[i], rows).transpose() *
               b.X.middleRows(layout_.packed_offset[a.frames[i]], rows);
  }
  return product;
}

// Σ_ij V_aiᵀ (S⁻¹)_ij V_bj: as many products as pairs of frames.
Eigen::MatrixXd CovarianceSystem::FromInverse(const Column& a, const Column& b) const {
  Eigen::MatrixXd product = Eigen::MatrixXd::Zero(a.V.cols(), b.V.cols());
  // Blocks of S⁻¹ come row by row, of any two frames in either order.
  RowMajor block;
  for (std::size_t i = 0; i < a.frames.size(); ++i) {
    for (std::size_t j = 0; j < b.frames.size(); ++j) {
      block.resize(layout_.TangentSize(a.frames[i]), layout_.TangentSize(b.frames[j]));
      inverse_->Block(a.frames[i], b.frames[j], block.data());
      product += a.V.middleRows(a.rows[i], block.rows()).transpose() * block *
                 b.V.middleRows(b.rows[j], block.cols());
    }
  }
  return product;
}

Eigen::MatrixXd CovarianceSystem::Product(VariableId a, VariableId b) const {
  const Column& left = columns_.at(a);
  const Column& right = columns_.at(b);
  Eigen::MatrixXd covariance;
  // A solution goes before the entries of the inverse: it is there for pairs that have no others.
  if (right.X.size() > 0) {
    covariance = FromSolution(left, right);
  } else if (left.X.size() > 0) {
    covariance = FromSolution(right, left).transpose();
  } else {
    covariance = FromInverse(left, right);
  }
  if (a == b && left.P_inv.size() > 0) {
    covariance += left.P_inv;
  }
  return covariance;
}

}  // namespace inceres::internal
