#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <numeric>
#include <utility>
#include <vector>

#include "inceres/io/bal.h"
#include "tools/sim/portable_math.h"

namespace inceres::internal {

/// FNV-1a over the bits of all numbers of a problem.
inline std::uint64_t HashOf(const BalProblem& problem) {
  std::uint64_t hash = 0xcbf29ce484222325u;
  const auto add = [&](const void* data) {
    const auto* bytes = static_cast<const unsigned char*>(data);
    for (int i = 0; i < 8; ++i) {
      hash = (hash ^ bytes[i]) * 0x100000001b3u;
    }
  };
  for (const BalObservation& observation : problem.observations) {
    const std::int64_t camera = observation.camera, point = observation.point;
    add(&camera);
    add(&point);
    add(&observation.x);
    add(&observation.y);
  }
  for (const auto* values : {&problem.cameras, &problem.points}) {
    for (const double value : *values) {
      add(&value);
    }
  }
  return hash;
}

inline Vector3 CenterOf(const BalProblem& problem, int camera) {
  const double* c = problem.CameraData(camera);
  return -1.0 * (Rotation::FromAngleAxis({c[0], c[1], c[2]}).Inverse() * Vector3{c[3], c[4], c[5]});
}

inline double DepthOf(const BalProblem& problem, const BalObservation& observation) {
  const double* c = problem.CameraData(observation.camera);
  const double* X = problem.PointData(observation.point);
  return -(Rotation::FromAngleAxis({c[0], c[1], c[2]}) * Vector3{X[0], X[1], X[2]} +
           Vector3{c[3], c[4], c[5]})[2];
}

/// In how many parts cameras fall that no chain of common points connects.
inline int NumParts(const BalProblem& problem) {
  std::vector<int> parent(static_cast<std::size_t>(problem.num_cameras));
  std::iota(parent.begin(), parent.end(), 0);
  const auto root = [&](int i) {
    while (parent[static_cast<std::size_t>(i)] != i) {
      i = parent[static_cast<std::size_t>(i)] =
          parent[static_cast<std::size_t>(parent[static_cast<std::size_t>(i)])];
    }
    return i;
  };
  int parts = problem.num_cameras;
  for (std::size_t i = 1; i < problem.observations.size(); ++i) {
    const BalObservation &a = problem.observations[i - 1], &b = problem.observations[i];
    if (a.point == b.point && root(a.camera) != root(b.camera)) {
      parent[static_cast<std::size_t>(root(a.camera))] = root(b.camera);
      --parts;
    }
  }
  return parts;
}

/// Pairs of cameras that see a common point, each once.
inline std::vector<std::pair<int, int>> CovisiblePairs(const BalProblem& problem) {
  std::vector<std::pair<int, int>> pairs;
  const auto& observations = problem.observations;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    for (std::size_t j = i + 1;
         j < observations.size() && observations[j].point == observations[i].point; ++j) {
      pairs.emplace_back(observations[i].camera, observations[j].camera);
    }
  }
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  return pairs;
}

/// Tracks of at least two, sorted, in front of every camera at the truth and at the start; each
/// camera sees ten points; all cameras are connected. Empty if so, or what is wrong.
inline const char* WhatIsWrong(const BalProblem& problem, const BalProblem& truth) {
  if (!problem.Validate().ok() || !truth.Validate().ok()) {
    return "not valid";
  }
  std::vector<int> per_camera(static_cast<std::size_t>(truth.num_cameras));
  const auto& observations = problem.observations;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const BalObservation& o = observations[i];
    const bool first = i == 0 || observations[i - 1].point != o.point;
    const bool last = i + 1 == observations.size() || observations[i + 1].point != o.point;
    if ((first && last) || (!first && observations[i - 1].camera >= o.camera) ||
        (first && i > 0 && observations[i - 1].point + 1 != o.point)) {
      return "a track is too short, or not sorted";
    }
    if (DepthOf(truth, o) < 2.0 - 1e-9 || DepthOf(problem, o) <= 0.0) {
      return "a point is behind a camera, or too near";
    }
    ++per_camera[static_cast<std::size_t>(o.camera)];
  }
  if (observations.empty() || observations.front().point != 0 ||
      observations.back().point + 1 != truth.num_points) {
    return "a point is not seen";
  }
  if (*std::min_element(per_camera.begin(), per_camera.end()) < 10) {
    return "a camera sees too little";
  }
  return NumParts(problem) == 1 ? "" : "the cameras are in several parts";
}

}  // namespace inceres::internal
