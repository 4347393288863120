#pragma once

#include <string>

#include "inceres/ceres/cross_check.h"

namespace inceres::internal {

/// What the log says of a cross-check that found violations: each of them, the first iteration that
/// differs, the parameter that differs most, and both traces side by side around that iteration.
std::string DescribeDisagreement(const CrossCheckResult& result);

/// What the log says of one that found differences beyond the tolerances, but excused them.
std::string DescribeExcuse(const CrossCheckResult& result);

}  // namespace inceres::internal
