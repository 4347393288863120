#pragma once

#include <cstdint>
#include <string>

#include "adapters/ceres/fallback/gate.h"

namespace inceres::internal {

/// Number of this process's next solve that goes to the log of that name, from 0.
std::int64_t NextNumberInLog(const std::string& path);

/// Whether stock begins the next comparison that goes to this log: half of the time, in the order
/// of the Thue–Morse sequence, which has no rhythm. Taken in plain turns, one of the two would
/// always get, say, the window after a keyframe.
bool StockGoesFirst(const std::string& path);

/// One line, without its end, for a solve that has ended; docs/compare.md lists the fields.
std::string LogLine(const SolveCall& call, std::int64_t number);

/// Appends the line and its end with one write at the end of the file, so that lines of several
/// threads and processes do not mix. A file that cannot be written is named in the log, once in the
/// life of the process; nothing else happens.
void AppendToLog(const std::string& path, const std::string& line);

}  // namespace inceres::internal
