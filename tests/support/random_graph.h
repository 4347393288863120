#pragma once

#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "inceres/problem/factor_graph.h"
#include "support/test_families.h"

namespace inceres::test {

/// Builds graphs of SmoothFamily factors from a seed. Factors of one shape share a family.
class RandomGraph {
 public:
  explicit RandomGraph(unsigned seed) : random_(seed) {}

  VariableId AddFrame(int size) { return AddVariable(size, Role::kFrame, nullptr); }
  VariableId AddFrame(std::shared_ptr<const Manifold> manifold) {
    return AddCurved(Role::kFrame, std::move(manifold));
  }
  VariableId AddLandmark(int size) { return AddVariable(size, Role::kLandmark, nullptr); }
  VariableId AddLandmark(std::shared_ptr<const Manifold> manifold) {
    return AddCurved(Role::kLandmark, std::move(manifold));
  }
  /// A constant in memory of this object.
  VariableId AddBorrowed(int size);

  /// Adds a factor between these variables; its residuals at the current values are random, up to
  /// `noise` in size.
  void Connect(int residual_size, const std::vector<VariableId>& ids,
               std::shared_ptr<const Loss> loss = nullptr, double noise = 0.5);

  /// Moves every variable that is not constant by a random tangent vector with entries up to
  /// `size`.
  void Perturb(double size);

  FactorGraph& graph() { return graph_; }
  Random& random() { return random_; }

 private:
  VariableId AddVariable(int size, Role role, std::shared_ptr<const Manifold> manifold);
  VariableId AddCurved(Role role, std::shared_ptr<const Manifold> manifold);
  const FamilyHandle<SmoothFamily>& FamilyFor(int residual_size,
                                              const std::vector<VariableId>& ids);

  Random random_;
  FactorGraph graph_;
  // by residual size and sizes of the slots
  std::map<std::vector<int>, FamilyHandle<SmoothFamily>> families_;
  std::vector<std::unique_ptr<std::vector<double>>> borrowed_;
};

/// What a random bundle-adjustment-like problem is made of.
struct BundleOptions {
  unsigned seed = 1;
  int num_frames = 6;
  int num_landmarks = 30;
  std::vector<int> frame_sizes = {6};     ///< taken in turn
  std::vector<int> landmark_sizes = {3};  ///< taken in turn
  std::vector<int> residual_sizes = {2};  ///< of observations, taken in turn
  int num_views = 3;                      ///< frames that see each landmark
  bool hosted = false;                    ///< observations touch the landmark's first frame as well
  bool by_frame = false;  ///< observations are added frame by frame, not landmark by landmark
  /// quaternions, spheres, subsets and poses instead of some Euclidean variables
  bool manifolds = false;
  bool losses = false;        ///< Huber, Cauchy or Tolerant on two of three observations
  bool constants = false;     ///< a frame and a landmark in seven are constant
  double noise = 0.5;         ///< size of the residuals before Perturb
  double perturbation = 0.0;  ///< moves the start away from where the residuals are that small
};

/// Frames along a path, each landmark seen by num_views neighbors, factors between consecutive
/// frames, priors on every frame.
std::unique_ptr<RandomGraph> MakeBundle(const BundleOptions& options);

}  // namespace inceres::test
