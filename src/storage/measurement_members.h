#pragma once

#include "inceres/factors/bal_reprojection.h"
#include "inceres/factors/bearing.h"
#include "inceres/factors/body_reprojection.h"
#include "inceres/factors/center_distance.h"
#include "inceres/factors/inverse_depth_reprojection.h"
#include "inceres/factors/landmark_position.h"
#include "inceres/factors/planar_relative_pose.h"
#include "inceres/factors/point_reprojection.h"
#include "inceres/factors/pose_edge.h"
#include "inceres/factors/pose_prior.h"
#include "inceres/factors/relative_pose.h"
#include "inceres/factors/relative_similarity.h"
#include "inceres/factors/stereo_reprojection.h"

namespace inceres::internal {

/// The members of a measurement, in the order in which they stand in a file: visit(values, count)
/// for each.
template <typename Visitor>
void VisitMeasurement(BalReprojectionFamily::Measurement& m, Visitor&& visit) {
  visit(&m.x, 1);
  visit(&m.y, 1);
}
template <typename Visitor>
void VisitMeasurement(InverseDepthReprojectionFamily::Measurement& m, Visitor&& visit) {
  visit(m.anchor_point, 2);
  visit(m.observed_point, 2);
  visit(m.sqrt_information, 3);
}
template <typename Visitor>
void VisitMeasurement(BodyReprojectionFamily::Measurement& m, Visitor&& visit) {
  visit(m.point_i, 2);
  visit(m.point_j, 2);
  visit(m.velocity_i, 2);
  visit(m.velocity_j, 2);
  visit(&m.offset_i, 1);
  visit(&m.offset_j, 1);
  visit(m.sqrt_information, 3);
}
template <typename Visitor>
void VisitMeasurement(RelativePoseFamily::Measurement& m, Visitor&& visit) {
  visit(m.q_ab, 4);
  visit(m.p_ab, 3);
  visit(m.sqrt_information, 36);
}
template <typename Visitor>
void VisitMeasurement(PlanarLandmarkFamily::Measurement& m, Visitor&& visit) {
  visit(m.z, 2);
  visit(m.sqrt_information, 4);
}
template <typename Visitor>
void VisitMeasurement(SpatialLandmarkFamily::Measurement& m, Visitor&& visit) {
  visit(m.z, 3);
  visit(m.sqrt_information, 9);
}
template <typename Visitor>
void VisitMeasurement(PositionPriorFamily::Measurement& m, Visitor&& visit) {
  visit(m.z, 3);
  visit(m.lever, 3);
  visit(m.sqrt_information, 9);
}
template <typename Visitor>
void VisitMeasurement(PoseEdgeFamily::Measurement& m, Visitor&& visit) {
  visit(m.p_m, 3);
  visit(m.q_m, 4);
  visit(m.sqrt_information, 36);
}
template <typename Visitor>
void VisitMeasurement(RelativeSimilarityFamily::Measurement& m, Visitor&& visit) {
  visit(m.p_m, 3);
  visit(m.q_m, 4);
  visit(&m.s_m, 1);
  visit(m.sqrt_information, 49);
}
template <typename Visitor>
void VisitMeasurement(PlanarRelativePoseFamily::Measurement& m, Visitor&& visit) {
  visit(m.motion, 3);
  visit(m.sqrt_information, 9);
}
template <typename Visitor>
void VisitMeasurement(PosePriorFamily::Measurement& m, Visitor&& visit) {
  visit(m.pose, 7);
  visit(m.sqrt_information, 36);
}
template <typename Visitor>
void VisitMeasurement(SpeedBiasPriorFamily::Measurement& m, Visitor&& visit) {
  visit(m.speed_bias, 9);
  visit(m.sqrt_information, 81);
}
template <typename Visitor>
void VisitMeasurement(CenterDistanceFamily::Measurement& m, Visitor&& visit) {
  visit(&m.distance, 1);
  visit(&m.sqrt_information, 1);
}
template <typename Visitor>
void VisitMeasurement(PixelObservation& m, Visitor&& visit) {
  visit(m.pixel, 2);
  visit(m.sqrt_information, 3);
}
template <typename Visitor>
void VisitMeasurement(BearingObservation& m, Visitor&& visit) {
  visit(m.direction, 3);
  visit(m.sqrt_information, 3);
}
template <typename Visitor>
void VisitMeasurement(StereoObservation& m, Visitor&& visit) {
  visit(m.left, 2);
  visit(&m.right_u, 1);
  visit(m.sqrt_information, 9);
}

}  // namespace inceres::internal
