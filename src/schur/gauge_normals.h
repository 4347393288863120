#pragma once

#include <cstdint>
#include <vector>

#include "inceres/linear/reduced_solver.h"
#include "linearize/incidences.h"

namespace inceres::internal {

constexpr int kGaugeModes = 7;   // translations, rotations, scale
constexpr int kGaugeStride = 8;  // of rows that have an entry for each

/// What the motions of landmarks are taken about: their middle, and how far away half of them are.
struct GaugeOrigin {
  double num_points = 0.0;  // that it comes from; 0: any will do
  double center[3] = {};
  double radius = 1.0;
};

/// The normal equations of the modes of frames.
struct GaugeSums {
  explicit GaugeSums(const BlockPattern& pattern);
  std::int64_t Bytes() const;

  std::vector<double> C;        // J_cᵀJ_c, by the pattern
  std::vector<double> R;        // −J_cᵀ J_l w, a column a mode; packed rows, kGaugeStride apart
  std::vector<double> squares;  // per frame: Σ ‖J_l w‖² of the factors that count there
};

/// Forms them from the Jacobians of all factors of Euclidean landmarks: of this process, where
/// several have some each. A landmark is Euclidean if it is three numbers without a manifold.
/// Threads: the evaluator's; the same bits for any number.
class GaugeNormals {
 public:
  /// Reads connections only.
  GaugeNormals(const Evaluator& evaluator, std::vector<char> is_shared);

  /// Of J_cᵀJ_c, by frames.
  const BlockPattern& pattern() const { return pattern_; }
  /// Landmarks that factors touch, once a factor, and Euclidean ones of them.
  double num_of_landmarks() const { return num_of_landmarks_; }
  double num_of_points() const { return num_of_points_; }

  GaugeOrigin FindOrigin() const;
  /// `sums`: of this pattern. Cost: a pass over J.
  void Accumulate(const GaugeOrigin& origin, GaugeSums* sums) const;
  std::int64_t Bytes() const;

 private:
  // Factors of one family that touch frames through one slot and a Euclidean landmark through
  // another, by frame.
  struct Source {
    int family;
    int slot;
    int landmark_slot;
    std::vector<int> begin;  // per frame, one more
    std::vector<std::int32_t> factors;
  };

  void CollectSources();
  void AddSource(const Linearization& cache, int slot, int landmark_slot,
                 const std::vector<std::int32_t>& factors);
  void BuildPattern();
  void AccumulateRows(int begin, int end, const GaugeOrigin& origin, GaugeSums* sums) const;
  // Blocks of one factor, where its Jacobians are kept in single precision.
  struct Scratch {
    std::vector<double> landmark, frame, other;
  };
  void AddFactor(const Source& source, int factor, int frame, const GaugeOrigin& origin,
                 Scratch* scratch, GaugeSums* sums) const;
  void AddBlocks(const Source& source, int factor, int frame, const double* J_c, Scratch* scratch,
                 GaugeSums* sums) const;
  int FrameThrough(const Linearization& cache, int factor, int slot) const;
  int LandmarkThrough(const Linearization& cache, int factor, int slot) const;

  const Evaluator& evaluator_;
  const std::vector<char> is_shared_;
  double num_of_landmarks_ = 0.0;
  double num_of_points_ = 0.0;
  std::vector<Source> sources_;
  BlockPattern pattern_;
};

}  // namespace inceres::internal
