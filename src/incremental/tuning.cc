#include "incremental/tuning.h"

#ifdef INCERES_TUNING_FROM_ENVIRONMENT
#include <cstdio>
#include <cstdlib>
#include <string>
#endif

// INCERES_TUNING is read only where the library was configured with INCERES_TUNING_FROM_ENVIRONMENT
// (docs/tuning.md), at the first call of TuningOfNewSolvers; it says "name=value,name=value". The
// names come from the header, by benchmarks/ablation.py --names when the build is configured: all
// fields of type double or int that are on one line.

namespace inceres::internal {
namespace {

#ifdef INCERES_TUNING_FROM_ENVIRONMENT
// A study with a misspelt name would find that the threshold does nothing.
[[noreturn]] void Refuse(const std::string& setting) {
  std::fprintf(stderr, "INCERES_TUNING: no such threshold, or no number: %s\n", setting.c_str());
  std::exit(2);
}

void Set(const std::string& setting, Tuning* tuning) {
  const std::size_t equals = setting.find('=');
  const std::string number = equals == std::string::npos ? "" : setting.substr(equals + 1);
  char* end = nullptr;
  const double value = std::strtod(number.c_str(), &end);
  // The whole rest must be a number.
  if (number.empty() || *end != '\0') {
    Refuse(setting);
  }
  const std::string name = setting.substr(0, equals);
#define INCERES_THRESHOLD(threshold)                                     \
  if (name == #threshold) {                                              \
    tuning->threshold = static_cast<decltype(tuning->threshold)>(value); \
    return;                                                              \
  }
#include <tuning_names.inc>
#undef INCERES_THRESHOLD
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

// Made at the first call, and after that as the caller leaves it.
Tuning& TuningOfNewSolvers() {
  static Tuning tuning = FirstTuning();
  return tuning;
}

}  // namespace inceres::internal
