#pragma once

#include <memory>
#include <vector>

#include "inceres/problem/factor_graph.h"

namespace inceres::test {

/// A street of cameras whose factors are functors of our own, so that nobody can know what their
/// parameters mean.
struct StreetGraphOptions {
  int num_cameras = 40;
  int points_per_camera = 12;
  int num_views = 4;  ///< neighbors along the street that see a point
  /// cameras in blocks of rotation, translation and focal length; else one block of seven
  bool split = false;
  bool shared_focal = false;    ///< with `split`: all cameras have one focal length
  bool inverse_depth = false;   ///< points are (a, b, 1/depth) in the first camera's frame
  bool first_constant = false;  ///< the first camera is held
  bool priors = false;          ///< on every tenth camera's translation
  double drift = 0.02;          ///< start values: how far each camera is off the one before it
};

struct StreetGraph {
  FactorGraph graph;
  std::vector<VariableId> focals;  ///< with `split`
};

std::unique_ptr<StreetGraph> MakeStreetGraph(const StreetGraphOptions& options);

}  // namespace inceres::test
