#include "base/cpu_model.h"

#include <cstddef>
#include <fstream>

// The first "model name : …" of /proc/cpuinfo, which x86 has; on an architecture that does not
// write such a line, or outside Linux, it is "unknown". For reports and benchmarks only: which
// kernels run is decided by what the processor can do, not by its name.

namespace inceres::internal {

std::string CpuModel() {
  std::ifstream cpuinfo("/proc/cpuinfo");
  for (std::string line; std::getline(cpuinfo, line);) {
    const std::size_t colon = line.find(": ");
    if (line.rfind("model name", 0) == 0 && colon != std::string::npos) {
      return line.substr(colon + 2);
    }
  }
  return "unknown";
}

}  // namespace inceres::internal
