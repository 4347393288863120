#pragma once

#include <deque>
#include <string>

#include "inceres/solver/summary.h"
#include "incremental/tuning.h"

namespace inceres::internal {

/// Whether Marquardt's rule, which tries all lengths of steps, has come to where nothing is to be
/// had any more, although its model promises more (docs/algorithms.md, "Stopping rule"):
///
/// - the last steps have together brought next to nothing, and so have those that were then taken
///   from little damping on, as who knows nothing would go on from there. If all of these were
///   damped by little, that is proven; steps that are damped hard gain little for being short;
/// - or hardly any could be taken for so long that all lengths have been tried, as at the border of
///   where a cost function evaluates. Where they creep along such a border, all of them together
///   gaining next to nothing twice in a row, that is an end, and no proof.
class Stagnation {
 public:
  enum class Verdict { kGoOn, kProven, kUnproven, kRefusals };
  /// What an end without a proof rests on where steps creep along a border.
  static constexpr char kCreeps[] =
      "Steps creep along where a cost function refuses, and gain next to nothing: it is not "
      "proven that this is a minimum.";

  explicit Stagnation(const Tuning::Batch& tuning) : tuning_(tuning) {}

  /// The descent begins, or the cost is another function: at this cost.
  void Begin(double cost);
  /// After an iteration that tried a step with this radius; `cost` is where it has led to, and
  /// `tolerance` what does not count of it.
  Verdict After(const IterationSummary& iteration, double cost, double tolerance, double radius);
  /// The same where all lengths of steps have been tried at a border, and who refused was held
  /// since: they are tried again before that is an end. `refused`: all of them were.
  void BeginAtBorder(double cost, bool refused) {
    Begin(cost);
    creeps_ = true;
    went_between_ = refused;
    restart_radius_ = tuning_.proof_radius;
  }
  /// What a verdict that ends the descent rests on, at this cost.
  std::string InWords(Verdict verdict, double cost) const;
  /// Whether steps have crept along a border when all lengths of them had been tried.
  bool creeps() const { return creeps_; }
  /// Whether steps are taken with little damping for the sake of a proof.
  bool is_proving() const { return is_proving_; }
  /// The radius from which the descent is to go on, or 0; asked once.
  double TakeRestartRadius();

 private:
  bool CreepsAgain(double cost, double tolerance);
  bool IsStalled(const IterationSummary& iteration, double cost, double tolerance, double radius);
  void NoteRadius(double radius);
  bool IsAtLeastRadius(const IterationSummary& iteration, double tolerance) const;
  double GainOf(const IterationSummary& iteration) const;
  bool Brought(int num_steps, double tolerances, const IterationSummary& last,
               double tolerance) const;
  Verdict EndProof(const IterationSummary& iteration, double tolerance);
  void BeginProof(const IterationSummary& iteration, double tolerance);

  const Tuning::Batch& tuning_;
  std::deque<double> costs_;  // where the last steps have led to
  // iterations, taken or not, since the cost last fell by more than next to nothing
  int num_since_gain_ = 0;
  double gained_from_ = 0.0;  // to this
  // radius of a step since then, and less than that all of them, but for steps that are hardly
  // damped for once
  double widest_ = 0.0;
  double last_radius_ = 0.0;     // of a step, but for those
  bool went_between_ = false;    // the radii since then, to those that a border passes over
  double lengths_from_ = 0.0;    // all lengths have been tried at a border since this cost
  bool creeps_ = false;          // and gained next to nothing
  bool is_proving_ = false;      // that steps stagnate
  bool is_damped_hard_ = false;  // and some of these had to be damped hard
  double restart_radius_ = 0.0;  // to be asked for
};

}  // namespace inceres::internal
