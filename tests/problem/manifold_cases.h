#pragma once

#include <functional>
#include <memory>
#include <ostream>
#include <random>
#include <string>
#include <vector>

#include "inceres/problem/manifolds.h"
#include "inceres/problem/rotation.h"

namespace inceres {

using Random = std::mt19937_64;

inline double Uniform(Random& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

inline std::vector<double> RandomVector(Random& random, int size, double limit = 2.0) {
  std::vector<double> values(static_cast<std::size_t>(size));
  for (double& value : values) {
    value = Uniform(random, -limit, limit);
  }
  return values;
}

// A unit quaternion; every fifth is within 1e-9 of the identity and every fifth within 1e-9 of a
// half turn.
inline std::vector<double> RandomQuaternion(Random& random) {
  std::vector<double> q = RandomVector(random, 4);
  const double shrink = std::uniform_int_distribution<int>(0, 4)(random);
  for (int k = 0; k < 3; ++k) {
    q[static_cast<std::size_t>(k)] *= shrink == 0 ? 1e-9 : 1.0;
  }
  q[3] *= shrink == 1 ? 1e-9 : 1.0;
  const double norm = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  for (double& value : q) {
    value /= norm;
  }
  return q;
}

inline std::vector<double> RandomPose(Random& random) {
  std::vector<double> pose = RandomVector(random, 3);
  const std::vector<double> q = RandomQuaternion(random);
  pose.insert(pose.end(), q.begin(), q.end());
  return pose;
}

inline std::vector<double> RandomSimilarity(Random& random) {
  std::vector<double> similarity = RandomPose(random);
  similarity.push_back(std::exp(Uniform(random, -2.0, 0.0)));
  return similarity;
}

// One manifold under test, with the sizes it must have and a generator of points on it.
struct ManifoldCase {
  std::string name;
  std::shared_ptr<const Manifold> manifold;
  int ambient_size;
  int tangent_size;
  std::function<std::vector<double>(Random&)> random_point;
};

// What GoogleTest and CTest call the instance.
inline void PrintTo(const ManifoldCase& manifold_case, std::ostream* stream) {
  *stream << manifold_case.name;
}

inline std::vector<ManifoldCase> AllManifolds() {
  const auto vector_of = [](int size) {
    return [size](Random& random) { return RandomVector(random, size); };
  };
  const auto product_point = [](Random& random) {
    std::vector<double> x = RandomVector(random, 5);
    const std::vector<double> q = RandomQuaternion(random);
    x.insert(x.end(), q.begin(), q.end());
    const std::vector<double> rest = RandomVector(random, 4);
    x.insert(x.end(), rest.begin(), rest.end());
    return x;
  };
  const auto product =
      std::make_shared<ProductManifold>(std::vector<std::shared_ptr<const Manifold>>{
          std::make_shared<EuclideanManifold>(3),
          std::make_shared<SubsetManifold>(2, std::vector<int>{0, 1}),
          std::make_shared<QuaternionManifold>(), std::make_shared<SphereManifold>(4)});
  return {
      {"Euclidean", std::make_shared<EuclideanManifold>(5), 5, 5, vector_of(5)},
      {"Subset", std::make_shared<SubsetManifold>(6, std::vector<int>{4, 0, 4}), 6, 4,
       vector_of(6)},
      {"Sphere3", std::make_shared<SphereManifold>(3), 3, 2, vector_of(3)},
      {"Sphere4", std::make_shared<SphereManifold>(4), 4, 3, vector_of(4)},
      {"Quaternion", std::make_shared<QuaternionManifold>(), 4, 3, RandomQuaternion},
      {"EigenQuaternion", std::make_shared<EigenQuaternionManifold>(), 4, 3, RandomQuaternion},
      {"RotationQuaternion", std::make_shared<RotationQuaternionManifold>(), 4, 3,
       RandomQuaternion},
      {"Pose", std::make_shared<PoseManifold>(), 7, 6, RandomPose},
      {"LeftPose", std::make_shared<LeftPoseManifold>(), 7, 6, RandomPose},
      {"SE3", std::make_shared<SE3Manifold>(), 7, 6, RandomPose},
      {"Similarity", std::make_shared<SimilarityManifold>(), 8, 7, RandomSimilarity},
      {"SE2", std::make_shared<SE2Manifold>(), 3, 3, vector_of(3)},
      {"Product", product, 13, 9, product_point},
  };
}

}  // namespace inceres
