#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>

namespace inceres::test {

/// Path of a public data set that does not ship with the repository: below $INCERES_DATA_DIR, or
/// below `../shared/data` of the source tree if that is not set. Empty if the file is not there;
/// the test then says GTEST_SKIP() << MissingData(name).
inline std::string FindData(const std::string& name) {
  const char* directory = std::getenv("INCERES_DATA_DIR");
  const std::string path =
      (directory != nullptr ? std::string(directory)
                            : std::string(INCERES_SOURCE_DIR "/../shared/data")) +
      "/" + name;
  return std::filesystem::exists(path) ? path : std::string();
}

inline std::string MissingData(const std::string& name) {
  return "needs " + name + " below $INCERES_DATA_DIR";
}

}  // namespace inceres::test
