#include "inceres/solver/covariance.h"

#include <algorithm>
#include <new>
#include <string>

#include "base/formatted.h"
#include "inceres/solver/incremental_solver.h"
#include "marginal/covariance_system.h"
#include "marginal/dense_svd_covariance.h"
#include "problem/find_fault.h"

namespace inceres {

using internal::Invalid;

Status CovarianceOptions::Validate() const {
  if (num_threads < 1) {
    return Invalid("CovarianceOptions::num_threads must be at least 1");
  }
  if (null_space_rank < -1) {
    return Invalid("CovarianceOptions::null_space_rank must be at least -1");
  }
  if (!(min_reciprocal_condition_number >= 0.0 && min_reciprocal_condition_number < 1.0)) {
    return Invalid("CovarianceOptions::min_reciprocal_condition_number must be in [0, 1)");
  }
  if (!(min_column_remainder >= 0.0 && min_column_remainder < 1.0)) {
    return Invalid("CovarianceOptions::min_column_remainder must be in [0, 1)");
  }
  return max_inflation > 1.0 ? Status::Ok()
                             : Invalid("CovarianceOptions::max_inflation must exceed 1");
}

std::string RankDeficiency::CountDirections() const {
  return directions.empty()
             ? ""
             : std::to_string(directions.size()) +
                   (has_more ? " directions or more are open" : " directions are open");
}

std::string RankDeficiency::ToString() const {
  std::string text;
  if (!landmarks.empty()) {
    text = std::to_string(landmarks.size()) +
           " landmarks are not determined by their factors, the first of them variable " +
           std::to_string(landmarks.front());
  }
  const char* separator = ": ";
  if (!directions.empty()) {
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
  return ComputeAt(graph, graph.state(), pairs);
}

Status GraphCovariance::Compute(const IncrementalSolver& solver, const Pairs& pairs) {
  const FactorGraph& graph = solver.graph();
  std::vector<double> state = graph.state();
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    if (graph.HasVariable(id) && graph.StateOffset(id) >= 0) {
      std::copy_n(solver.Values(id), graph.AmbientSize(id), state.begin() + graph.StateOffset(id));
    }
  }
  return ComputeAt(graph, state, pairs);
}

// Blocks of what moves from the system, once it is factored; of constants zeros.
template <typename Factorize, typename System>
Status GraphCovariance::Fill(const FactorGraph& graph, const Pairs& pairs,
                             const Factorize& factorize, const System& system) {
  Pairs moving;
  for (const auto& [a, b] : pairs) {
    for (const VariableId id : {a, b}) {
      if (!graph.IsConstant(id) && !system.Has(id)) {
        return Invalid("variable " + std::to_string(id) +
                       " has no covariance: no factor touches it");
      }
    }
    if (!graph.IsConstant(a) && !graph.IsConstant(b)) {
      moving.emplace_back(a, b);
    }
  }
  const Status status = moving.empty() ? Status::Ok() : factorize(moving);
  for (std::size_t k = 0; status.ok() && k < pairs.size(); ++k) {
    const auto [a, b] = pairs[k];
    Block& block = blocks_[{a, b}];
    block.rows = graph.TangentSize(a);
    block.columns = graph.TangentSize(b);
    block.values.assign(
        static_cast<std::size_t>(block.rows) * static_cast<std::size_t>(block.columns), 0.0);
    if (!graph.IsConstant(a) && !graph.IsConstant(b)) {
      using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
      Eigen::Map<RowMajor>(block.values.data(), block.rows, block.columns) = system.Product(a, b);
    }
  }
  return status;
}

Status GraphCovariance::ComputeAt(const FactorGraph& graph, const std::vector<double>& state,
                                  const Pairs& pairs) {
  blocks_.clear();
  deficiency_ = RankDeficiency();
  Status status = options_.Validate();
  status = status.ok() ? graph.Validate() : status;
  if (!status.ok()) {
    return status;
  }
  for (const auto& pair : pairs) {
    for (const VariableId id : {pair.first, pair.second}) {
      if (!graph.HasVariable(id)) {
        return Invalid("variable " + std::to_string(id) + " does not exist");
      }
    }
  }
  try {
    if (options_.algorithm == CovarianceAlgorithm::kDenseSvd) {
      internal::DenseSvdCovariance system(graph, state, options_);
      const auto factorize = [&system](const Pairs& /*pairs*/) { return system.Compute(); };
      status = Fill(graph, pairs, factorize, system);
    } else {
      internal::CovarianceSystem system(graph, state, options_);
      const auto factorize = [&system](const Pairs& moving) {
        const Status factored = system.Factorize();
        return factored.ok() ? system.Prepare(moving) : factored;
      };
      status = Fill(graph, pairs, factorize, system);
      deficiency_ = system.deficiency();
    }
  } catch (const std::bad_alloc&) {
    blocks_.clear();
    return Status::Error(StatusCode::kUnavailable, "Out of memory.");
  }
  return status;
}

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
  for (int r = 0; r < block.columns; ++r) {
    for (int c = 0; c < block.rows; ++c) {
      covariance[r * block.rows + c] =
          block.values.data()[static_cast<std::ptrdiff_t>(c) * block.columns + r];
    }
  }
  return true;
}

}  // namespace inceres
