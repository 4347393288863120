#include "base/zeroed_array.h"

#include <cstdint>
#include <utility>

#include <gtest/gtest.h>

namespace inceres::internal {
namespace {

TEST(ZeroedArray, IsZeroAndAlignedWhateverItsSize) {
  for (const std::size_t size :
       {std::size_t{1}, std::size_t{7}, std::size_t{100000}, std::size_t{3} << 20}) {
    const ZeroedArray array(size);
    ASSERT_EQ(array.size(), size);
    const auto alignment = static_cast<std::uintptr_t>(CacheLineAllocator<double>::Alignment(size));
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(array.data()) % alignment, 0U);
    for (std::size_t k = 0; k < size; ++k) {
      ASSERT_EQ(array.data()[k], 0.0) << "entry " << k << " of " << size;
    }
    array.data()[size - 1] = 1.0;  // is there
  }
}

TEST(ZeroedArray, MovesWithItsMemory) {
  ZeroedArray first(3);
  double* const data = first.data();
  data[2] = 5.0;
  const ZeroedArray second = std::move(first);
  EXPECT_EQ(second.data(), data);
  EXPECT_EQ(second.data()[2], 5.0);
  EXPECT_EQ(ZeroedArray().size(), 0U);
}

}  // namespace
}  // namespace inceres::internal
