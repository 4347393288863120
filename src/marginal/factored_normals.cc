#include "marginal/factored_normals.h"

#include <algorithm>
#include <string>

#include "linear/not_positive_definite.h"
#include "linear/small_cholesky.h"
#include "marginal/null_space.h"

namespace inceres::internal {

// What is delicate is rank. A pivot says little: rounding makes singular matrices definite. So
// three tests ask by how much a variance exceeds the one with all else known: of each landmark for
// known frames, of a probe of the whole gauge, and of each variable that is asked for
// (CheckVariance). A NaN fails all of them.
//
// "All else known" includes landmarks, so that variances are held against diag(C), and not against
// diag(S): where the landmarks of a frame use up all that its factors say of it, S = C − W P⁻¹ Wᵀ
// is rounding, which is positive as often as not, and its inverse times itself is one.
//
// How large that rounding is depends on the landmarks as well. One of an inflation κ_l has a P⁻¹
// that is exact to κ_l ε, so S_kk is exact to ε E_k, E_k = Σ_l κ_l (the share of l in C_kk). A
// variance Σ_kk has digits while Σ_kk ε E_k is small: it is held against E as well.

namespace {

// A share of a direction worth naming, and how many of them.
constexpr double kShare = 0.01;
constexpr int kMostShares = 8;
constexpr int kMostDirections = 32;

// Of a variance in units of E: four digits are left at the worst. Mostly there are more, and a
// caller who wants eight, as he says by the inflation he bears, may have so many times that.
constexpr double kMostOfE = 1e12;
constexpr double kTimesInflation = 100.0;

// In chunks they never leave the processor's cache. kQr reads them all.
JacobianStorage StorageOf(const FactorGraph& graph, const CovarianceOptions& options,
                          bool keeps_jacobians) {
  return keeps_jacobians || options.algorithm == CovarianceAlgorithm::kQr ||
                 JacobianChunks::Obstacle(graph) != nullptr
             ? JacobianStorage::kBySlot
             : JacobianStorage::kInChunks;
}

}  // namespace

FactoredNormals::FactoredNormals(const FactorGraph& graph, const std::vector<double>& state,
                                 const CovarianceOptions& options, bool keeps_jacobians)
    // graph, options and state are the caller's: nothing of them is copied but the values.
    : graph_(graph),
      options_(options),
      executor_(options.num_threads),
      layout_(graph, /*eliminate_landmarks=*/true),
      evaluator_(graph, layout_, executor_, StorageOf(graph, options, keeps_jacobians)),
      incidences_(evaluator_, DirectElimination::kQuadsPerChunk),
      elimination_(&evaluator_, incidences_),
      factor_(executor_) {
  evaluator_.points().SetCurrent(state);
}

// The message names one variable and counts directions; who is in them is in deficiency_.
Status FactoredNormals::NotDetermined(VariableId id, const char* why) {
  FindDirections();
  std::string found = deficiency_.CountDirections();
  if (!found.empty()) {
    found.insert(0, "; ");
  }
  return Status::Error(StatusCode::kSingular,
                       "variable " + std::to_string(id) + " has no covariance: " + why + found);
}

// Once, and only after a failure: it costs a factorization and many solves.
void FactoredNormals::FindDirections() {
  // by rows S is not formed
  if (diagonal_.size() == 0 || !deficiency_.directions.empty() || by_rows_ != nullptr) {
    return;
  }
  // What the one test or the other calls open.
  const Eigen::VectorXd units = diagonal_ + options_.max_inflation / MostRounding() * rounding_;
  const Eigen::MatrixXd directions =
      FindNullSpace(pattern(), elimination_.S(), units, 1.0 / options_.max_inflation,
                    // One more than are told, to know whether there are more.
                    kMostDirections + 1, executor_);
  deficiency_.has_more = directions.cols() > kMostDirections;
  for (Eigen::Index c = 0; c < std::min<Eigen::Index>(directions.cols(), kMostDirections); ++c) {
    deficiency_.directions.push_back(
        SharesOf(diagonal_.cwiseQuotient(units).cwiseProduct(directions.col(c).cwiseAbs2())));
  }
}

// `squares`: of the scalars of all frames, in units of the diagonal of C.
RankDeficiency::Direction FactoredNormals::SharesOf(const Eigen::VectorXd& squares) const {
  const double whole = squares.sum();
  std::vector<std::pair<VariableId, double>> shares;
  shares.reserve(static_cast<std::size_t>(layout_.num_frames));
  for (int frame = 0; frame < layout_.num_frames; ++frame) {
    // Those of all frames add up to one.
    shares.emplace_back(
        layout_.variables[frame],
        squares.segment(layout_.packed_offset[frame], layout_.TangentSize(frame)).sum() / whole);
  }
  const auto end = std::remove_if(shares.begin(), shares.end(),
                                  [](const auto& share) { return share.second < kShare; });
  shares.erase(end, shares.end());
  // Equal shares stay in the order of the frames.
  std::stable_sort(shares.begin(), shares.end(),
                   [](const auto& a, const auto& b) { return a.second > b.second; });
  shares.resize(std::min<std::size_t>(shares.size(), kMostShares));
  return {std::move(shares)};
}

// Landmarks are tested first: one that is open has spoiled S, and would be blamed on a frame.
Status FactoredNormals::Factorize() {
  // The same without S, in factored_rows.cc.
  if (options_.algorithm == CovarianceAlgorithm::kQr) {
    double cost = 0.0;
    // Nothing was evaluated at this state before.
    const Status evaluated = evaluator_.EvaluateJacobians(/*known_point=*/false, &cost);
    return evaluated.ok() ? FactorizeRows() : evaluated;
  }
  std::vector<int> open;
  Status status = elimination_.Eliminate(options_.max_inflation, &open);
  status = status.ok() ? NameOpen(open) : status;
  if (!status.ok() || layout_.num_frames == 0) {
    return status;
  }
  // Before the factorization: if that fails, directions are looked for in units of it.
  diagonal_ = Eigen::Map<const Eigen::VectorXd>(elimination_.diagonal().data(), pattern().size());
  rounding_ = Eigen::Map<const Eigen::VectorXd>(elimination_.rounding().data(), pattern().size());
  // A vector of zeros, since damping is an argument of the factorization.
  const std::vector<double> no_damping(static_cast<std::size_t>(layout_.frame_size()), 0.0);
  const ReducedMatrix S(pattern(), elimination_.S(), no_damping.data());
  status = factor_.Analyze(S);
  if (status.ok()) {
    status = NameVariable(factor_, factor_.Factorize(S, {}),
                          [this](std::size_t frame) { return layout_.variables[frame]; });
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

// Ok of none.
Status FactoredNormals::NameOpen(const std::vector<int>& landmarks) {
  for (const int l : landmarks) {
    deficiency_.landmarks.push_back(layout_.variables[layout_.num_frames + l]);
  }
  return landmarks.empty() ? Status::Ok()
                           : NotDetermined(deficiency_.landmarks.front(),
                                           "the landmark is not determined by its factors");
}

// How much variances may be in units of E. By rows errors are those of a root of S.
double FactoredNormals::MostRounding() const {
  return options_.algorithm == CovarianceAlgorithm::kQr
             ? kMostOfE * kMostOfE
             : std::max(options_.max_inflation,
                        std::min(kMostOfE, kTimesInflation * options_.max_inflation));
}

// The frame that a scalar belongs to: the last one that begins at or before it.
VariableId FactoredNormals::FrameWith(Eigen::Index scalar) const {
  const auto after = std::upper_bound(pattern().offsets.begin(), pattern().offsets.end(),
                                      static_cast<int>(scalar));
  return layout_.variables[after - pattern().offsets.begin() - 1];
}

// A Cholesky factor of a singular matrix often exists, thanks to rounding. Then a right-hand side
// with a share along the null space has a huge solution: one of mixed signs, in units of the
// diagonal, has such a share.
// Without landmarks E is C.
Status FactoredNormals::CheckGauge() {
  const Status status = Probe(diagonal_, options_.max_inflation);
  return status.ok() && layout_.num_landmarks() > 0 ? Probe(rounding_, MostRounding()) : status;
}

// In units of the root of the diagonal the probe has entries of ±1; what is open blows up its share
// of the solution. Signs come from a fixed sequence: the same verdict in each run.
Status FactoredNormals::Probe(const Eigen::VectorXd& diagonal, double most) {
  const Eigen::VectorXd scale = diagonal.cwiseSqrt();
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
  return inflation <= most
             ? Status::Ok()
             : NotDetermined(FrameWith(largest),
                             "the gauge is free, or what determines it is lost to rounding");
}

// Column by column; a solution that overflows is no solution.
Status FactoredNormals::Solve(const Eigen::MatrixXd& right, Eigen::MatrixXd* left) {
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

// Variance times C_kk: over what it would be with all other variables known; of kQr times S_kk,
// with all other frames known. Times E_kk: over what rounding alone would leave, in units of ε.
Status FactoredNormals::CheckVariance(int frame, int k, double variance) {
  const int scalar = layout_.packed_offset[frame] + k;
  return variance * diagonal_[scalar] <= options_.max_inflation &&
                 variance * rounding_[scalar] <= MostRounding()
             ? Status::Ok()
             : NotDetermined(layout_.variables[frame], "what determines it is lost to rounding");
}

}  // namespace inceres::internal
