#include "support/random_graph.h"

#include <algorithm>
#include <cmath>

#include "inceres/problem/losses.h"
#include "inceres/problem/manifolds.h"

namespace inceres::test {

VariableId RandomGraph::AddVariable(int size, Role role, std::shared_ptr<const Manifold> manifold) {
  const std::vector<double> values = random_.Vector(static_cast<std::size_t>(size));
  return graph_.AddVariable(values.data(), size, role, std::move(manifold));
}

// Values of unit norm suit every manifold: for a quaternion they are a rotation.
VariableId RandomGraph::AddCurved(Role role, std::shared_ptr<const Manifold> manifold) {
  std::vector<double> values = random_.Vector(static_cast<std::size_t>(manifold->AmbientSize()));
  double norm = 0.0;
  for (const double value : values) {
    norm += value * value;
  }
  for (double& value : values) {
    value /= std::sqrt(norm);
  }
  return graph_.AddVariable(values.data(), static_cast<int>(values.size()), role,
                            std::move(manifold));
}

VariableId RandomGraph::AddBorrowed(int size) {
  borrowed_.push_back(
      std::make_unique<std::vector<double>>(random_.Vector(static_cast<std::size_t>(size))));
  return graph_.AddBorrowedConstant(borrowed_.back()->data(), size);
}

const FamilyHandle<SmoothFamily>& RandomGraph::FamilyFor(int residual_size,
                                                         const std::vector<VariableId>& ids) {
  std::vector<int> shape = {residual_size};
  std::vector<FactorFamily::Slot> slots;
  for (const VariableId id : ids) {
    // A borrowed constant has no tangent size; any slot of its ambient size takes it.
    const int ambient_size = graph_.AmbientSize(id);
    const int tangent_size = graph_.TangentSize(id) > 0 ? graph_.TangentSize(id) : ambient_size;
    slots.push_back({ambient_size, tangent_size});
    shape.push_back(ambient_size);
    shape.push_back(tangent_size);
  }
  auto found = families_.find(shape);
  if (found == families_.end()) {
    auto family = std::make_shared<SmoothFamily>(residual_size, slots);
    found = families_.emplace(shape, graph_.AddFamily(family)).first;
  }
  return found->second;
}

void RandomGraph::Connect(int residual_size, const std::vector<VariableId>& ids,
                          std::shared_ptr<const Loss> loss, double noise) {
  const FamilyHandle<SmoothFamily>& family = FamilyFor(residual_size, ids);
  const int i = graph_.AddFactor(family, family->MakeMeasurement(&random_), ids, std::move(loss));
  std::vector<const double*> parameters;
  for (const VariableId id : ids) {
    parameters.push_back(graph_.Values(id));
  }
  std::vector<double> residuals = random_.Vector(static_cast<std::size_t>(residual_size));
  std::transform(residuals.begin(), residuals.end(), residuals.begin(),
                 [noise](double r) { return noise * r; });
  family->SetResiduals(i, parameters.data(), residuals.data());
}

void RandomGraph::Perturb(double size) {
  for (VariableId id = 0; id < graph_.num_variables(); ++id) {
    if (graph_.IsConstant(id)) {
      continue;
    }
    std::vector<double> delta = random_.Vector(static_cast<std::size_t>(graph_.TangentSize(id)));
    std::transform(delta.begin(), delta.end(), delta.begin(),
                   [size](double d) { return size * d; });
    std::vector<double> moved(graph_.Values(id), graph_.Values(id) + graph_.AmbientSize(id));
    if (graph_.manifold(id) == nullptr) {
      std::transform(moved.begin(), moved.end(), delta.begin(), moved.begin(), std::plus<>());
    } else if (!graph_.manifold(id)->Plus(graph_.Values(id), delta.data(), moved.data())) {
      continue;
    }
    graph_.SetValues(id, moved.data());
  }
}

namespace {

class BundleMaker {
 public:
  explicit BundleMaker(const BundleOptions& options)
      : options_(options), result_(std::make_unique<RandomGraph>(options.seed)), graph_(*result_) {}

