#include "inceres/factors/gauge.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "inceres/factors/diagonal_prior.h"
#include "inceres/factors/pose_prior.h"
#include "inceres/problem/rotation.h"
#include "problem/find_fault.h"

// Which directions of a problem are free is known beforehand: rotation and translation, and of
// monocular images the scale. So they are held by what is least: one variable, constant or by a
// prior of weight 1 at its present values, and for the scale one row with a residual that is 0 now.
// Neither can bend a minimum, since the rest of the cost does not change along the gauge: the
// minimum over all is where these residuals are zero. That is also why weights need not be chosen
// with care. (A BAL camera that is made constant keeps its intrinsics too, which is more than the
// gauge.)
//
// Choose decides and checks without touching the graph; Hold, which cannot fail, changes it. So a
// refusal leaves the graph as it was.

namespace inceres {
namespace {

// A coordinate holds the scale only if the scale moves it by this share of what it moves the
// center.
// At this share an error of the coordinate is an error of the scale a thousand times as large.
constexpr double kLeastShare = 1e-3;

Status Refused(const std::string& message) {
  return internal::Invalid("HoldGauge: " + message);
}

int AmbientSizeOf(CenterKind kind) {
  return kind == CenterKind::kPose ? 7 : kind == CenterKind::kBalCamera ? 9 : 3;
}

// Where the position stands among the values.
// A BAL camera has its rotation first.
int FirstOfPosition(CenterKind kind) {
  return kind == CenterKind::kBalCamera ? 3 : 0;
}

bool IsOnLeftPose(const Manifold* manifold) {
  return dynamic_cast<const LeftPoseManifold*>(manifold) != nullptr;
}

// Holds the gauge of one graph: the choice is kept in held_ between Choose and Hold.
class GaugeHolder {
 public:
  GaugeHolder(const GaugeOptions& options, FactorGraph* graph) : options_(options), graph_(*graph) {
    held_.reference = options.reference;
  }

  Status Choose();
  void Hold();
  const HeldGauge& held() const { return held_; }

 private:
  Status CheckFrame(VariableId id) const;
  bool IsOfKind(VariableId id) const;
  Status CheckPrior() const;
  Status ChooseOther();
  Status ChooseCoordinate();
  void HoldReference();
  void HoldScale();
  double DistanceTo(VariableId id, double apart[3]) const;
  void MotionByScale(double motion[3]) const;

