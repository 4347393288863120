#include "tools/replay/vio_source.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "tools/command_line/read_flags.h"
#include "tools/replay/replay_ceres_problem.h"
#include "tools/replay/replay_graph.h"
#include "tools/replay/replay_scripts.h"
#include "tools/sim/vio_scene.h"

namespace inceres::tools {
namespace {

class VioSource : public ProblemSource {
 public:
  explicit VioSource(ReplayScript script) : script_(std::move(script)) {}

  std::string Describe() const override { return script_.description; }
  bool HasLandmarks() const override { return true; }

  Status MakeCeresInstance(const LossSpec& loss, CeresInstance* instance) const override {
    instance->parameters.resize(Size());
    ReplayCeresProblem problem(false, instance->parameters.data());
    for (const ReplayStep& step : script_.steps) {
      if (Status status = problem.Add(WithLoss(step, loss)); !status.ok()) {
        return status;
      }
    }
    instance->landmarks_first = problem.LandmarksFirst();
    instance->problem = problem.TakeProblem();
    return Status::Ok();
  }

  Status MakeGraph(const LossSpec& loss, std::unique_ptr<FactorGraph>* graph) const override {
    auto result = std::make_unique<FactorGraph>();
    ReplayGraph builder(false);
    for (const ReplayStep& step : script_.steps) {
      if (Status status = builder.Add(WithLoss(step, loss), result.get()); !status.ok()) {
        return status;
      }
    }
    *graph = std::move(result);
    return Status::Ok();
  }

  std::vector<double> ParametersOf(const FactorGraph& graph) const override {
    return graph.state();
  }

  // Nothing to align: the first pose is fixed, and the IMU knows the scale.
  GeometryDifference Difference(const std::vector<double>& a,
                                const std::vector<double>& b) const override {
    SceneGeometry scene;
    GeometryDifference difference;
    ForEachVariable([&](ReplayVariable::Kind kind, std::size_t offset) {
      const Eigen::Map<const Eigen::Vector3d> at_a(a.data() + offset), at_b(b.data() + offset);
      if (kind == ReplayVariable::Kind::kPose) {
        const Eigen::Map<const Eigen::Quaterniond> q_a(a.data() + offset + 3),
            q_b(b.data() + offset + 3);
        scene.centers.emplace_back(at_b);
        difference.positions = std::max(difference.positions, (at_a - at_b).norm());
        difference.rotations =
            std::max(difference.rotations, q_a.normalized().angularDistance(q_b.normalized()));
      } else if (kind == ReplayVariable::Kind::kPoint) {
        scene.points.emplace_back(at_b);
        difference.points = std::max(difference.points, (at_a - at_b).norm());
      }
    });
    const double size = SceneSize(scene);
    difference.positions /= size;
    difference.points /= size;
    return difference;
  }

 private:
  template <typename Visit>
  void ForEachVariable(const Visit& visit) const {
    std::size_t offset = 0;
    for (const ReplayStep& step : script_.steps) {
      for (const ReplayVariable& variable : step.variables) {
        visit(variable.kind, offset);
        offset += static_cast<std::size_t>(AmbientSize(variable.kind));
      }
    }
  }

  std::size_t Size() const {
    std::size_t size = 0;
    ForEachVariable([&](ReplayVariable::Kind kind, std::size_t offset) {
      size = offset + static_cast<std::size_t>(AmbientSize(kind));
    });
    return size;
  }

  // The script is made without losses.
  static ReplayStep WithLoss(ReplayStep step, const LossSpec& loss) {
    for (ReplayFactor& factor : step.factors) {
      if (std::holds_alternative<PointSighting>(factor.measurement)) {
        factor.loss = loss;
      }
    }
    return step;
  }

  ReplayScript script_;
};

}  // namespace

Status OpenVioSequence(const std::string& name, VioSequence* sequence) {
  VioSceneOptions options;
  const std::vector<std::string> presets = VioScenePresets();
  const bool is_preset = std::find(presets.begin(), presets.end(), name) != presets.end();
  Status status = is_preset ? GetVioScenePreset(name, &options)
                            : ReadVioSequence(name, sequence, ReadOptionsFromFlags());
  if (status.ok() && is_preset) {
    status = GenerateVioScene(options, sequence);
  }
  if (status.ok() && sequence->frames.size() < 2) {
    status = Status::Error(StatusCode::kIo, name + ": two or more frames are needed");
  }
  return status;
}

Status MakeVioSource(const VioSequence& sequence, std::unique_ptr<ProblemSource>* source) {
  VioReplayOptions options;
  options.prior = false;
  options.loss = LossSpec();
  ReplayScript script;
  Status status = MakeVioReplay(sequence, options, &script);
  if (status.ok()) {
    *source = std::make_unique<VioSource>(std::move(script));
  }
  return status;
}

}  // namespace inceres::tools
