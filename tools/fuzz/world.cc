#include "tools/fuzz/world.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace inceres::fuzz {
namespace {

constexpr int kMaxSize = 30;
constexpr int kMaxBlocks = 128;          // more than twice what a recipe begins with
constexpr double kMismatchChance = 0.1;  // of a ray

ceres::Problem::Options NothingOwned(bool fast_removal) {
  ceres::Problem::Options options;
  options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.enable_fast_removal = fast_removal;
  return options;
}

}  // namespace

World::World(const Recipe& recipe, Dice* dice)
    : recipe_(recipe),
      dice_(dice),
      problem_(std::make_unique<ceres::Problem>(NothingOwned(recipe.fast_removal))),
      memory_(kMaxBlocks * kMaxSize) {
  for (int b = kMaxBlocks; b-- > 0;) {
    free_memory_.push_back(memory_.data() + static_cast<std::ptrdiff_t>(b) * kMaxSize);
  }
  for (int i = 0; i < recipe_.num_frames; ++i) {
    AddFrame();
  }
  for (int i = 0; i < recipe_.num_points; ++i) {
    AddPoint();
  }
}

World::~World() {
  problem_.reset();  // before what it points to
}

bool World::HasFault() const {
  return std::any_of(factors_.begin(), factors_.end(),
                     [](const auto& factor) { return factor->cost->fault() != Fault::kNone; });
}

double World::MagnitudeOf(const Factor& factor) {
  std::vector<const double*> parameters;
  for (const Block* block : factor.blocks) {
    parameters.push_back(block->x);
  }
  return factor.cost->Magnitude(parameters.data());
}

bool World::IsFixed(const Factor& factor) {
  return std::all_of(factor.blocks.begin(), factor.blocks.end(),
                     [](const Block* block) { return block->constant; });
}

double World::Magnitude() const {
  double sum = 0.0;
  for (const auto& factor : factors_) {
    sum += MagnitudeOf(*factor);
  }
  return sum;
}

std::vector<ceres::ResidualBlockId> World::MovingResidualBlocks(double* magnitude) const {
  std::vector<ceres::ResidualBlockId> ids;
  *magnitude = 0.0;
  for (const auto& factor : factors_) {
    if (!IsFixed(*factor)) {
      ids.push_back(factor->id);
      *magnitude += MagnitudeOf(*factor);
    }
  }
  return ids;
}

std::vector<double> World::Values() const {
  std::vector<double> values;
  for (const auto& block : blocks_) {
    values.insert(values.end(), block->x, block->x + block->size);
  }
  return values;
}

void World::SetValues(const std::vector<double>& values) {
  const double* from = values.data();
  for (const auto& block : blocks_) {
    std::copy_n(from, block->size, block->x);
    from += block->size;
  }
}

double World::Weight() {
  return (recipe_.projective ? 100.0 : 1.0) *
         dice_->Magnitude(1.0 / recipe_.weight_spread, recipe_.weight_spread + 1e-9);
}

World::Block* World::AddBlock(bool is_point, int size) {
  auto block = std::make_unique<Block>();
  block->size = size;
  block->is_point = is_point;
  for (int j = 0; j < size; ++j) {
    block->truth.push_back(recipe_.projective ? 0.05 * dice_->Signed() : 2.0 * dice_->Signed());
  }
  if (recipe_.rays && is_point) {
    block->truth = {1.0 / dice_->Between(2.0, 8.0)};
  } else if (recipe_.rays) {
    // Backward, so that the cameras before are in view.
    block->truth[2] = -0.3 * static_cast<double>(Blocks(false).size() % 9);
  } else if (recipe_.projective && is_point) {
    block->truth = {dice_->Between(-1.0, 4.0), 2.0 * dice_->Signed(), dice_->Between(3.0, 8.0)};
  } else if (recipe_.projective) {
    block->truth[0] = 0.4 * static_cast<double>(Blocks(false).size() % 9);
    if (size == 7) {
      block->truth[6] = 1.0;
    }
  } else if (dice_->Chance(recipe_.manifold_chance)) {
    block->manifold = RandomManifold(size, dice_, &block->truth);
  }
  block->x = free_memory_.back();
  free_memory_.pop_back();
  PlaceBlock(block.get());
  blocks_.push_back(std::move(block));
  return blocks_.back().get();
}

// Puts it into the problem, at start values.
void World::PlaceBlock(Block* block) {
  std::copy(block->truth.begin(), block->truth.end(), block->x);
  problem_->AddParameterBlock(block->x, block->size, block->manifold.get());
  Perturb(block, recipe_.perturbation);
  if (block->manifold == nullptr && dice_->Chance(recipe_.bound_chance)) {
    const int j = dice_->Int(0, block->size - 1);
    const double width = dice_->Between(0.0, 0.5);
    if (dice_->Chance(0.5)) {
      problem_->SetParameterLowerBound(block->x, j, block->x[j] - width);
    }
    if (dice_->Chance(0.5)) {
      problem_->SetParameterUpperBound(block->x, j, block->x[j] + 0.01 + width);
    }
  }
  if (dice_->Chance(recipe_.constant_chance)) {
    block->constant = true;
    problem_->SetParameterBlockConstant(block->x);
  }
}

