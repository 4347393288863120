#include "inceres/estimator/sliding_window_estimator.h"

#include <string>
#include <utility>

#include <Eigen/Eigenvalues>

#include "estimator/window.h"
#include "inceres/solver/covariance.h"
#include "inceres/solver/linear_prior.h"
#include "linearize/factor_linearizer.h"

namespace inceres {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// As newly made, but for the memory of the update.
void Clear(WindowSummary* summary) {
  WindowSummary cleared;
  std::swap(cleared.update, summary->update);
  *summary = std::move(cleared);
}

Status NoLandmark(std::int64_t track) {
  return Status::Error(StatusCode::kInvalidArgument,
                       "track " + std::to_string(track) + " has no landmark in the window");
}

}  // namespace

class SlidingWindowEstimator::Impl {
 public:
  explicit Impl(const SlidingWindowOptions& options) : window(options) {}

  const internal::FrameRecord& Frame(int i) const {
    return window.frames()[static_cast<std::size_t>(i)];
  }
  // Null if the track has no landmark.
  const internal::Track* Landmark(std::int64_t track) const {
    const internal::Track* found = window.tracks().Find(track);
    return found != nullptr && found->has_landmark() ? found : nullptr;
  }
  const IncrementalSolver& solver() const { return window.graph().solver; }

  internal::Window window;
};

SlidingWindowEstimator::SlidingWindowEstimator(const SlidingWindowOptions& options)
    : impl_(std::make_unique<Impl>(options)) {
}

SlidingWindowEstimator::~SlidingWindowEstimator() = default;

Status SlidingWindowEstimator::Start(const WindowStart& start,
                                     const std::vector<WindowObservation>& observations) {
  return impl_->window.Start(start, observations);
}

WindowSummary SlidingWindowEstimator::AddFrame(const WindowFrame& frame) {
  WindowSummary summary;
  AddFrame(frame, &summary);
  return summary;
}

void SlidingWindowEstimator::AddFrame(const WindowFrame& frame, WindowSummary* summary) {
  Clear(summary);
  internal::Window& window = impl_->window;
  summary->status = window.Admit(frame, summary);
  if (summary->status.ok()) {
    summary->status = window.Solve(summary);
    const Status slid = window.Slide(summary);
    summary->status = summary->status.ok() ? slid : summary->status;
  }
  summary->num_landmarks = window.tracks().CountLandmarks();
  if (num_frames() > 0) {
    summary->state = State(num_frames() - 1);
  }
}

int SlidingWindowEstimator::num_frames() const {
  return static_cast<int>(impl_->window.frames().size());
}

WindowState SlidingWindowEstimator::State(int i) const {
  return impl_->window.graph().StateOf(impl_->Frame(i));
}

const IncrementalSolver& SlidingWindowEstimator::solver() const {
  return impl_->solver();
}

VariableId SlidingWindowEstimator::PoseId(int i) const {
  return impl_->Frame(i).pose;
}

VariableId SlidingWindowEstimator::SpeedBiasId(int i) const {
  return impl_->Frame(i).speed_bias;
}

VariableId SlidingWindowEstimator::LandmarkId(std::int64_t track) const {
  const internal::Track* found = impl_->Landmark(track);
  return found != nullptr ? found->landmark : -1;
}

Status SlidingWindowEstimator::StateCovariance(int i, std::array<double, 225>* covariance) const {
  if (i < 0 || i >= num_frames()) {
    return Status::Error(
        StatusCode::kInvalidArgument,
        "the window has no frame " + std::to_string(i) + ", but " + std::to_string(num_frames()));
  }
  const VariableId pose = PoseId(i), speed_bias = SpeedBiasId(i);
  GraphCovariance blocks;
  const Status status =
      blocks.Compute(solver(), {{pose, pose}, {pose, speed_bias}, {speed_bias, speed_bias}});
  if (!status.ok()) {
    return status;
  }
  RowMajor pp(6, 6), ps(6, 9), ss(9, 9);
  blocks.Get(pose, pose, pp.data());
  blocks.Get(pose, speed_bias, ps.data());
  blocks.Get(speed_bias, speed_bias, ss.data());
  Eigen::Map<RowMajor> all(covariance->data(), 15, 15);
  all << pp, ps, ps.transpose(), ss;
  return Status::Ok();
}

Status SlidingWindowEstimator::LandmarkPosition(std::int64_t track,
                                                std::array<double, 3>* point) const {
  const internal::Track* found = impl_->Landmark(track);
  if (found == nullptr) {
    return NoLandmark(track);
  }
  const internal::View& anchor_view = found->views.front();
  const VariableId anchor = impl_->window.FrameNumbered(anchor_view.frame).pose;
  const internal::Feature feature = impl_->window.graph().FeatureOf(found->landmark, anchor_view);
  const Eigen::Vector3d x = internal::PointInWorld(feature, solver().Values(anchor),
                                                   impl_->window.options().body_from_camera.data());
  *point = {x.x(), x.y(), x.z()};
  return Status::Ok();
}

Status SlidingWindowEstimator::LandmarkHessian(std::int64_t track,
                                               std::vector<double>* hessian) const {
  const internal::Track* found = impl_->Landmark(track);
  if (found == nullptr) {
    return NoLandmark(track);
  }
  const FactorGraph& graph = solver().graph();
  const VariableId landmark = found->landmark;
  const int size = graph.TangentSize(landmark);
  RowMajor P = RowMajor::Zero(size, size);
  internal::FactorLinearizer linearizer(
      graph, [this](VariableId id) { return solver().Values(id); },
      [=](VariableId id) { return id == landmark; });
  for (const internal::View& view : found->views) {
    internal::LinearizedFactor factor;
    if (view.factor.family < 0) {
      continue;  // the exact view from the anchor
    }
    const Status status = linearizer.Linearize(view.factor, &factor);
    if (!status.ok()) {
      return status;
    }
    const FactorFamily& family = graph.family(view.factor.family);
    // the landmark's, in both families
    const internal::SlotJacobians& slot = factor.slots[family.num_slots() - 1];
    const Eigen::Map<const RowMajor, 0, Eigen::OuterStride<>> J(
        slot.data, factor.rows, size, Eigen::OuterStride<>(slot.row_stride));
    P += J.transpose() * J;
  }
  hessian->assign(P.data(), P.data() + P.size());
  return Status::Ok();
}

std::vector<double> SlidingWindowEstimator::PriorSpectrum() const {
  const LinearPrior* prior = FindLinearPrior(solver().graph(), impl_->window.prior());
  if (prior == nullptr) {
    return {};
  }
  const auto rows = static_cast<Eigen::Index>(prior->e0.size());
  const Eigen::Map<const RowMajor> J(prior->J.data(), rows, prior->num_columns());
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> decomposition(J.transpose() * J,
                                                                     Eigen::EigenvaluesOnly);
  const Eigen::VectorXd& values = decomposition.eigenvalues();
  return {values.data(), values.data() + values.size()};
}

}  // namespace inceres
