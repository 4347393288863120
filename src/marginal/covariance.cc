#include "inceres/solver/covariance.h"

#include <algorithm>
#include <new>
#include <string>

#include "base/formatted.h"
#include "base/option_rules.h"
#include "inceres/solver/incremental_solver.h"
#include "linearize/jacobian_map.h"
#include "marginal/covariance_system.h"
#include "marginal/dense_svd_covariance.h"
#include "problem/find_fault.h"

namespace inceres {

using internal::Invalid;
using internal::RowMajor;

// Blocks of H⁻¹ without damping (docs/algorithms.md, "Covariance"): what a caller may ask for is
// checked here, one of three algorithms computes it, and the blocks are kept by pair. A pair is
// kept in the order in which it was asked for and found in either; all others of an earlier Compute
// are gone.
//
// The rank is not a matter of a pivot: a variance too large to be true to its digits is a status,
// and what is open is in deficiency_.

Status CovarianceOptions::Validate() const {
  return internal::OptionRules("CovarianceOptions")
      .AtLeastOne("num_threads", num_threads)
      .Require(null_space_rank >= -1, "null_space_rank", null_space_rank, ">= -1")
      .Require(min_reciprocal_condition_number >= 0.0 && min_reciprocal_condition_number < 1.0,
               "min_reciprocal_condition_number", min_reciprocal_condition_number, "in [0, 1)")
      .Require(min_column_remainder >= 0.0 && min_column_remainder < 1.0, "min_column_remainder",
               min_column_remainder, "in [0, 1)")
      // 1 is that of a variable that has nothing to do with others.
      .Require(max_inflation > 1.0, "max_inflation", max_inflation, "> 1")
      .status();
}

// Empty where none was looked for or found: landmarks alone may be open.
std::string RankDeficiency::CountDirections() const {
  return directions.empty()
             ? ""
             : std::to_string(directions.size()) +
                   (has_more ? " directions or more are open" : " directions are open");
}

// Landmarks first, then each direction with the frames that move along it: frames of one direction
// apart by commas, directions by semicolons.
std::string RankDeficiency::ToString() const {
  std::string text;
  if (!landmarks.empty()) {
    text = std::to_string(landmarks.size()) +
           " landmarks are not determined by their factors, the first of them variable " +
           std::to_string(landmarks.front());
  }
  const char* separator = ": ";
  if (!directions.empty()) {
    // The first separator is the colon behind this count.
    text += (text.empty() ? "" : "; ") + CountDirections();
  }
  for (const Direction& direction : directions) {
    for (const auto& [id, share] : direction.shares) {
      text += separator + internal::VariableName(id) + internal::Formatted(" (%.2f)", share);
      separator = ", ";
    }
    separator = "; ";
  }
  return text;
}

Status GraphCovariance::Compute(const FactorGraph& graph, const Pairs& pairs) {
  // Looked at as before a solve: whatever evaluates it may rely on its rules.
  return ComputeAt(graph, graph.Validate(), graph.state(), pairs);
}

// The solver holds values of its own, which stand in for those of the graph. Constants that are
// borrowed have no place in the state and are read where they lie. Its edits were looked at; the
// graph's own state lags behind, and need not be within bounds.
Status GraphCovariance::Compute(const IncrementalSolver& solver, const Pairs& pairs) {
  const FactorGraph& graph = solver.graph();
  std::vector<double> state = graph.state();
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    if (graph.HasVariable(id) && graph.StateOffset(id) >= 0) {
      std::copy_n(solver.Values(id), graph.AmbientSize(id), state.begin() + graph.StateOffset(id));
    }
  }
  return ComputeAt(graph, Status::Ok(), state, pairs);
}

// Blocks of what moves from the system, once it is factored; of constants zeros.
// A template over the system, for kSchur and kQr have one and kDenseSvd another. Everything that
// may fail comes before the first block is written.
template <typename System>
Status GraphCovariance::Fill(const FactorGraph& graph, const Pairs& pairs, System* system) {
  Pairs moving;
  for (const auto& [a, b] : pairs) {
    for (const VariableId id : {a, b}) {
      // Without a factor it has no place in the layout, and nothing in H.
      if (!graph.IsConstant(id) && !system->Has(id)) {
        return Invalid("variable " + std::to_string(id) +
                       " has no covariance: no factor touches it");
      }
    }
    // A constant has no row in H; its covariances are zeros.
    if (!graph.IsConstant(a) && !graph.IsConstant(b)) {
      moving.emplace_back(a, b);
    }
  }
  // Of constants alone nothing is factored: a singular problem is no error then.
  const Status status = moving.empty() ? Status::Ok() : system->Factorize(moving);
  for (std::size_t k = 0; status.ok() && k < pairs.size(); ++k) {
    const auto [a, b] = pairs[k];
    Block& block = blocks_[{a, b}];
    block.rows = graph.TangentSize(a);
    block.columns = graph.TangentSize(b);
    // Zeros, which they remain where one of the two is constant.
    block.values.assign(
        static_cast<std::size_t>(block.rows) * static_cast<std::size_t>(block.columns), 0.0);
    if (!graph.IsConstant(a) && !graph.IsConstant(b)) {
      Eigen::Map<RowMajor>(block.values.data(), block.rows, block.columns) = system->Product(a, b);
    }
  }
  return status;
}

// What was computed before is forgotten first: after an error there are no blocks.
Status GraphCovariance::ComputeAt(const FactorGraph& graph, const Status& valid,
                                  const std::vector<double>& state, const Pairs& pairs) {
  blocks_.clear();
  deficiency_ = RankDeficiency();
  Status status = options_.Validate();
  status = status.ok() ? valid : status;
  if (!status.ok()) {
    return status;
  }
  bool has_landmarks = false;
  // Ids before anything else asks the graph for them.
  for (const auto& pair : pairs) {
    for (const VariableId id : {pair.first, pair.second}) {
      if (!graph.HasVariable(id)) {
        return Invalid("variable " + std::to_string(id) + " does not exist");
      }
      has_landmarks = has_landmarks || graph.role(id) == Role::kLandmark;
    }
  }
  try {
    if (options_.algorithm == CovarianceAlgorithm::kDenseSvd) {
      internal::DenseSvdCovariance system(graph, state, options_);
      status = Fill(graph, pairs, &system);
    } else {
      internal::CovarianceSystem system(graph, state, options_, has_landmarks);
      status = Fill(graph, pairs, &system);
      // Also after an error, which it explains.
      deficiency_ = system.deficiency();
    }
  } catch (const std::bad_alloc&) {
    blocks_.clear();
    return Status::Error(StatusCode::kUnavailable, "Out of memory.");
  }
  return status;
}

// Asked for in the order of Compute a block is copied, in the other one transposed.
bool GraphCovariance::Get(VariableId a, VariableId b, double* covariance) const {
  auto found = blocks_.find({a, b});
  if (found != blocks_.end()) {
    std::copy(found->second.values.begin(), found->second.values.end(), covariance);
    return true;
  }
  found = blocks_.find({b, a});
  if (found == blocks_.end()) {
    return false;
  }
  const Block& block = found->second;
  // cov(a, b) is the transpose of cov(b, a).
  Eigen::Map<RowMajor>(covariance, block.columns, block.rows) =
      Eigen::Map<const RowMajor>(block.values.data(), block.rows, block.columns).transpose();
  return true;
}

}  // namespace inceres