void World::Perturb(Block* block, double size) {
  const int tangent_size =
      block->manifold != nullptr ? block->manifold->TangentSize() : block->size;
  std::vector<double> step(static_cast<std::size_t>(tangent_size));
  for (double& s : step) {
    s = size * dice_->Signed();
  }
  if (block->manifold != nullptr) {
    const std::vector<double> x(block->x, block->x + block->size);
    block->manifold->Plus(x.data(), step.data(), block->x);
  } else {
    for (int j = 0; j < block->size; ++j) {
      block->x[j] += step[static_cast<std::size_t>(j)];
      block->x[j] = std::min(std::max(block->x[j], problem_->GetParameterLowerBound(block->x, j)),
                             problem_->GetParameterUpperBound(block->x, j));
    }
  }
}

void World::AddFrame() {
  const auto& sizes = recipe_.frame_sizes;
  Block* frame = AddBlock(false, dice_->OneOf(sizes));
  const std::vector<Block*> frames = Blocks(false);
  if (frames.size() == 1 || dice_->Chance(recipe_.prior_chance)) {
    AddPrior(frame, Weight());
  }
  if (frames.size() > 1 && dice_->Chance(recipe_.link_chance)) {
    AddLink(frame, frames[frames.size() - 2]);
  }
  if (frames.size() > 2 && dice_->Chance(recipe_.loop_chance)) {
    AddLink(frame,
            frames[static_cast<std::size_t>(dice_->Int(0, static_cast<int>(frames.size()) - 3))]);
  }
}

void World::AddPoint() {
  const auto& sizes = recipe_.point_sizes;
  Block* point = AddBlock(true, dice_->OneOf(sizes));
  for (int view = 0; view < recipe_.views; ++view) {
    Observe(point);
  }
  if (!recipe_.projective && dice_->Chance(recipe_.prior_chance)) {
    AddPrior(point, Weight());
  }
}

void World::AddPrior(Block* block, double weight) {
  Connect(FuzzCost::Kind::kSmooth, {block}, block->size, weight, false);
}

void World::AddLink(Block* block, Block* other) {
  if (block->size == other->size && dice_->Chance(recipe_.distance_chance)) {
    Connect(FuzzCost::Kind::kDistance, {other, block}, 1, Weight(), true);
  } else {
    Connect(FuzzCost::Kind::kSmooth, {other, block},
            dice_->Int(1, std::max(1, std::min(block->size, 8))), Weight(), true);
  }
}

void World::Observe(Block* point) {
  const std::vector<Block*> frames = Blocks(false);
  if (frames.empty()) {
    return;
  }
  Block* frame = dice_->OneOf(frames);
  if (recipe_.rays) {
    Block* first = dice_->OneOf(frames);
    if (first != frame) {
      Connect(FuzzCost::Kind::kRay, {first, frame, point}, 2, Weight(), true);
    }
  } else if (recipe_.projective) {
    const auto kind = recipe_.unguarded ? FuzzCost::Kind::kUnguarded : FuzzCost::Kind::kProjection;
    Connect(kind, {frame, point}, 2, Weight(), true);
  } else {
    Connect(FuzzCost::Kind::kSmooth, {frame, point}, dice_->Int(1, 3), Weight(), true);
  }
}

void World::Connect(FuzzCost::Kind kind, const std::vector<Block*>& blocks, int num_residuals,
                    double weight, bool may_lose) {
  auto factor = std::make_unique<Factor>();
  std::vector<int> sizes;
  std::vector<const double*> truth;
  for (const Block* block : blocks) {
    sizes.push_back(block->size);
    truth.push_back(block->truth.data());
  }
  factor->cost =
      std::make_unique<FuzzCost>(kind, sizes, num_residuals, weight, recipe_.curvature, dice_);
  // A mismatch is seen as if it were behind the camera that the ray is of.
  const double behind = -20.0;
  if (kind == FuzzCost::Kind::kRay && dice_->Chance(kMismatchChance)) {
    truth.back() = &behind;
  }
  factor->cost->Measure(truth, recipe_.noise, dice_);
  factor->blocks = blocks;
  if (may_lose && dice_->Chance(recipe_.loss_chance)) {
    if (dice_->Chance(0.05)) {
      factor->cost->Shift(recipe_.projective ? 0.2 : 5.0, dice_);  // an outlier
    }
    ChooseLoss(factor.get());
  }
  Insert(factor.get());
  factors_.push_back(std::move(factor));
}

void World::ChooseLoss(Factor* factor) {
  factor->loss = RandomLoss(dice_);
  if (dice_->Chance(0.5)) {
    factor->changeable_loss = new ChangeableLoss(std::move(factor->loss));
    factor->loss.reset(factor->changeable_loss);
  }
}

void World::Insert(Factor* factor) {
  std::vector<double*> parameters;
  for (const Block* block : factor->blocks) {
    parameters.push_back(block->x);
  }
  factor->id = problem_->AddResidualBlock(factor->cost.get(), factor->loss.get(), parameters);
}

std::vector<World::Block*> World::Blocks(bool points) const {
  std::vector<Block*> found;
  for (const auto& block : blocks_) {
    if (block->is_point == points) {
      found.push_back(block.get());
    }
  }
  return found;
}

World::Block* World::AnyBlock() {
  return dice_->OneOf(blocks_).get();
}

World::Factor* World::AnyFactor() {
  return dice_->OneOf(factors_).get();
}

}  // namespace inceres::fuzz
