#include "trust_region/block_minimizer.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>

#include "base/address.h"
#include "inceres/problem/constant_size.h"
#include "linearize/robustify.h"
#include "simd/kernels.h"
#include "trust_region/small_qr.h"

namespace inceres::internal {
namespace {

// Levenberg–Marquardt for one variable (docs/ceres_contract.md, "Inner iterations"). Ceres solves
// the problem of each block by a solver of its own with default options and DENSE_QR; this is that
// loop for a Jacobian of few columns, without allocation once memory has grown.
//
// The factors are those of the evaluator, which writes their residuals to its column for the
// candidate; Jacobians go to rows of our own. [J f] is kept by columns: gradient and column norms
// are dot products of it, and a step is a QR of its copy with √Λ below. The model stays when a
// candidate is evaluated with Jacobians and then refused.

// The defaults of ceres::Solver::Options, and of its strategy.
constexpr int kMaxIterations = 50;
constexpr int kMaxInvalidSteps = 5;
constexpr double kFunctionTolerance = 1e-6;
constexpr double kGradientTolerance = 1e-10;
constexpr double kParameterTolerance = 1e-8;
constexpr double kMinRelativeDecrease = 1e-3;
constexpr double kInitialRadius = 1e4;
constexpr double kMaxRadius = 1e32;
constexpr double kMinRadius = 1e-32;
constexpr double kMinDiagonal = 1e-6;
constexpr double kMaxDiagonal = 1e32;
// Of the cost: a step that promises more is taken most likely, one that promises less may end it.
constexpr double kLargePromise = 10.0 * kFunctionTolerance;
// Of the cost: a step that promises less leads to where the variable stays most likely, four times
// of five on Ladybug-49, nine times of ten on a simulated street. From there the next group begins,
// and the next iteration: the Jacobians of all variables of its factors are computed and kept.
constexpr double kLastPromise = 0.1;

// Sightings from the one that is evaluated to the one whose memory is asked for. Factors of a
// variable lie apart where they are stored by another one, and their cost functions anywhere.
constexpr int kAhead = 8;

}  // namespace

BlockMinimizer::BlockMinimizer(CeresRules rules, bool asks_as_ceres, const Sighting* last,
                               Evaluator* evaluator)
    : last_(last),
      evaluator_(*evaluator),
      graph_(evaluator->graph()),
      infinite_cost_is_failure_(rules == CeresRules::k22),
      asks_as_ceres_(asks_as_ceres) {
  constant_.kind = TangentMap::Kind::kConstant;
  unwanted_.kind = TangentMap::Kind::kUnwanted;
}

// Nothing of the variable before is left but memory.
void BlockMinimizer::Take(VariableId id, const Sighting* begin, const Sighting* end) {
  id_ = id;
  begin_ = begin;
  end_ = end;
  size_ = graph_.TangentSize(id);
  num_rows_ = 0;
  int num_slots = 0;
  for (const Sighting* s = begin; s != end; ++s) {
    num_rows_ += graph_.family(s->family).residual_size();
    num_slots = std::max(num_slots, graph_.family(s->family).num_slots());
  }
  // As many as the widest family has slots; of views only the variable's own is set.
  views_.resize(num_slots);
  maps_.resize(num_slots);
  values_ = evaluator_.points().mutable_candidate().data() + graph_.StateOffset(id);
  current_.assign(values_, values_ + graph_.AmbientSize(id));
  best_ = current_;
  tangent_.Set(graph_, id, /*wanted=*/true);
  // Zeros in the padding, which evaluations leave alone.
  rows_.assign(static_cast<std::size_t>(num_rows_) * PadToQuad(size_), 0.0);
  f_.resize(num_rows_);
  scale_.assign(size_, 0.0);
  step_.resize(size_);
  scratch_.resize(2 * static_cast<std::size_t>(size_) + 1);
  state_norm_ = -1.0;
  radius_ = kInitialRadius;
  decrease_factor_ = 2.0;
}

void BlockMinimizer::Minimize(VariableId id, const Sighting* begin, const Sighting* end) {
  Take(id, begin, end);
  bool goes_on = Linearize(Asked::kOwnJacobians);
  best_cost_ = cost_;
  bool successful = true;
  int num_invalid = 0;
  for (int iteration = 0; goes_on; ++iteration) {
    // Values count once there are Jacobians at them, as in Ceres.
    if (successful && cost_ < best_cost_) {
      best_cost_ = cost_;
      best_ = current_;
    }
    // Ceres's order: iterations, radius, and the gradient only after a step that was taken.
    if (iteration >= kMaxIterations || radius_ <= kMinRadius ||
        (successful && ProjectedGradientIsSmall())) {
      break;
    }
    successful = false;
    if (ComputeStep()) {
      num_invalid = 0;
      goes_on = TryStep(&successful);
    } else {
      goes_on = ++num_invalid < kMaxInvalidSteps;
      ShrinkRadius();
    }
  }
  // The candidate has been moved by trials and by the test of the gradient.
  std::copy(best_.begin(), best_.end(), values_);
}

void BlockMinimizer::ShrinkRadius() {
  radius_ /= decrease_factor_;
  decrease_factor_ *= 2.0;
}

// The model at the current values, which the candidate has. False if they cannot be evaluated.
bool BlockMinimizer::Linearize(Asked asked) {
  if (!EvaluateJacobians(asked, current_, &cost_)) {
    return false;
  }
  FormColumns();
  return true;
}

// Of the values x, which the candidate has. The model stays.
bool BlockMinimizer::EvaluateJacobians(Asked asked, const std::vector<double>& x, double* cost) {
  tangent_.MarkMoved();
  return tangent_.Refresh(graph_, id_, x.data()) == nullptr && Evaluate(asked, cost);
}

// Factor by factor, in the order of the sightings: the cost has one order of sums.
bool BlockMinimizer::Evaluate(Asked asked, double* cost) {
  const bool jacobians = asked != Asked::kCosts;
  *cost = 0.0;
  int row = 0;
  for (const Sighting* s = begin_; s != end_; ++s) {
    Linearization& factors = evaluator_.families()[s->family];
    FactorBatch batch = factors.CandidateBatch(s->factor, s->factor + 1);
    if (last_ - s > kAhead && s[kAhead].family == s->family) {
      batch.next = s[kAhead].factor;  // of the next variable, near the end of this one's
    }
    if (jacobians) {
      AskForJacobians(asked, *s, row, &batch);
    }
    if (factors.family->Evaluate(batch).failed() || !Robustify(*s, row, jacobians, cost)) {
      return false;
    }
    row += factors.residual_size;
  }
  // A release of Ceres from 2.2 on counts a cost that is not finite as a failed evaluation; 2.1
  // goes on with it.
  return std::isfinite(*cost) || !infinite_cost_is_failure_;
}

// Those of the variable are written; others' are computed, to be kept, or count as constants.
void BlockMinimizer::AskForJacobians(Asked asked, const Sighting& sighting, int row,
                                     FactorBatch* batch) {
  const Linearization& factors = evaluator_.families()[sighting.family];
  const std::ptrdiff_t entry = factors.Entry(sighting.factor);
  const bool all = asked == Asked::kAllJacobians && batch->kept != nullptr;
  for (int s = 0; s < factors.num_slots; ++s) {
    const bool moves = all && factors.tangent_maps[entry + s]->kind != TangentMap::Kind::kConstant;
    maps_[s] = moves ? &unwanted_ : &constant_;
  }
  maps_[sighting.slot] = &tangent_.map();
  // The table pretends to begin where the maps of factor 0 would be. That address is a number only.
  batch->tangent_maps = AddressBefore(entry, maps_.data());
  // A factor stride of 0: a batch of one, whatever the factor's place.
  const int stride = PadToQuad(size_);
  views_[sighting.slot] = {rows_.data() + std::ptrdiff_t{row} * stride, 0, stride};
  batch->jacobians = views_.data();
}

// Adds the cost of a factor; with Jacobians its rows become those of plain least squares. False if
// its loss has none.
bool BlockMinimizer::Robustify(const Sighting& sighting, int row, bool jacobians, double* cost) {
  Linearization& factors = evaluator_.families()[sighting.family];
  const int rows = factors.residual_size;
  // The evaluator's column of residuals of the candidate: after the round they are evaluated anew.
  double* f = factors.candidate_residuals.data() + std::ptrdiff_t{sighting.factor} * rows;
  const Loss* const loss = graph_.loss(sighting.family, sighting.factor);
  const LossValue value(loss, f, rows);
  *cost += value.cost();
  if (!jacobians || !value.HasRoot()) {
    return !jacobians;
  }
  if (loss != nullptr) {
    constexpr std::int32_t kHasJacobian = 0;
    const int stride = PadToQuad(size_);
    const SlotJacobians J = {rows_.data() + static_cast<std::ptrdiff_t>(row) * stride, 0, stride,
                             size_};
    RobustifyFactor(value, rows, 1, &J, 0, &kHasJacobian, LossCurvature::kPositive, f);
  }
  WithConstantSize(rows, [&](auto size) { std::copy_n(f, size, f_.begin() + row); });
  return true;
}

// [J f] by columns, and of it the products that give gradient and column norms.
void BlockMinimizer::FormColumns() {
  // One stride for J, f and the rows of √Λ below.
  const int stride = DampedColumnStride(num_rows_, size_);
  columns_.assign(static_cast<std::size_t>(size_ + 1) * stride, 0.0);
  BestKernels().rows_to_columns(num_rows_, size_, rows_.data(), PadToQuad(size_), columns_.data(),
                                stride);
  std::copy(f_.begin(), f_.end(), columns_.begin() + static_cast<std::ptrdiff_t>(size_) * stride);
  // Rows k < size: −JᵀJ; row size: −fᵀJ, the negative gradient.
  H_.assign(static_cast<std::size_t>(size_ + 1) * size_, 0.0);
  BestKernels().subtract_row_dots(size_ + 1, size_, PadToQuad(num_rows_), columns_.data(), stride,
                                  columns_.data(), stride, H_.data(), size_);
  // Scales of columns are measured at the start and then kept, as with jacobi_scaling.
  if (scale_.front() == 0.0) {  // this is the start
    for (int k = 0; k < size_; ++k) {
      scale_[k] = 1.0 / (1.0 + std::sqrt(-H_[k * (size_ + 1)]));
    }
  }
}

// The candidate's values := current ⊞ step, within bounds.
bool BlockMinimizer::MoveFromCurrent(const double* step) {
  if (!MoveVariable(graph_, id_, current_.data(), step, values_)) {
    return false;
  }
  if (const VariableBounds* bounds = graph_.bounds(id_)) {
    ClampToBounds(*bounds, values_);
  }
  return true;
}

// Whether x ⊞ −g is where x is; true too if there is no such point, for nothing more is to be done.
// As x ⊞ −g − x in the ambient space, with bounds: the projected gradient.
bool BlockMinimizer::ProjectedGradientIsSmall() {
  const double* gradient = H_.data() + static_cast<std::ptrdiff_t>(size_) * size_;  // −g
  if (!MoveFromCurrent(gradient)) {
    return true;
  }
  double largest = 0.0;
  for (std::size_t k = 0; k < current_.size(); ++k) {
    largest = std::max(largest, std::fabs(current_[k] - values_[k]));
  }
  return largest <= kGradientTolerance;
}

// False if the step is invalid.
// Several dampings may follow on one model: the columns are copied.
bool BlockMinimizer::ComputeStep() {
  reflected_ = columns_;
  const int stride = DampedColumnStride(num_rows_, size_);
  for (int k = 0; k < size_; ++k) {
    const double s2 = scale_[k] * scale_[k];
    const double squared_norm = -H_[k * (size_ + 1)];
    // Λ_j = clamp(s_j² H_jj) / (r s_j²), as LevenbergMarquardt has it.
    const double damping =
        std::clamp(s2 * squared_norm, kMinDiagonal, kMaxDiagonal) / (radius_ * s2);
    reflected_[static_cast<std::size_t>(k) * stride + num_rows_ + k] = std::sqrt(damping);
  }
  // A column without rank gives infinity or NaN, seen below.
  SolveDampedColumns(num_rows_, size_, reflected_.data(), scratch_.data(), step_.data());
  if (!std::all_of(step_.begin(), step_.end(), [](double entry) { return std::isfinite(entry); })) {
    return false;
  }
  // From the rows, not from H: near the minimum its sign decides.
  model_decrease_ =
      BestKernels()
          .column_products(PadToQuad(num_rows_), size_, columns_.data(), stride, step_.data())
          .model_decrease;
  return model_decrease_ > 0.0;
}

// The cost of the candidate, with Jacobians where a step that promises much will be taken most
// likely; whether there are some.
bool BlockMinimizer::EvaluateCandidate(double* cost) {
  if (!MoveFromCurrent(step_.data())) {
    *cost = std::numeric_limits<double>::max();
    return false;
  }
  candidate_.assign(values_, values_ + current_.size());
  // Saves the second evaluation of a step that is taken; where Jacobians fail the cost alone
  // decides. Ceres asks for the Jacobians of a step once it is taken.
  if (!asks_as_ceres_ && model_decrease_ > kLargePromise * cost_) {
    const bool is_last = model_decrease_ < kLastPromise * cost_;
    if (EvaluateJacobians(is_last ? Asked::kAllJacobians : Asked::kOwnJacobians, candidate_,
                          cost)) {
      return true;
    }
  }
  if (!Evaluate(Asked::kCosts, cost)) {
    *cost = std::numeric_limits<double>::max();
  }
  return false;
}

// Takes the step or refuses it; false if that was the last one.
bool BlockMinimizer::TryStep(bool* successful) {
  double candidate_cost = 0.0;
  const bool has_jacobians = EvaluateCandidate(&candidate_cost);
  // In the ambient space, after clamping, as Ceres measures it.
  double squared_length = 0.0;
  for (std::size_t k = 0; k < current_.size(); ++k) {
    squared_length += (values_[k] - current_[k]) * (values_[k] - current_[k]);
  }
  const double change = cost_ - candidate_cost;
  // written so that a NaN ends it
  if (std::sqrt(squared_length) <= kParameterTolerance * (state_norm_ + kParameterTolerance) ||
      !(std::fabs(change) > kFunctionTolerance * cost_)) {
    return false;
  }
  const double quality = change / model_decrease_;
  if (!(quality > kMinRelativeDecrease)) {
    ShrinkRadius();
    return true;
  }
  current_.assign(values_, values_ + current_.size());
  // Before the first accepted step it is −1, so that the test of the parameters is not reached.
  state_norm_ =
      std::sqrt(std::inner_product(current_.begin(), current_.end(), current_.begin(), 0.0));
  if (has_jacobians) {
    cost_ = candidate_cost;
    FormColumns();
  } else if (!Linearize(Asked::kAllJacobians)) {
    return false;
  }
  *successful = true;
  // Nielsen's rule, as in the outer loop.
  radius_ =
      std::min(kMaxRadius, radius_ / std::max(1.0 / 3.0, 1.0 - std::pow(2.0 * quality - 1.0, 3)));
  decrease_factor_ = 2.0;
  return true;
}

}  // namespace inceres::internal
