#include "linearize/robust_costs.h"

#include <cmath>

#include "inceres/problem/constant_size.h"

namespace inceres::internal {
namespace {

// Costs and corrections of a group of factors (docs/algorithms.md, "Robust losses"). Losses are
// asked one by one; the Jacobians of the group are then scaled by one call of a kernel, slot by
// slot, while they are in the cache.
//
// A group is at most kSumSize factors, of which the cost is one sum, factor by factor: it is the
// smallest unit that sums of costs are made of, and how factors are spread over threads cannot
// change it. The cost is of f as it was evaluated; correction comes after.
//
// Values of losses are kept from the candidate's evaluation, for an accepted candidate is
// linearized next. Whether they are of the same residual is asked of s = ‖f‖² and its bits. Equal
// squares of other residuals would have the same values, since a loss sees nothing but s.

// What the losses of a group make of it. of_jacobian is √ρ' and (α / s), of_residual what f is
// multiplied by, √ρ' / (1 − α).
struct GroupScales {
  FactorScale of_jacobian[kSumSize];
  double of_residual[kSumSize];
  bool are_finite = true;
};

// Of the candidate: the values of the losses are kept. With the number of rows known to the
// compiler, s of a residual is a few instructions beside the loss's call.
double SumCandidateCosts(int begin, int end, const double* candidate_f, Linearization* family) {
  const std::shared_ptr<const Loss>* const losses = family->graph->losses(family->id);
  const double* f = candidate_f + std::ptrdiff_t{begin} * family->residual_size;
  LossValue* const values = family->loss_values.data();
  return WithConstantSize(family->residual_size, [=](auto rows) {
    const double* next = f;  // copies, which registers can hold
    double cost = 0.0;
    for (int i = begin; i < end; ++i, next += rows) {
      values[i].Set(losses[i].get(), SquaredNorm(next, rows));
      cost += values[i].cost();
    }
    return cost;
  });
}

// Those of the point that was linearized; a loss is not asked again where its value is known.
template <typename Size>
// Most losses have ρ'' ≤ 0 and take no second-order term, which leaves J and f with the same factor
// √ρ'. Nothing is written to J or f here: where one factor of the group has no root, the others
// stay uncorrected. A weight that is not finite or negative, whose root is NaN, is noted by a sum
// that such a number makes NaN, so that the loop has no branch for it.
double SumLinearizedCosts(Size rows, bool known_point, LossCurvature curvature, int begin, int end,
                          const double* residuals, Linearization* family, GroupScales* scales,
                          EvaluationFailure* failure) {
  const std::shared_ptr<const Loss>* const losses = family->graph->losses(family->id) + begin;
  LossValue* const values = family->loss_values.data() + begin;
  const double* f = residuals + std::ptrdiff_t{begin} * rows;
  const bool takes_negative =
      curvature == LossCurvature::kNegative || curvature == LossCurvature::kBoth;
  double cost = 0.0;
  double not_finite = 0.0;  // NaN with the first scale that is not
  for (int n = 0; n < end - begin; ++n, f += rows) {
    LossValue& value = values[n];
    const double s = SquaredNorm(f, rows);
    if (!known_point || s != value.s) {
      value.Set(losses[n].get(), s);
    }
    cost += value.cost();
    if (value.rho[2] <= 0.0 && !takes_negative) {  // as of most losses: nothing but a weight
      const double sqrt_weight = std::sqrt(value.rho[1]);
      scales->of_jacobian[n] = {sqrt_weight, 0.0};
      scales->of_residual[n] = sqrt_weight;
      not_finite += sqrt_weight * 0.0;
      continue;
    }
    if (!value.HasRoot()) {
      *failure = {begin + n, kLossWithoutRoot};
      break;
    }
    const RobustScale scale(value, curvature);
    scales->of_jacobian[n] = scale.jacobian();
    scales->of_residual[n] = scale.is_corrected() ? scale.residual() : scale.sqrt_weight;
    not_finite += (scale.sqrt_weight + scale.alpha_over_s) * 0.0;
  }
  scales->are_finite = not_finite == 0.0;
  return cost;
}

// J first, for it needs f as it was evaluated. A group with a scale that is not finite goes factor
// by factor, for the kernel would leave NaN in the padding (RobustScale::Apply); so do whole rows,
// of which there are few.
void Correct(const GroupScales& scales, LossCurvature curvature, int begin, int end,
             const LinearizationPlaces& places, Linearization* family) {
  const auto num_slots = static_cast<int>(family->slots.size());
  double* const f = places.residuals + std::ptrdiff_t{begin} * family->residual_size;
  // Whole rows have one slot with offset 0 for all factors.
  if (!family->has_whole_rows() && scales.are_finite) {
    BestKernels().correct_factors(places.slots, num_slots, begin, end - begin,
                                  family->tangent_offsets.data() + family->Entry(begin), f,
                                  family->residual_size, scales.of_jacobian);
  } else {
    const bool whole_rows = family->has_whole_rows();
    for (int i = begin; i < end; ++i) {
      RobustScale(family->loss_values[i], curvature)
          .Apply(f + std::ptrdiff_t{i - begin} * family->residual_size, family->residual_size,
                 num_slots, places.slots, i,
                 family->tangent_offsets.data() + (whole_rows ? 0 : family->Entry(i)));
    }
  }
  const double* const weights = scales.of_residual;
  const int count = end - begin;
  WithConstantSize(family->residual_size, [=](auto rows) {
    double* next = f;
    for (int n = 0; n < count; ++n, next += rows) {
      for (int r = 0; r < rows; ++r) {
        next[r] *= weights[n];
      }
    }
  });
}

// Without losses: one pass over the residuals.
double SumPlainCosts(const Linearization& family, const double* f, int begin, int end) {
  return PlainCost(f + std::ptrdiff_t{begin} * family.residual_size,
                   std::ptrdiff_t{end - begin} * family.residual_size);
}

}  // namespace

double SumCosts(bool linearized, bool known_point, LossCurvature curvature, int begin, int end,
                const double* candidate_f, const LinearizationPlaces& places, Linearization* family,
                EvaluationFailure* failure) {
  if (!family->graph->HasLosses(family->id)) {
    return SumPlainCosts(*family, linearized ? places.residuals : candidate_f, begin, end);
  }
  if (!linearized) {
    return SumCandidateCosts(begin, end, candidate_f, family);
  }
  GroupScales scales;
  const double cost = WithConstantSize(family->residual_size, [&](auto rows) {
    return SumLinearizedCosts(rows, known_point, curvature, begin, end, places.residuals, family,
                              &scales, failure);
  });
  if (!failure->failed()) {
    Correct(scales, curvature, begin, end, places, family);
  }
  return cost;
}

void SumCostsByGroup(bool linearized, bool known_point, LossCurvature curvature, int begin, int end,
                     const double* candidate_f, const LinearizationPlaces& places,
                     Linearization* family, double* sums, EvaluationFailure* failure) {
  const bool has_losses = family->graph->HasLosses(family->id);
  const double* const f = linearized ? places.residuals : candidate_f;
  while (begin < end && !failure->failed()) {
    const int group_end = std::min((begin / kSumSize + 1) * kSumSize, end);
    *sums++ = has_losses ? SumCosts(linearized, known_point, curvature, begin, group_end,
                                    candidate_f, places, family, failure)
                         : SumPlainCosts(*family, f, begin, group_end);
    begin = group_end;
  }
}

}  // namespace inceres::internal