  const GaugeOptions& options_;
  FactorGraph& graph_;
  HeldGauge held_;
};

// By sizes, for a graph does not know what its values mean: an ambient size and a tangent size that
// go together in this kind. A landmark is none, whatever its size, for it is eliminated first.
bool GaugeHolder::IsOfKind(VariableId id) const {
  const int ambient = AmbientSizeOf(options_.kind);
  const int tangent = options_.kind == CenterKind::kPose ? 6 : ambient;
  return graph_.HasVariable(id) && graph_.role(id) == Role::kFrame &&
         graph_.AmbientSize(id) == ambient && graph_.TangentSize(id) == tangent;
}

Status GaugeHolder::CheckFrame(VariableId id) const {
  if (!graph_.HasVariable(id)) {
    return Refused("there is no " + internal::VariableName(id));
  }
  return IsOfKind(id)
             ? Status::Ok()
             : Refused(internal::VariableName(id) + " is no frame of this kind and its sizes");
}

// The side on which a prior on a pose perturbs is that of the pose's manifold.
Status GaugeHolder::CheckPrior() const {
  const Manifold* manifold = graph_.manifold(held_.reference);
  const bool fits =
      dynamic_cast<const PoseManifold*>(manifold) != nullptr || IsOnLeftPose(manifold);
  // A constant reference needs no prior, and other kinds have priors in their own coordinates.
  return options_.kind != CenterKind::kPose || options_.reference_by == GaugeReference::kConstant ||
                 fits
             ? Status::Ok()
             : Refused(internal::VariableName(held_.reference) +
                       " is on another manifold than the prior on a pose needs: use kConstant");
}

double GaugeHolder::DistanceTo(VariableId id, double apart[3]) const {
  double a[3], b[3];
  // Between centers, not stored positions: of BAL cameras those are −R c.
  CenterOf(options_.kind, graph_.Values(held_.reference), a);
  CenterOf(options_.kind, graph_.Values(id), b);
  for (int k = 0; k < 3; ++k) {
    apart[k] = b[k] - a[k];
  }
  return std::hypot(apart[0], apart[1], apart[2]);
}

Status GaugeHolder::Choose() {
  // The first one in the order of ids: the same choice in each run.
  for (VariableId id = 0; id < graph_.num_variables() && held_.reference < 0; ++id) {
    held_.reference = IsOfKind(id) ? id : -1;
  }
  if (held_.reference < 0) {
    return Refused("the graph has no frame of this kind and its sizes");
  }
  Status status = CheckFrame(held_.reference);
  status = status.ok() ? CheckPrior() : status;
  if (!status.ok() || options_.scale_by == GaugeScale::kMeasured) {
    return status;
  }
  // Measured by the edges themselves: [x y] in meters.
  if (options_.kind == CenterKind::kPlanarPose) {
    return Refused("relative poses in the plane measure the scale: it is not held");
  }
  status = ChooseOther();
  return status.ok() && options_.scale_by == GaugeScale::kCoordinate ? ChooseCoordinate() : status;
}

// Of those that may be chosen, the one with the furthest center: an error of its place is the
// smallest share of the scale.
Status GaugeHolder::ChooseOther() {
  double apart[3];
  held_.other = options_.other;
  for (VariableId id = 0; id < graph_.num_variables() && options_.other < 0; ++id) {
    // A constant one cannot answer to the scale.
    if (id == held_.reference || !IsOfKind(id) || graph_.IsConstant(id)) {
      continue;
    }
    const double distance = DistanceTo(id, apart);
    // Strictly greater: of equal distances the first id.
    if (held_.other < 0 || distance > held_.distance) {
      held_.other = id;
      held_.distance = distance;
    }
  }
  if (held_.other < 0) {
    return Refused("the scale needs a second frame of this kind that is not constant");
  }
  const Status status = CheckFrame(held_.other);
  if (!status.ok()) {
    return status;
  }
  if (held_.other == held_.reference) {
    return Refused(internal::VariableName(held_.other) +
                   " is the reference: the scale needs another one");
  }
  if (graph_.IsConstant(held_.other)) {
    return Refused(internal::VariableName(held_.other) +
                   " is constant: the scale needs one that moves");
  }
  // Again for a given one; apart is not used.
  held_.distance = DistanceTo(held_.other, apart);
  // The row is relative to the distance, which is divided by.
  if (!(held_.distance > 0.0 && std::isfinite(held_.distance))) {
    return Refused("the centers of variables " + std::to_string(held_.reference) + " and " +
                   std::to_string(held_.other) + " coincide: their distance holds no scale");
  }
  return Status::Ok();
}

// How the other's stored position moves when the scale about the reference's center grows.
void GaugeHolder::MotionByScale(double motion[3]) const {
  DistanceTo(held_.other, motion);
  // In BAL the stored position is t = −R c, so it grows along −R (c_b − c_a) when the scale does
  // about the center of the reference.
  if (options_.kind == CenterKind::kBalCamera) {  // t = −R c
    const double* w = graph_.Values(held_.other);
    const RotationCoefficients angle = CoefficientsOfAngle(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    double R[9];
    RotationPolynomial(w, angle.sinc, angle.cosc, R);
    const double back[3] = {-motion[0], -motion[1], -motion[2]};
    MultiplyMatrixVector(R, back, motion);
  }
}

Status GaugeHolder::ChooseCoordinate() {
  double motion[3];
  MotionByScale(motion);
  const int first = FirstOfPosition(options_.kind);
  int k = options_.coordinate - first;
  if (options_.coordinate < 0) {
    // The coordinate that moves most: the row's derivative by the scale is then at least 1/√3 of
    // the whole motion.
    k = 0;
    for (int other = 1; other < 3; ++other) {
      k = std::fabs(motion[other]) > std::fabs(motion[k]) ? other : k;
    }
  }
  if (k < 0 || k >= 3) {
    return Refused("coordinate " + std::to_string(options_.coordinate) +
                   " is none of the position");
  }
  if (!(std::fabs(motion[k]) >= kLeastShare * held_.distance)) {
    return Refused("coordinate " + std::to_string(first + k) + " of " +
                   internal::VariableName(held_.other) + " does not change when the scale does");
  }
  held_.coordinate = first + k;
  // The distance is reported for kDistance only.
  held_.distance = 0.0;
  return Status::Ok();
}

// The constant case adds no factor; the prior of a pose is on the side of its manifold, that of the
// other kinds on leading values.
void GaugeHolder::HoldReference() {
  if (options_.reference_by == GaugeReference::kConstant) {
    graph_.SetConstant(held_.reference, true);
    return;
  }
  // At the values of now the prior's residual is zero, and its Jacobian has full rank on the pose.
  const double* values = graph_.Values(held_.reference);
  if (options_.kind == CenterKind::kPose) {
    // U = I: the diagonal entries of a 6×6 matrix are 7 apart.
    PosePriorFamily::Measurement prior;
    std::copy_n(values, 7, prior.pose);
    for (int k = 0; k < 6; ++k) {
      prior.sqrt_information[7 * k] = 1.0;
    }
    const auto side =
        IsOnLeftPose(graph_.manifold(held_.reference)) ? Perturbation::kLeft : Perturbation::kRight;
    const auto family = graph_.AddFamily(std::make_shared<PosePriorFamily>(side));
    graph_.AddFactor(family, prior, {held_.reference});
    held_.reference_family = family;
    return;
  }
  const int ambient = AmbientSizeOf(options_.kind);
  // Of a BAL camera rotation and translation only: focal length and distortion are no gauge.
  const int size = options_.kind == CenterKind::kBalCamera ? 6 : ambient;
  const auto family =
      graph_.AddFamily(std::make_shared<DiagonalPriorFamily>(size, ambient, ambient));
  graph_.AddFactor(family,
                   {std::vector<double>(values, values + size),
                    std::vector<double>(static_cast<std::size_t>(size), 1.0)},
                   {held_.reference});
  held_.reference_family = family;
}

void GaugeHolder::HoldScale() {
  if (options_.scale_by == GaugeScale::kDistance) {
    const auto family = graph_.AddFamily(std::make_shared<CenterDistanceFamily>(options_.kind));
    // sqrt_information = 1 / distance makes the row relative: 1 means a scale twice as large.
    graph_.AddFactor(family, {held_.distance, 1.0 / held_.distance},
                     {held_.reference, held_.other});
    held_.scale_family = family;
    return;
  }
  // A prior is on leading coordinates: those before it are given no weight.
  const int size = held_.coordinate + 1;
  const double* values = graph_.Values(held_.other);
  std::vector<double> weights(static_cast<std::size_t>(size), 0.0);
  weights.back() = 1.0;
  const auto family = graph_.AddFamily(std::make_shared<DiagonalPriorFamily>(
      size, graph_.AmbientSize(held_.other), graph_.TangentSize(held_.other)));
  graph_.AddFactor(family, {std::vector<double>(values, values + size), weights}, {held_.other});
  held_.scale_family = family;
}

// The families are added here, after all checks have passed.
void GaugeHolder::Hold() {
  HoldReference();
  if (held_.other >= 0) {
    HoldScale();
  }
}

}  // namespace

// After a refusal neither the graph nor `held` has changed.
Status HoldGauge(const GaugeOptions& options, FactorGraph* graph, HeldGauge* held) {
  GaugeHolder holder(options, graph);
  const Status status = holder.Choose();
  if (status.ok()) {
    holder.Hold();
    if (held != nullptr) {
      *held = holder.held();
    }
  }
  return status;
}

}  // namespace inceres
