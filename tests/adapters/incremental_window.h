#pragma once

#include <map>
#include <utility>
#include <vector>

#include <ceres/ceres.h>

namespace inceres::testing {

/// A small robot in the plane that drives along a street and sees landmarks ahead: a living
/// ceres::Problem, whose window slides. Parameter blocks lie in two pools, and the memory of what
/// left the window is used again for what enters it. Two of them, told the same, are the same
/// problem at other addresses.
///
/// Frames (x, y, heading) are tied by odometry, the oldest has a prior; a landmark (x, y) at c in
/// the frame's axes is observed as c / (3 + c_x) with a Huber loss. Costs are AutoDiff, with
/// divisions: cost-only and Jacobian calls differ in their last bits.
class IncrementalWindow {
 public:
  static constexpr int kMaxFrames = 8;
  // along the street; those near the window are in the problem
  static constexpr int kNumLandmarks = 60;

  IncrementalWindow();
  IncrementalWindow(const IncrementalWindow&) = delete;
  IncrementalWindow& operator=(const IncrementalWindow&) = delete;

  /// A frame enters with odometry and observations, and the landmarks it is the second to see; the
  /// oldest leaves if there are kMaxFrames already, with the landmarks nobody sees any more.
  void Step();
  /// Holds all landmarks and all frames but the newest, or frees them (but for the oldest frame of
  /// all).
  void SetFrozen(bool frozen);
  /// Moves one frame and one landmark by hand.
  void Nudge(double by);

  ceres::Problem* problem() { return &problem_; }
  ceres::ParameterBlockOrdering* LandmarksFirst() const;
  int num_landmarks() const { return static_cast<int>(landmarks_.size()); }
  /// ½ Σ ρ by Ceres.
  double Cost();
  /// All values, in an order that does not depend on addresses.
  std::vector<double> Values() const;
  void SetValues(const std::vector<double>& values);

 private:
  struct Sighting {
    int frame;
    double u, v;
  };

  void AddFrame();
  void AddPrior(int frame);
  void RemoveOldestFrame();
  void See(int frame, int landmark, double u, double v);
  double* TakeRoom(std::vector<double*>* pool);

  std::vector<double> memory_;
  std::vector<double*> frame_room_;
  std::vector<double*> landmark_room_;
  ceres::HuberLoss loss_{0.05};
  ceres::Problem problem_;
  int next_frame_ = 0;
  std::map<int, double*> frames_;
  std::map<int, double*> landmarks_;
  std::map<int, std::vector<Sighting>> sightings_;  // by landmark; of frames in the window
};

}  // namespace inceres::testing
