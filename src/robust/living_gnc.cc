#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "base/stopwatch.h"
#include "inceres/solver/gnc.h"
#include "robust/foresight.h"
#include "robust/squared_errors.h"
#include "robust/suspect.h"

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
// A wrong loop bends the whole graph before its weight has gone, and then the graph comes back. So
// suspects that come few at a time wait without weight for a solution of all else, of which
// Foresight tells what the rounds would do; only where it is not sure are they carried out.
//
// Kept between Updates: of each suspect its phase, μ, threshold, and the loss that it has been
// given in the solver's graph, with its weight. Any other loss there is not from here: the suspect
// has come with it, or was edited, and the next Update replaces it.

namespace internal {
namespace {

// A weight that is off by less than this share of the larger one leaves its factor as it is.
constexpr double kFineWeight = 0.05;

// Of more that come together what holds them may be among themselves: nothing is foreseen.
constexpr std::size_t kMostForeseen = 8;

// Variables that are looked at for what holds a new one.
constexpr std::size_t kMostSteps = 64;

// Ends an Update after so many iterations. It ends one as successful, so that the solver keeps the
// values and says nothing of a failure; that the minimum was not reached is remembered here, and
// the next round goes on from there. A limit of 0 would end at once: who wants none gives no
// observer.
class IterationLimit : public UpdateObserver {
 public:
  explicit IterationLimit(int limit) : limit_(limit) {}
  ObserverAction EndOfIteration(const UpdateIteration& iteration) override {
    is_reached_ = iteration.iteration >= limit_;
    return is_reached_ ? ObserverAction::kTerminateSuccessfully : ObserverAction::kContinue;
  }
  bool is_reached() const { return is_reached_; }

 private:
  const int limit_;
  bool is_reached_ = false;
};

}  // namespace
}  // namespace internal

class LivingGnc::Impl {
 public:
  Impl(const GncOptions& options, IncrementalSolver* solver)
      : options_(options), solver_(*solver) {}

  void Update(GncSummary* summary);

 private:
  friend class LivingGnc;
  using Suspect = internal::Suspect;
  using Phase = Suspect::Phase;

  // A place in a family is given to other factors in time, which generations tell apart; an id
  // without one, below 0, means whatever is there.
  static bool IsSame(FactorId a, FactorId b) {
    return a.family == b.family && a.index == b.index &&
           (a.generation < 0 || b.generation < 0 || a.generation == b.generation);
  }
  std::vector<FactorId> Ids() const;
  bool Prepare(GncSummary* summary);
  Status Measure();
  Status ApplyWeights(const std::vector<double>& weights);
  bool HasOtherLoss(const Suspect& suspect) const {
    return solver_.graph().loss(suspect.id.family, suspect.id.index) != suspect.loss.get();
  }
  bool Reweigh(bool first, int* num_open);
  std::size_t LetWait();
  void LookAgain();
  bool IsHeldWithout(VariableId id) const;
  void Foresee();
  void LetWaitOrForesee(bool first, std::size_t* num_waiting);
  bool UpdateSolver(int max_iterations, GncSummary* summary);
  void Judge(GncSummary* summary) const;

  GncOptions options_;
  IncrementalSolver& solver_;
  std::vector<Suspect> suspects_;
  std::vector<double> squared_errors_;
  std::vector<double> weights_;   // wanted, one a suspect
  std::int64_t num_known_ = 0;    // variables that had come when the last Update ended
  std::size_t num_out_then_ = 0;  // without weight, when they were looked at again
  bool is_cut_ = false;           // the last round has not come to its minimum
};

std::vector<FactorId> LivingGnc::Impl::Ids() const {
  std::vector<FactorId> ids;
  ids.reserve(suspects_.size());
  for (const Suspect& suspect : suspects_) {
    ids.push_back(suspect.id);
  }
  return ids;
}

