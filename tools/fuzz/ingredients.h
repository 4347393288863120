#pragma once

#include <memory>
#include <utility>
#include <vector>

#include <ceres/loss_function.h>
#include <ceres/manifold.h>
#include <ceres/solver.h>

#include "tools/fuzz/dice.h"
#include "tools/fuzz/recycled.h"

namespace inceres::fuzz {

/// A random robust loss: Huber, SoftLOne, Cauchy, Arctan, Tolerant, Tukey, trivial, scaled or
/// composed.
std::unique_ptr<ceres::LossFunction> RandomLoss(Dice* dice);

/// A user's own loss, whose content can be replaced while it is in use, in recycled memory.
class ChangeableLoss final : public ceres::LossFunction {
 public:
  explicit ChangeableLoss(std::unique_ptr<ceres::LossFunction> content)
      : content_(std::move(content)) {}
  void Evaluate(double squared_norm, double rho[3]) const override {
    content_->Evaluate(squared_norm, rho);
  }
  void Change(std::unique_ptr<ceres::LossFunction> content) { content_ = std::move(content); }

  static void* operator new(std::size_t bytes) { return Recycled::Take(bytes); }
  static void operator delete(void* memory, std::size_t bytes) {
    Recycled::GiveBack(memory, bytes);
  }

 private:
  std::unique_ptr<ceres::LossFunction> content_;
};

/// A random manifold for a block of this size, or none; x is put on it.
std::unique_ptr<ceres::Manifold> RandomManifold(int size, Dice* dice, std::vector<double>* x);

/// Which options a life may draw.
struct OptionRange {
  /// exact mode: what other modes have no use for, or hand to stock, too
  bool follows_stock = false;
};

/// Options of a solve that ceres::Solve accepts, from the range.
ceres::Solver::Options RandomOptions(const OptionRange& range, Dice* dice);
/// Changes one or two of them.
void ChangeOptions(const OptionRange& range, Dice* dice, ceres::Solver::Options* options);

}  // namespace inceres::fuzz
