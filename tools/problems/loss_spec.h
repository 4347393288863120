#pragma once

#include <memory>
#include <string>
#include <tuple>

#include "inceres/problem/losses.h"
#include "inceres/status.h"

namespace inceres::tools {

/// A robust loss as written on a command line: "none", "huber:1.5", "cauchy:2". The scale is in the
/// units of the residual.
struct LossSpec {
  enum class Kind { kNone, kHuber, kCauchy };
  Kind kind = Kind::kNone;
  double scale = 0.0;

  friend bool operator<(const LossSpec& a, const LossSpec& b) {
    return std::tie(a.kind, a.scale) < std::tie(b.kind, b.scale);
  }
};

/// Parses `text`; on failure the message quotes it and `spec` is unchanged.
Status ParseLoss(const std::string& text, LossSpec* spec);

/// "none", "huber:1.5", …: what ParseLoss reads.
std::string ToString(const LossSpec& spec);

/// The loss as the core knows it; null for none.
std::shared_ptr<const Loss> MakeCoreLoss(const LossSpec& spec);

}  // namespace inceres::tools