// Whatever may have become wrong since the last Update: options, and suspects that were removed
// without Forget. False with a message in the summary. A threshold is found once, when the factor
// is there.
bool LivingGnc::Impl::Prepare(GncSummary* summary) {
  Status status = options_.Validate();
  status = status.ok() ? internal::CheckSuspects(solver_.graph(), Ids()) : status;
  if (!status.ok()) {
    summary->message = status.message;
    return false;
  }
  for (Suspect& suspect : suspects_) {
    if (suspect.threshold == 0.0) {
      suspect.threshold =
          internal::ThresholdOf(options_, solver_.graph().family(suspect.id.family));
    }
  }
  return true;
}

// At the solver's values, without losses. One residual for each suspect.
Status LivingGnc::Impl::Measure() {
  return internal::SquaredErrors(
      solver_.graph(), Ids(), [this](VariableId id) { return solver_.Values(id); },
      &squared_errors_);
}

// Whether a weight is to change; at first only suspects in doubt are looked at, for what was added
// to the problem since is not solved for. Cost: a few operations a suspect. A suspect whose loss is
// not from here is given its weight in any case, also an equal one: a factor that has just come has
// the loss that its user gave it, whose place the weight takes.
bool LivingGnc::Impl::Reweigh(bool first, int* num_open) {
  bool any = false;
  *num_open = 0;
  weights_.resize(suspects_.size());
  for (std::size_t k = 0; k < suspects_.size(); ++k) {
    Suspect& suspect = suspects_[k];
    const bool looked_at = !first || suspect.phase != Phase::kSettled;
    const double weight =
        looked_at ? suspect.NextWeight(squared_errors_[k] / suspect.threshold) : suspect.weight;
    const bool decided = weight == 0.0 || weight == 1.0;
    // Weights 0 and 1 are told exactly, so that in the end they agree with the verdicts.
    const bool differs = decided ? weight != suspect.weight
                                 : std::fabs(weight - suspect.weight) >
                                       internal::kFineWeight * std::max(weight, suspect.weight);
    const bool changes = differs || HasOtherLoss(suspect);
    weights_[k] = changes ? weight : suspect.weight;
    any = any || changes;
    *num_open += suspect.phase == Phase::kOpen || suspect.phase == Phase::kWaiting ? 1 : 0;
  }
  return any;
}

// Whether the variable has its place without suspects: it was there when they came, or other
// factors lead from it to such a one, or to a constant, or hold it by themselves. Not far away: in
// a graph that is all new nothing is foreseen. A walk, breadth first, over factors that are no
// suspects, which ends at the first variable that has a place or after kMostSteps of them. What was
// there when the last Update ended has a serial number below num_known_, which ids, given out
// again, do not tell. A factor of one variable, as a prior, counts as holding it.
bool LivingGnc::Impl::IsHeldWithout(VariableId id) const {
  const FactorGraph& graph = solver_.graph();
  std::vector<VariableId> seen{id};
  for (std::size_t k = 0; k < std::min(seen.size(), internal::kMostSteps) && graph.TracksFactors();
       ++k) {
    if (graph.VariableSerial(seen[k]) < num_known_ || graph.IsConstant(seen[k])) {
      return true;
    }
    bool is_held = false;
    graph.ForEachFactorOf(seen[k], [&](FactorId factor) {
      const bool is_suspect =
          std::any_of(suspects_.begin(), suspects_.end(),
                      [&](const Suspect& suspect) { return IsSame(suspect.id, factor); });
      const int num_slots = graph.family(factor.family).num_slots();
      is_held = is_held || (!is_suspect && num_slots == 1);
      for (int s = 0; s < num_slots && !is_suspect; ++s) {
        const VariableId other = graph.Variables(factor.family, factor.index)[s];
        if (std::find(seen.begin(), seen.end(), other) == seen.end()) {
          seen.push_back(other);
        }
      }
    });
    if (is_held) {
      return true;
    }
  }
  return false;
}

