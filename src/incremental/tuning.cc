#include "incremental/tuning.h"

#ifdef INCERES_TUNING_FROM_ENVIRONMENT
#include <cstdio>
#include <cstdlib>
#endif

// Names of the thresholds, for the ablation (docs/tuning.md) and tests: one list serves both, so a
// threshold that is missing here cannot be studied. INCERES_TUNING is read only where the library
// was configured with INCERES_TUNING_FROM_ENVIRONMENT, at the first call of TuningOfNewSolvers; it
// says "name=value,name=value".

namespace inceres::internal {
namespace {

#ifdef INCERES_TUNING_FROM_ENVIRONMENT
// A study with a misspelt name would find that the threshold does nothing.
[[noreturn]] void Refuse(const std::string& setting) {
  std::fprintf(stderr, "INCERES_TUNING: no such threshold, or no number: %s\n", setting.c_str());
  std::exit(2);
}

// A setting without '=' fits no name.
void Set(const std::string& setting, Tuning* tuning) {
  const std::size_t equals = setting.find('=');
  for (const NamedThreshold& threshold : NamedThresholds(tuning)) {
    if (equals == std::string::npos || threshold.name != setting.substr(0, equals)) {
      continue;
    }
    char* end = nullptr;
    // The whole rest must be a number.
    const double value = std::strtod(setting.c_str() + equals + 1, &end);
    if (end == setting.c_str() + equals + 1 || *end != '\0') {
      Refuse(setting);
    }
    if (threshold.real != nullptr) {
      *threshold.real = value;
    } else {
      *threshold.count = static_cast<int>(value);
    }
    return;
  }
  Refuse(setting);
}

// Settings are taken one after the other: the last one of a name counts.
Tuning FirstTuning() {
  Tuning tuning;
  const char* settings = std::getenv("INCERES_TUNING");
  std::string rest = settings != nullptr ? settings : "";
  while (!rest.empty()) {
    const std::size_t comma = rest.find(',');
    Set(rest.substr(0, comma), &tuning);
    rest = comma == std::string::npos ? "" : rest.substr(comma + 1);
  }
  return tuning;
}
#else
// Without the ablation the environment is not read at all.
Tuning FirstTuning() {
  return Tuning();
}
#endif

}  // namespace

// Pointers into the caller's Tuning: a write through them is what changes it.
std::vector<NamedThreshold> NamedThresholds(Tuning* tuning) {
  std::vector<NamedThreshold> all;
  // A threshold is a real number or a count; the other pointer is null.
  const auto real = [&](const char* name, double* value) { all.push_back({name, value, nullptr}); };
  const auto count = [&](const char* name, int* value) { all.push_back({name, nullptr, value}); };
  real("stop.share", &tuning->stop.share);
  real("stop.plain_share", &tuning->stop.plain_share);
  real("stop.rest_share", &tuning->stop.rest_share);
  real("stop.steady_factor", &tuning->stop.steady_factor);
  real("stop.factor_growth", &tuning->stop.factor_growth);
  real("stop.nothing_share", &tuning->stop.nothing_share);
  real("stop.landmarks_share", &tuning->stop.landmarks_share);
  real("stop.creeping_landmarks", &tuning->stop.creeping_landmarks);
  count("stop.stagnation", &tuning->stop.stagnation);
  real("stop.fine_damping", &tuning->stop.fine_damping);
  real("relinearize.exact", &tuning->relinearize.exact);
  real("relinearize.gradient_share", &tuning->relinearize.gradient_share);
  real("relinearize.refresh_share", &tuning->relinearize.refresh_share);
  real("relinearize.weight_change", &tuning->relinearize.weight_change);
  real("relinearize.corrected_weight_change", &tuning->relinearize.corrected_weight_change);
  real("relinearize.blame_share", &tuning->relinearize.blame_share);
  real("truncate.floor", &tuning->truncate.floor);
  real("truncate.wildfire_share", &tuning->truncate.wildfire_share);
  real("truncate.sum_share", &tuning->truncate.sum_share);
  real("truncate.pull_share", &tuning->truncate.pull_share);
  real("truncate.no_pull", &tuning->truncate.no_pull);
  count("truncate.max_scalars", &tuning->truncate.max_scalars);
  real("landmarks.share", &tuning->landmarks.share);
  real("landmarks.deciding_share", &tuning->landmarks.deciding_share);
  real("landmarks.dominance", &tuning->landmarks.dominance);
  real("landmarks.min_damping", &tuning->landmarks.min_damping);
  real("landmarks.least_seen", &tuning->landmarks.least_seen);
  real("landmarks.outdated_damping", &tuning->landmarks.outdated_damping);
  real("landmarks.max_stretch", &tuning->landmarks.max_stretch);
  real("earlier_factor.kept", &tuning->earlier_factor.kept);
  real("earlier_factor.caution", &tuning->earlier_factor.caution);
  real("earlier_factor.step_share", &tuning->earlier_factor.step_share);
  real("earlier_factor.contraction", &tuning->earlier_factor.contraction);
  real("earlier_factor.worth_asking", &tuning->earlier_factor.worth_asking);
  real("retreat.damping_growth", &tuning->retreat.damping_growth);
  real("retreat.poor_ratio", &tuning->retreat.poor_ratio);
  real("retreat.good_ratio", &tuning->retreat.good_ratio);
  real("retreat.radius_fall", &tuning->retreat.radius_fall);
  real("retreat.radius_growth", &tuning->retreat.radius_growth);
  real("retreat.shortening", &tuning->retreat.shortening);
  count("retreat.max_shortenings", &tuning->retreat.max_shortenings);
  count("retreat.max_shortened_in_row", &tuning->retreat.max_shortened_in_row);
  real("new_frames.worthwhile_share", &tuning->new_frames.worthwhile_share);
  real("rebuild.mostly_new", &tuning->rebuild.mostly_new);
  real("rebuild.replace_cost", &tuning->rebuild.replace_cost);
  real("batch.settled_share", &tuning->batch.settled_share);
  real("batch.proof_share", &tuning->batch.proof_share);
  real("batch.proof_radius", &tuning->batch.proof_radius);
  count("batch.proof_steps", &tuning->batch.proof_steps);
  count("batch.quick_stagnation", &tuning->batch.quick_stagnation);
  real("batch.quick_stagnation_gain", &tuning->batch.quick_stagnation_gain);
  count("batch.quick_proof_steps", &tuning->batch.quick_proof_steps);
  real("batch.quick_proof_gain", &tuning->batch.quick_proof_gain);
  real("batch.no_gain_share", &tuning->batch.no_gain_share);
  real("batch.rest_share", &tuning->batch.rest_share);
  real("batch.fast_ratio", &tuning->batch.fast_ratio);
  real("batch.good_model", &tuning->batch.good_model);
  real("batch.kept_promise", &tuning->batch.kept_promise);
  real("batch.trial_error", &tuning->batch.trial_error);
  real("batch.steady_factor", &tuning->batch.steady_factor);
  real("batch.near_gain", &tuning->batch.near_gain);
  real("batch.seeing_radius", &tuning->batch.seeing_radius);
  real("batch.held_back_share", &tuning->batch.held_back_share);
  count("batch.patience", &tuning->batch.patience);
  count("batch.stagnation", &tuning->batch.stagnation);
  real("batch.stagnation_gain", &tuning->batch.stagnation_gain);
  real("batch.free_stagnation_gain", &tuning->batch.free_stagnation_gain);
  real("batch.free_radius", &tuning->batch.free_radius);
  count("batch.stall", &tuning->batch.stall);
  real("batch.stall_gain", &tuning->batch.stall_gain);
  real("batch.min_radius", &tuning->batch.min_radius);
  real("batch.border_radius", &tuning->batch.border_radius);
  real("batch.max_radius", &tuning->batch.max_radius);
  real("batch.shrunk_share", &tuning->batch.shrunk_share);
  return all;
}

// Made at the first call, and after that as the caller leaves it.
Tuning& TuningOfNewSolvers() {
  static Tuning tuning = FirstTuning();
  return tuning;
}

}  // namespace inceres::internal
