#include "incremental/cost_rounding.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace inceres::internal {
namespace {

// Operations on numbers of full size that a residual is taken to come of; and what they round.
constexpr double kOperations = 16.0;
constexpr double kRounding = kOperations * std::numeric_limits<double>::epsilon();

// min(most, factor ‖J‖²), reading no more rows of J than that takes.
double LeastOf(double most, double factor, const SlotJacobians& slot, const double* J, int rows) {
  double least = 0.0;
  for (int k = 0; k < rows && least < most; ++k, J += slot.row_stride) {
    for (int c = 0; c < slot.columns; ++c) {
      least += factor * J[c] * J[c];
    }
  }
  return std::min(most, least);
}

}  // namespace

double CostRounding::LargestValue(VariableId id) const {
  double largest = 0.0;
  for (int k = 0; k < graph_.AmbientSize(id); ++k) {
    largest = std::max(largest, std::fabs(variables_.current(id)[k]));
  }
  return largest;
}

// Calls visit(part), the newest first, while it returns true.
template <typename Visit>
void CostRounding::ForEachPart(const Visit& visit) const {
  const auto most = [this](VariableId id, int size, const double* diagonal, int stride) {
    double trace = 0.0;
    for (int k = 0; k < size; ++k) {
      trace += diagonal[k * stride];
    }
    const double rounding = kRounding * LargestValue(id);
    return 0.5 * rounding * rounding * trace;
  };
  bool go_on = true;
  bool any_frame = false;
  for (auto i = static_cast<std::int32_t>(schur_.frames().size()) - 1; go_on && i >= 0; --i) {
    const IncrementalSchur::Frame& frame = schur_.frames()[i];
    if (frame.id >= 0 && !frame.held) {
      const double part = most(frame.id, frame.size, schur_.FrameDiagonal(i), 1);
      any_frame = any_frame || part > 0.0;
      go_on = visit(Part{frame.id, i, -1, part});
    }
  }
  // No frame can move, and the landmarks' own factors are all that blurs the cost.
  go_on = go_on && !any_frame;
  for (auto l = static_cast<std::int32_t>(schur_.landmarks().size()) - 1; go_on && l >= 0; --l) {
    const IncrementalSchur::Landmark& landmark = schur_.landmarks()[l];
    if (landmark.id >= 0 && schur_.IsInS(l)) {
      go_on = visit(Part{landmark.id, -1, l,
                         most(landmark.id, landmark.size, schur_.blocks().P(l), kQuad + 1)});
    }
  }
}

double CostRounding::AtMost() const {
  double sum = 0.0;
  ForEachPart([&sum](const Part& part) {
    sum += part.most;
    return true;
  });
  return sum;
}

double CostRounding::OfResiduals(double negligible, double enough) const {
  const double share = negligible / std::max(1, graph_.num_live_variables());
  double sum = 0.0;
  ForEachPart([&](const Part& part) {
    sum += part.most <= share ? part.most : std::min(part.most, OfResidualsOf(part));
    return sum < enough;
  });
  return sum;
}

template <typename Visit>
void CostRounding::ForEachFactorOf(const Part& part, const Visit& visit) const {
  if (part.frame < 0) {
    const std::vector<FactorRef>& factors = schur_.landmarks()[part.landmark].factors;
    std::for_each(factors.begin(), factors.end(), visit);
    return;
  }
  const IncrementalSchur::Frame& frame = schur_.frames()[part.frame];
  std::for_each(frame.factors.begin(), frame.factors.end(), visit);
  for (const std::int32_t landmark : frame.landmarks) {
    schur_.structure().ForEachFactorBetween(landmark, part.frame, visit);
  }
}

// ½ Σ_i min(‖q_i‖, n ε ‖J_iv‖ ‖x_v‖)² over the variable's factors.
double CostRounding::OfResidualsOf(const Part& part) const {
  const double rounding = kRounding * LargestValue(part.id);
  double sum = 0.0;
  ForEachFactorOf(part, [&](const FactorRef& ref) {
    const IncrementalFamily& family = families_[ref.family];
    if (!family.weighed().linearized(ref.factor)) {
      return;
    }
    const double* q = family.weighed().q(ref.factor);
    const double squared = std::inner_product(q, q + family.residual_size(), q, 0.0);
    for (int s = 0; squared > 0.0 && s < family.num_slots(); ++s) {
      if (family.variables(ref.factor)[s] == part.id) {
        sum += 0.5 * LeastOf(squared, rounding * rounding, family.slots()[s],
                             family.Jacobian(ref.factor, s), family.residual_size());
      }
    }
  });
  return sum;
}

}  // namespace inceres::internal
