#pragma once

#include <vector>

#include "inceres/linear/reduced_solver.h"
#include "linear/reduced_prediction.h"
#include "linearize/incidences.h"
#include "schur/covisibility.h"

namespace inceres::internal {

/// What a scene's connections say of its reduced system S before any of it is planned.
class SceneShape {
 public:
  SceneShape(const Evaluator& evaluator, const LandmarkIncidences& incidences);

  /// Unknowns of the frames.
  double size() const { return layout_.frame_size(); }
  double num_frames() const { return layout_.num_frames; }
  /// Entries of Jacobians that a product with S reads where S is not formed.
  double numbers_read() const { return numbers_read_; }
  /// Products of blocks of Y that make up S, and their flops.
  double num_products() const { return num_products_; }
  double product_flops() const { return product_flops_; }

  /// By some rows of S.
  struct Sample {
    double fill = 0.0;  ///< share of the blocks that are there
    /// Blocks that a chunk of landmarks adds to, of all chunks, for each product: each is read and
    /// written once a chunk.
    double writes_per_product = 0.0;
  };
  Sample TakeSample() const;
  /// The blocks of S. Cost: the products, one by one, and to sort each row.
  BlockPattern Pattern() const;
  struct Extent {
    /// How many steps from frame to frame, over landmarks that both see or factors that touch both,
    /// lead from one end of the scene to the other: at least, for what is looked for is the far end
    /// of the far end. Of several scenes the longest. Shared frames lead nowhere.
    int length = 0;
    /// All frames, from one end to the other, scene by scene; shared ones last.
    std::vector<int> order;
  };
  /// Cost: the incidences twice.
  Extent FindExtent() const;
  /// What it takes to factor S in this order, each row from its first block on: an upper bound for
  /// who orders better. Cost: the incidences once.
  ReducedPrediction PredictEnvelope(const Extent& extent) const;

 private:
  // A walk through the scene: how far away each frame is, -1 where it has not been.
  struct Walk {
    std::vector<int> level;
    std::vector<int> reached;   // frames, in this order
    std::vector<int> spent_in;  // per landmark: the last walk that has gone over it
    int count = 0;
  };

  template <typename Visit>
  void ForEachCoupled(int frame, const Visit& visit) const;
  int GoFrom(int frame, Walk* walk) const;

  const Layout& layout_;
  const LandmarkIncidences& incidences_;
  const std::vector<char> is_shared_;
  const Companions companions_;
  double numbers_read_ = 0.0;
  double num_products_ = 0.0;
  double product_flops_ = 0.0;
};

}  // namespace inceres::internal
