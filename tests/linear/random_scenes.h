#pragma once

#include <algorithm>
#include <cstdlib>
#include <set>
#include <utility>
#include <vector>

#include "linear/random_system.h"

namespace inceres::internal {

/// A path of frames of 6 that know the ten before them, with a loop every 60 frames: subtrees
/// beside each other, large fronts above.
inline RandomSystem PathWithLoops(int num_frames) {
  return {std::vector<int>(static_cast<std::size_t>(num_frames), 6),
          [](int i, int j) {
            return i - j <= 10 || (i % 60 == 0 && j % 60 == 0 && (i - j) % 180 == 0);
          },
          1};
}

/// A street grid of blocks, each coupled to those up to two away: dear enough for its size to be
/// cut into many parts.
inline RandomSystem Grid(int width, int height, int block_size) {
  const auto is_near = [width](int i, int j) {
    return std::abs(i / width - j / width) <= 2 && std::abs(i % width - j % width) <= 2;
  };
  return {std::vector<int>(static_cast<std::size_t>(width * height), block_size), is_near, 1};
}

/// Cameras of 6, each coupled to half of a few points of 3, and sets of such that share nothing but
/// one last block: fronts with very many children, some of them in subtrees beside each other.
inline RandomSystem FewPointsSeenByMany(int num_cameras, int num_points, int num_sets,
                                        unsigned seed) {
  std::vector<int> sizes;
  test::Random random(seed);
  std::set<std::pair<int, int>> coupled;
  for (int s = 0; s < num_sets; ++s) {
    const int first_point = static_cast<int>(sizes.size());
    sizes.insert(sizes.end(), static_cast<std::size_t>(num_points), 3);
    for (int c = 0; c < num_cameras; ++c) {
      for (int p = 0; p < num_points; ++p) {
        if (random.Between(0.0, 1.0) < 0.5) {
          coupled.emplace(static_cast<int>(sizes.size()), first_point + p);
        }
      }
      sizes.push_back(6);
    }
  }
  for (int block = 0; block < static_cast<int>(sizes.size()); ++block) {
    coupled.emplace(static_cast<int>(sizes.size()), block);
  }
  sizes.push_back(5);
  return {sizes, coupled, seed};
}

/// Poses of so many rows, each row coupled to all of the poses beside it; loops between some, a
/// branch that ends freely, and a ring that hangs on one pose.
inline RandomSystem Odometry(int num_poses, const std::vector<int>& rows_of_pose, unsigned seed) {
  const int num_rows = static_cast<int>(rows_of_pose.size());
  std::vector<int> sizes;
  for (int pose = 0; pose < num_poses; ++pose) {
    sizes.insert(sizes.end(), rows_of_pose.begin(), rows_of_pose.end());
  }
  test::Random random(seed);
  std::vector<std::pair<int, int>> loops;
  for (int k = 0; k < num_poses / 12; ++k) {
    loops.emplace_back(random.Below(num_poses / 2), random.Below(num_poses / 2));
  }
  // The branch begins in the middle, the ring before the last fifth.
  const int branch = num_poses / 2, ring = num_poses - num_poses / 5;
  return {sizes,
          [=](int i, int j) {
            const int a = i / num_rows, b = j / num_rows;
            const bool in_turn = a - b <= 1 && a != branch;
            const bool at_branch = a == branch && (b == branch || b == 2);
            const bool closes_ring = a == num_poses - 1 && b == ring;
            return in_turn || at_branch || closes_ring ||
                   std::any_of(loops.begin(), loops.end(), [&](const auto& loop) {
                     return std::max(loop.first, loop.second) == a &&
                            std::min(loop.first, loop.second) == b;
                   });
          },
          seed};
}

}  // namespace inceres::internal
