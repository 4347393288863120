#pragma once

#include <algorithm>
#include <cstddef>
#include <string>
#include <type_traits>
#include <vector>

#include <gtest/gtest.h>

#include "base/aligned_vector.h"
#include "simd/kernels.h"
#include "support/random_values.h"

namespace inceres::internal {

/// A kernel test that runs once for every instruction set and is skipped, by name, where there is
/// none.
class KernelTest : public testing::TestWithParam<InstructionSet> {
 protected:
  void SetUp() override {
    kernels_ = KernelsFor(GetParam());
    if (kernels_ == nullptr) {
      GTEST_SKIP() << "this build or processor has no kernels of the set "
                   << testing::PrintToString(GetParam());
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

  // The same blocks of `depth` padded rows, each with its last column apart.
  static AlignedVector<double> WithTail(const AlignedVector<double>& padded, int depth, int size) {
    const std::size_t row = static_cast<std::size_t>(size / kQuad * kQuad);
    const std::size_t padded_row = row + kQuad;
    const std::size_t block = static_cast<std::size_t>(QuadsWithTail(depth, size) * kQuad);
    const auto rows = static_cast<std::size_t>(depth);
    const std::size_t num_blocks = padded.size() / (rows * padded_row);
    AlignedVector<double> values(num_blocks * block, 0.0);
    for (std::size_t b = 0; b < num_blocks; ++b) {
      for (std::size_t r = 0; r < rows; ++r) {
        const double* from = padded.data() + (b * rows + r) * padded_row;
        std::copy(from, from + row, values.data() + b * block + r * row);
        values[b * block + rows * row + r] = from[row];
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
void ExpectClose(const Values& actual, const Expected& expected, double scale, double tolerance,
                 const std::string& what) {
  ASSERT_EQ(actual.size(), expected.size());
  for (std::size_t k = 0; k < actual.size(); ++k) {
    ASSERT_NEAR(actual[k], expected[k], tolerance * scale) << what << ", entry " << k;
  }
}

// Blocks without padding from `data` on, kept in T.
template <typename T>
SlotJacobians UnpaddedSlot(T* data, std::ptrdiff_t factor_stride, int columns) {
  SlotJacobians slot = {nullptr, factor_stride, columns, columns};
  if constexpr (std::is_same_v<T, float>) {
    slot.single = data;
  } else {
    slot.data = data;
  }
  return slot;
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

#define INCERES_FOR_ALL_INSTRUCTION_SETS(Fixture)                                           \
  INSTANTIATE_TEST_SUITE_P(Sets, Fixture,                                                   \
                           testing::Values(InstructionSet::kGeneric, InstructionSet::kAvx2, \
                                           InstructionSet::kAvx512, InstructionSet::kNeon), \
                           InstructionSetName)

}  // namespace inceres::internal
