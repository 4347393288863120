// The thresholds of the incremental solver have names, and those of a new solver are what was set
// before.

#include "incremental/tuning.h"

#include <fstream>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/solver/incremental_solver.h"
#include "incremental/incremental_bundle.h"

namespace inceres::internal {
namespace {

TEST(Tuning, EveryThresholdOfTheHeaderHasItsName) {
  Tuning tuning;
  std::set<std::string> names;
  std::set<const void*> places;
  for (const NamedThreshold& threshold : NamedThresholds(&tuning)) {
    EXPECT_TRUE((threshold.real == nullptr) != (threshold.count == nullptr)) << threshold.name;
    names.insert(threshold.name);
    places.insert(threshold.real != nullptr ? static_cast<const void*>(threshold.real)
                                            : threshold.count);
  }
  std::ifstream header(INCERES_SOURCE_DIR "/src/incremental/tuning.h");
  ASSERT_TRUE(header.good());
  std::size_t num_fields = 0;
  for (std::string line; std::getline(header, line);) {
    std::smatch field;
    if (std::regex_match(line, field, std::regex("    (?:double|int) (\\w+) = [^;]+;"))) {
      ++num_fields;
      bool named = false;
      for (const std::string& name : names) {
        named = named || name.substr(name.find('.') + 1) == field[1];
      }
      EXPECT_TRUE(named) << line;
    }
  }
  EXPECT_EQ(names.size(), num_fields);
  EXPECT_EQ(places.size(), num_fields);
}

TEST(Tuning, IsTakenByTheNextSolver) {
  const auto evaluations = [] {
    IncrementalOptions options;
    options.batch_share = 1.0;
    test::IncrementalBundle bundle(options);
    bundle.Grow(10, 60, 3);
    return bundle.solver.Update().num_evaluated_factors;
  };
  const auto usual = evaluations();
  TuningOfNewSolvers().stop.share = 1e-6;
  const auto strict = evaluations();
  TuningOfNewSolvers() = Tuning();
  EXPECT_GT(strict, usual);
  EXPECT_EQ(evaluations(), usual);
}

}  // namespace
}  // namespace inceres::internal
