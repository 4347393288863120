#include "support/street_graph.h"

#include <array>
#include <memory>

#include "inceres/autodiff/autodiff_family.h"
#include "support/street_scene.h"

namespace inceres::test {
namespace {

// Pulls a position to where the street has it, with standard deviation ½ per axis.
struct TranslationPrior {
  template <typename T>
  bool operator()(const T* translation, T* residuals) const {
    for (int k = 0; k < 3; ++k) {
      residuals[k] = 2.0 * (translation[k] - at[k]);
    }
    return true;
  }
  double at[3];
};

// The point is (a, b, ρ): (a, b, 1) / ρ in a frame that lies at `origin`.
struct InverseDepthView {
  template <typename T>
  bool operator()(const T* camera, const T* point, T* residuals) const {
    const T x[3] = {origin + point[0] / point[2], point[1] / point[2], 1.0 / point[2]};
    return WholeView{u, v}(camera, x, residuals);
  }
  double u, v, origin;
};

class StreetBuilder {
 public:
  explicit StreetBuilder(const StreetGraphOptions& options) : options_(options) {}

  std::unique_ptr<StreetGraph> Build() {
    whole_ = graph().AddFamily(std::make_shared<AutoDiffFamily<WholeView, 2, 7, 3>>("whole"));
    split_ = graph().AddFamily(std::make_shared<AutoDiffFamily<SplitView, 2, 3, 3, 1, 3>>("split"));
    inverse_ =
        graph().AddFamily(std::make_shared<AutoDiffFamily<InverseDepthView, 2, 7, 3>>("inverse"));
    priors_ = graph().AddFamily(std::make_shared<AutoDiffFamily<TranslationPrior, 3, 3>>("prior"));
    for (int i = 0; i < options_.num_cameras; ++i) {
      AddCamera(i);
    }
    for (int i = 0; i + options_.num_views <= options_.num_cameras; ++i) {
      for (int k = 0; k < options_.points_per_camera; ++k) {
        AddPoint(i);
      }
    }
    return std::move(street_);
  }

 private:
  FactorGraph& graph() { return street_->graph; }

  void AddCamera(int i) {
    const std::array<double, 7> start = scene_.NextCamera(options_.drift);
    const double* const camera = start.data();
    if (!options_.split) {
      cameras_.push_back({graph().AddVariable(camera, 7, Role::kFrame)});
    } else {
      const bool own_focal = i == 0 || !options_.shared_focal;
      const VariableId rotation = graph().AddVariable(camera, 3, Role::kFrame);
      const VariableId translation = graph().AddVariable(camera + 3, 3, Role::kFrame);
      if (own_focal) {
        street_->focals.push_back(graph().AddVariable(camera + 6, 1, Role::kFrame));
      }
      cameras_.push_back({rotation, translation, street_->focals.back()});
      if (options_.priors && i % 10 == 0) {
        graph().AddFactor(priors_, {{-1.0 * i, 0.0, 0.0}}, {translation});
      }
    }
    for (const VariableId id : cameras_.back()) {
      const bool is_shared = options_.split && id == street_->focals.front();
      graph().SetConstant(id, options_.first_constant && i == 0 && !is_shared);
    }
  }

  void AddPoint(int first) {
    const std::array<double, 3> x = scene_.Point(first);
    const double inverse[3] = {(x[0] - first) / x[2], x[1] / x[2], 1.0 / x[2]};
    const VariableId point =
        graph().AddVariable(options_.inverse_depth ? inverse : x.data(), 3, Role::kLandmark);
    for (int i = first; i < first + options_.num_views; ++i) {
      const auto [u, v] = scene_.Pixel(x, i);
      std::vector<VariableId> ids = cameras_[static_cast<std::size_t>(i)];
      ids.push_back(point);
      if (options_.inverse_depth) {
        graph().AddFactor(inverse_, {u, v, static_cast<double>(first)}, ids);
      } else if (options_.split) {
        graph().AddFactor(split_, {u, v}, ids);
      } else {
        graph().AddFactor(whole_, {u, v}, ids);
      }
    }
  }

  const StreetGraphOptions options_;
  StreetScene scene_;
  std::unique_ptr<StreetGraph> street_ = std::make_unique<StreetGraph>();
  FamilyHandle<AutoDiffFamily<WholeView, 2, 7, 3>> whole_;
  FamilyHandle<AutoDiffFamily<SplitView, 2, 3, 3, 1, 3>> split_;
  FamilyHandle<AutoDiffFamily<InverseDepthView, 2, 7, 3>> inverse_;
  FamilyHandle<AutoDiffFamily<TranslationPrior, 3, 3>> priors_;
  std::vector<std::vector<VariableId>> cameras_;
};

}  // namespace

std::unique_ptr<StreetGraph> MakeStreetGraph(const StreetGraphOptions& options) {
  return StreetBuilder(options).Build();
}

}  // namespace inceres::test
