#include "schur/inner_iterations.h"

#include <algorithm>
#include <functional>
#include <limits>
#include <numeric>

#include "linearisation/robustify.h"
#include "schur/landmark_factor.h"

namespace inceres::internal {
namespace {

constexpr int kLandmarkGrain = 64;
constexpr double kInitialDamping = 1e-6;
constexpr double kMinDamping = 1e-10;
constexpr double kMaxDamping = 1e3;
constexpr double kDampingFactor = 10.0;
// Of the step's gain: a run takes a fifth of an iteration. Points that creep gain 0.2 to 0.8, those of a window 0.01 to 0.06.
constexpr double kWorthwhileShare = 0.1;

}  // namespace

InnerIterations::InnerIterations(Evaluator* evaluator)
    : evaluator_(*evaluator), layout_(evaluator->layout()), identity_(kQuad + 1), jacobians_(evaluator->families().size()) {
  constant_.kind = TangentMap::Kind::kConstant;
  unwanted_.kind = TangentMap::Kind::kUnwanted;
  for (int size = 0; size <= kQuad; ++size) {
    identity_[size].ambient_size = identity_[size].tangent_size = size;
  }
  for (const FamilyCache& cache : evaluator_.families()) {
    BuildJacobians(cache);
  }
  BuildStretches();
  damping_.assign(layout_.num_landmarks(), kInitialDamping);
  gains_.resize(layout_.num_landmarks());
}

void InnerIterations::BuildJacobians(const FamilyCache& cache) {
  const FactorGraph& graph = evaluator_.graph();
  const int num_slots = cache.family->num_slots();
  LandmarkJacobians& jacobians = jacobians_[cache.id];
  jacobians.maps.resize(std::size_t(cache.num_factors) * num_slots);
  bool any = false;
  for (int i = 0; i < cache.num_factors; ++i) {
    for (int s = 0; s < num_slots; ++s) {
      const VariableId id = graph.Variables(cache.id, i)[s];
      const TangentMap*& map = jacobians.maps[std::size_t(i) * num_slots + s];
      if (layout_.Position(id) < 0) {
        map = &constant_;
      } else if (layout_.LandmarkOf(id) < 0 || graph.manifold(id) != nullptr || graph.bounds(id) != nullptr) {
        map = &unwanted_;
      } else {
        map = &identity_[graph.TangentSize(id)];
        any = true;
      }
    }
  }
  const std::ptrdiff_t factor_stride = std::ptrdiff_t{cache.family->residual_size()} * kQuad;
  jacobians.values.resize(any ? cache.num_factors * factor_stride : 0);
  jacobians.views.assign(num_slots, {jacobians.values.data(), factor_stride, kQuad});
}

void InnerIterations::BuildStretches() {
  std::vector<std::vector<Stretch>> of_landmark(layout_.num_landmarks());
  for (const FamilyCache& cache : evaluator_.families()) {
    const int num_slots = cache.family->num_slots();
    for (int i = 0; i < cache.num_factors; ++i) {
      const VariableId* variables = evaluator_.graph().Variables(cache.id, i);
      for (int s = 0; s < num_slots; ++s) {
        if (!jacobians_[cache.id].maps[std::size_t(i) * num_slots + s]->wanted()) {
          continue;
        }
        std::vector<Stretch>& stretches = of_landmark[layout_.LandmarkOf(variables[s])];
        if (!stretches.empty() && stretches.back().family == cache.id && stretches.back().end == i) {
          ++stretches.back().end;
        } else {
          stretches.push_back({cache.id, i, i + 1});
        }
      }
    }
  }
  stretches_begin_.push_back(0);
  for (const std::vector<Stretch>& stretches : of_landmark) {
    stretches_.insert(stretches_.end(), stretches.begin(), stretches.end());
    stretches_begin_.push_back(static_cast<int>(stretches_.size()));
  }
}

bool InnerIterations::IsDue() {
  return to_go_ == 0 || to_go_-- == 0;
}

void InnerIterations::Pace(double gain, double step_gain) {
  rest_ = gain < kWorthwhileShare * step_gain ? std::max(1, 2 * rest_) : 0;
  to_go_ = rest_;
}

double InnerIterations::Run(double min_gain) {
  evaluator_.PointToCandidate();
  evaluator_.executor().For(layout_.num_landmarks(), kLandmarkGrain, [&](int begin, int end) {
    for (int l = begin; l < end; ++l) {
      gains_[l] = Improve(l, min_gain);
    }
  });
  num_moved_ = static_cast<int>(std::count_if(gains_.begin(), gains_.end(), [](double gain) { return gain > 0.0; }));
  return std::accumulate(gains_.begin(), gains_.end(), 0.0);
}

double InnerIterations::Improve(int landmark, double min_gain) {
  NormalEquations equations;
  if (!Linearise(landmark, &equations)) {
    return 0.0;
  }
  const int position = layout_.num_frames + landmark;
  const int size = layout_.TangentSize(position);
  double scaled[kQuad];
  double U_inv[kQuad * kQuad];
  double z[kQuad];
  double step[kQuad];  // of the other sign
  for (int k = 0; k < size; ++k) {
    scaled[k] = damping_[landmark] * equations.P[k * kQuad + k];
  }
  if (!InvertCholeskyFactor(size, equations.P, scaled, U_inv)) {
    return 0.0;
  }
  MultiplyLower(size, U_inv, equations.g, z);
  MultiplyLowerTransposed(size, U_inv, z, step);
  // gᵀ(P + Λ)⁻¹g is at most twice what the model promises.
  if (!(0.5 * std::inner_product(z, z + size, z, 0.0) > min_gain)) {
    return 0.0;
  }
  double* x = evaluator_.mutable_candidate().data() + evaluator_.graph().StateOffset(layout_.variables[position]);
  double before[kQuad];
  std::copy_n(x, size, before);
  std::transform(x, x + size, step, x, std::minus<>());
  const double gain = equations.cost - Cost(landmark);
  if (gain > 0.0) {
    damping_[landmark] = std::max(kMinDamping, damping_[landmark] / kDampingFactor);
    return gain;
  }
  damping_[landmark] = std::min(kMaxDamping, damping_[landmark] * kDampingFactor);
  std::copy_n(before, size, x);
  return 0.0;
}

bool InnerIterations::Evaluate(const Stretch& stretch, bool jacobians) {
  FamilyCache& cache = evaluator_.families()[stretch.family];
  FactorBatch batch;
  batch.begin = stretch.begin;
  batch.end = stretch.end;
  batch.parameters = cache.parameters.data();  // Run has pointed them to the candidate
  batch.residuals = cache.candidate_residuals.data();
  if (jacobians) {
    batch.tangent_maps = jacobians_[stretch.family].maps.data();
    batch.jacobians = jacobians_[stretch.family].views.data();
  }
  return !cache.family->Evaluate(batch).failed();
}

bool InnerIterations::Linearise(int landmark, NormalEquations* equations) {
  const int size = layout_.TangentSize(layout_.num_frames + landmark);
  for (int k = stretches_begin_[landmark]; k < stretches_begin_[landmark + 1]; ++k) {
    const Stretch& stretch = stretches_[k];
    if (!Evaluate(stretch, /*jacobians=*/true)) {
      return false;
    }
    for (int i = stretch.begin; i < stretch.end; ++i) {
      Accumulate(evaluator_.families()[stretch.family], i, size, equations);
    }
  }
  return true;
}

void InnerIterations::Accumulate(const FamilyCache& cache, int factor, int size, NormalEquations* equations) const {
  const int rows = cache.family->residual_size();
  const double* f = cache.candidate_residuals.data() + std::ptrdiff_t{factor} * rows;
  const Loss* loss = cache.has_losses ? evaluator_.graph().loss(cache.id, factor) : nullptr;
  const double s = std::inner_product(f, f + rows, f, 0.0);
  double rho[3] = {s, 1.0, 0.0};
  if (loss != nullptr) {
    loss->Evaluate(s, rho);
  }
  equations->cost += 0.5 * rho[0];
  const double* J = jacobians_[cache.id].values.data() + std::ptrdiff_t{factor} * rows * kQuad;
  for (int r = 0; r < rows; ++r, J += kQuad) {
    for (int a = 0; a < size; ++a) {
      const double weighted = rho[1] * J[a];
      equations->g[a] += weighted * f[r];
      for (int b = 0; b < size; ++b) {
        equations->P[a * kQuad + b] += weighted * J[b];
      }
    }
  }
}

// Infinite where a factor cannot be evaluated.
double InnerIterations::Cost(int landmark) {
  double cost = 0.0;
  for (int k = stretches_begin_[landmark]; k < stretches_begin_[landmark + 1]; ++k) {
    const Stretch& stretch = stretches_[k];
    if (!Evaluate(stretch, /*jacobians=*/false)) {
      return std::numeric_limits<double>::infinity();
    }
    const FamilyCache& cache = evaluator_.families()[stretch.family];
    const int rows = cache.family->residual_size();
    for (int i = stretch.begin; i < stretch.end; ++i) {
      const Loss* loss = cache.has_losses ? evaluator_.graph().loss(cache.id, i) : nullptr;
      cost += RobustCost(loss, cache.candidate_residuals.data() + std::ptrdiff_t{i} * rows, rows);
    }
  }
  return cost;
}

std::int64_t InnerIterations::Bytes() const {
  std::int64_t bytes = static_cast<std::int64_t>(stretches_.size() * sizeof(Stretch) + 2 * sizeof(double) * gains_.size());
  for (const LandmarkJacobians& jacobians : jacobians_) {
    bytes += static_cast<std::int64_t>(jacobians.values.size() * sizeof(double) + jacobians.maps.size() * sizeof(void*));
  }
  return bytes;
}

}  // namespace inceres::internal
