#include "robust/foresight.h"

#include <algorithm>
#include <iterator>

#include <Eigen/LU>

#include "base/sort_unique.h"
#include "linearize/factor_linearizer.h"
#include "linearize/jacobian_map.h"

namespace inceres::internal {

// The minimum over δ of ½ δᵀΣ⁻¹δ + ½ (f + Jδ)ᵀW(f + Jδ) is where f + Jδ = (I + J Σ Jᵀ W)⁻¹ f: the
// first term is what the rest of the graph costs more. Σ comes from the factor that the Update has
// left, and is of the size of the suspects' variables, however large the graph is.
//
// It follows from the gradient, Σ⁻¹δ + JᵀW(f + Jδ) = 0: with e = f + Jδ this is δ = −Σ JᵀW e, and e
// = f − J Σ Jᵀ W e. So Σ is multiplied with and never inverted, which matters where a variable is
// hardly held and Σ is large. The matrix I + J Σ Jᵀ W has an inverse for any weights W ≥ 0, since
// the eigenvalues of J Σ Jᵀ W are those of W^½ J Σ Jᵀ W^½, none of which is negative. It is not
// symmetric, unless all weights are equal, hence LU with pivots and no Cholesky factor.
//
// Prepare pays for Σ once; each round that is played asks for other weights, and costs the cube of
// the residuals' size, of eight suspects at most.

// Suspects mostly share variables, as loops that close at the same place do, and each variable has
// one place in Σ. The list is sorted: columns of J are found by a search in it. Constants have no
// covariance, and J no column of them.
void Foresight::ListVariables(const FactorGraph& graph, const std::vector<FactorId>& suspects) {
  variables_.clear();
  begin_.assign(1, 0);
  for (const FactorId& id : suspects) {
    const FactorFamily& family = graph.family(id.family);
    begin_.push_back(begin_.back() + family.residual_size());
    const VariableId* const ids = graph.Variables(id.family, id.index);
    std::copy_if(ids, ids + family.num_slots(), std::back_inserter(variables_),
                 [&](VariableId variable) { return !graph.IsConstant(variable); });
  }
  SortUnique(&variables_);
}

// Without their losses, which let them weigh nothing. Columns are those of the joint covariance.
// Each suspect writes the rows that begin_ gives it, and of these the columns of its variables; all
// others stay zero. At the solver's values, which are those that Σ belongs to.
Status Foresight::Linearize(const IncrementalSolver& solver, const std::vector<FactorId>& suspects,
                            const std::vector<int>& columns, Eigen::MatrixXd* J) {
  const FactorGraph& graph = solver.graph();
  FactorLinearizer linearizer(
      graph, [&](VariableId id) { return solver.Values(id); },
      [&](VariableId id) { return !graph.IsConstant(id); });
  *J = Eigen::MatrixXd::Zero(begin_.back(), columns.back());
  f_.resize(begin_.back());
  for (std::size_t k = 0; k < suspects.size(); ++k) {
    LinearizedFactor factor;
    const Status status = linearizer.LinearizePlainly(suspects[k], &factor);
    if (!status.ok()) {
      return status;
    }
    f_.segment(begin_[k], factor.rows) = Eigen::Map<const Eigen::VectorXd>(factor.f, factor.rows);
    const VariableId* const ids = graph.Variables(suspects[k].family, suspects[k].index);
    for (int s = 0; s < graph.family(suspects[k].family).num_slots(); ++s) {
      const SlotJacobians& slot = factor.slots[s];
      if (slot.data != nullptr) {
        const auto at = std::lower_bound(variables_.begin(), variables_.end(), ids[s]);
        J->block(begin_[k], columns[at - variables_.begin()], factor.rows, slot.columns) =
            JacobianOf(slot, 0, factor.rows);
      }
    }
  }
  return Status::Ok();
}

// The covariance is asked for with default options, of all variables together: J Σ Jᵀ needs the
// blocks between suspects, by which one that is right speaks for another. Its values are symmetric,
// so it does not matter that they are read column by column.
Status Foresight::Prepare(const IncrementalSolver& solver, const std::vector<FactorId>& suspects) {
  ListVariables(solver.graph(), suspects);
  LiveCovariance covariance;
  Status status = solver.Covariance(variables_, {}, &covariance);
  Eigen::MatrixXd J;
  status = status.ok() ? Linearize(solver, suspects, covariance.offsets, &J) : status;
  if (status.ok()) {
    spread_ = J * Eigen::Map<const Eigen::MatrixXd>(covariance.values.data(), J.cols(), J.cols()) *
              J.transpose();
  }
  return status;
}

// A weight multiplies the columns of its suspect, for W stands on the right. With weights of zero A
// is I, and the errors are those of now, to the bit.
std::vector<double> Foresight::SquaredErrors(const std::vector<double>& weights) const {
  Eigen::MatrixXd A = spread_;
  for (std::size_t k = 0; k < weights.size(); ++k) {
    A.middleCols(begin_[k], begin_[k + 1] - begin_[k]) *= weights[k];
  }
  A.diagonal().array() += 1.0;
  const Eigen::VectorXd f = A.partialPivLu().solve(f_);
  std::vector<double> errors;
  for (std::size_t k = 0; k < weights.size(); ++k) {
    errors.push_back(f.segment(begin_[k], begin_[k + 1] - begin_[k]).squaredNorm());
  }
  return errors;
}

}  // namespace inceres::internal
