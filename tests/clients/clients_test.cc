// What well-known programs do with Ceres, by a program that knows nothing else, run bare and with
// the drop-in in front of Ceres: the same results.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "dropin/run_program.h"

namespace inceres::testing {
namespace {

struct Client {
  const char* name;
  // of numbers; where a trace is long, rounding adds up
  double tolerance;
  bool exact_counts;
  // what of its calls stock still answers
  const char* left_to_stock;
};

// Of inexact steps on numeric derivatives, stopped on the way: stock differs from itself by 2e-4
// where one value of the start is moved by a few units in the last place.
constexpr double kOfInexactSteps = 1e-3;

void PrintTo(const Client& client, std::ostream* stream) {
  *stream << client.name;
}

// All but times.
std::vector<std::string> Lines(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) {
    if (line.rfind("seconds ", 0) != 0) {
      lines.push_back(line);
    }
  }
  return lines;
}

void ExpectCloseLine(const std::string& stock, const std::string& ours, double tolerance) {
  std::istringstream a(stock), b(ours);
  std::string word_a, word_b;
  while (a >> word_a) {
    ASSERT_TRUE(b >> word_b) << ours;
    char* end = nullptr;
    const double value = std::strtod(word_a.c_str(), &end);
    if (*end != '\0') {
      EXPECT_EQ(word_a, word_b);
      continue;
    }
    EXPECT_NEAR(std::strtod(word_b.c_str(), nullptr), value,
                tolerance * std::max(1.0, std::abs(value)))
        << stock << "\n"
        << ours;
  }
  EXPECT_FALSE(b >> word_b) << ours;
}

class Clients : public ::testing::TestWithParam<Client> {};

TEST_P(Clients, HaveTheSameResultsWithTheDropIn) {
  const Client& client = GetParam();
  const ProgramRun bare = RunProgram(INCERES_CLIENT_PROGRAM, client.name, "");
  const ProgramRun ours = RunProgram(INCERES_CLIENT_PROGRAM, client.name,
                                     "LD_PRELOAD=" INCERES_DROPIN " GLOG_logtostderr=1");
  ASSERT_EQ(bare.exit_code, 0) << bare.err;
  ASSERT_EQ(ours.exit_code, 0) << ours.err;
  const std::vector<std::string> stock_lines = Lines(bare.out), our_lines = Lines(ours.out);
  ASSERT_EQ(stock_lines.size(), our_lines.size()) << ours.out;
  ASSERT_GE(stock_lines.size(), 3U);
  for (std::size_t k = 0; k < stock_lines.size(); ++k) {
    const bool counts = stock_lines[k].rfind("termination ", 0) == 0;
    ExpectCloseLine(stock_lines[k], our_lines[k],
                    counts && client.exact_counts ? 0.0 : client.tolerance);
  }
  const std::string handed = "inceres: handed to stock Ceres: ";
  const std::size_t at = ours.err.find(handed);
  if (client.left_to_stock == nullptr) {
    EXPECT_EQ(at, std::string::npos) << ours.err.substr(std::min(at, ours.err.size()), 200);
  } else {
    EXPECT_NE(ours.err.find(client.left_to_stock), std::string::npos) << ours.err;
  }
}

INSTANTIATE_TEST_SUITE_P(Of, Clients,
                         ::testing::Values(Client{"colmap_local", 1e-6, true, nullptr},
                                           Client{"colmap_global", 1e-6, true, nullptr},
                                           Client{"alicevision", 1e-6, true, nullptr},
                                           Client{"openmvg", 1e-6, true, nullptr},
                                           Client{"theia", 1e-6, true, nullptr},
                                           Client{"opensfm", 1e-6, true, nullptr},
                                           Client{"cartographer", 1e-6, true, nullptr},
                                           Client{"slam_toolbox", 1e-6, true, nullptr},
                                           Client{"openvins", 1e-6, true, nullptr},
                                           Client{"fuse", 1e-6, true, nullptr},
                                           Client{"asp", kOfInexactSteps, true, nullptr}),
                         [](const auto& client) { return std::string(client.param.name); });

}  // namespace
}  // namespace inceres::testing
