#pragma once

#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "base/aligned_vector.h"
#include "block/kernels.h"
#include "support/random_values.h"

namespace inceres::internal {

/// A kernel test that runs once for every instruction set and is skipped, by name, where there is none.
class KernelTest : public testing::TestWithParam<InstructionSet> {
 protected:
  void SetUp() override {
    kernels_ = KernelsFor(GetParam());
    if (kernels_ == nullptr) {
      GTEST_SKIP() << "this build or processor has no kernels of the set " << testing::PrintToString(GetParam());
    }
  }

  const Kernels& kernels() const { return *kernels_; }
  static const Kernels& generic() { return *KernelsFor(InstructionSet::kGeneric); }

  // Rows of `size` random entries, zeros up to the next quad.
  AlignedVector<double> PaddedRows(int rows, int size) {
    AlignedVector<double> values(static_cast<std::size_t>(rows * PadToQuad(size)), 0.0);
    for (int r = 0; r < rows; ++r) {
      for (int c = 0; c < size; ++c) {
        values[static_cast<std::size_t>(r * PadToQuad(size) + c)] = random_.Unit();
      }
    }
    return values;
  }

  test::Random random_{12345};

 private:
  const Kernels* kernels_ = nullptr;
};

/// Both within `tolerance` of the sum of the magnitudes that went into it.
template <typename Values, typename Expected>
void ExpectClose(const Values& actual, const Expected& expected, double scale, double tolerance, const std::string& what) {
  ASSERT_EQ(actual.size(), expected.size());
  for (std::size_t k = 0; k < actual.size(); ++k) {
    ASSERT_NEAR(actual[k], expected[k], tolerance * scale) << what << ", entry " << k;
  }
}

inline std::string InstructionSetName(const testing::TestParamInfo<InstructionSet>& info) {
  switch (info.param) {
    case InstructionSet::kGeneric:
      return "Generic";
    case InstructionSet::kAvx2:
      return "Avx2";
    case InstructionSet::kAvx512:
      return "Avx512";
    case InstructionSet::kNeon:
      return "Neon";
  }
  return "Unknown";
}

#define INCERES_FOR_ALL_INSTRUCTION_SETS(Fixture)                                                                       \
  INSTANTIATE_TEST_SUITE_P(                                                                                             \
      Sets, Fixture,                                                                                                    \
      testing::Values(InstructionSet::kGeneric, InstructionSet::kAvx2, InstructionSet::kAvx512, InstructionSet::kNeon), \
      InstructionSetName)

}  // namespace inceres::internal
