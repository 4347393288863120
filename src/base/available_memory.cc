#include "base/available_memory.h"

#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <string>

#include <sys/resource.h>

namespace inceres::internal {
namespace {

constexpr double kUnlimited = std::numeric_limits<double>::infinity();

// The number after a word in a file of lines "word number …"; infinite if there is none.
double NumberAfter(const std::string& word, const std::string& path) {
  std::ifstream file(path);
  std::string found;
  while (file >> found) {
    double number = 0.0;
    if (found == word && file >> number) {
      return number;
    }
    file.clear();
    file.ignore(std::numeric_limits<std::streamsize>::max(), '\n');
  }
  return kUnlimited;
}

double FirstNumber(const std::string& path) {
  std::ifstream file(path);
  double number = 0.0;
  return file >> number ? number : kUnlimited;  // "max": no limit
}

double LeftOfMachine() {
  return 1024.0 * NumberAfter("MemAvailable:", "/proc/meminfo");
}

// Pages of files can be given back: those of programs and data count.
double LeftOfControlGroup() {
  std::ifstream file("/proc/self/cgroup");
  std::string line;
  double left = kUnlimited;
  while (std::getline(file, line)) {
    if (line.rfind("0::", 0) == 0) {
      const std::string folder = "/sys/fs/cgroup" + (line.size() == 4 ? "" : line.substr(3));
      const double limit = FirstNumber(folder + "/memory.max");
      const double used = NumberAfter("anon", folder + "/memory.stat");
      left = limit < kUnlimited && used < kUnlimited ? limit - used : kUnlimited;
    }
  }
  return left;
}

double LeftOfAddressSpace() {
  rlimit limit = {};
  if (getrlimit(RLIMIT_AS, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) {
    return kUnlimited;
  }
  const double used = FirstNumber("/proc/self/statm") * static_cast<double>(sysconf(_SC_PAGESIZE));
  return static_cast<double>(limit.rlim_cur) - (used < kUnlimited ? used : 0.0);
}

}  // namespace

double AvailableBytes() {
  return std::max(0.0, std::min({LeftOfMachine(), LeftOfControlGroup(), LeftOfAddressSpace()}));
}

}  // namespace inceres::internal
