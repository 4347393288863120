#include "base/available_memory.h"

#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <string>

#include <sys/resource.h>

// What a memory budget (base/memory_budget.h) is held against where the user sets none. Three
// limits may bind, and each is told by another file of Linux: the machine's free memory
// (/proc/meminfo), the control group a container runs in (/sys/fs/cgroup), the address space of the
// process (RLIMIT_AS). Any file that is missing or has no such number counts as no limit, so that a
// system without them has infinitely much.

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
    // A word where a number should be has set the fail bit.
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

// MemAvailable, and not MemFree: what the kernel could give back without swapping is in it. In kB.
double LeftOfMachine() {
  return 1024.0 * NumberAfter("MemAvailable:", "/proc/meminfo");
}

// What the group of a folder allows. Only "anon" is counted as used, pages of programs and data:
// with memory.current, files that were read once would count, whose pages can be given back.
double LeftOfGroup(const std::string& folder) {
  const double limit = FirstNumber(folder + "/memory.max");
  const double used =
      limit < kUnlimited ? NumberAfter("anon", folder + "/memory.stat") : kUnlimited;
  return used < kUnlimited ? limit - used : kUnlimited;
}

// The first number of statm is the size of the address space in pages, which is what RLIMIT_AS is
// about; the resident set is smaller.
double LeftOfAddressSpace() {
  rlimit limit = {};
  if (getrlimit(RLIMIT_AS, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) {
    return kUnlimited;
  }
  const double used = FirstNumber("/proc/self/statm") * static_cast<double>(sysconf(_SC_PAGESIZE));
  return static_cast<double>(limit.rlim_cur) - (used < kUnlimited ? used : 0.0);
}

}  // namespace

// A group's limit binds all groups in it, and a group that has none of its own may be in one that
// has: a service in a slice, a scope in a user's slice.
double LeftOfControlGroups(const std::string& membership, const std::string& root) {
  std::ifstream file(membership);
  std::string line;
  double left = kUnlimited;
  while (std::getline(file, line)) {
    // The line of version 2, "0::/path"; those of version 1 start with another number. The root
    // group is "0::/".
    if (line.rfind("0::/", 0) != 0) {
      continue;
    }
    std::string path = line.substr(3);
    while (!path.empty()) {
      left = std::min(left, LeftOfGroup(root + path));
      path.resize(path.rfind('/'));
    }
    left = std::min(left, LeftOfGroup(root));
  }
  return left;
}

double AvailableBytes() {
  // A group may hold more than its limit for a moment: never less than nothing.
  return std::max(
      0.0, std::min({LeftOfMachine(), LeftOfControlGroups("/proc/self/cgroup", "/sys/fs/cgroup"),
                     LeftOfAddressSpace()}));
}

}  // namespace inceres::internal
