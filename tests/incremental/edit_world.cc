#include "incremental/edit_world.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "inceres/problem/manifolds.h"
#include "incremental/whole_graph.h"
#include "schur/batch_system.h"

namespace inceres::internal {
namespace {

constexpr double kHeavy = 1e7;           // √ of the weight of a heavy prior
constexpr double kTinyDiagonal = 1e-12;  // damps a frame without factors

bool operator==(const FactorId& a, const FactorId& b) {
  return a.family == b.family && a.index == b.index;
}

template <typename Id>
bool Contains(const std::vector<Id>& ids, const Id& id) {
  return std::any_of(ids.begin(), ids.end(), [&id](const Id& other) { return other == id; });
}

bool IsFull(const std::vector<VariableId>& ids, int most) {
  return static_cast<int>(ids.size()) >= most;
}

}  // namespace

EditWorld::EditWorld(const EditWorldOptions& options)
    : options_(options),
      random_(options.seed),
      system_(graph_, 1),
      edit_(graph_),
      descending_(random_.Below(2) == 0) {
  for (int& kind : frame_kinds_) {
    kind = random_.Below(10);
  }
  for (int& kind : landmark_kinds_) {
    kind = random_.Below(5);
  }
}

// What the graph holds now.
void EditWorld::Rescan() {
  frames_.clear();
  landmarks_.clear();
  borrowed_.clear();
  factors_.clear();
  for (VariableId id = 0; id < graph_.num_variables(); ++id) {
    if (graph_.HasVariable(id)) {
      (graph_.StateOffset(id) < 0           ? borrowed_
       : graph_.role(id) == Role::kLandmark ? landmarks_
                                            : frames_)
          .push_back(id);
    }
  }
  for (FamilyId family = 0; family < graph_.num_families(); ++family) {
    for (int i = 0; i < graph_.NumFactors(family); ++i) {
      if (graph_.HasFactor(family, i)) {
        factors_.push_back({family, i});
      }
    }
  }
  removed_.clear();
  removed_factors_.clear();
  placed_.clear();
  new_values_.clear();
}

bool EditWorld::Edit() {
  const test::Random random = random_;
  Compose();
  if (edit_.revision() != graph_.revision()) {
    // a new family came meanwhile: the same edit once more, for it was begun too early
    random_ = random;
    Compose();
  }
  const Status status = system_.Apply(edit_);
  const auto says = [&status](const char* what) {
    return status.message.find(what) != std::string::npos;
  };
  EXPECT_TRUE(status.ok() || says("second landmark")) << status.message;
  if (status.ok() && options_.permanent_frame && permanent_ < 0) {
    permanent_ = new_values_.begin()->first;
  }
  if (!status.ok()) {
    AdmitPlacedMeasurements();
  }
  return status.ok();
}

// Measurements placed in a family for an edit that was refused are there all the same.
void EditWorld::AdmitPlacedMeasurements() {
  edit_.Restart();
  for (const FactorId& factor : placed_) {
    edit_.MeasurementChanged(factor);
  }
  EXPECT_TRUE(system_.Apply(edit_).ok());
}

void EditWorld::Compose() {
  Rescan();
  edit_.Restart();
  Remove();
  for (int changes = 1 + random_.Below(4); changes > 0; --changes) {
    Change();
  }
}

// Removals first: what they take with them is then not used by the rest of the edit.
void EditWorld::Remove() {
  const bool full =
      IsFull(frames_, options_.max_frames) || IsFull(landmarks_, options_.max_landmarks);
  if (full || random_.Below(8) == 0) {
    RemoveVariable();
  }
  for (int most = 6 * options_.max_landmarks; most < static_cast<int>(factors_.size()); most += 4) {
    RemoveFactor();
  }
  if (random_.Below(3) == 0) {
    RemoveFactor();
  }
}

void EditWorld::Change() {
  const VariableId frame = frames_.empty() ? -1 : Any(frames_);
  const VariableId variable = random_.Below(2) == 0 || landmarks_.empty() ? frame : Any(landmarks_);
  const int kind = frame < 0 ? 0 : random_.Below(16);
  if (kind <= 1) {
    IsFull(frames_, options_.max_frames) ? AddFactors(frame) : AddFrame();
  } else if (kind <= 4) {
    IsFull(landmarks_, options_.max_landmarks) || !options_.landmarks ? AddFactors(variable)
                                                                      : AddLandmark();
  } else if (kind == 5 && !IsFull(borrowed_, 3)) {
    AddBorrowed();
  } else if (kind <= 9) {
    AddFactors(variable);
    AddFactors(variable);
  } else if (kind <= 11) {
    AddPrior(variable, options_.heavy_priors ? kHeavy : 1.0);
  } else if (kind == 12) {
    ChangeLoss();
  } else if (kind == 13) {
    ChangeMeasurement();
  } else if (kind == 14) {
    ChangeValues();
  } else {
    Toggle();
  }
}

std::vector<double> EditWorld::RandomValues(int size, bool curved) {
  std::vector<double> values = random_.Vector(size);
  if (curved) {  // of unit norm: that suits every manifold
    double norm = 0.0;
    for (const double value : values) {
      norm += value * value;
    }
    std::transform(values.begin(), values.end(), values.begin(),
                   [norm](double value) { return value / std::sqrt(norm); });
  }
  return values;
}

const double* EditWorld::ValuesOf(VariableId id) const {
  const auto added = new_values_.find(id);
  return added != new_values_.end() ? added->second.data() : system_.variables().current(id);
}

void EditWorld::AddFrame() {
  const int kind = frame_kinds_[random_.Below(3)];
  const std::shared_ptr<const Manifold> manifold =
      kind == 0   ? std::make_shared<PoseManifold>()
      : kind == 8 ? std::shared_ptr<const Manifold>(std::make_shared<QuaternionManifold>())
                  : nullptr;
  const int size = manifold != nullptr ? manifold->AmbientSize() : kind;
  const std::vector<double> values = RandomValues(size, manifold != nullptr);
  const VariableId id = edit_.AddVariable(values.data(), size, Role::kFrame, manifold);
  new_values_[id] = values;
  shapes_[id] = {size, manifold != nullptr ? manifold->TangentSize() : size};
  frames_.push_back(id);
  AddPrior(id, 1.0);
  AddFactors(id);
  if (random_.Below(8) == 0) {
    edit_.SetConstant(id, true);
  }
}

void EditWorld::AddLandmark() {
  const int kind = landmark_kinds_[random_.Below(2)];
  const std::shared_ptr<const Manifold> manifold =
      kind == 0 ? std::make_shared<SphereManifold>(4) : nullptr;
  const int size = manifold != nullptr ? manifold->AmbientSize() : kind;
  const std::vector<double> values = RandomValues(size, manifold != nullptr);
  const VariableId id = edit_.AddVariable(values.data(), size, Role::kLandmark, manifold);
  new_values_[id] = values;
  shapes_[id] = {size, manifold != nullptr ? 3 : size};
  landmarks_.push_back(id);
  if (random_.Below(8) == 0) {
    edit_.SetConstant(id, true);
  }
  for (int observations = random_.Below(4); observations >= 0; --observations) {
    AddFactors(id);
  }
}

void EditWorld::AddBorrowed() {
  memory_.push_back(std::make_unique<std::vector<double>>(RandomValues(2, false)));
  const VariableId id = edit_.AddBorrowedConstant(memory_.back()->data(), 2);
  new_values_[id] = *memory_.back();
  shapes_[id] = {2, 2};
  borrowed_.push_back(id);
  if (!frames_.empty()) {
    Connect(3, {Any(frames_), id}, 1.0, 0.5);
  }
}

// One more factor of this variable: with another frame, with two, or a frame and a landmark.
void EditWorld::AddFactors(VariableId id) {
  std::vector<VariableId> ids = {id};
  for (int others = 1 + random_.Below(2); others > 0 && !frames_.empty(); --others) {
    const VariableId other = Any(frames_);
    if (!Contains(ids, other)) {
      ids.push_back(other);
    }
  }
  if (permanent_ >= 0 && random_.Below(2) == 0 && !Contains(ids, permanent_)) {
    ids.push_back(permanent_);
  }
  if (random_.Below(10) == 0 && !landmarks_.empty()) {
    const VariableId landmark = Any(landmarks_);
    const bool constant = new_values_.count(landmark) == 0 && graph_.IsConstant(landmark);
    if (!Contains(ids, landmark) && (constant || random_.Below(4) == 0)) {
      ids.push_back(
          landmark);  // a second one may come if one of them is constant; else the edit is refused
    }
  }
  // Few orders of the slots, and so few families: ascending by kind, or descending.
  std::sort(ids.begin(), ids.end(), [this](VariableId a, VariableId b) {
    return descending_ ? shapes_.at(a).ambient_size > shapes_.at(b).ambient_size
                       : shapes_.at(a).ambient_size < shapes_.at(b).ambient_size;
  });
  Connect(2 + 2 * random_.Below(2), ids, std::pow(10.0, random_.Between(-1.0, 1.5)), 0.5);
}

void EditWorld::AddPrior(VariableId id, double sqrt_weight) {
  Connect(shapes_.at(id).tangent_size, {id}, sqrt_weight,
          sqrt_weight == 1.0 ? 0.5 : std::pow(10.0, random_.Between(-2.0, 3.0)));
}

// A factor whose residuals at the current values are random, up to `residual` in size.
void EditWorld::Connect(int residual_size, const std::vector<VariableId>& ids, double sqrt_weight,
                        double residual) {
  std::vector<int> key = {residual_size};
  std::vector<FactorFamily::Slot> slots;
  std::vector<const double*> parameters;
  for (const VariableId id : ids) {
    if (Contains(removed_, id)) {
      return;
    }
    const Shape& shape = shapes_.at(id);
    slots.push_back({shape.ambient_size, shape.tangent_size});
    key.push_back(10 * shape.ambient_size + shape.tangent_size);
    parameters.push_back(ValuesOf(id));
  }
  auto found = families_.find(key);
  if (found == families_.end()) {
    auto family = std::make_shared<test::SmoothFamily>(residual_size, slots);
    found = families_.emplace(key, graph_.AddFamily(family)).first;
  }
  const FamilyHandle<test::SmoothFamily>& family = found->second;
  test::SmoothFamily::Measurement measurement = family->MakeMeasurement(&random_);
  const std::size_t row = measurement.size() / residual_size;
  for (std::size_t k = 0; k < measurement.size(); ++k) {
    const bool phase = k % row > 0 && k % row % 3 == 0;
    measurement[k] *= phase ? 1.0 : sqrt_weight;
  }
  const FactorId factor = edit_.AddFactor(family, measurement, ids, RandomLoss());
  std::vector<double> residuals = random_.Vector(residual_size);
  std::transform(residuals.begin(), residuals.end(), residuals.begin(),
                 [residual](double r) { return residual * r; });
  family->SetResiduals(factor.index, parameters.data(), residuals.data());
}

std::shared_ptr<const Loss> EditWorld::RandomLoss() {
  switch (random_.Below(6)) {
    case 0:
      return std::make_shared<HuberLoss>(0.3);
    case 1:
      return std::make_shared<CauchyLoss>(0.4);
    case 2:
      return std::make_shared<TolerantLoss>(0.5, 0.2);
    default:
      return nullptr;
  }
}

FactorId EditWorld::AnyFactor() {
  for (int attempt = 0; attempt < 4 && !factors_.empty(); ++attempt) {
    const FactorId factor = factors_[random_.Below(static_cast<int>(factors_.size()))];
    const VariableId* ids = graph_.Variables(factor.family, factor.index);
    const bool goes = std::any_of(ids, ids + graph_.family(factor.family).num_slots(),
                                  [this](VariableId id) { return Contains(removed_, id); });
    if (!goes && !Contains(removed_factors_, factor)) {
      return factor;
    }
  }
  return {};
}

void EditWorld::RemoveFactor() {
  const FactorId factor = AnyFactor();
  if (factor.index >= 0) {
    edit_.RemoveFactor(factor);
    removed_factors_.push_back(factor);
  }
}

void EditWorld::RemoveVariable() {
  std::vector<VariableId>& ids = !borrowed_.empty() && random_.Below(8) == 0   ? borrowed_
                                 : !landmarks_.empty() && random_.Below(3) > 0 ? landmarks_
                                                                               : frames_;
  if (ids.empty()) {
    return;
  }
  const int at = random_.Below(static_cast<int>(ids.size()));
  if (new_values_.count(ids[at]) > 0 || ids[at] == permanent_) {
    return;
  }
  edit_.RemoveVariable(ids[at]);
  removed_.push_back(ids[at]);
  ids.erase(ids.begin() + at);
}

void EditWorld::ChangeLoss() {
  const FactorId factor = AnyFactor();
  if (factor.index >= 0) {
    // Twice in three times a weight alone, often none: it may come back.
    const int kind = random_.Below(3);
    edit_.SetLoss(factor, kind == 0 ? RandomLoss()
                                    : std::make_shared<ScaledLoss>(
                                          nullptr, kind == 1 ? 0.0 : random_.Between(0.1, 3.0)));
  }
}

// By either way there is.
void EditWorld::ChangeMeasurement() {
  const FactorId factor = AnyFactor();
  if (factor.index < 0) {
    return;
  }
  for (auto& [key, family] : families_) {
    if (family.id != factor.family) {
      continue;
    }
    const auto measurement = family->MakeMeasurement(&random_);
    if (random_.Below(2) == 0) {
      edit_.SetMeasurement(factor, family, measurement);
    } else {
      family->Place(factor.index, measurement);
      edit_.MeasurementChanged(factor);
      placed_.push_back(factor);
    }
  }
}

// To somewhere near: with a heavy prior about, the cost rises all the same.
void EditWorld::ChangeValues() {
  const std::vector<VariableId>& ids =
      random_.Below(2) == 0 && !landmarks_.empty() ? landmarks_ : frames_;
  const VariableId id = ids.empty() ? -1 : Any(ids);
  if (id < 0 || new_values_.count(id) > 0) {
    return;
  }
  const double size = std::pow(10.0, random_.Between(-8.0, 0.0));
  std::vector<double> step = random_.Vector(shapes_.at(id).tangent_size);
  std::transform(step.begin(), step.end(), step.begin(),
                 [size](double entry) { return size * entry; });
  std::vector<double> moved(ValuesOf(id), ValuesOf(id) + shapes_.at(id).ambient_size);
  if (graph_.manifold(id) != nullptr) {
    EXPECT_TRUE(graph_.manifold(id)->Plus(ValuesOf(id), step.data(), moved.data()));
  } else {
    std::transform(moved.begin(), moved.end(), step.begin(), moved.begin(), std::plus<>());
  }
  edit_.SetValues(id, moved.data());
}

// Several at once, some of them twice: the last word counts.
void EditWorld::Toggle() {
  for (int count = 1 + random_.Below(4); count > 0; --count) {
    const std::vector<VariableId>& ids =
        random_.Below(2) == 0 && !landmarks_.empty() ? landmarks_ : frames_;
    if (!ids.empty()) {
      const VariableId id = Any(ids);
      edit_.SetConstant(id, random_.Below(3) == 0);
      if (random_.Below(4) == 0) {
        edit_.SetConstant(id, random_.Below(3) == 0);
      }
    }
  }
}

void EditWorld::Relinearize() {
  RelinearizeWork work;
  const RebuildPolicy rules[] = {RebuildPolicy::kWhenCheaper, RebuildPolicy::kAlways,
                                 RebuildPolicy::kNever};
  const RebuildPolicy rule = rules[random_.Below(6) == 0 ? 1 : 2 * random_.Below(2)];
  const Status status =
      system_.Relinearize(std::pow(10.0, random_.Between(-9.0, 1.0)), rule, &work);
  ASSERT_TRUE(status.ok()) << status.message;
  EXPECT_TRUE(rule != RebuildPolicy::kAlways || work.rebuilt);
  EXPECT_EQ(system_.NumDirtyFactors(), 0);
}

void EditWorld::StepNewFrames() {
  RelinearizeWork work;
  ASSERT_TRUE(system_.LinearizeDirty(&work).ok());
  IndexSet frames;
  system_.TakeNewFrames(&frames);
  IncrementalSchur& schur = system_.schur();
  std::vector<std::int32_t> landmarks;
  frames.ForEach([&](std::int32_t frame) {
    for (const std::int32_t landmark : schur.frames()[frame].landmarks) {
      EXPECT_FALSE(schur.IsInS(landmark)) << "it has a new factor";
      landmarks.push_back(landmark);
    }
  });
  std::sort(landmarks.begin(), landmarks.end());
  landmarks.erase(std::unique(landmarks.begin(), landmarks.end()), landmarks.end());
  for (const std::int32_t landmark : landmarks) {
    schur.PutIntoRows(landmark, 1e-3, frames);
  }
  frames.ForEach([&](std::int32_t frame) {
    std::vector<double> step = random_.Vector(schur.frames()[frame].size);
    std::transform(step.begin(), step.end(), step.begin(),
                   [](double entry) { return 1e-2 * entry; });
    system_.step().SetFrame(frame, step.data());
  });
  for (const std::int32_t landmark : landmarks) {
    if (schur.blocks().state(landmark) == LandmarkState::kInRows) {
      system_.step().Visit(landmark);
    }
    schur.TakeOutOfRows(landmark, frames);
  }
  double change = 0.0;
  double predicted = 0.0;
  ASSERT_TRUE(system_.step().Evaluate(&change, &predicted).ok());
  if (random_.Below(3) == 0) {
    system_.step().Reject();
  } else {
    system_.Accept();
  }
}

void EditWorld::MarkSome() {
  for (const IncrementalFamily& family : system_.families()) {
    for (int i = 0; i < family.num_places(); ++i) {
      if (graph_.HasFactor(family.id(), i) && random_.Below(6) == 0) {
        system_.MarkDirty({family.id(), i});
      }
    }
  }
  for (int l = 0; l < static_cast<int>(system_.schur().landmarks().size()); ++l) {
    if (system_.schur().landmarks()[l].id >= 0 && random_.Below(6) == 0) {
      system_.Redamp(l);
    }
  }
}

void EditWorld::Step() {
  const IncrementalSchur& schur = system_.schur();
  for (int i = 0; i < static_cast<int>(schur.frames().size()); ++i) {
    if (schur.frames()[i].id >= 0 && !schur.frames()[i].held && random_.Below(2) == 0) {
      std::vector<double> step = random_.Vector(schur.frames()[i].size);
      std::transform(step.begin(), step.end(), step.begin(),
                     [](double entry) { return 1e-2 * entry; });
      system_.step().SetFrame(i, step.data());
    }
  }
  for (int l = 0; l < static_cast<int>(schur.landmarks().size()); ++l) {
    if (schur.IsInS(l) && random_.Below(2) == 0) {
      system_.step().Visit(l);
    }
  }
  double change = 0.0;
  double predicted = 0.0;
  const double before = system_.cost();
  ASSERT_TRUE(system_.step().Evaluate(&change, &predicted).ok());
  if (random_.Below(3) == 0) {
    system_.step().Reject();
    EXPECT_EQ(system_.cost(), before);
  } else {
    system_.Accept();
    EXPECT_NEAR(system_.cost(), before + change,
                (options_.heavy_priors ? 1e-10 : 1e-12) * (before + std::fabs(change)));
  }
}

// What is kept of the rounding has the bits of what is found anew.
void EditWorld::ExpectRounding() {
  const double most = system_.rounding().AtMost();
  // Now and then only: what has changed adds up until it is asked for.
  const double of_residuals = random_.Below(2) == 0 ? system_.rounding().OfResiduals() : -1.0;
  // To one that was just made all rows are new.
  for (int row = 0; row < static_cast<int>(system_.schur().frames().size()); ++row) {
    system_.schur().changes().TouchValues(row);
  }
  CostRounding fresh(graph_, system_.variables(), system_.families(), &system_.schur());
  ASSERT_EQ(most, fresh.AtMost());
  if (of_residuals >= 0.0) {
    ASSERT_EQ(of_residuals, fresh.OfResiduals());
  }
}

void EditWorld::ExpectLaw() {
  const BatchSystem batch(graph_, system_);
  ASSERT_NO_FATAL_FAILURE(batch.ExpectLaw());
  ASSERT_NO_FATAL_FAILURE(ExpectRounding());
  IncrementalSchur& schur = system_.schur();
  std::vector<double> damping;
  std::vector<double> b;
  std::vector<char> held;
  if (random_.Below(4) == 0) {
    mu_ = std::pow(10.0, random_.Between(-4.0, 0.0));
    mu_changed_ = true;
  }
  for (int row = 0; row < static_cast<int>(schur.frames().size()); ++row) {
    held.push_back(schur.frames()[row].held ? 1 : 0);
    for (int k = 0; k < schur.frames()[row].size; ++k) {
      const bool is_held = schur.frames()[row].held;
      damping.push_back(is_held ? 1.0 : mu_ * std::max(schur.FrameDiagonal(row)[k], kTinyDiagonal));
      b.push_back(is_held ? 0.0 : schur.b(row)[k]);
    }
  }
  if (random_.Below(4) == 0) {  // the thesis's form in between
    reduced_.Refresh(DampingForm::kThesis, mu_, &schur);
    for (int row = 0; row < static_cast<int>(held.size()); ++row) {
      const int size = schur.frames()[row].size;
      const double* S = size > 0 ? schur.S().values(schur.S().row(row).back().offset) : nullptr;
      for (int k = 0; k < size; ++k) {
        const double expected = schur.frames()[row].held
                                    ? 1.0
                                    : mu_ * std::max(S[k * (PadToQuad(size) + 1)], kTinyDiagonal);
        ASSERT_EQ(reduced_.damping()[schur.FrameOffset(row) + k], expected);
      }
    }
    ASSERT_TRUE(reduced_.Refresh(DampingForm::kHybrid, mu_, &schur)) << "all rows are damped anew";
  }
  reduced_.Refresh(DampingForm::kHybrid, mu_, &schur);
  ASSERT_EQ(reduced_.b(), b);
  ASSERT_EQ(reduced_.damping(), damping);
  ASSERT_EQ(reduced_.constant(), held);
  for (int row = 0; row < static_cast<int>(held.size()); ++row) {
    ASSERT_EQ(reduced_.pulls()[row], reduced_.Pull(schur, row, b.data() + schur.FrameOffset(row)))
        << "row " << row;
  }
  // Now and then the solver is told no more than the first of the rows.
  const auto rows_of = [this,
                        &schur](const std::vector<std::int32_t>& rows) -> ReducedSolver::Rows {
    return {rows.empty() ? schur.S().num_rows() : rows.front(),
            random_.Below(3) == 0 ? nullptr : &rows};
  };
  std::vector<std::int32_t> changed;
  schur.changes().TakeUnfactored(&changed);
  const ReducedSolver::Rows rows = mu_changed_ ? ReducedSolver::Rows() : rows_of(changed);
  mu_changed_ = false;
  frame_step_.resize(b.size());
  const ReducedMatrix A(schur.S(), damping.data(), held.data());
  ASSERT_TRUE(solver_.Factorize(A, rows).ok());
  schur.changes().TakeUnsolved(&changed);
  ASSERT_TRUE(solver_.Solve(b.data(), rows_of(changed), {}, frame_step_.data()).ok());
  ASSERT_NO_FATAL_FAILURE(batch.ExpectStep(frame_step_, mu_));
}

void EditWorld::ExpectFreshCost() {
  FactorGraph graph = graph_;
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    if (graph.HasVariable(id) && graph.StateOffset(id) >= 0) {
      graph.SetValues(id, system_.variables().current(id));
    }
  }
  IncrementalSystem fresh(graph, 1);
  AddWholeGraph(&fresh);
  RelinearizeWork work;
  ASSERT_TRUE(fresh.Relinearize(1e-4, RebuildPolicy::kNever, &work).ok());
  ASSERT_NEAR(system_.cost(), fresh.cost(), 1e-10 * fresh.cost());
  ASSERT_NO_FATAL_FAILURE(BatchSystem(graph, fresh).ExpectLaw());
}

}  // namespace inceres::internal
