#pragma once

#include <vector>

#include "adapters/ceres/read/index.h"
#include "adapters/ceres/read/introspection.h"
#include "inceres/linear/reduced_solver.h"

namespace inceres::internal {

/// Which blocks of the reduced system S are there for a choice of landmarks, without forming any:
/// frames in order of first appearance and cliques of them, all pairs of which have a block. A
/// landmark's frames are a clique, and so are the variable blocks of a residual block without one.
class ReducedGraph {
 public:
  /// `is_landmark`: per parameter block, at most one in any residual block. Cost: linear in slots.
  ReducedGraph(const ProblemView& view, const std::vector<char>& is_landmark);

  int num_frames() const { return static_cast<int>(offsets_.size()) - 1; }
  /// Scalar unknowns of S.
  double size() const { return offsets_.back(); }
  /// Multiplications and additions of the elimination.
  double elimination_flops() const { return elimination_flops_; }
  /// Pairs of frames, and frames with themselves, in the cliques of landmarks, as often as they are
  /// there; in all cliques.
  double num_landmark_pairs() const { return num_landmark_pairs_; }
  double num_pairs() const { return num_pairs_; }
  /// Scalar unknowns of the largest clique of a landmark; all its pairs are there, and have to be
  /// factored.
  double largest_clique() const { return largest_clique_; }
  /// Summed tangent size of the frames of a landmark.
  double FramesSize(int block) const { return frames_size_[static_cast<std::size_t>(block)]; }

  /// Flops and entries of a Cholesky factor whose rows begin where those of S do, the frames in
  /// order of first appearance and those that are nearly everywhere last: what a better order may
  /// undercut. Cost: linear.
  struct Envelope {
    double flops = 0.0;
    double entries = 0.0;
  };
  Envelope EnvelopeOfAppearance() const;

  /// The share of S that is there, found at up to 64 of its rows, a fixed stride apart.
  double SampleFill() const;

  /// S itself. Cost: the pairs of all cliques, at most.
  BlockPattern Pattern() const;

 private:
  void NumberFrames(const ProblemView& view, const std::vector<char>& is_landmark);
  void AddCliqueOfLandmark(const ProblemView& view, const CompressedRows::Row& residuals,
                           int landmark);
  void AddToClique(const ProblemView& view, const ResidualBlockView& residual);
  double EndClique();
  void IndexCliques();
  template <typename Visit>
  void ForEachNeighbor(int frame, int last, std::vector<int>* seen, const Visit& visit) const;
  int SizeOf(int frame) const {
    return offsets_[static_cast<std::size_t>(frame) + 1] -
           offsets_[static_cast<std::size_t>(frame)];
  }

  std::vector<int> frame_of_;        // per parameter block, or -1
  std::vector<int> offsets_;         // per frame: its first scalar unknown; one more
  std::vector<int> members_;         // of the cliques: frames
  std::vector<int> clique_begin_;    // one more than cliques
  CompressedRows cliques_of_;        // each frame
  std::vector<double> frames_size_;  // per parameter block
  std::vector<int> seen_in_;         // per frame: the last clique it was added to
  double elimination_flops_ = 0.0;
  double num_landmark_pairs_ = 0.0;
  double num_pairs_ = 0.0;
  double largest_clique_ = 0.0;
};

}  // namespace inceres::internal
