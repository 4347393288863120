#pragma once

#include <string>
#include <utility>
#include <vector>

namespace inceres::tools {

/// What a measurement depends on besides the problem: names and values, for the report. Keys:
/// "cpu", "hardware_threads", "compiler", "flags", "build_type", "commit" (of the tree the tool was
/// built from; "-dirty" if it had changes), "ceres", "blas", "blas_config", "date".
std::vector<std::pair<std::string, std::string>> DescribeEnvironment();

/// True if this process uses an OpenBLAS that starts no threads of its own, which measurements are
/// meant to be taken with.
bool BlasIsSerialOpenBlas();

}  // namespace inceres::tools
