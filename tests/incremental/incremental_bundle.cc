#include "incremental/incremental_bundle.h"

#include <algorithm>
#include <limits>

#include <gtest/gtest.h>

#include "inceres/solver/solver.h"

namespace inceres::test {

using Slots = std::vector<FactorFamily::Slot>;

IncrementalBundle::IncrementalBundle(const IncrementalOptions& options, unsigned seed)
    : solver(options),
      random_(seed),
      priors_(solver.AddFamily(std::make_shared<DiagonalPriorFamily>(6))),
      ties_(solver.AddFamily(std::make_shared<SmoothFamily>(6, Slots{{6, 6}, {6, 6}}))),
      views_(solver.AddFamily(std::make_shared<SmoothFamily>(2, Slots{{6, 6}, {3, 3}}))),
      edit_(solver.graph()) {
}

VariableId IncrementalBundle::AddVariable(Role role, int size) {
  std::vector<double> start = random_.Vector(size);
  const VariableId id = edit_.AddVariable(start.data(), size, role);
  variables_[id] = {role, false, std::move(start), {}, {}};
  return id;
}

// Near zero at the origin, about which all variables begin, and hardly curved: there is one
// minimum.
SmoothFamily::Measurement IncrementalBundle::RandomMeasurement(const SmoothFamily& family) {
  SmoothFamily::Measurement measurement = family.MakeMeasurement(&random_);
  const std::size_t row = measurement.size() / family.residual_size();
  for (std::size_t k = 0; k < measurement.size(); ++k) {
    const std::size_t entry = k % row;
    measurement[k] *= entry > 0 && entry % 3 == 2 ? 0.05 : 1.0;  // B
    measurement[k] = entry == 0 ? 0.5 * random_.Unit() : measurement[k];
  }
  return measurement;
}

FactorId IncrementalBundle::Add(Factor factor) {
  const FactorId id = factor.kind == kPrior
                          ? edit_.AddFactor(priors_, factor.prior, factor.variables, factor.loss)
                          : edit_.AddFactor(factor.kind == kTie ? ties_ : views_, factor.smooth,
                                            factor.variables, factor.loss);
  factors_[{id.family, id.index}] = std::move(factor);
  return id;
}

VariableId IncrementalBundle::AddFrame() {
  const VariableId frame = AddVariable(Role::kFrame, 6);
  frames_.push_back(frame);
  AddPrior(frame, 1.0);
  if (frames_.size() > 1) {
    Add({kTie, {frames_[frames_.size() - 2], frame}, nullptr, {}, RandomMeasurement(*ties_)});
  }
  return frame;
}

VariableId IncrementalBundle::AddLandmark(const std::vector<VariableId>& frames,
                                          std::shared_ptr<const Loss> loss) {
  const VariableId landmark = AddVariable(Role::kLandmark, 3);
  landmarks_.push_back(landmark);
  for (const VariableId frame : frames) {
    Add({kView, {frame, landmark}, loss, {}, RandomMeasurement(*views_)});
  }
  return landmark;
}

FactorId IncrementalBundle::AddPrior(VariableId frame, double sqrt_information) {
  return Add({kPrior,
              {frame},
              nullptr,
              {random_.Vector(6), std::vector<double>(6, sqrt_information)},
              {}});
}

void IncrementalBundle::RemoveVariable(VariableId id) {
  edit_.RemoveVariable(id);
  for (auto factor = factors_.begin(); factor != factors_.end();) {
    const auto& ids = factor->second.variables;
    factor = std::find(ids.begin(), ids.end(), id) != ids.end() ? factors_.erase(factor)
                                                                : std::next(factor);
  }
  variables_.erase(id);
  frames_.erase(std::remove(frames_.begin(), frames_.end(), id), frames_.end());
  landmarks_.erase(std::remove(landmarks_.begin(), landmarks_.end(), id), landmarks_.end());
}

void IncrementalBundle::RemoveFactor(FactorId id) {
  edit_.RemoveFactor(id);
  factors_.erase({id.family, id.index});
}

void IncrementalBundle::SetConstant(VariableId id, bool constant) {
  edit_.SetConstant(id, constant);
  variables_[id].constant = constant;
}

void IncrementalBundle::SetLoss(FactorId id, std::shared_ptr<const Loss> loss) {
  edit_.SetLoss(id, loss);
  factors_[{id.family, id.index}].loss = std::move(loss);
}

void IncrementalBundle::ChangeMeasurement(FactorId id) {
  Factor& factor = factors_[{id.family, id.index}];
  if (factor.kind == kPrior) {
    factor.prior.mean = random_.Vector(6);
    edit_.SetMeasurement(id, priors_, factor.prior);
  } else {
    const FamilyHandle<SmoothFamily>& family = factor.kind == kTie ? ties_ : views_;
    factor.smooth = RandomMeasurement(*family);
    edit_.SetMeasurement(id, family, factor.smooth);
  }
}

void IncrementalBundle::SetValues(VariableId id, const std::vector<double>& values) {
  edit_.SetValues(id, values.data());
  variables_[id].start = values;
}

void IncrementalBundle::SetBounds(VariableId id, const std::vector<double>& lower,
                                  const std::vector<double>& upper) {
  edit_.SetBounds(id, lower.empty() ? nullptr : lower.data(),
                  upper.empty() ? nullptr : upper.data());
  variables_[id].lower = lower;
  variables_[id].upper = upper;
}

void IncrementalBundle::BoundSome(const std::vector<VariableId>& ids, int one_in) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  for (const VariableId id : ids) {
    if (random_.Below(one_in) > 0) {
      continue;
    }
    const int size = solver.graph().AmbientSize(id);
    const double* x = solver.Values(id);
    std::vector<double> lower(x, x + size);
    std::vector<double> upper(x, x + size);
    const int side = random_.Below(3);
    for (int k = 0; k < size; ++k) {
      const auto entry = static_cast<std::size_t>(k);
      lower[entry] = side == 1 ? -kInfinity : lower[entry] - 0.05;
      upper[entry] = side == 2 ? kInfinity : upper[entry] + 0.05;
    }
    SetBounds(id, lower, upper);
  }
}

