#include <algorithm>
#include <memory>

#include "tools/fuzz/world.h"

namespace inceres::fuzz {
namespace {

// Twice the blocks a life began with, and a few: beyond, what is removed makes room.
int Room(int begin) {
  return 2 * begin + 2;
}

constexpr double kHuge = 1e6;  // weight of priors that come and go

}  // namespace

std::string World::Edit() {
  if (factors_.empty() || blocks_.empty()) {
    AddFrame();
    return "a frame comes";
  }
  const int num_frames = static_cast<int>(Blocks(false).size());
  const int num_points = static_cast<int>(Blocks(true).size());
  const int choice = dice_->Int(0, 99);
  if (choice < 8) {
    if (num_frames >= Room(recipe_.num_frames)) {
      RemoveBlock(Blocks(false).front());
    }
    AddFrame();
    return "a frame comes";
  }
  if (choice < 20) {
    if (recipe_.point_sizes.empty() || num_points >= Room(recipe_.num_points)) {
      RemoveBlock(AnyBlock());
      return "a block goes";
    }
    AddPoint();
    return "a point comes";
  }
  if (choice < 28) {
    RemoveBlock(AnyBlock());
    return "a block goes";
  }
  if (choice < 36) {
    RemoveFactor(static_cast<std::size_t>(dice_->Int(0, static_cast<int>(factors_.size()) - 1)));
    return "a factor goes";
  }
  if (choice < 44) {
    Block* block = AnyBlock();
    if (block->is_point) {
      Observe(block);
    } else {
      AddPrior(block, Weight() * (dice_->Chance(0.1) ? kHuge : 1.0));
    }
    return "a factor comes";
  }
  if (choice < 54) {
    ReplaceFactor();
    return "a factor is replaced at its address";
  }
  if (choice < 64) {
    AnyFactor()->cost->Shift(recipe_.projective ? dice_->Magnitude(1e-4, 0.1) : dice_->Magnitude(1e-3, 2.0), dice_);
    return "a measurement is revised in place";
  }
  if (choice < 78) {
    MoveValues(recipe_.perturbation * dice_->Magnitude(1e-6, 1.0));
    return "values are written";
  }
  if (choice < 86) {
    Toggle();
    return "constant or variable";
  }
  if (choice < 90) {
    ChangeLoss();
    return "another loss";
  }
  if (choice < 93) {
    ReviseLoss();
    return "a loss is revised in place";
  }
  if (choice < 96) {
    StartFault();
    return "a cost function turns faulty";
  }
  Heal();
  return "faults heal";
}

void World::RemoveFactor(std::size_t f) {
  problem_->RemoveResidualBlock(factors_[f]->id);
  factors_.erase(factors_.begin() + static_cast<std::ptrdiff_t>(f));
}

void World::RemoveBlock(Block* block) {
  problem_->RemoveParameterBlock(block->x);
  factors_.erase(
      std::remove_if(factors_.begin(), factors_.end(),
                     [&](const auto& factor) { return std::count(factor->blocks.begin(), factor->blocks.end(), block) > 0; }),
      factors_.end());
  free_memory_.push_back(block->x);
  blocks_.erase(std::find_if(blocks_.begin(), blocks_.end(), [&](const auto& other) { return other.get() == block; }));
}

// Another cost function of the same kind on the same blocks, where the old one was.
void World::ReplaceFactor() {
  Factor* factor = AnyFactor();
  std::vector<int> sizes;
  std::vector<const double*> truth;
  for (const Block* block : factor->blocks) {
    sizes.push_back(block->size);
    truth.push_back(block->truth.data());
  }
  const FuzzCost::Kind kind = factor->cost->kind();
  const int num_residuals = factor->cost->num_residuals();
  problem_->RemoveResidualBlock(factor->id);
  factor->cost.reset();
  factor->cost = std::make_unique<FuzzCost>(kind, sizes, num_residuals, Weight(), recipe_.curvature, dice_);
  factor->cost->Measure(truth, recipe_.noise, dice_);
  Insert(factor);
}

void World::MoveValues(double size) {
  for (const auto& block : blocks_) {
    if (dice_->Chance(0.2)) {
      Perturb(block.get(), size);
    }
  }
}

void World::Toggle() {
  Block* block = AnyBlock();
  block->constant = !block->constant;
  if (block->constant) {
    problem_->SetParameterBlockConstant(block->x);
  } else {
    problem_->SetParameterBlockVariable(block->x);
  }
}

void World::StartFault() {
  constexpr Fault kFaults[] = {Fault::kRefuse, Fault::kRefuse, Fault::kNanResidual, Fault::kInfResidual, Fault::kNanJacobian};
  Factor* factor = AnyFactor();
  const double margin = dice_->Chance(0.05) ? -1.0 : recipe_.perturbation * dice_->Magnitude(1e-3, 1.0);
  factor->cost->SetFault(kFaults[dice_->Int(0, 4)], factor->blocks[0]->x, margin, dice_);
}

void World::Heal() {
  for (const auto& factor : factors_) {
    factor->cost->SetFault(Fault::kNone, factor->blocks[0]->x, 0.0, dice_);
  }
}

// The residual block is removed and added again, for Ceres has no other way.
void World::ChangeLoss() {
  Factor* factor = AnyFactor();
  problem_->RemoveResidualBlock(factor->id);
  factor->changeable_loss = nullptr;
  factor->loss.reset();
  if (dice_->Chance(0.7)) {
    ChooseLoss(factor);
  }
  Insert(factor);
}

void World::ReviseLoss() {
  for (const auto& factor : factors_) {
    if (factor->changeable_loss != nullptr && dice_->Chance(0.5)) {
      factor->changeable_loss->Change(RandomLoss(dice_));
    }
  }
}

}  // namespace inceres::fuzz
