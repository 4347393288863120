#pragma once

#include <memory>
#include <vector>

#include "inceres/problem/factor_graph.h"
#include "robust/foresight.h"
#include "robust/gnc_schedule.h"

namespace inceres::internal {

/// A suspect of a living graph, and how far its weight has come.
struct Suspect {
  // New: its μ has not begun. Waiting: without weight, for foresight. Foreseen: right, as far as
  // that tells. Unforeseen: its μ is about to begin, come what may. Open: its weight is on the way.
  // Settled: 0 or 1 by its threshold, or the last weight of Geman–McClure.
  enum class Phase { kNew, kWaiting, kForeseen, kUnforeseen, kOpen, kSettled };

  Suspect(FactorId factor, const GncOptions& options)
      : id(factor), schedule(options.kernel, options.step) {}

  /// What follows from its error over its threshold, one round further on. `weight` is left to the
  /// caller.
  double NextWeight(double s);
  bool IsOut() const { return phase == Phase::kSettled && weight == 0.0; }

  FactorId id;
  double threshold = 0.0;            ///< of ‖f‖²
  double weight = 1.0;               ///< that it has been given
  std::shared_ptr<const Loss> loss;  ///< as which; null: weight 1
  GncSchedule schedule;
  Phase phase = Phase::kNew;

 private:
  double WeightOfNew(double s);
};

/// The phases of suspects that wait, of which Foresight was prepared: kForeseen, kSettled without
/// weight, or kUnforeseen where that is not sure.
std::vector<Suspect::Phase> ForeseePhases(const Foresight& foresight,
                                          const std::vector<Suspect>& waiting, int max_rounds);

}  // namespace inceres::internal
