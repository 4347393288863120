#include "inceres/solver/incremental_solver.h"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "base/stopwatch.h"
#include "linear/envelope_cholesky.h"
#include "schur/live_system.h"

namespace inceres {

using internal::EnvelopeCholesky;
using internal::FactorRef;
using internal::LiveFamily;
using internal::LiveSchur;
using internal::LiveSystem;

namespace {

constexpr double kExact = 1e-20;         // squared error above which a Jacobian is not simply the current one
constexpr double kRefreshShare = 0.01;   // θ_c² / θ_r²: what convergence is allowed to rest on
constexpr double kWeightChange = 0.1;    // relative change of ρ' beyond which a factor's weight in H is renewed
constexpr double kTinyDiagonal = 1e-12;  // stands in for a diagonal entry of C that is zero

}  // namespace

Status IncrementalOptions::Validate() const {
  const auto fail = [](const char* field, double value, const char* rule) {
    std::ostringstream text;
    text << "IncrementalOptions::" << field << " = " << value << " but must be " << rule;
    return Status::Error(StatusCode::kInvalidArgument, text.str());
  };
  if (max_num_iterations < 0) {
    return fail("max_num_iterations", max_num_iterations, ">= 0");
  }
  if (!(max_seconds > 0.0)) {
    return fail("max_seconds", max_seconds, "> 0");
  }
  if (!(function_tolerance >= 0.0)) {
    return fail("function_tolerance", function_tolerance, ">= 0");
  }
  if (!(min_relative_decrease >= 0.0)) {
    return fail("min_relative_decrease", min_relative_decrease, ">= 0");
  }
  if (!(min_damping > 0.0)) {
    return fail("min_damping", min_damping, "> 0");
  }
  if (!(initial_damping >= min_damping)) {
    return fail("initial_damping", initial_damping, ">= min_damping");
  }
  if (!(max_damping >= initial_damping)) {
    return fail("max_damping", max_damping, ">= initial_damping");
  }
  if (!(relinearisation_share >= 0.0)) {
    return fail("relinearisation_share", relinearisation_share, ">= 0");
  }
  if (!(truncation_share >= 0.0)) {
    return fail("truncation_share", truncation_share, ">= 0");
  }
  return Status::Ok();
}

class IncrementalSolver::Impl {
 public:
  explicit Impl(const IncrementalOptions& options) : options_(options), mu_(options.initial_damping) { Restart(); }

  UpdateSummary Update();

  FactorGraph graph;
  std::unique_ptr<LiveSystem> live;

 private:
  void Restart();
  void Run(double start);
  bool Iterate();
  bool SolveFrames();
  void SelectActive();
  void CountTouched();
  void MarkStale();
  bool RefreshAll(double threshold);
  void Retreat();
  double StaleThreshold() const { return 2.0 * options_.function_tolerance * live->cost() / std::max(1, graph.num_factors()); }
  bool Finish(Termination termination, std::string message);

