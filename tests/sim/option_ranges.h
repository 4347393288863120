#pragma once

#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/status.h"

namespace inceres::internal {

/// Each of these fields is refused, by its name, below its range, above it and where it is no
/// number.
template <typename Options>
void ExpectRanges(const std::string& type, const Options& good,
                  const std::vector<std::pair<double Options::*, const char*>>& fields) {
  for (const auto& [field, name] : fields) {
    for (const double value : {-0.5, 1e7, std::nan(""), std::numeric_limits<double>::infinity()}) {
      Options options = good;
      options.*field = value;
      const Status status = options.Validate();
      EXPECT_EQ(status.code, StatusCode::kInvalidArgument) << name << " " << value;
      EXPECT_EQ(status.message.find(type + ": " + name + " is "), 0u) << status.message;
    }
  }
}

}  // namespace inceres::internal
