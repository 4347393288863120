#include <algorithm>
#include <cmath>
#include <cstddef>

#include "base/stopwatch.h"
#include "inceres/solver/gnc.h"
#include "robust/gnc_schedule.h"
#include "robust/squared_errors.h"

namespace inceres {

// Graduated non-convexity on a graph that lives on (docs/algorithms.md, "Graduated non-convexity";
// McGann, Rogers & Kaess 2023 for a history of each factor). Every suspect has a μ of its own,
// which begins with the error it comes with: a graduation of all anew for each new suspect would
// forget what is decided, and touch factors that nothing has changed.
//
// An Update alternates: measure ‖f‖² of all suspects; move each μ and find the weights; tell the
// solver those that have changed, as losses w · ½‖f‖²; solve. A weight that changes costs no
// linearization: cached Jacobians are scaled (docs/algorithms.md, "Incremental Schur complement",
// other weights). Hence small changes are not worth telling, and decided suspects rest.
//
// Kept between Updates: of each suspect its phase, μ, threshold, and the loss that it has been
// given in the solver's graph, with its weight. Any other loss there is not from here: the suspect
// has come with it, or was edited, and the next Update replaces it.

namespace internal {
namespace {

// A weight that is off by less than this share of the larger one leaves its factor as it is.
constexpr double kFineWeight = 0.05;

}  // namespace
}  // namespace internal

class LivingGnc::Impl {
 public:
  Impl(const GncOptions& options, IncrementalSolver* solver)
      : options_(options), solver_(*solver) {}

  // The threshold is found by Prepare, when the factor is in the graph; 0 until then.
  void Watch(FactorId factor) {
    suspects_.push_back(
        {factor, 0.0, 1.0, nullptr, internal::GncSchedule(options_.kernel, options_.step)});
  }
  // The weight stays until the next Update finds that of a suspect that has just come.
  void Reset(FactorId factor) {
    for (Suspect& suspect : suspects_) {
      if (IsSame(suspect.id, factor)) {
        Begin(&suspect);
      }
    }
  }
  void ResetAll() {
    std::for_each(suspects_.begin(), suspects_.end(), [](Suspect& suspect) { Begin(&suspect); });
  }
  void Forget(FactorId factor) {
    suspects_.erase(
        std::remove_if(suspects_.begin(), suspects_.end(),
                       [&](const Suspect& suspect) { return IsSame(suspect.id, factor); }),
        suspects_.end());
  }
  int num_suspects() const { return static_cast<int>(suspects_.size()); }
  void Update(GncSummary* summary);

 private:
  // New: its μ has not begun. Open: its weight is on the way. Settled: 0 or 1 by its threshold, or
  // the last weight of Geman–McClure.
  enum class Phase { kNew, kOpen, kSettled };
  struct Suspect {
    FactorId id;
    double threshold;
    double weight;                     // that it has been given
    std::shared_ptr<const Loss> loss;  // as which; null: weight 1
    internal::GncSchedule schedule;
    Phase phase = Phase::kNew;
  };

  // A place in a family is given to other factors in time, which generations tell apart; an id
  // without one, below 0, means whatever is there.
  static bool IsSame(FactorId a, FactorId b) {
    return a.family == b.family && a.index == b.index &&
           (a.generation < 0 || b.generation < 0 || a.generation == b.generation);
  }
  static void Begin(Suspect* suspect) { suspect->phase = Phase::kNew; }

  bool Prepare(GncSummary* summary);
  Status Measure();
  Status ApplyWeights(const std::vector<double>& weights);
  bool HasOtherLoss(const Suspect& suspect) const {
    return solver_.graph().loss(suspect.id.family, suspect.id.index) != suspect.loss.get();
  }
  double NextWeight(Suspect* suspect, double s) const;
  double WeightOfNew(Suspect* suspect, double s) const;
  bool Reweigh(bool first, int* num_open);
  bool UpdateSolver(GncSummary* summary);
  void Judge(GncSummary* summary) const;

