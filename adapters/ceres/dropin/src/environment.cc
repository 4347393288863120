#include "adapters/ceres/dropin/src/environment.h"

#include <cstdlib>

#include <glog/logging.h>

namespace inceres::internal {
namespace {

Environment ReadEnvironment() {
  Environment environment;
  const char* mode = std::getenv("INCERES_MODE");
  if (!ParseMode(mode, &environment.mode)) {
    LOG(WARNING) << "inceres: INCERES_MODE is '" << mode << "', which is none of exact, incremental, auto, stock; "
                 << ModeName(environment.mode) << " is used.";
  }
  return environment;
}

}  // namespace

const Environment& TheEnvironment() {
  static const Environment kEnvironment = ReadEnvironment();
  return kEnvironment;
}

bool ParseMode(const char* text, DropinMode* mode) {
  if (text == nullptr || *text == '\0') {
    *mode = DropinMode::kExact;
    return true;
  }
  for (const DropinMode candidate : {DropinMode::kExact, DropinMode::kIncremental, DropinMode::kAuto, DropinMode::kStock}) {
    if (std::string(text) == ModeName(candidate)) {
      *mode = candidate;
      return true;
    }
  }
  return false;
}

const char* ModeName(DropinMode mode) {
  switch (mode) {
    case DropinMode::kExact:
      return "exact";
    case DropinMode::kIncremental:
      return "incremental";
    case DropinMode::kAuto:
      return "auto";
    case DropinMode::kStock:
      break;
  }
  return "stock";
}

}  // namespace inceres::internal
