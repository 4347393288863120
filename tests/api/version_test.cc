// What a user sees first: the version and the umbrella header.
#include "inceres/version.h"

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include <gtest/gtest.h>

#include "api/umbrella_alone.h"

namespace inceres {
namespace {

TEST(Version, IsThatOfTheProject) {
  EXPECT_EQ(std::string(INCERES_VERSION_STRING), INCERES_PROJECT_VERSION);
  const std::string joined = std::to_string(INCERES_VERSION_MAJOR) + "." +
                             std::to_string(INCERES_VERSION_MINOR) + "." +
                             std::to_string(INCERES_VERSION_PATCH);
  EXPECT_EQ(joined, INCERES_VERSION_STRING);
}

TEST(Umbrella, IsAllThatAProgramIncludes) {
  EXPECT_NEAR(test::CostByUmbrellaAlone(), 0.0, 1e-12);
}

// Every public header of the core is in it: whoever adds one adds it here too.
TEST(Umbrella, HasEveryHeaderOfTheCore) {
  const std::filesystem::path top = std::string(INCERES_SOURCE_DIR) + "/include";
  std::ifstream file(top / "inceres/inceres.h");
  const std::string umbrella((std::istreambuf_iterator<char>(file)),
                             std::istreambuf_iterator<char>());
  int count = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(top)) {
    const std::string header = entry.path().lexically_relative(top).generic_string();
    const bool outside = header.rfind("inceres/io/", 0) == 0 ||
                         header.rfind("inceres/storage/", 0) == 0 ||
                         header.rfind("inceres/distributed/", 0) == 0 ||
                         header == "inceres/inceres.h" || header == "inceres/eigen.h" ||
                         header == "inceres/autodiff/jet_eigen.h";  // of who has Eigen
    if (entry.path().extension() == ".h" && !outside) {
      ++count;
      EXPECT_NE(umbrella.find("#include \"" + header + "\"\n"), std::string::npos) << header;
    }
  }
  EXPECT_GT(count, 30);
}

}  // namespace
}  // namespace inceres