void IncrementalBundle::Apply() {
  const Status status = solver.Apply(edit_);
  EXPECT_TRUE(status.ok()) << status.message;
  edit_.Restart();
}

void IncrementalBundle::Grow(int num_frames, int num_landmarks, int views,
                             std::shared_ptr<const Loss> loss) {
  const auto first = static_cast<int>(frames_.size());
  for (int i = 0; i < num_frames; ++i) {
    AddFrame();
  }
  const int begin = std::max(0, first - views + 1);
  for (int l = 0; l < num_landmarks; ++l) {
    const int at =
        begin + random_.Below(std::max(1, static_cast<int>(frames_.size()) - views - begin + 1));
    const int end = std::min(at + views, static_cast<int>(frames_.size()));
    AddLandmark({frames_.begin() + at, frames_.begin() + end}, loss);
  }
  Apply();
}

void IncrementalBundle::Rebuild(bool from_values_held, FactorGraph* graph) const {
  std::map<VariableId, VariableId> renamed;
  for (const auto& [id, variable] : variables_) {
    // A constant stays where it is held: that may be elsewhere than where it began.
    const double* values =
        from_values_held || variable.constant ? solver.Values(id) : variable.start.data();
    renamed[id] =
        graph->AddVariable(values, static_cast<int>(variable.start.size()), variable.role);
    graph->SetConstant(renamed[id], variable.constant);
    if (!variable.constant) {
      graph->SetBounds(renamed[id], variable.lower.empty() ? nullptr : variable.lower.data(),
                       variable.upper.empty() ? nullptr : variable.upper.data());
    }
  }
  const auto priors = graph->AddFamily(std::make_shared<DiagonalPriorFamily>(6));
  const auto ties = graph->AddFamily(std::make_shared<SmoothFamily>(6, Slots{{6, 6}, {6, 6}}));
  const auto views = graph->AddFamily(std::make_shared<SmoothFamily>(2, Slots{{6, 6}, {3, 3}}));
  for (const auto& [key, factor] : factors_) {
    std::vector<VariableId> variables;
    for (const VariableId id : factor.variables) {
      variables.push_back(renamed.at(id));
    }
    if (factor.kind == kPrior) {
      graph->AddFactor(priors, factor.prior, variables, factor.loss);
    } else {
      graph->AddFactor(factor.kind == kTie ? ties : views, factor.smooth, variables, factor.loss);
    }
  }
}

Summary IncrementalBundle::SolveInBatch(bool from_values_held) const {
  FactorGraph graph;
  Rebuild(from_values_held, &graph);
  SolverOptions options;
  options.function_tolerance = 1e-14;
  options.parameter_tolerance = 0.0;
  options.max_num_iterations = 200;
  Summary summary = Solve(options, &graph);
  EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
  return summary;
}

double IncrementalBundle::FreshMinimum(const IncrementalOptions& options,
                                       bool from_values_held) const {
  IncrementalBundle fresh(options);
  std::map<VariableId, VariableId> renamed;
  for (const auto& [id, variable] : variables_) {
    const double* values =
        from_values_held || variable.constant ? solver.Values(id) : variable.start.data();
    renamed[id] =
        fresh.edit_.AddVariable(values, static_cast<int>(variable.start.size()), variable.role);
    fresh.edit_.SetConstant(renamed[id], variable.constant);
    if (!variable.lower.empty() || !variable.upper.empty()) {
      fresh.SetBounds(renamed[id], variable.lower, variable.upper);
    }
  }
  for (const auto& [key, factor] : factors_) {
    Factor copy = factor;
    for (VariableId& id : copy.variables) {
      id = renamed.at(id);
    }
    fresh.Add(std::move(copy));
  }
  fresh.Apply();
  const UpdateSummary summary = fresh.solver.Update();
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  return summary.final_cost;
}

std::vector<FactorId> IncrementalBundle::Views() const {
  std::vector<FactorId> views;
  for (const auto& [key, factor] : factors_) {
    if (factor.kind == kView) {
      views.push_back({key.first, key.second});
    }
  }
  return views;
}

std::vector<double> IncrementalBundle::Values() const {
  std::vector<double> values;
  for (const auto& [id, variable] : variables_) {
    values.insert(values.end(), solver.Values(id), solver.Values(id) + variable.start.size());
  }
  return values;
}

int CountOnBounds(const FactorGraph& graph) {
  int count = 0;
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    const VariableBounds* bounds = graph.IsConstant(id) ? nullptr : graph.bounds(id);
    for (int k = 0; bounds != nullptr && k < graph.AmbientSize(id); ++k) {
      const double x = graph.Values(id)[k];
      const auto entry = static_cast<std::size_t>(k);
      EXPECT_GE(x, bounds->lower[entry]);
      EXPECT_LE(x, bounds->upper[entry]);
      count += x == bounds->lower[entry] || x == bounds->upper[entry] ? 1 : 0;
    }
  }
  return count;
}

}  // namespace inceres::test
