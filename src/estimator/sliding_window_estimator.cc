#include "inceres/estimator/sliding_window_estimator.h"

#include <string>

#include <Eigen/Eigenvalues>

#include "estimator/window.h"
#include "inceres/solver/covariance.h"
#include "inceres/solver/marginalization.h"
#include "linearize/factor_linearizer.h"
#include "linearize/jacobian_map.h"

// The public face of a window. The work is in estimator/window.h, phase by phase; here is the order
// of the phases and what can be read out between two calls: states, covariances of one frame, how
// well a landmark is determined, what the prior knows. Read-outs change nothing and take the values
// that the solver holds. They are not on the path of a frame: each one costs what its comment in
// the header says.

namespace inceres {
namespace {

using internal::RowMajor;

// As newly made, but for the memory it holds.
// Copied and not moved: strings and vectors that are given an empty one's value keep their capacity
// for a caller who passes the same summary each time.
void Clear(WindowSummary* summary) {
  const WindowSummary cleared;
  *summary = cleared;
}

// A track without a landmark may exist: seen once, or with too little parallax so far.
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
  // A frame that is not admitted leaves all as it was, so there is nothing to solve.
  if (summary->status.ok()) {
    // The window slides whatever fails before, be it landmarks or the solve: frames come in at a
    // fixed rate, and a window that does not slide grows. The first thing that went wrong is what
    // is told.
    for (const auto phase :
         {&internal::Window::CreateLandmarks, &internal::Window::Solve, &internal::Window::Slide}) {
      const Status status = (window.*phase)(summary);
      summary->status = summary->status.ok() ? status : summary->status;
    }
  }
  summary->num_landmarks = window.tracks().CountLandmarks();
  // The newest frame as the solver leaves it, or the last good one if this one was refused.
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
  // Three blocks are enough: the fourth is the transpose of the second. They are neighbors by the
  // IMU factor or the prior, so their entries of S⁻¹ come from the factor's own pattern
  // (docs/algorithms.md, "Covariance").
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
  // Row-major like the blocks: (δp, φ), velocity, biases, both ways.
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
  // The first view is from the anchor: λ and m are in that camera.
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
  // P = Σ JᵀJ over the landmark's own columns, the frames held: the block that elimination inverts,
  // and so the inverse of the covariance that the landmark would have if all frames were known.
  RowMajor P = RowMajor::Zero(size, size);
  // Linearized anew at the values held, with the loss's weight, and only in the landmark's slot.
  internal::FactorLinearizer linearizer(
      graph, [this](VariableId id) { return solver().Values(id); },
      [=](VariableId id) { return id == landmark; });
  for (const internal::View& view : found->views) {
    internal::LinearizedFactor factor;
    // With kInverseDepth the first view has no factor: its bearing is taken as exact.
    if (view.factor.family < 0) {
      continue;  // the exact view from the anchor
    }
    const Status status = linearizer.Linearize(view.factor, &factor);
    if (!status.ok()) {
      return status;
    }
    const FactorFamily& family = graph.family(view.factor.family);
    // the landmark's, in both families
    const internal::JacobianMap J =
        internal::JacobianOf(factor.slots[family.num_slots() - 1], 0, factor.rows);
    P += J.transpose() * J;
  }
  hessian->assign(P.data(), P.data() + P.size());
  return Status::Ok();
}

// Eigenvalues of JᵀJ, the information of what has left; a zero is a direction that nothing
// measured. Squaring J costs half of the digits: values far below the largest are noise.
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
