#include "adapters/ceres/report/environment.h"

#include <algorithm>
#include <charconv>
#include <cstddef>
#include <cstdlib>
#include <iterator>
#include <optional>
#include <sstream>
#include <system_error>
#include <utility>

#include <glog/logging.h>

namespace inceres {
namespace internal {
namespace {

// In the order of DropinMode.
constexpr const char* kModeNames[] = {"exact", "incremental", "auto", "fallback", "stock"};
static_assert(std::size(kModeNames) == static_cast<std::size_t>(DropinMode::kStock) + 1);

std::optional<DropinMode> ModeNamed(const std::string& name) {
  const auto* const found = std::find(std::begin(kModeNames), std::end(kModeNames), name);
  return found != std::end(kModeNames)
             ? std::optional<DropinMode>(static_cast<DropinMode>(found - kModeNames))
             : std::nullopt;
}

// With a decimal point, whatever the program's locale.
template <typename Number>
std::optional<Number> NonNegative(const std::string& text) {
  Number value = 0;
  const char* const end = text.data() + text.size();
  const char* const begin = text.data() + (text[0] == '+' ? 1 : 0);
  const auto [rest, error] = std::from_chars(begin, end, value);
  const bool whole = error == std::errc() && rest == end;
  return whole && value >= 0 ? std::optional<Number>(value) : std::nullopt;
}

// One item of INCERES_CROSS_CHECK; false if it means nothing.
bool ReadItem(const std::string& item, CrossCheckOptions* check) {
  if (item == "0" || item == "1") {
    check->enabled = item == "1";
    return true;
  }
  const std::size_t equals = item.find('=');
  if (equals == std::string::npos) {
    return false;
  }
  const std::string name = item.substr(0, equals);
  const std::string text = item.substr(equals + 1);
  const std::optional<double> value = NonNegative<double>(text);
  const std::optional<int> count = NonNegative<int>(text);
  if (name == "keep" && (text == "ours" || text == "stock")) {
    check->keep = text == "ours" ? SolvedBy::kOurs : SolvedBy::kStock;
  } else if (name == "cost" && value) {
    check->cost_tolerance = value;
  } else if (name == "parameters" && value) {
    check->parameter_tolerance = value;
  } else if (name == "iterations" && count) {
    check->iteration_tolerance = count;
  } else if (name == "radius" && value) {
    check->radius_tolerance = value;
  } else if (name == "spread" && value) {
    check->spread_factor = *value;
  } else {
    return false;
  }
  check->enabled = true;
  return true;
}

std::string Complaint(const char* variable, const std::string& value, const char* known) {
  return std::string(variable) + ": \"" + value +
         "\" means nothing here and is ignored; known are " + known;
}

SolveMode ModeOfOneSolve(DropinMode mode) {
  if (mode == DropinMode::kFallback || mode == DropinMode::kStock) {
    return SolveMode::kStock;
  }
  return mode == DropinMode::kIncremental ? SolveMode::kIncremental : SolveMode::kExact;
}

}  // namespace

const char* ModeName(DropinMode mode) {
  return kModeNames[static_cast<std::size_t>(mode)];
}

Environment ReadEnvironment(const std::function<const char*(const char*)>& variable) {
  Environment environment;
  const auto value_of = [&](const char* name) {
    const char* value = variable(name);
    return std::string(value == nullptr ? "" : value);
  };
  const std::string mode = value_of("INCERES_MODE");
  if (const std::optional<DropinMode> known = ModeNamed(mode)) {
    environment.mode = *known;
  } else if (!mode.empty()) {
    environment.complaints.push_back(
        Complaint("INCERES_MODE", mode, "exact, incremental, auto, fallback, stock"));
  }
  const std::string windows = value_of("INCERES_WINDOWS");
  environment.exact_windows = windows != "incremental";
  if (!windows.empty() && windows != "incremental" && windows != "exact") {
    environment.complaints.push_back(Complaint("INCERES_WINDOWS", windows, "exact, incremental"));
  }
  std::istringstream items(value_of("INCERES_CROSS_CHECK"));
  for (std::string item; std::getline(items, item, ',');) {
    if (!item.empty() && !ReadItem(item, &environment.cross_check)) {
      environment.complaints.push_back(
          Complaint("INCERES_CROSS_CHECK", item,
                    "1, 0, keep=ours, keep=stock, cost=X, parameters=X, iterations=N, radius=X, "
                    "spread=X with X, N >= 0, N a whole number"));
    }
  }
  environment.ab_log = value_of("INCERES_AB_LOG");
  return environment;
}

const Environment& TheEnvironment() {
  // Never destroyed: a solve may come as late as another library's destructors.
  static const Environment& kEnvironment = *[] {
    // Nothing where the program has rights that its user has not (setuid, setgid, capabilities):
    // with them he could have a log written to any file.
    Environment read =
        ReadEnvironment([](const char* name) -> const char* { return secure_getenv(name); });
    for (const std::string& complaint : read.complaints) {
      LOG(WARNING) << "inceres: " << complaint;
    }
    return new Environment(std::move(read));
  }();
  return kEnvironment;
}

}  // namespace internal

SolveOptions OptionsFromEnvironment() {
  const internal::Environment& environment = internal::TheEnvironment();
  SolveOptions options;
  options.mode = internal::ModeOfOneSolve(environment.mode);
  options.cross_check = environment.cross_check;
  options.ab_log = environment.ab_log;
  return options;
}

}  // namespace inceres