  std::unique_ptr<RandomGraph> Make() {
    for (int i = 0; i < options_.num_frames; ++i) {
      frames_.push_back(MakeFrame(i));
      graph_.graph().SetConstant(frames_.back(), options_.constants && i % 7 == 3);
    }
    for (int i = 0; i < options_.num_frames; ++i) {
      const VariableId frame = frames_[static_cast<std::size_t>(i)];
      graph_.Connect(graph_.graph().TangentSize(frame), {frame}, nullptr, options_.noise);
      if (i > 0) {
        graph_.Connect(1 + (i * 4) % 15, {frames_[static_cast<std::size_t>(i) - 1], frame}, nullptr,
                       options_.noise);
      }
    }
    for (int l = 0; l < options_.num_landmarks; ++l) {
      MakeLandmark(l);
    }
    std::stable_sort(waiting_.begin(), waiting_.end(),
                     [](const auto& a, const auto& b) { return FrameOf(a) < FrameOf(b); });
    for (const Observation& observation : waiting_) {
      Connect(observation);
    }
    graph_.Perturb(options_.perturbation);
    return std::move(result_);
  }

 private:
  struct Observation {
    int residual_size;
    std::vector<VariableId> ids;  // the landmark last
    std::shared_ptr<const Loss> loss;
  };
  static VariableId FrameOf(const Observation& observation) {
    return observation.ids[observation.ids.size() - 2];
  }
  void Connect(const Observation& observation) {
    graph_.Connect(observation.residual_size, observation.ids, observation.loss, options_.noise);
  }

  static int InTurn(const std::vector<int>& sizes, int i) {
    return sizes[static_cast<std::size_t>(i) % sizes.size()];
  }

  VariableId MakeFrame(int i) {
    if (!options_.manifolds || i % 4 == 0) {
      return graph_.AddFrame(InTurn(options_.frame_sizes, i));
    }
    if (i % 4 == 1) {
      return graph_.AddFrame(std::make_shared<PoseManifold>());
    }
    if (i % 4 == 2) {
      return graph_.AddFrame(std::make_shared<SubsetManifold>(7, std::vector<int>{1, 4}));
    }
    return graph_.AddFrame(std::make_shared<QuaternionManifold>());
  }

  std::shared_ptr<const Loss> MakeLoss(int i) {
    if (!options_.losses || i % 3 == 0) {
      return nullptr;
    }
    if (i % 3 == 1) {
      return std::make_shared<HuberLoss>(0.3);
    }
    return i % 2 == 0 ? std::shared_ptr<const Loss>(std::make_shared<CauchyLoss>(0.4))
                      : std::make_shared<TolerantLoss>(0.5, 0.2);  // its ρ'' is positive
  }

  void MakeLandmark(int l) {
    const bool curved = options_.manifolds && l % 3 == 0;
    const VariableId landmark = curved ? graph_.AddLandmark(std::make_shared<SphereManifold>(4))
                                       : graph_.AddLandmark(InTurn(options_.landmark_sizes, l));
    graph_.graph().SetConstant(landmark, options_.constants && l % 7 == 2);
    const int first =
        graph_.random().Below(std::max(1, options_.num_frames - options_.num_views + 1));
    for (int v = options_.hosted ? 1 : 0; v < options_.num_views; ++v) {
      std::vector<VariableId> ids = {frames_[static_cast<std::size_t>(first + v)], landmark};
      if (options_.hosted) {
        ids.insert(ids.begin(), frames_[static_cast<std::size_t>(first)]);
      }
      const Observation observation{InTurn(options_.residual_sizes, l + v), ids,
                                    MakeLoss(num_observations_++)};
      if (options_.by_frame) {
        waiting_.push_back(observation);
      } else {
        Connect(observation);
      }
    }
  }

  const BundleOptions& options_;
  std::unique_ptr<RandomGraph> result_;
  RandomGraph& graph_;
  std::vector<VariableId> frames_;
  std::vector<Observation> waiting_;  // until all landmarks are there
  int num_observations_ = 0;
};

}  // namespace

std::unique_ptr<RandomGraph> MakeBundle(const BundleOptions& options) {
  return BundleMaker(options).Make();
}

}  // namespace inceres::test
