#include "schur/inner_iterations.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>
#include <utility>

#include "base/counting_sort.h"
#include "linear/small_cholesky.h"

namespace inceres::internal {

// Landmark refinement of the batch mode (docs/algorithms.md, "Landmark refinement"; Jeong et al.
// 2012, embedded point iterations). With the frames of the candidate held, each landmark takes one
// damped step δ_l = −(P + λD)⁻¹ g of its own and keeps it if the cost of its factors falls.
// One round is two evaluations: with the landmarks' Jacobians for those that are asked, and
// residuals alone for those that have moved. Between the two every landmark is independent, so
// tasks share nothing, and sums over landmarks are made in their order.
//
// Kept between calls: λ of each landmark, what each gained last time, and how long to rest. A round
// costs about as much as a fifth of an iteration, so who is asked, and when, is decided by what
// earlier rounds and a sample have gained against the step of the frames.
//
// The candidate's residuals are overwritten, and corrected for the losses in place: they are worth
// nothing after a Run. A residual or cost that is not a number makes a landmark stay where it is.

namespace {

constexpr int kLandmarkGrain = 64;
constexpr int kFactorGrain = 1024;
constexpr double kInitialDamping = 1e-6;
constexpr double kMinDamping = 1e-10;
constexpr double kMaxDamping = 1e3;
constexpr double kDampingFactor = 10.0;
// Of the step's gain: a run takes a fifth of an iteration. Points that creep gain 0.2 to 0.8, those
// of a window 0.01 to 0.06.
constexpr double kWorthwhileShare = 0.1;
// Steps creep when they gain more than this share of what the one before gained.
constexpr double kCreepShare = 0.2;
// Of the mean gain of all landmarks: one that gained more is asked again. On Ladybug-49 one in 120,
// with 0.999 of the gain.
constexpr double kChosenShare = 0.1;
// One landmark in so many is asked first, where that makes a sample from which the gain of all can
// be told.
constexpr int kSampleStride = 8;
constexpr int kMinSample = 128;

// A loss that is bounded may have a value where the residual is not a number.
double CostOf(const LossValue& loss) {
  return std::isnan(loss.s) ? loss.s : loss.cost();
}

// Whether landmarks that gain this much are asked again after a step that gained so much.
bool IsWorthwhile(double gain, double step_gain) {
  return gain > 0.0 && gain >= kWorthwhileShare * step_gain;
}

}  // namespace

InnerIterations::InnerIterations(Evaluator* evaluator)
    : evaluator_(*evaluator),
      layout_(evaluator->layout()),
      kernels_(BestKernels()),
      identity_(kQuad + 1),
      jacobians_(evaluator->families().size()) {
  // A factor's slots get one of three maps: constant, of no interest, or the identity of the
  // landmark's size, which makes the family yield the Jacobian in the landmark's own coordinates.
  constant_.kind = TangentMap::Kind::kConstant;
  unwanted_.kind = TangentMap::Kind::kUnwanted;
  for (int size = 0; size <= kQuad; ++size) {
    identity_[size].ambient_size = identity_[size].tangent_size = size;
  }
  const std::vector<SlotUse> uses = FindUses();
  for (const Linearization& cache : evaluator_.families()) {
    BuildJacobians(uses, cache);
  }
  BuildGroups();
  // At first nearly Gauss–Newton, and all landmarks are asked.
  damping_.assign(layout_.num_landmarks(), kInitialDamping);
  trials_.resize(layout_.num_landmarks());
  chosen_.assign(layout_.num_landmarks(), true);
}

// For each variable what an evaluation yields for it, and which landmark it is, or -1. Of frames,
// and of landmarks that a plain sum of vectors would lead off their manifold or out of bounds, no
// Jacobian is wanted; what is not part of the solve is held.
std::vector<InnerIterations::SlotUse> InnerIterations::FindUses() const {
  const FactorGraph& graph = evaluator_.graph();
  std::vector<SlotUse> uses(graph.num_variables(), {&constant_, -1});
  for (const VariableId id : layout_.variables) {
    const int landmark = layout_.LandmarkOf(id);
    const bool moves =
        landmark >= 0 && graph.manifold(id) == nullptr && graph.bounds(id) == nullptr;
    uses[id] =
        moves ? SlotUse{&identity_[graph.TangentSize(id)], landmark} : SlotUse{&unwanted_, -1};
  }
  return uses;
}

void InnerIterations::BuildJacobians(const std::vector<SlotUse>& uses, const Linearization& cache) {
  LandmarkJacobians& jacobians = jacobians_[cache.id];
  jacobians.maps.reserve(std::size_t(cache.num_factors) * cache.num_slots);
  jacobians.landmarks.reserve(cache.num_factors);
  bool any = false;
  for (int i = 0; i < cache.num_factors; ++i) {
    const VariableId* ids = evaluator_.graph().Variables(cache.id, i);
    int landmark = -1;
    for (int s = 0; s < cache.num_slots; ++s) {
      // A free place has no variables.
      const SlotUse use = ids[s] < 0 ? SlotUse{&constant_, -1} : uses[ids[s]];
      jacobians.maps.push_back(use.map);
      landmark = std::max(landmark, use.landmark);  // of a factor one slot at most has one
    }
    jacobians.landmarks.push_back(landmark);
    any = any || landmark >= 0;
  }
  const std::ptrdiff_t factor_stride = std::ptrdiff_t{cache.residual_size} * kQuad;
  // One Jacobian a factor, rows four apart: at most one of its slots writes there.
  jacobians.values = ZeroedArray(any ? cache.num_factors * factor_stride : 0);
  jacobians.views.assign(cache.num_slots, {jacobians.values.data(), factor_stride, kQuad});
  jacobians.blocks = {jacobians.values.data(), factor_stride, kQuad, kQuad};
}

// By landmark, of each by family, of each ascending.
void InnerIterations::BuildGroups() {
  struct Sighting {
    FamilyId family;
    std::int32_t factor;
  };
  const auto for_each_sighting = [this](const auto& visit) {
    for (const LandmarkJacobians& jacobians : jacobians_) {
      for (std::size_t i = 0; i < jacobians.landmarks.size(); ++i) {
        if (jacobians.landmarks[i] >= 0) {
          visit(jacobians.landmarks[i],
                Sighting{static_cast<FamilyId>(&jacobians - jacobians_.data()),
                         static_cast<std::int32_t>(i)});
        }
      }
    }
  };
  std::vector<int> begin;
  std::vector<Sighting> sightings;
  CountingSort(layout_.num_landmarks(), for_each_sighting, &begin, &sightings);
  sightings_.reserve(sightings.size());
  groups_begin_.push_back(0);
  for (int landmark = 0; landmark < layout_.num_landmarks(); ++landmark) {
    for (int k = begin[landmark]; k < begin[landmark + 1]; ++k) {
      const auto [family, factor] = sightings[k];
      if (k == begin[landmark] || family != groups_.back().family) {
        groups_.push_back({family, k, k});
      }
      ++groups_.back().end;
      sightings_.push_back(factor);
    }
    groups_begin_.push_back(static_cast<int>(groups_.size()));
  }
}

bool InnerIterations::IsDue(double step_gain) {
  // A step that went uphill is refused: the next one is held against the last that gained, for any
  // gain is more than a share of a loss.
  if (!(step_gain > 0.0)) {
    return false;
  }
  // The gain of the step before is taken down in any case, also where the landmarks rest.
  const bool creeps = step_gain > kCreepShare * std::exchange(last_step_gain_, step_gain);
  // A step that does not creep does not count as one of the rest.
  return creeps && (to_go_ == 0 || to_go_-- == 0);
}

void InnerIterations::Pace(double gain, double step_gain) {
  const bool worthwhile = IsWorthwhile(gain, step_gain);
  const bool all_were_asked = std::exchange(all_are_chosen_, !worthwhile);
  // Below zero where it was not worth it: then all are chosen, for a gain is never negative.
  const double min_gain = worthwhile ? kChosenShare * gain / layout_.num_landmarks() : -1.0;
  std::transform(trials_.begin(), trials_.end(), chosen_.begin(),
                 [min_gain](const Trial& trial) { return trial.gain > min_gain; });
  // A rest follows only where all were asked: a few that gained little may have been the wrong few.
  rest_ = worthwhile || !all_were_asked ? 0 : std::max(1, 2 * rest_);
  to_go_ = rest_;
}

double InnerIterations::Run(double min_gain, double step_gain) {
  const int num_landmarks = layout_.num_landmarks();
  for (Trial& trial : trials_) {
    // Of landmarks that are not asked this time, too.
    trial.gain = 0.0;
  }
  // The families read and write the candidate from here on.
  evaluator_.points().PointTo(/*candidate=*/true);
  // Where all would be asked, and there are enough for a sample to say something: every eighth
  // first.
  const bool samples =
      all_are_chosen_ && step_gain > 0.0 && num_landmarks >= kSampleStride * kMinSample;
  if (samples) {
    for (int l = 0; l < num_landmarks; ++l) {
      chosen_[l] = l % kSampleStride == next_sample_;
    }
    // Another eighth next time, so that none is never asked.
    next_sample_ = (next_sample_ + 1) % kSampleStride;
  }
  RunChosen(min_gain);
  // The sample's gain, scaled up, tells what all would gain: then the other seven eighths follow.
  if (samples && IsWorthwhile(kSampleStride * SumOfGains(), step_gain)) {
    std::transform(chosen_.begin(), chosen_.end(), chosen_.begin(),
                   [](char chosen) { return static_cast<char>(chosen == 0); });
    RunChosen(min_gain);
  }
  num_moved_ = static_cast<int>(
      std::count_if(trials_.begin(), trials_.end(), [](const Trial& t) { return t.gain > 0.0; }));
  return SumOfGains();
}

// In the order of the landmarks: the same bits for any number of threads.
double InnerIterations::SumOfGains() const {
  return std::accumulate(trials_.begin(), trials_.end(), 0.0,
                         [](double sum, const Trial& trial) { return sum + trial.gain; });
}

void InnerIterations::RunChosen(double min_gain) {
  const Executor& executor = evaluator_.executor();
  const int num_landmarks = layout_.num_landmarks();
  // Residuals and Jacobians at the candidate, then a step for each landmark.
  Evaluate(/*jacobians=*/true, [this](int landmark) { return landmark >= 0 && chosen_[landmark]; });
  executor.For(num_landmarks, kLandmarkGrain, [&](int begin, int end) {
    for (int l = begin; l < end; ++l) {
      Propose(l, min_gain);
    }
  });
  // Residuals where the landmarks have gone to; those that did not move are not evaluated again.
  Evaluate(/*jacobians=*/false,
           [this](int landmark) { return landmark >= 0 && trials_[landmark].moves; });
  executor.For(num_landmarks, kLandmarkGrain, [&](int begin, int end) {
    for (int l = begin; l < end; ++l) {
      Judge(l);
    }
  });
}

// The factors whose landmark is selected, at the candidate, run by run.
template <typename Selected>
void InnerIterations::Evaluate(bool jacobians, const Selected& selected) {
  for (const Linearization& cache : evaluator_.families()) {
    const std::vector<std::int32_t>& landmarks = jacobians_[cache.id].landmarks;
    evaluator_.executor().For(static_cast<int>(landmarks.size()), kFactorGrain,
                              [&](int begin, int end) {
                                for (int i = begin; i < end;) {
                                  if (!selected(landmarks[i])) {
                                    ++i;
                                    continue;
                                  }
                                  // Neighbors are evaluated in one call. How they are cut into
                                  // tasks does not change the values.
                                  const int first = i;
                                  while (i < end && selected(landmarks[i])) {
                                    ++i;
                                  }
                                  EvaluateRun(cache.id, first, i, jacobians);
                                }
                              });
  }
}

// A factor that cannot be evaluated gets a residual that is not a number: its landmark will stay.
void InnerIterations::EvaluateRun(FamilyId family, int begin, int end, bool jacobians) {
  Linearization& cache = evaluator_.families()[family];
  FactorBatch batch = cache.CandidateBatch(begin, end);  // Run has pointed the parameters there
  if (jacobians) {
    batch.tangent_maps = jacobians_[family].maps.data();
    batch.jacobians = jacobians_[family].views.data();
  }
  const EvaluationFailure failure = cache.family->Evaluate(batch);
  if (!failure.failed()) {
    return;
  }
  // The factor at fault is found by evaluating one at a time; the others of the batch are right
  // then.
  if (end == begin + 1) {
    const int rows = cache.residual_size;
    std::fill_n(cache.candidate_residuals.data() + std::ptrdiff_t{begin} * rows, rows,
                std::numeric_limits<double>::quiet_NaN());
    return;
  }
  for (int i = begin; i < end; ++i) {  // of such a batch nothing counts
    EvaluateRun(family, i, i + 1, jacobians);
  }
}

double* InnerIterations::Values(int landmark) {
  const VariableId id = layout_.variables[layout_.num_frames + landmark];
  return evaluator_.points().mutable_candidate().data() + evaluator_.graph().StateOffset(id);
}

// Moves the landmark if its step promises enough.
void InnerIterations::Propose(int landmark, double min_gain) {
  Trial& trial = trials_[landmark];
  trial.moves = false;
  if (!chosen_[landmark]) {
    return;
  }
  NormalEquations equations;
  const int size = layout_.TangentSize(layout_.num_frames + landmark);
  for (int k = groups_begin_[landmark]; k < groups_begin_[landmark + 1]; ++k) {
    // By family and in ascending order: one order of the sums.
    Accumulate(groups_[k], size, &equations);
  }
  double scaled[kQuad];
  double U_inv[kQuad * kQuad];
  double z[kQuad];
  double step[kQuad];
  for (int k = 0; k < size; ++k) {
    scaled[k] = damping_[landmark] * LandmarkDampingScale(equations.P[k * kQuad + k]);
  }
  // Its factors do not determine it, or P is not finite: it stays.
  if (!InvertCholeskyFactor(size, equations.P, scaled, U_inv)) {
    return;
  }
  // z = U_inv η and δ = U_invᵀ z, so that zᵀz = gᵀ(P + Λ)⁻¹g.
  MultiplyLower(size, U_inv, equations.eta, z);
  MultiplyLowerTransposed(size, U_inv, z, step);
  // gᵀ(P + Λ)⁻¹g is at most twice what the model promises.
  if (!(0.5 * std::inner_product(z, z + size, z, 0.0) > min_gain)) {
    return;
  }
  // The cost before is that of the evaluation with Jacobians: of the same factors in the same order
  // as Judge sums them, so that the difference is one of like sums.
  trial.moves = true;
  trial.cost = equations.cost;
  double* x = Values(landmark);
  std::copy_n(x, size, trial.start);
  // ⊞ of a vector space: landmarks on a manifold were left out.
  std::transform(x, x + size, step, x, std::plus<>());
}

// Puts a landmark back that has not gained; one whose cost is not a number has not.
void InnerIterations::Judge(int landmark) {
  Trial& trial = trials_[landmark];
  if (!trial.moves) {
    return;
  }
  const double gain = trial.cost - Cost(landmark);
  // NaN compares false and counts as a failure.
  if (gain > 0.0) {
    damping_[landmark] = std::max(kMinDamping, damping_[landmark] / kDampingFactor);
    trial.gain = gain;
    return;
  }
  damping_[landmark] = std::min(kMaxDamping, damping_[landmark] * kDampingFactor);
  // The values themselves, bit by bit, and not the step taken back.
  std::copy_n(trial.start, layout_.TangentSize(layout_.num_frames + landmark), Values(landmark));
}

void InnerIterations::Accumulate(const Group& group, int size, NormalEquations* equations) {
  const Linearization& cache = evaluator_.families()[group.family];
  const SlotJacobians& blocks = jacobians_[group.family].blocks;
  const int rows = cache.residual_size;
  // One slot that all of these factors have: the shared memory of the landmark's Jacobian.
  constexpr std::int32_t kHasJacobian = 0;
  for (int k = group.begin; k < group.end; ++k) {
    const std::int32_t factor = sightings_[k];
    double* f = cache.candidate_residuals.data() + std::ptrdiff_t{factor} * rows;
    const LossValue loss(cache.graph->loss(cache.id, factor), f, rows);
    equations->cost += CostOf(loss);
    // First order in the loss: LossCurvature::kNone leaves P = Σ ρ' J_lᵀJ_l, which is never
    // indefinite.
    RobustifyFactor(loss, rows, 1, &blocks, factor, &kHasJacobian, LossCurvature::kNone, f);
  }
  LandmarkFactors factors;
  factors.factors = sightings_.data() + group.begin;
  factors.count = group.end - group.begin;
  factors.residual_size = rows;
  factors.jacobians = &blocks;
  factors.residuals = cache.candidate_residuals.data();
  // The kernel reads one slot and the residuals; frames do not come in.
  kernels_.landmark_gram(size, factors, equations->P, equations->eta);
}

double InnerIterations::Cost(int landmark) const {
  double cost = 0.0;
  for (int k = groups_begin_[landmark]; k < groups_begin_[landmark + 1]; ++k) {
    const Linearization& cache = evaluator_.families()[groups_[k].family];
    const int rows = cache.residual_size;
    for (int at = groups_[k].begin; at < groups_[k].end; ++at) {
      const double* f = cache.candidate_residuals.data() + std::ptrdiff_t{sightings_[at]} * rows;
      cost += CostOf(LossValue(cache.graph->loss(cache.id, sightings_[at]), f, rows));
    }
  }
  return cost;
}

std::int64_t InnerIterations::Bytes() const {
  std::int64_t bytes = static_cast<std::int64_t>(
      groups_.size() * sizeof(Group) + sightings_.size() * sizeof(std::int32_t) +
      (sizeof(double) + sizeof(Trial) + sizeof(char)) * trials_.size());
  for (const LandmarkJacobians& jacobians : jacobians_) {
    bytes += static_cast<std::int64_t>(jacobians.values.size() * sizeof(double) +
                                       jacobians.maps.size() * sizeof(void*) +
                                       jacobians.landmarks.size() * sizeof(std::int32_t));
  }
  return bytes;
}

}  // namespace inceres::internal
