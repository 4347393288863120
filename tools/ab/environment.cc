#include "tools/ab/environment.h"

#include <dlfcn.h>

#include <climits>
#include <cstdlib>
#include <ctime>
#include <thread>

#include <ceres/version.h>

#include "inceres_tools_build_info.h"
#include "src/base/cpu_model.h"

namespace inceres::tools {
namespace {

// The file that supplies dgemm_ to CHOLMOD and Ceres, links resolved, last two components: the
// folder tells the flavours apart.
std::string BlasLibrary() {
  void* dgemm = dlsym(RTLD_DEFAULT, "dgemm_");
  Dl_info info;
  if (dgemm == nullptr || dladdr(dgemm, &info) == 0) {
    return "unknown";
  }
  char resolved[PATH_MAX];
  const std::string path =
      realpath(info.dli_fname, resolved) != nullptr ? resolved : info.dli_fname;
  const std::size_t last = path.rfind('/');
  const std::size_t folder =
      last == std::string::npos || last == 0 ? last : path.rfind('/', last - 1);
  return folder == std::string::npos ? path : path.substr(folder + 1);
}

template <typename Function>
Function* FindBlasFunction(const char* name) {
  if (BlasLibrary().find("openblas") == std::string::npos) {
    return nullptr;  // an OpenBLAS may be loaded as well, but it is not the one in use
  }
  return reinterpret_cast<Function*>(dlsym(RTLD_DEFAULT, name));
}

std::string BlasConfig() {
  auto* get_config = FindBlasFunction<char*()>("openblas_get_config");
  return get_config == nullptr ? "unknown" : get_config();
}

std::string Now() {
  const std::time_t now = std::time(nullptr);
  char text[32];
  std::strftime(text, sizeof(text), "%Y-%m-%dT%H:%M:%SZ", std::gmtime(&now));
  return text;
}

}  // namespace

std::vector<std::pair<std::string, std::string>> DescribeEnvironment() {
  return {{"cpu", internal::CpuModel()},
          {"hardware_threads", std::to_string(std::thread::hardware_concurrency())},
          {"compiler", kBuildCompiler},
          {"flags", kBuildFlags},
          {"build_type", kBuildType},
          {"commit", kBuildCommit},
          {"ceres", CERES_VERSION_STRING},
          {"blas", BlasLibrary()},
          {"blas_config", BlasConfig()},
          {"date", Now()}};
}

bool BlasIsSerialOpenBlas() {
  auto* get_parallel = FindBlasFunction<int()>("openblas_get_parallel");
  return get_parallel != nullptr && get_parallel() == 0;
}

}  // namespace inceres::tools
