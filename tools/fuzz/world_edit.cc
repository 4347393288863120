#include <algorithm>
#include <memory>

#include "tools/fuzz/world.h"

namespace inceres::fuzz {
namespace {

// Twice the blocks a life began with, and a few: beyond, what is removed makes room.
int Room(int begin) {
  return 2 * begin + 2;
}

constexpr double kHuge = 1e6;               // weight of priors that come and go
constexpr double kIntoCameraChance = 0.03;  // of an edit, where no guard is

}  // namespace

std::string World::Edit() {
  struct Kind {
    int percent;
    const char* (World::*edit)();
  };
  constexpr Kind kKinds[] = {{8, &World::FrameComes},
                             {12, &World::PointComes},
                             {8, &World::BlockGoes},
                             {8, &World::FactorGoes},
                             {8, &World::FactorComes},
                             {10, &World::FactorIsReplaced},
                             {10, &World::MeasurementIsRevised},
                             {14, &World::ValuesAreWritten},
                             {8, &World::Toggle},
                             {4, &World::LossIsReplaced},
                             {3, &World::LossesAreRevised},
                             {3, &World::FaultBegins},
                             {4, &World::FaultsHeal}};
  if (factors_.empty() || blocks_.empty()) {
    return FrameComes();
  }
  if (recipe_.unguarded && dice_->Chance(kIntoCameraChance)) {
    return PointGoesIntoCamera();
  }
  int choice = dice_->Int(0, 99);
  const Kind* kind = kKinds;
  for (; choice >= kind->percent; ++kind) {
    choice -= kind->percent;
  }
  return (this->*kind->edit)();
}

const char* World::FrameComes() {
  const std::vector<Block*> frames = Blocks(false);
  if (static_cast<int>(frames.size()) >= Room(recipe_.num_frames)) {
    RemoveBlock(frames.front());
  }
  AddFrame();
  return "a frame comes";
}

const char* World::PointComes() {
  if (recipe_.point_sizes.empty() ||
      static_cast<int>(Blocks(true).size()) >= Room(recipe_.num_points)) {
    return BlockGoes();
  }
  AddPoint();
  return "a point comes";
}

const char* World::BlockGoes() {
  RemoveBlock(AnyBlock());
  return "a block goes";
}

const char* World::FactorGoes() {
  const auto f = static_cast<std::size_t>(dice_->Int(0, static_cast<int>(factors_.size()) - 1));
  problem_->RemoveResidualBlock(factors_[f]->id);
  factors_.erase(factors_.begin() + static_cast<std::ptrdiff_t>(f));
  return "a factor goes";
}

const char* World::FactorComes() {
  Block* block = AnyBlock();
  if (block->is_point) {
    Observe(block);
  } else {
    AddPrior(block, Weight() * (dice_->Chance(0.1) ? kHuge : 1.0));
  }
  return "a factor comes";
}

const char* World::MeasurementIsRevised() {
  AnyFactor()->cost->Shift(
      recipe_.projective ? dice_->Magnitude(1e-4, 0.1) : dice_->Magnitude(1e-3, 2.0), dice_);
  return "a measurement is revised in place";
}

void World::RemoveBlock(Block* block) {
  for (const auto& factor : factors_) {
    // With fast removal Ceres would take them in the order of their addresses, and lives would
    // depend on malloc.
    if (recipe_.fast_removal &&
        std::count(factor->blocks.begin(), factor->blocks.end(), block) > 0) {
      problem_->RemoveResidualBlock(factor->id);
    }
  }
  problem_->RemoveParameterBlock(block->x);
  factors_.erase(std::remove_if(factors_.begin(), factors_.end(),
                                [&](const auto& factor) {
                                  return std::count(factor->blocks.begin(), factor->blocks.end(),
                                                    block) > 0;
                                }),
                 factors_.end());
  free_memory_.push_back(block->x);
  blocks_.erase(std::find_if(blocks_.begin(), blocks_.end(),
                             [&](const auto& other) { return other.get() == block; }));
}

// Another cost function of the same kind on the same blocks, where the old one was.
const char* World::FactorIsReplaced() {
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
  factor->cost =
      std::make_unique<FuzzCost>(kind, sizes, num_residuals, Weight(), recipe_.curvature, dice_);
  factor->cost->Measure(truth, recipe_.noise, dice_);
  Insert(factor);
  return "a factor is replaced at its address";
}

const char* World::ValuesAreWritten() {
  const double size = recipe_.perturbation * dice_->Magnitude(1e-6, 1.0);
  for (const auto& block : blocks_) {
    if (dice_->Chance(0.2)) {
      Perturb(block.get(), size);
    }
  }
  return "values are written";
}

const char* World::Toggle() {
  Block* block = AnyBlock();
  block->constant = !block->constant;
  if (block->constant) {
    problem_->SetParameterBlockConstant(block->x);
  } else {
    problem_->SetParameterBlockVariable(block->x);
  }
  return "constant or variable";
}

const char* World::FaultBegins() {
  constexpr Fault kFaults[] = {Fault::kRefuse, Fault::kRefuse, Fault::kNanResidual,
                               Fault::kInfResidual, Fault::kNanJacobian};
  Factor* factor = AnyFactor();
  const double margin =
      dice_->Chance(0.05) ? -1.0 : recipe_.perturbation * dice_->Magnitude(1e-3, 1.0);
  factor->cost->SetFault(kFaults[dice_->Int(0, 4)], factor->blocks[0]->x, margin, dice_);
  return "a cost function turns faulty";
}

const char* World::FaultsHeal() {
  for (const auto& factor : factors_) {
    factor->cost->SetFault(Fault::kNone, factor->blocks[0]->x, 0.0, dice_);
  }
  return "faults heal";
}

// To its center but for the last digits, or to where its ray begins.
const char* World::PointGoesIntoCamera() {
  const std::vector<Block*> points = Blocks(true);
  const std::vector<Block*> frames = Blocks(false);
  if (points.empty() || frames.empty()) {
    return "nothing";
  }
  Block* point = dice_->OneOf(points);
  if (recipe_.rays) {
    point->x[0] = dice_->Magnitude(1.0, 1e6);
    return "a point goes to where its rays begin";
  }
  const Block* frame = dice_->OneOf(frames);
  const double distance = dice_->Magnitude(1e-15, 1e-3);
  for (int j = 0; j < 3; ++j) {
    point->x[j] = frame->x[j] + distance * dice_->Signed();
  }
  return "a point goes into a camera";
}

// The residual block is removed and added again, for Ceres has no other way.
const char* World::LossIsReplaced() {
  Factor* factor = AnyFactor();
  problem_->RemoveResidualBlock(factor->id);
  factor->changeable_loss = nullptr;
  factor->loss.reset();
  if (dice_->Chance(0.7)) {
    ChooseLoss(factor);
  }
  Insert(factor);
  return "another loss";
}

const char* World::LossesAreRevised() {
  for (const auto& factor : factors_) {
    if (factor->changeable_loss != nullptr && dice_->Chance(0.5)) {
      factor->changeable_loss->Change(RandomLoss(dice_));
    }
  }
  return "losses are revised in place";
}

}  // namespace inceres::fuzz
