#pragma once

#include <cstdint>
#include <string>

#include "base/formatted.h"

namespace inceres::internal {

/// Lines of a report, in the columns of Ceres's: a label and one value, or two, right-aligned.
inline std::string ReportLine(const char* label, const std::string& value) {
  return Formatted("%-20s%25s\n", label, value.c_str());
}
inline std::string ReportLine(const char* label, std::int64_t given, std::int64_t used) {
  return Formatted("%-20s%25lld%25lld\n", label, static_cast<long long>(given),
                   static_cast<long long>(used));
}
inline std::string ReportLine(const char* label, double value) {
  return Formatted("%-20s%25e\n", label, value);
}
inline std::string ReportLine(const char* label, std::int64_t value) {
  return Formatted("%-27s%18lld\n", label, static_cast<long long>(value));
}
inline std::string ReportLine(const char* label, int value) {
  return ReportLine(label, static_cast<std::int64_t>(value));
}

/// Seconds of a stage; with how often it was done in brackets if count ≥ 0.
inline std::string ReportSeconds(const char* label, double seconds, int count = -1) {
  std::string text = Formatted("%-27s%18.6f", label, seconds);
  text += count < 0 ? "\n" : " (" + std::to_string(count) + ")\n";
  return text;
}

/// The first line of a report, with the release.
inline std::string ReportTitle(const char* what, const char* release) {
  return Formatted("%s (inceres %s)\n\n", what, release);
}

/// "Termination:    CONVERGENCE (Function tolerance reached. …)". The message may be of any length.
inline std::string ReportTermination(const char* termination, const std::string& message) {
  return Formatted("Termination: %32s (", termination) + message + ")\n";
}

}  // namespace inceres::internal
