#pragma once

#include <cstdint>
#include <vector>

#include "linear/aggregation.h"

namespace inceres::internal {

/// Which frames see each landmark, each once.
struct Visibility {
  int num_frames;
  const std::vector<int>& begin;  // per landmark, one more
  const std::int32_t* frames;

  int num_landmarks() const { return static_cast<int>(begin.size()) - 1; }
};

/// Clusters of frames that see the same landmarks, as Ceres 2.1 finds them for CLUSTER_JACOBI. Two
/// frames are as similar as the landmarks that both see are many, over the geometric mean of what
/// each sees. Cost: Σ over landmarks of frames², and for canonical views clusters times edges.
///
/// Canonical views: one after the other the frame that adds most to Σ over frames of the similarity
/// to the nearest center becomes a center, while it adds more than 3; at least three of them.
/// Single linkage: what is connected by similarities of 0.9 or more. With `tridiagonal` each
/// cluster has up to two neighbors: paths, of the pairs with the most landmarks in common first.
///
/// A frame that no center is like goes to a cluster by its number, and where two are equal the
/// order of libstdc++'s unordered containers decides, as in Ceres, which may number frames
/// otherwise: clusters are its own where neither occurs. Sources: Simon, Snavely & Seitz, "Scene
/// summarization for online image collections", ICCV 2007; Kushal & Agarwal, "Visibility based
/// preconditioning for bundle adjustment", CVPR 2012.
FrameClusters FindVisibilityClusters(const Visibility& visibility, bool single_linkage,
                                     bool tridiagonal);

}  // namespace inceres::internal
