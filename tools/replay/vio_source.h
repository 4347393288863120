#pragma once

#include <memory>
#include <string>

#include "inceres/io/vio_sequence.h"
#include "inceres/status.h"
#include "tools/problems/problem_source.h"

namespace inceres::tools {

/// The sequence of "vio:NAME": simulated, if NAME is a preset of GenerateVioScene (./NAME is then
/// the file), else read from a file. kIo if it has fewer than two frames.
Status OpenVioSequence(const std::string& name, VioSequence* sequence);

/// All frames of a sequence at once, as MakeVioReplay has them, without its prior; parameters are
/// the variables in its order. The same analytic factors for all: cost functions of Ceres call the
/// core's. Requires Validate() and two or more frames.
Status MakeVioSource(const VioSequence& sequence, std::unique_ptr<ProblemSource>* source);

}  // namespace inceres::tools
