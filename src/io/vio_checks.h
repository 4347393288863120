#pragma once

#include <algorithm>
#include <cmath>
#include <string>

#include "inceres/export.h"
#include "inceres/io/vio_sequence.h"

namespace inceres::internal {

// What is wrong with parts of a sequence, for its Validate() and for its reader, which knows the
// line.

template <typename Values>
bool AllFinite(const Values& values) {
  return std::all_of(std::begin(values), std::end(values),
                     [](double value) { return std::isfinite(value); });
}

/// Whether x, y, z, w is of length 1, up to what nine printed digits leave.
inline bool IsUnitQuaternion(const double* q) {
  return std::fabs(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0) < 1e-8;
}

/// "field: what is wrong", or empty. Exported for the simulator, which checks the same.
INCERES_EXPORT std::string FaultOf(const VioCamera& camera);
INCERES_EXPORT std::string FaultOf(double pixel_noise, const ImuNoise& noise);

}  // namespace inceres::internal