  GncOptions options_;
  IncrementalSolver& solver_;
  std::vector<Suspect> suspects_;
  std::vector<double> squared_errors_;
  std::vector<double> weights_;  // wanted, one a suspect
};

// Whatever may have become wrong since the last Update: options, and suspects that were removed
// without Forget. False with a message in the summary.
bool LivingGnc::Impl::Prepare(GncSummary* summary) {
  std::vector<FactorId> ids;
  ids.reserve(suspects_.size());
  for (const Suspect& suspect : suspects_) {
    ids.push_back(suspect.id);
  }
  Status status = options_.Validate();
  status = status.ok() ? internal::CheckSuspects(solver_.graph(), ids) : status;
  if (!status.ok()) {
    summary->message = status.message;
    return false;
  }
  for (Suspect& suspect : suspects_) {
    if (suspect.threshold == 0.0) {
      const int rows = solver_.graph().family(suspect.id.family).residual_size();
      suspect.threshold =
          options_.threshold_scale * ChiSquareQuantile(options_.inlier_probability, rows);
    }
  }
  return true;
}

// At the solver's values, without losses. One residual for each suspect.
Status LivingGnc::Impl::Measure() {
  std::vector<FactorId> ids;
  ids.reserve(suspects_.size());
  for (const Suspect& suspect : suspects_) {
    ids.push_back(suspect.id);
  }
  return internal::SquaredErrors(
      solver_.graph(), ids, [this](VariableId id) { return solver_.Values(id); }, &squared_errors_);
}

// The history begins where the cost is convex up to its error; what is an inlier has none.
// In doubt is what is no inlier yet: s above 1. Its first weight lies between 0 and 1.
double LivingGnc::Impl::WeightOfNew(Suspect* suspect, double s) const {
  suspect->schedule = internal::GncSchedule(options_.kernel, options_.step);
  const bool in_doubt = suspect->schedule.Begin(s);
  suspect->phase = in_doubt ? Phase::kOpen : Phase::kSettled;
  return in_doubt ? suspect->schedule.Weight(s) : suspect->schedule.LastWeight(s);
}

// The schedule of one suspect. A settled one that truncation has kept and whose error has grown
// past its threshold begins anew, as if it had just come: it is not dropped at once. One that was
// dropped and has come below comes back at once, by LastWeight.
double LivingGnc::Impl::NextWeight(Suspect* suspect, double s) const {
  const bool truncated = options_.kernel == GncKernel::kTruncatedLeastSquares;
  if (suspect->phase == Phase::kNew ||
      (suspect->phase == Phase::kSettled && truncated && suspect->weight == 1.0 && s > 1.0)) {
    return WeightOfNew(suspect, s);
  }
  if (suspect->phase == Phase::kSettled) {
    return suspect->schedule.LastWeight(s);
  }
  suspect->schedule.Advance();
  // A right one is drawn in by the first round or two: from there on it is as one that comes with
  // the error it has now.
  if (truncated && s <= 1.0) {
    suspect->phase = Phase::kSettled;
    return 1.0;
  }
  // Never backwards: an error that has grown changes nothing here.
  suspect->schedule.SkipTo(s);
  const double weight = suspect->schedule.Weight(s);
  // Of Geman–McClure the weight is never 0 or 1: it is decided when μ is 1.
  const bool decided = truncated ? weight == 0.0 || weight == 1.0 : suspect->schedule.IsLast();
  suspect->phase = decided ? Phase::kSettled : Phase::kOpen;
  return weight;
}

// Whether a weight is to change; at first only suspects in doubt are looked at, for what was added
// to the problem since is not solved for.
bool LivingGnc::Impl::Reweigh(bool first, int* num_open) {
  bool any = false;
  *num_open = 0;
  weights_.resize(suspects_.size());
  for (std::size_t k = 0; k < suspects_.size(); ++k) {
    Suspect& suspect = suspects_[k];
    const bool looked_at = !first || suspect.phase != Phase::kSettled;
    const double weight =
        looked_at ? NextWeight(&suspect, squared_errors_[k] / suspect.threshold) : suspect.weight;
    const bool decided = weight == 0.0 || weight == 1.0;
    // Weights 0 and 1 are told exactly, so that in the end they agree with the verdicts.
    const bool differs = decided ? weight != suspect.weight
                                 : std::fabs(weight - suspect.weight) >
                                       internal::kFineWeight * std::max(weight, suspect.weight);
    const bool changes = differs || HasOtherLoss(suspect);
    weights_[k] = changes ? weight : suspect.weight;
    any = any || changes;
    *num_open += suspect.phase == Phase::kOpen ? 1 : 0;
  }
  return any;
}

// One edit for all. Weights are remembered after the solver has accepted it: on failure its losses
// are as before.
Status LivingGnc::Impl::ApplyWeights(const std::vector<double>& weights) {
  GraphEdit edit(solver_.graph());
  std::vector<std::shared_ptr<const Loss>> losses;
  for (std::size_t k = 0; k < suspects_.size(); ++k) {
    losses.push_back(suspects_[k].loss);
    if (weights[k] != suspects_[k].weight) {
      losses.back() =
          weights[k] == 1.0 ? nullptr : std::make_shared<ScaledLoss>(nullptr, weights[k]);
    }
    if (weights[k] != suspects_[k].weight || HasOtherLoss(suspects_[k])) {
      edit.SetLoss(suspects_[k].id, losses.back());
    }
  }
  Status status = solver_.Apply(edit);
  for (std::size_t k = 0; k < suspects_.size() && status.ok(); ++k) {
    suspects_[k].weight = weights[k];
    suspects_[k].loss = losses[k];
  }
  return status;
}

// One round: the solver's Update and its row in the summary, with the largest μ of those that are
// open. False ends it, with the solver's own message.
bool LivingGnc::Impl::UpdateSolver(GncSummary* summary) {
  GncRound round;
  for (const Suspect& suspect : suspects_) {
    round.num_full += suspect.weight == 1.0 ? 1 : 0;
    round.num_none += suspect.weight == 0.0 ? 1 : 0;
    round.mu = suspect.phase == Phase::kOpen ? std::max(round.mu, suspect.schedule.mu()) : round.mu;
  }
  const UpdateSummary update = solver_.Update();
  if (!IsUsable(update.termination)) {
    summary->termination = update.termination;
    summary->message = update.message;
    return false;
  }
  if (summary->rounds.empty()) {
    summary->initial_cost = update.initial_cost;
  }
  round.cost = summary->final_cost = solver_.cost();
  round.num_iterations = update.num_iterations;
  round.num_relinearized_factors = update.num_relinearized_factors;
  round.num_reweighed_factors = update.num_reweighed_factors;
  summary->num_iterations += round.num_iterations;
  summary->rounds.push_back(round);
  return true;
}

// By the last measurement, which is of the final values: the loop ends right after one.
void LivingGnc::Impl::Judge(GncSummary* summary) const {
  for (std::size_t k = 0; k < suspects_.size(); ++k) {
    const Suspect& suspect = suspects_[k];
    const bool inlier = squared_errors_[k] <= suspect.threshold;
    summary->verdicts.push_back(
        {suspect.id, squared_errors_[k], suspect.threshold, suspect.weight, inlier});
    summary->num_outliers += inlier ? 0 : 1;
  }
}

void LivingGnc::Impl::Update(GncSummary* summary) {
  if (!Prepare(summary)) {
    return;
  }
  int num_open = 0;
  bool changes = true;
  // Measure, weigh, solve. The first round solves even if no weight changes: the graph may have
  // been edited. It looks only at suspects that are not settled, because their errors are at values
  // that have not been solved for since; from the second on all are looked at.
  for (int i = 0;; ++i) {
    Status status = Measure();
    if (status.ok()) {
      changes = Reweigh(/*first=*/i == 0, &num_open);
      status = changes ? ApplyWeights(weights_) : status;
    }
    if (!status.ok()) {
      summary->termination = Termination::kFailure;
      summary->message = status.message;
      return;
    }
    // At the limit weights have been applied for which nothing is solved any more.
    const bool settled = i > 0 && !changes && num_open == 0;
    if (settled || i >= options_.max_rounds) {
      summary->termination = settled ? Termination::kConvergence : Termination::kNoConvergence;
      summary->message = settled ? "The weights have settled."
                                 : "Stopped by max_rounds: the weights have not settled.";
      break;
    }
    // Without a change of weights another Update has nothing to do; μ of open suspects moves on in
    // the next round.
    if ((changes || i == 0) && !UpdateSolver(summary)) {
      return;
    }
  }
  Judge(summary);
}

LivingGnc::LivingGnc(const GncOptions& options, IncrementalSolver* solver)
    : impl_(std::make_unique<Impl>(options, solver)) {
}
LivingGnc::~LivingGnc() = default;

void LivingGnc::Watch(FactorId factor) {
  impl_->Watch(factor);
}
void LivingGnc::Reset(FactorId factor) {
  impl_->Reset(factor);
}
void LivingGnc::ResetAll() {
  impl_->ResetAll();
}
void LivingGnc::Forget(FactorId factor) {
  impl_->Forget(factor);
}
int LivingGnc::num_suspects() const {
  return impl_->num_suspects();
}

GncSummary LivingGnc::Update() {
  const double start = internal::NowInSeconds();
  GncSummary summary;
  impl_->Update(&summary);
  summary.seconds = internal::NowInSeconds() - start;
  return summary;
}

}  // namespace inceres
