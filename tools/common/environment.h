#pragma once

#include <string>
#include <utility>
#include <vector>

namespace inceres::tools {

/// What a measurement depends on besides the problem: names and values, for the report. Keys: "cpu", "hardware_threads",
/// "compiler", "flags", "build_type", "commit" (of the tree the tool was built from; "-dirty" if it had changes), "ceres",
/// "blas", "blas_config", "date".
std::vector<std::pair<std::string, std::string>> DescribeEnvironment();

/// True unless the BLAS of this process is known to start threads of its own.
bool BlasIsSerial();

}  // namespace inceres::tools