// A wrong suspect that was taken for right makes right ones wrong, and foresight of one at a time
// never tells. So as often as there are twice as many without weight, the newest of them take their
// rounds together.
void LivingGnc::Impl::LookAgain() {
  std::vector<Suspect*> out;
  for (Suspect& suspect : suspects_) {
    if (suspect.IsOut()) {
      out.push_back(&suspect);
    }
  }
  if (out.size() < std::max<std::size_t>(2, 2 * num_out_then_)) {
    return;
  }
  num_out_then_ = out.size();
  const std::size_t num_looked_at = std::min(out.size(), internal::kMostForeseen);
  std::for_each(out.end() - static_cast<std::ptrdiff_t>(num_looked_at), out.end(),
                [](Suspect* suspect) { suspect->phase = Phase::kUnforeseen; });
}

// Which of the new ones in doubt wait for foresight: all of them or none; how many. Those that an
// Update has left waiting that failed are as new.
std::size_t LivingGnc::Impl::LetWait() {
  std::vector<Suspect*> doubtful;
  for (std::size_t k = 0; k < suspects_.size(); ++k) {
    Phase& phase = suspects_[k].phase;
    phase = phase == Phase::kWaiting ? Phase::kNew : phase;
    if (phase == Phase::kNew && squared_errors_[k] > suspects_[k].threshold) {
      doubtful.push_back(&suspects_[k]);
    }
  }
  const auto is_held = [this](const Suspect* suspect) {
    const FactorGraph& graph = solver_.graph();
    const VariableId* const ids = graph.Variables(suspect->id.family, suspect->id.index);
    return std::all_of(ids, ids + graph.family(suspect->id.family).num_slots(),
                       [this](VariableId id) { return IsHeldWithout(id); });
  };
  if (options_.kernel != GncKernel::kTruncatedLeastSquares ||
      doubtful.size() > internal::kMostForeseen ||
      !std::all_of(doubtful.begin(), doubtful.end(), is_held)) {
    return 0;
  }
  for (Suspect* const suspect : doubtful) {
    suspect->phase = Phase::kWaiting;
  }
  return doubtful.size();
}

// Where nothing is foreseen all rounds are carried out. At the solution of all else, in which they
// weigh nothing. Their phases say what comes next: kForeseen gets its weight at once, kSettled
// stays without one, and kUnforeseen begins its μ in the Reweigh that follows.
void LivingGnc::Impl::Foresee() {
  std::vector<std::size_t> places;
  std::vector<Suspect> waiting;
  std::vector<FactorId> ids;
  for (std::size_t k = 0; k < suspects_.size(); ++k) {
    if (suspects_[k].phase == Phase::kWaiting) {
      places.push_back(k);
      waiting.push_back(suspects_[k]);
      ids.push_back(suspects_[k].id);
    }
  }
  internal::Foresight foresight;
  std::vector<Phase> phases(places.size(), Phase::kUnforeseen);
  if (foresight.Prepare(solver_, ids).ok()) {
    phases = internal::ForeseePhases(foresight, waiting, options_.max_rounds);
  }
  for (std::size_t n = 0; n < places.size(); ++n) {
    suspects_[places[n]].phase = phases[n];
  }
}

// After the first measurement new suspects may be let wait; after the second, which knows what all
// else is without them, they do so no more.
void LivingGnc::Impl::LetWaitOrForesee(bool first, std::size_t* num_waiting) {
  if (first) {
    *num_waiting = LetWait();
    if (*num_waiting == 0) {
      LookAgain();
    }
  } else if (*num_waiting > 0) {
    Foresee();
    *num_waiting = 0;
  }
}

// One edit for all. Weights are remembered after the solver has accepted it: on failure its losses
// are as before. A weight of 1 is no loss at all, so that inliers are plain least squares again;
// any other one is w times the identity, and a weight of 0 keeps the factor in the graph, for its
// error is still asked for. Losses are new objects each time: it is by their addresses that
// HasOtherLoss tells them from a user's.
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

