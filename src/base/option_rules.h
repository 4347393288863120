#pragma once

#include <sstream>

#include "inceres/status.h"

namespace inceres::internal {

/// The rules that options keep, in the order in which they are looked at: the first one that is
/// broken is told, "Owner::name = value but must be rule". A rule says what must hold, so that a
/// NaN, which no comparison holds for, breaks it.
class OptionRules {
 public:
  explicit OptionRules(const char* owner) : owner_(owner) {}

  /// Text is made only where it is needed: a solve checks all of its options.
  template <typename T>
  OptionRules& Require(bool holds, const char* name, const T& value, const char* rule) {
    if (!holds && status_.ok()) {
      std::ostringstream text;
      text << owner_ << "::" << name << " = " << value << " but must be " << rule;
      status_ = Status::Error(StatusCode::kInvalidArgument, text.str());
    }
    return *this;
  }
  template <typename T>
  OptionRules& NotNegative(const char* name, T value) {
    return Require(value >= T(0), name, value, ">= 0");
  }
  template <typename T>
  OptionRules& Positive(const char* name, T value) {
    return Require(value > T(0), name, value, "> 0");
  }
  template <typename T>
  OptionRules& AtLeastOne(const char* name, T value) {
    return Require(value >= T(1), name, value, ">= 1");
  }
  OptionRules& Also(const Status& rules) {
    status_ = status_.ok() ? rules : status_;
    return *this;
  }

  const Status& status() const { return status_; }

 private:
  const char* owner_;
  Status status_;
};

}  // namespace inceres::internal
