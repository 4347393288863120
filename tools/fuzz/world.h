#pragma once

#include <memory>
#include <string>
#include <vector>

#include <ceres/loss_function.h>
#include <ceres/manifold.h>
#include <ceres/problem.h>

#include "tools/fuzz/dice.h"
#include "tools/fuzz/fuzz_cost.h"
#include "tools/fuzz/ingredients.h"

namespace inceres::fuzz {

/// What a random problem is like; drawn once for a life, so that what is added later fits what
/// there is.
struct Recipe {
  bool projective = false;       ///< cameras and points, else smooth functions
  bool unguarded = false;        ///< points may come next to cameras, and behind them
  bool rays = false;             ///< points are inverse depths along rays of cameras
  std::vector<int> frame_sizes;  ///< of 1 to 30
  std::vector<int> point_sizes;  ///< of 1 to 4
  int num_frames = 0;
  int num_points = 0;
  int views = 0;             ///< frames that see a point
  double link_chance = 0.0;  ///< of a factor between a frame and the one before it
  double loop_chance = 0.0;  ///< … and any other
  double prior_chance = 0.0;
  double distance_chance = 0.0;  ///< of a link to be a distance, where sizes agree
  double manifold_chance = 0.0;
  double loss_chance = 0.0;
  double constant_chance = 0.0;
  double bound_chance = 0.0;
  double curvature = 0.0;
  double noise = 0.0;         ///< of measurements, in units of what is measured
  double perturbation = 0.0;  ///< of start values
  double weight_spread = 1.0;
  bool fast_removal = false;
};

/// `bounds`: whether the recipe may have them.
Recipe RandomRecipe(bool bounds, Dice* dice);
/// Of cameras and points that are degenerate now and then: next to a camera's center, or where no
/// cost depends on them.
Recipe DegenerateRecipe(Dice* dice);

/// A ceres::Problem that random edits change in every way a user's program can, with the objects it
/// rests on. What is removed is freed at once, and its memory serves what comes next.
class World {
 public:
  World(const Recipe& recipe, Dice* dice);
  ~World();
  World(const World&) = delete;
  World& operator=(const World&) = delete;

  /// One random change; returns what it was.
  std::string Edit();

  struct Block {
    double* x = nullptr;  ///< user memory
    int size = 0;
    bool is_point = false;
    bool constant = false;
    std::unique_ptr<ceres::Manifold> manifold;
    std::vector<double> truth;
  };
  struct Factor {
    std::unique_ptr<FuzzCost> cost;
    std::unique_ptr<ceres::LossFunction> loss;
    ChangeableLoss* changeable_loss = nullptr;  ///< the loss, if its content can be replaced
    std::vector<Block*> blocks;
    ceres::ResidualBlockId id = nullptr;
  };

  ceres::Problem& problem() { return *problem_; }
  const std::vector<std::unique_ptr<Block>>& blocks() const { return blocks_; }
  const std::vector<std::unique_ptr<Factor>>& factors() const { return factors_; }
  bool HasFault() const;
  /// Σ FuzzCost::Magnitude of all factors at the current values.
  double Magnitude() const;
  /// The residual blocks of factors with a block that is not constant, whose cost is what Ceres's
  /// function tolerance is relative to, and Σ FuzzCost::Magnitude of them.
  std::vector<ceres::ResidualBlockId> MovingResidualBlocks(double* magnitude) const;
  /// All values, block after block, and back.
  std::vector<double> Values() const;
  void SetValues(const std::vector<double>& values);

 private:
  static bool IsFixed(const Factor& factor);
  static double MagnitudeOf(const Factor& factor);
  Block* AddBlock(bool is_point, int size);
  void PlaceBlock(Block* block);
  void AddFrame();
  void AddPoint();
  void Connect(FuzzCost::Kind kind, const std::vector<Block*>& blocks, int num_residuals,
               double weight, bool may_lose);
  void Insert(Factor* factor);
  void AddPrior(Block* block, double weight);
  void AddLink(Block* block, Block* other);
  void Observe(Block* point);
  void Perturb(Block* block, double size);
  void RemoveBlock(Block* block);
  void ChooseLoss(Factor* factor);

  // The edits; each tells what it did.
  const char* FrameComes();
  const char* PointComes();
  const char* BlockGoes();
  const char* FactorGoes();
  const char* FactorComes();
  const char* FactorIsReplaced();
  const char* MeasurementIsRevised();
  const char* ValuesAreWritten();
  const char* Toggle();
  const char* LossIsReplaced();
  const char* LossesAreRevised();
  const char* FaultBegins();
  const char* FaultsHeal();
  const char* PointGoesIntoCamera();

  std::vector<Block*> Blocks(bool points) const;
  Block* AnyBlock();
  Factor* AnyFactor();
  double Weight();

  const Recipe recipe_;
  Dice* dice_;
  std::unique_ptr<ceres::Problem> problem_;
  std::vector<std::unique_ptr<Block>> blocks_;
  std::vector<std::unique_ptr<Factor>> factors_;
  std::vector<double*> free_memory_;  // the last one freed is the next one used
  // one piece, so that which address is lower does not depend on what was before
  std::vector<double> memory_;
};

}  // namespace inceres::fuzz
