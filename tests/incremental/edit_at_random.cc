// IncrementalBundle::EditAtRandom.

#include <algorithm>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "incremental/incremental_bundle.h"

namespace inceres::test {

// One, or a third of them.
std::vector<FactorId> IncrementalBundle::SomeViews() {
  const std::vector<FactorId> views = Views();
  const std::size_t stride = random_.Below(2) == 0 ? 3 : views.size();
  std::vector<FactorId> some;
  for (auto k = static_cast<std::size_t>(random_.Below(static_cast<int>(stride))); k < views.size();
       k += stride) {
    some.push_back(views[k]);
  }
  return some;
}

void IncrementalBundle::EditAtRandom(const std::vector<EditKind>& kinds,
                                     const std::shared_ptr<const Loss>& loss) {
  switch (kinds[static_cast<std::size_t>(random_.Below(static_cast<int>(kinds.size())))]) {
    case EditKind::kGrow:
      if (random_.Below(2) == 0) {
        return Grow(1, 2 + random_.Below(4), 3, loss);
      }
      AddLandmark({frames_.front(), frames_.back()}, loss);
      break;
    case EditKind::kSlide:
      RemoveVariable(frames_.front());
      for (int k = 0; k < 4 && landmarks_.size() > 1; ++k) {
        RemoveVariable(landmarks_.front());
      }
      return Grow(1, 4, 3, loss);
    case EditKind::kRemove:
      RemoveSome();
      break;
    case EditKind::kViews:
      for (const FactorId view : SomeViews()) {
        RemoveFactor(view);
      }
      break;
    case EditKind::kPin:
      PinOrLetGo();
      break;
    case EditKind::kLosses:
      for (const FactorId view : SomeViews()) {
        SetLoss(view, random_.Below(3) == 0 ? nullptr : std::make_shared<HuberLoss>(0.1));
      }
      break;
    case EditKind::kMeasurements:
      for (const FactorId view : SomeViews()) {
        ChangeMeasurement(view);
      }
      break;
    case EditKind::kValues:
      return SetSomeValues();
    case EditKind::kConstants:
      HoldOrFreeSome();
      break;
    case EditKind::kBounds:
      if (random_.Below(3) > 0) {
        BoundSome({AnyVariable(), AnyVariable()}, 1);
      } else {
        SetBounds(AnyVariable(), {}, {});
      }
      break;
    case EditKind::kGroups:
      edit_.SetEliminationGroup(random_.Below(3) == 0 ? AddFrame() : Any(frames_),
                                random_.Below(3));
      ChangeMeasurement(Views().back());
  }
  Apply();
}

void IncrementalBundle::RemoveSome() {
  const int share = random_.Below(3) == 0 ? 3 : static_cast<int>(landmarks_.size());
  for (int count = static_cast<int>(landmarks_.size()) / share; count > 0 && landmarks_.size() > 4;
       --count) {
    RemoveVariable(Any(landmarks_));
  }
  if (random_.Below(3) == 0 && frames_.size() > 4) {
    RemoveVariable(Any(frames_));
  }
}

void IncrementalBundle::PinOrLetGo() {
  constexpr double kHeavy = 1e7;
  for (const auto& [key, factor] : factors_) {
    if (factor.kind == kPrior && factor.prior.sqrt_information.front() == kHeavy) {
      return RemoveFactor({key.first, key.second});
    }
  }
  AddPrior(Any(frames_), kHeavy);
  AddPrior(Any(frames_), kHeavy);
}

void IncrementalBundle::SetSomeValues() {
  const VariableId id = AnyVariable();
  const Variable& variable = variables_[id];
  const bool is_bounded = !variable.lower.empty() || !variable.upper.empty();
  if (variable.constant && is_bounded) {
    return;
  }
  const std::vector<double> values = random_.Vector(variable.start.size());
  SetValues(id, values);
  Apply();
  EXPECT_TRUE(is_bounded || std::equal(values.begin(), values.end(), solver.Values(id)));
}

void IncrementalBundle::HoldOrFreeSome() {
  const VariableId id = AnyVariable();
  const bool becomes_constant = !variables_[id].constant;
  SetConstant(id, becomes_constant);
  for (std::size_t k = 0; random_.Below(4) > 0 && k < landmarks_.size(); ++k) {
    SetConstant(landmarks_[k], becomes_constant);
  }
}

}  // namespace inceres::test