  IncrementalOptions options_;
  EnvelopeCholesky cholesky_;
  double mu_;
  double nu_ = 2.0;
  double factored_mu_ = -1.0;
  std::vector<double> damping_;
  std::vector<double> frame_step_;
  std::vector<std::int32_t> visited_;
  UpdateSummary summary_;
};

// A new system from the values held now: nothing cached survives.
void IncrementalSolver::Impl::Restart() {
  if (live != nullptr) {
    for (VariableId id = 0; id < live->values().num_variables(); ++id) {
      graph.SetValues(id, live->values().current(id));
    }
  }
  live = std::make_unique<LiveSystem>(graph);
  cholesky_ = EnvelopeCholesky();
  factored_mu_ = -1.0;
}

UpdateSummary IncrementalSolver::Impl::Update() {
  const double start = internal::NowInSeconds();
  summary_ = UpdateSummary();
  Status status = options_.Validate();
  if (status.ok()) {
    status = graph.Validate();
  }
  if (status.ok()) {
    live->TakeUpAdditions();
    mu_ = std::clamp(mu_, options_.min_damping, options_.initial_damping);
    nu_ = 2.0;
    Run(start);
  } else {
    Finish(Termination::kFailure, status.message);
  }
  summary_.final_cost = live->cost();
  const auto& landmarks = live->schur().landmarks();
  summary_.num_parked_landmarks =
      static_cast<int>(std::count_if(landmarks.begin(), landmarks.end(), [](const auto& landmark) { return landmark.parked; }));
  summary_.seconds = internal::NowInSeconds() - start;
  return summary_;
}

void IncrementalSolver::Impl::Run(double start) {
  for (bool first = true;; first = false) {
    summary_.num_relinearised_factors += live->NumDirtyFactors();
    const Status linearised = live->Relinearise(std::max(mu_, options_.min_damping));
    if (!linearised.ok()) {
      Finish(Termination::kFailure, linearised.message);
      Restart();
      return;
    }
    summary_.num_eliminated_landmarks += live->TakeNumEliminated();
    if (first) {
      summary_.initial_cost = live->cost();
    }
    if (summary_.num_iterations >= options_.max_num_iterations || internal::NowInSeconds() - start >= options_.max_seconds) {
      Finish(Termination::kNoConvergence, "Iteration or time limit reached.");
      return;
    }
    if (Iterate()) {
      return;
    }
  }
}

// One step from the current linearisation. True when the Update is over.
bool IncrementalSolver::Impl::Iterate() {
  ++summary_.num_iterations;
  double change = HUGE_VAL;
  double predicted = HUGE_VAL;
  bool accepted = false;
  if (SolveFrames()) {
    SelectActive();
    const bool evaluated = live->EvaluateStep(&change, &predicted).ok();
    CountTouched();
    const double ratio = evaluated && predicted > 0.0 ? -change / predicted : -1.0;
    accepted = ratio > options_.min_relative_decrease;
    if (accepted) {
      mu_ = std::max(options_.min_damping, mu_ * std::max(1.0 / 3.0, 1.0 - std::pow(2.0 * ratio - 1.0, 3)));
      nu_ = 2.0;
      live->AcceptValues();
      MarkStale();
      live->EndStep();
    } else {
      live->Reject();
    }
  }
  const double tolerance = options_.function_tolerance * live->cost();
  if (std::fabs(change) <= tolerance || predicted <= tolerance) {
    // Refresh before success.
    return RefreshAll(kRefreshShare * StaleThreshold()) ? false
                                                        : Finish(Termination::kConvergence, "Function tolerance reached.");
  }
  if (!accepted) {
    Retreat();
    return mu_ > options_.max_damping && Finish(Termination::kNoConvergence, "No step lowers the cost at the largest damping.");
  }
  return false;
}

// δ_c from (S + μ diag(C)) δ_c = b; the factor resumes at the first row that changed. False if there is no factor.
bool IncrementalSolver::Impl::SolveFrames() {
  LiveSchur& schur = live->schur();
  const std::vector<double>& C_diagonal = schur.FrameDiagonal();
  damping_.resize(C_diagonal.size());
  frame_step_.resize(C_diagonal.size());
  std::transform(C_diagonal.begin(), C_diagonal.end(), damping_.begin(),
                 [this](double entry) { return mu_ * std::max(entry, kTinyDiagonal); });
  const int touched = mu_ == factored_mu_ ? schur.TakeFirstChanged() : (schur.TakeFirstChanged(), 0);
  const int first = std::min(touched, cholesky_.num_valid_rows());
  const bool factored = cholesky_.Factorize(schur.S(), damping_.data(), first).ok();
  factored_mu_ = mu_;
  summary_.num_factored_rows += cholesky_.num_valid_rows() - first;
  if (factored) {
    cholesky_.Solve(schur.b().data(), frame_step_.data());
  }
  return factored;
}

// The active set (algorithms.md section 5): frames whose predicted gain counts, landmarks seen from them or with a gain of their
// own.
void IncrementalSolver::Impl::SelectActive() {
  const LiveSchur& schur = live->schur();
  const double budget = options_.truncation_share * options_.function_tolerance * live->cost();
  const double frame_budget = budget / std::max(1, static_cast<int>(schur.frames().size()));
  const double landmark_budget = budget / std::max(1, static_cast<int>(schur.landmarks().size()));
  for (int i = 0; i < static_cast<int>(schur.frames().size()); ++i) {
    const LiveSchur::Frame& frame = schur.frames()[i];
    const double* delta = frame_step_.data() + schur.FrameOffset(i);
    const double* diagonal = schur.FrameDiagonal().data() + schur.FrameOffset(i);
    double gain = 0.0;
    for (int k = 0; k < frame.size; ++k) {
      gain += delta[k] * delta[k] * diagonal[k] * (1.0 + mu_);
    }
    if (gain > frame_budget) {
      ++summary_.num_moved_frames;
      live->SetFrameStep(i, delta);
    }
  }
  visited_.clear();
  for (int l = 0; l < static_cast<int>(schur.landmarks().size()); ++l) {
    const LiveSchur::Landmark& landmark = schur.landmarks()[l];
    const bool near_motion = std::any_of(landmark.frames.begin(), landmark.frames.end(),
                                         [this](std::int32_t frame) { return live->FrameMoves(frame); });
    if (near_motion || landmark.decrement > landmark_budget) {
      visited_.push_back(l);
      live->Visit(l);
    }
  }
  summary_.num_visited_landmarks += static_cast<int>(visited_.size());
}

void IncrementalSolver::Impl::CountTouched() {
  live->ForEachTouched([this](FactorRef) { ++summary_.num_evaluated_factors; });
}

// Marks for relinearisation the touched factors whose old linearisation errs too much, or whose weight has changed.
void IncrementalSolver::Impl::MarkStale() {
  const double threshold = options_.relinearisation_share * StaleThreshold();
  live->ForEachTouched([&](FactorRef ref) {
    const LiveFamily& family = live->families()[ref.family];
    if (family.SquaredError(ref.factor) > threshold || std::fabs(family.WeightRatio(ref.factor) - 1.0) > kWeightChange) {
      live->MarkDirty(ref);
    }
  });
}

// Marks every factor whose old linearisation errs by more than the threshold. True if there are any.
bool IncrementalSolver::Impl::RefreshAll(double threshold) {
  bool any = false;
  for (const LiveFamily& family : live->families()) {
    for (std::int32_t i = 0; i < family.num_factors(); ++i) {
      if (family.SquaredError(i) > threshold) {
        live->MarkDirty({family.id(), i});
        any = true;
      }
    }
  }
  return any;
}

// A rejected step: with old Jacobians about it was perhaps their fault, so refresh before retreating; otherwise more damping,
// which the landmarks that would have moved take up too.
void IncrementalSolver::Impl::Retreat() {
  ++summary_.num_rejected_steps;
  if (RefreshAll(kExact)) {
    return;
  }
  mu_ *= nu_;
  nu_ *= 2.0;
  for (const std::int32_t landmark : visited_) {
    if (live->schur().landmarks()[landmark].lambda < mu_) {
      live->Redamp(landmark);
    }
  }
}

bool IncrementalSolver::Impl::Finish(Termination termination, std::string message) {
  summary_.termination = termination;
  summary_.message = std::move(message);
  return true;
}

IncrementalSolver::IncrementalSolver(const IncrementalOptions& options) : impl_(std::make_unique<Impl>(options)) {
}
IncrementalSolver::~IncrementalSolver() = default;

FactorGraph& IncrementalSolver::graph() {
  return impl_->graph;
}

const FactorGraph& IncrementalSolver::graph() const {
  return impl_->graph;
}

UpdateSummary IncrementalSolver::Update() {
  return impl_->Update();
}

const double* IncrementalSolver::Values(VariableId id) const {
  return id < impl_->live->values().num_variables() ? impl_->live->values().current(id) : impl_->graph.Values(id);
}

double IncrementalSolver::cost() const {
  return impl_->live->cost();
}

}  // namespace inceres
