// Saved graphs from anyone: whatever is done to one, with a checksum that is right, loading it
// fails with a reason or gives a graph that validates, and asks for no memory that the file is not
// as large as.
#include <algorithm>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string>

#include <gtest/gtest.h>

#include "inceres/storage/graph_file.h"
#include "storage/every_family.h"
#include "storage/rewrite_heading.h"
#include "support/random_values.h"

namespace inceres {
namespace {

using test::kGraphHeading;
using test::WithTrueHeading;

class Mutations : public testing::Test {
 protected:
  Mutations() {
    test::MakeEverything(&original_);
    EXPECT_TRUE(SaveGraphToBytes(original_, formats_, &bytes_).ok());
  }

  // Whether it was loaded.
  bool Load(const std::string& bytes) {
    const double mark = 5.0;
    FactorGraph graph;
    graph.AddVariable(&mark, 1, Role::kFrame);
    LoadedFamilies families;
    const Status status = LoadGraphFromBytes(bytes, formats_, &graph, &families);
    if (status.ok()) {
      EXPECT_TRUE(graph.Validate().ok());
      return true;
    }
    EXPECT_FALSE(status.message.empty());
    const bool unknown_format = status.message.find("which is not known here") != std::string::npos;
    EXPECT_EQ(status.code, unknown_format ? StatusCode::kUnavailable : StatusCode::kIo)
        << status.message;
    EXPECT_EQ(graph.num_variables(), 1);
    EXPECT_EQ(*graph.Values(0), 5.0);
    EXPECT_TRUE(families.families.empty());
    return false;
  }

  FactorGraph original_;
  GraphFormats formats_;
  std::string bytes_;
};

TEST_F(Mutations, EveryTruncationIsRefused) {
  // At the end stand the elimination groups of two variables. A graph without any ends before.
  constexpr std::size_t kGroups = 8 + 2 * 8;
  ASSERT_TRUE(Load(bytes_));
  for (std::size_t size = kGraphHeading; size < bytes_.size();
       size += size < 400 || size + 100 > bytes_.size() ? 1 : 7) {
    EXPECT_EQ(Load(WithTrueHeading(bytes_.substr(0, size))), size + kGroups == bytes_.size())
        << size;
  }
}

TEST_F(Mutations, WhatIsLeftOverIsRefused) {
  EXPECT_FALSE(Load(WithTrueHeading(bytes_ + std::string(1, '\0'))));
  EXPECT_FALSE(Load(WithTrueHeading(bytes_ + bytes_.substr(kGraphHeading))));
}

// Huge, negative and just too large numbers wherever a count might be.
TEST_F(Mutations, NoCountIsBelieved) {
  const std::int64_t numbers[] = {std::numeric_limits<std::int64_t>::max(),
                                  std::numeric_limits<std::int64_t>::min(),
                                  std::int64_t{1} << 40,
                                  (std::int64_t{1} << 61) + 1,
                                  -1,
                                  static_cast<std::int64_t>(bytes_.size()),
                                  INT32_MAX,
                                  std::int64_t{0}};
  int turn = 0;
  int num_loaded = 0;
  for (std::size_t at = kGraphHeading; at + 8 <= bytes_.size(); at += 3) {
    std::string mutated = bytes_;
    std::memcpy(&mutated[at], &numbers[turn++ % 8], 8);
    num_loaded += Load(WithTrueHeading(mutated)) ? 1 : 0;
  }
  EXPECT_GT(num_loaded, 0) << "numbers of measurements may be anything";
  EXPECT_LT(num_loaded, turn);
}

// Flipped bits, random bytes, pieces cut out, doubled and exchanged; the same ones at every run.
TEST_F(Mutations, RandomDamageIsRefusedOrHarmless) {
  test::Random random(17);
  int num_loaded = 0;
  for (int round = 0; round < 4000; ++round) {
    std::string mutated = bytes_;
    for (int change = random.Below(4); change >= 0; --change) {
      const auto below = [&random](std::size_t size) {
        return static_cast<std::size_t>(random.Below(static_cast<int>(size)));
      };
      const std::size_t at = kGraphHeading + below(mutated.size() - kGraphHeading);
      const std::size_t piece = std::min<std::size_t>(1 + below(40), mutated.size() - at);
      switch (random.Below(5)) {
        case 0:
          mutated[at] = static_cast<char>(mutated[at] ^ (1 << random.Below(8)));
          break;
        case 1:
          mutated[at] = static_cast<char>(random.Below(256));
          break;
        case 2:
          mutated.erase(at, piece);
          break;
        case 3:
          mutated.insert(at, mutated.substr(at, piece));
          break;
        case 4:
          mutated.replace(at, piece, bytes_, kGraphHeading + below(bytes_.size() - 100), piece);
          break;
      }
      if (mutated.size() <= kGraphHeading + 100) {
        break;
      }
    }
    num_loaded += Load(WithTrueHeading(mutated)) ? 1 : 0;
  }
  EXPECT_GT(num_loaded, 100);
  EXPECT_LT(num_loaded, 3900);
}

}  // namespace
}  // namespace inceres