// One round: the solver's Update, or so many iterations of it if they are not 0, and its row in the
// summary, with the largest μ of those that are open. False ends it, with the solver's own message.
// The initial cost is that of the first round, before any of them has moved something; costs of
// different rounds are of different weights, and cannot be compared.
bool LivingGnc::Impl::UpdateSolver(int max_iterations, GncSummary* summary) {
  GncRound round;
  for (const Suspect& suspect : suspects_) {
    round.num_full += suspect.weight == 1.0 ? 1 : 0;
    round.num_none += suspect.weight == 0.0 ? 1 : 0;
    round.mu = suspect.phase == Phase::kOpen ? std::max(round.mu, suspect.schedule.mu()) : round.mu;
  }
  internal::IterationLimit limit(max_iterations);
  UpdateSummary update;
  solver_.Update(&update, max_iterations > 0 ? &limit : nullptr);
  is_cut_ = limit.is_reached();
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
    internal::AddVerdict(suspect.id, squared_errors_[k], suspect.threshold, suspect.weight,
                         summary);
  }
}

void LivingGnc::Impl::Update(GncSummary* summary) {
  if (!Prepare(summary)) {
    return;
  }
  int num_open = 0;
  bool changes = true;
  std::size_t num_waiting = 0;
  // Measure, weigh, solve. The first round solves even if no weight changes: the graph may have
  // been edited. It looks only at suspects that are not settled, because their errors are at values
  // that have not been solved for since; from the second on all are looked at.
  for (int i = 0;; ++i) {
    Status status = Measure();
    if (status.ok()) {
      LetWaitOrForesee(/*first=*/i == 0, &num_waiting);
      changes = Reweigh(/*first=*/i == 0, &num_open);
      // Weights that nothing will be solved with are not applied: verdicts tell those of the state.
      status = changes && i < options_.max_rounds ? ApplyWeights(weights_) : status;
    }
    if (!status.ok()) {
      summary->termination = Termination::kFailure;
      summary->message = status.message;
      return;
    }
    const bool settled = i > 0 && !changes && num_open == 0 && !is_cut_;
    if (settled || i >= options_.max_rounds) {
      summary->termination = settled ? Termination::kConvergence : Termination::kNoConvergence;
      summary->message = settled ? "The weights have settled."
                                 : "Stopped by max_rounds: the weights have not settled.";
      break;
    }
    // Without a change of weights another Update has nothing to do; μ of open suspects moves on in
    // the next round. As long as weights are on the way no round is worth more than a few steps.
    const bool is_open = num_open > 0 && num_waiting == 0;
    if ((changes || i == 0 || is_cut_) &&
        !UpdateSolver(is_open ? options_.iterations_a_round : 0, summary)) {
      return;
    }
  }
  num_known_ = solver_.graph().num_added_variables();
  Judge(summary);
}

LivingGnc::LivingGnc(const GncOptions& options, IncrementalSolver* solver)
    : impl_(std::make_unique<Impl>(options, solver)) {
}
LivingGnc::~LivingGnc() = default;

// The threshold is found by Prepare, when the factor is in the graph; 0 until then.
void LivingGnc::Watch(FactorId factor) {
  impl_->suspects_.emplace_back(factor, impl_->options_);
}

// The weight stays until the next Update finds that of a suspect that has just come.
void LivingGnc::Reset(FactorId factor) {
  for (Impl::Suspect& suspect : impl_->suspects_) {
    if (Impl::IsSame(suspect.id, factor)) {
      suspect.phase = Impl::Phase::kNew;
    }
  }
}

// Together: what was taken for right may have to go for what was left out.
void LivingGnc::ResetAll() {
  for (Impl::Suspect& suspect : impl_->suspects_) {
    suspect.phase = Impl::Phase::kUnforeseen;
  }
}

void LivingGnc::Forget(FactorId factor) {
  std::vector<Impl::Suspect>& suspects = impl_->suspects_;
  suspects.erase(std::remove_if(suspects.begin(), suspects.end(),
                                [&](const Impl::Suspect& suspect) {
                                  return Impl::IsSame(suspect.id, factor);
                                }),
                 suspects.end());
}

int LivingGnc::num_suspects() const {
  return static_cast<int>(impl_->suspects_.size());
}

GncSummary LivingGnc::Update() {
  const double start = internal::NowInSeconds();
  GncSummary summary;
  impl_->Update(&summary);
  summary.seconds = internal::NowInSeconds() - start;
  return summary;
}

}  // namespace inceres
