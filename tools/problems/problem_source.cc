#include "tools/problems/problem_source.h"

#include <utility>

#include "inceres/io/bal_graph.h"
#include "inceres/io/g2o.h"
#include "tools/command_line/command_line.h"
#include "tools/command_line/output.h"
#include "tools/command_line/read_flags.h"
#include "tools/command_line/read_progress.h"
#include "tools/problems/pose_graph_ceres_problem.h"
#include "tools/replay/vio_source.h"

namespace inceres::tools {
namespace {

// A pose graph; parameters are the poses as PoseGraph lays them out.
class PoseGraphSource : public ProblemSource {
 public:
  explicit PoseGraphSource(PoseGraph graph) : graph_(std::move(graph)) {}

  std::string Describe() const override {
    return std::to_string(graph_.NumVertices()) + " poses in " + std::to_string(graph_.dimension) +
           "D, " + std::to_string(graph_.edges.size()) + " edges";
  }
  bool HasLandmarks() const override { return false; }

  Status MakeCeresInstance(const LossSpec& loss, CeresInstance* instance) const override {
    instance->parameters = graph_.poses;
    return BuildPoseGraphCeresProblem(graph_, loss, instance->parameters.data(),
                                      &instance->problem);
  }
  Status MakeGraph(const LossSpec& /*loss*/,
                   std::unique_ptr<FactorGraph>* /*graph*/) const override {
    return Invalid("--builtin_factors: there are built-in factors for bal: and vio: problems only");
  }
  std::vector<double> ParametersOf(const FactorGraph& graph) const override {
    return graph.state();
  }

  GeometryDifference Difference(const std::vector<double>& a,
                                const std::vector<double>& b) const override {
    return PoseDifference(graph_, a, b);
  }

 private:
  PoseGraph graph_;
};

Status CheckConnected(const BalProblem& bal) {
  Status status = bal.Validate();
  if (status.ok() && bal.num_cameras + bal.num_points < 3) {
    status = Status::Error(StatusCode::kInvalidArgument, "fewer than three cameras and points");
  }
  return status;
}

}  // namespace

BalProblem BalSource::WithParameters(const std::vector<double>& parameters) const {
  BalProblem result = bal_;
  const auto points = parameters.begin() + static_cast<std::ptrdiff_t>(bal_.cameras.size());
  result.cameras.assign(parameters.begin(), points);
  result.points.assign(points, parameters.end());
  return result;
}

std::string BalSource::Describe() const {
  return std::to_string(bal_.num_cameras) + " cameras, " + std::to_string(bal_.num_points) +
         " points, " + std::to_string(bal_.observations.size()) + " observations";
}

std::vector<double> BalSource::Parameters() const {
  std::vector<double> parameters = bal_.cameras;
  parameters.insert(parameters.end(), bal_.points.begin(), bal_.points.end());
  return parameters;
}

Status BalSource::MakeCeresInstance(const LossSpec& loss, CeresInstance* instance) const {
  instance->parameters = Parameters();
  double* cameras = instance->parameters.data();
  double* points = cameras + bal_.cameras.size();
  instance->problem =
      BuildBalCeresProblem(bal_, loss, cameras, points, BalCameraModel::kAngleAxis, jacobians_);
  instance->landmarks_first = PointsFirstOrdering(bal_, cameras, points);
  return Status::Ok();
}

Status BalSource::MakeGraph(const LossSpec& loss, std::unique_ptr<FactorGraph>* graph) const {
  auto result = std::make_unique<FactorGraph>();
  AddBal(bal_, MakeCoreLoss(loss), result.get());
  *graph = std::move(result);
  return Status::Ok();
}

// Cameras come first in the graph, so its state is laid out like the parameters.
std::vector<double> BalSource::ParametersOf(const FactorGraph& graph) const {
  return graph.state();
}

GeometryDifference BalSource::Difference(const std::vector<double>& a,
                                         const std::vector<double>& b) const {
  return DifferenceUpToSimilarity(GeometryOf(WithParameters(a)), GeometryOf(WithParameters(b)));
}

Status OpenProblem(const std::string& specification, std::unique_ptr<ProblemSource>* source,
                   BalJacobians jacobians) {
  const std::size_t colon = specification.find(':');
  const std::string kind = specification.substr(0, colon);
  if (colon == std::string::npos || colon + 1 == specification.size() ||
      (kind != "bal" && kind != "g2o" && kind != "vio")) {
    return Invalid("--problem '" + specification +
                   "': use bal:FILE, g2o:FILE, vio:FILE or vio:PRESET");
  }
  const std::string path = specification.substr(colon + 1);
  if (kind == "bal") {
    BalProblem bal;
    Status status =
        ReadBal(path, &bal, ReadProgressPrinter(path, ProgressOutput()), ReadOptionsFromFlags());
    status = status.ok() ? CheckConnected(bal) : status;
    if (status.ok()) {
      *source = std::make_unique<BalSource>(std::move(bal), jacobians);
    }
    return status;
  }
  if (kind == "vio") {
    VioSequence sequence;
    const Status status = OpenVioSequence(path, &sequence);
    return status.ok() ? MakeVioSource(sequence, source) : status;
  }
  PoseGraph graph;
  Status status = ReadG2o(path, &graph, ReadOptionsFromFlags());
  if (status.ok()) {
    *source = std::make_unique<PoseGraphSource>(std::move(graph));
  }
  return status;
}

}  // namespace inceres::tools
