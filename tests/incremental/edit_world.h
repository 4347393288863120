#pragma once

#include <map>
#include <memory>
#include <vector>

#include "inceres/problem/factor_graph.h"
#include "inceres/problem/graph_edit.h"
#include "incremental/incremental_system.h"
#include "incremental/reduced_vectors.h"
#include "linear/resumed_solver.h"
#include "support/random_values.h"
#include "support/test_families.h"

namespace inceres::internal {

struct EditWorldOptions {
  unsigned seed = 1;
  bool landmarks = true;
  bool heavy_priors = true;  ///< of weight 1e14, on frames and landmarks, now and then
  bool permanent_frame =
      false;           ///< the first variable stays for good, and takes part in half of the factors
  int max_frames = 8;  ///< removed ones make room for others
  int max_landmarks = 16;
};

/// A small problem that random edits change in every way there is, the incremental system that
/// follows it, and the resumed factor of its S: what the edit-sequence law is tested on. Frames of
/// many sizes and manifolds, landmarks of every size, losses, constants that come as such or become
/// so, factors of two landmarks, borrowed constants.
class EditWorld {
 public:
  explicit EditWorld(const EditWorldOptions& options);

  /// An edit of one to four changes. False if the graph refused it: two free landmarks met in a
  /// factor.
  bool Edit();
  /// Linearizes what is dirty, under a random rule and a random damping of the landmarks.
  void Relinearize();
  /// A step of the frames that have come and of the landmarks they see, on S as far as these frames
  /// are concerned.
  void StepNewFrames();
  /// Linearizes some factors anew and damps some landmarks anew.
  void MarkSome();
  /// A random step of some variables, accepted or rejected.
  void Step();
  /// The law, the packed vectors, and the same step as batch from the resumed factor.
  void ExpectLaw();
  /// The law against a system that begins now: same cost at the same values.
  void ExpectFreshCost();

  const IncrementalSystem& system() const { return system_; }
  const FactorGraph& graph() const { return graph_; }

 private:
  struct Shape {
    int ambient_size;
    int tangent_size;
  };

  void ExpectRounding();
  void Rescan();
  void Compose();
  void AdmitPlacedMeasurements();
  void Remove();
  void Change();
  void AddFrame();
  void AddLandmark();
  void AddBorrowed();
  void AddFactors(VariableId id);
  void AddPrior(VariableId id, double weight);
  void Connect(int residual_size, const std::vector<VariableId>& ids, double sqrt_weight,
               double residual);
  void RemoveFactor();
  void RemoveVariable();
  void ChangeLoss();
  void ChangeMeasurement();
  void ChangeValues();
  void Toggle();
  std::shared_ptr<const Loss> RandomLoss();
  std::vector<double> RandomValues(int size, bool curved);
  const double* ValuesOf(VariableId id) const;
  VariableId Any(const std::vector<VariableId>& ids) {
    return ids[random_.Below(static_cast<int>(ids.size()))];
  }
  FactorId AnyFactor();

  const EditWorldOptions options_;
  test::Random random_;
  FactorGraph graph_;
  IncrementalSystem system_;
  ResumedSolver solver_;
  ReducedVectors reduced_;
  std::vector<double> frame_step_;
  double mu_ = 1e-3;
  bool mu_changed_ = true;
  GraphEdit edit_;
  bool descending_;
  int frame_kinds_[3];     // 0: pose, 8: quaternion, else the size of a Euclidean variable
  int landmark_kinds_[2];  // 0: on a sphere, else the size
  // by residual size and sizes of the slots
  std::map<std::vector<int>, FamilyHandle<test::SmoothFamily>> families_;
  // of variables the edit under construction adds
  std::map<VariableId, std::vector<double>> new_values_;
  std::map<VariableId, Shape> shapes_;
  std::vector<VariableId> frames_;
  std::vector<VariableId> landmarks_;
  VariableId permanent_ = -1;
  std::vector<VariableId> removed_;  // by the edit under construction
  std::vector<VariableId> borrowed_;
  std::vector<FactorId> factors_;
  std::vector<FactorId> removed_factors_;
  // whose measurements the edit under construction has changed already
  std::vector<FactorId> placed_;
  std::vector<std::unique_ptr<std::vector<double>>> memory_;  // of borrowed constants
};

}  // namespace inceres::internal
