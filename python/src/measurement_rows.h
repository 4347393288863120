#pragma once

#include <algorithm>

#include "inceres/factors/body_reprojection.h"
#include "inceres/factors/diagonal_prior.h"
#include "inceres/factors/equidistant_reprojection.h"
#include "inceres/factors/planar_relative_pose.h"
#include "inceres/factors/point_reprojection.h"
#include "inceres/factors/pose_prior.h"
#include "inceres/factors/relative_pose.h"

namespace inceres::python {

/// What a row of numbers from Python is to each family: its numbers in order, and, if it has more
/// columns, the square root information behind them.

template <typename Packed>
void CopyInformation(const double* row, int num_columns, int first, int count, Packed* to) {
  if (num_columns > first) {
    std::copy_n(row + first, count, *to);
  }
}

inline PixelObservation ReadPixel(const double* row, int num_columns) {
  PixelObservation seen;
  std::copy_n(row, 2, seen.pixel);
  CopyInformation(row, num_columns, 2, 3, &seen.sqrt_information);
  return seen;
}

inline StereoObservation ReadStereo(const double* row, int num_columns) {
  StereoObservation seen;
  std::copy_n(row, 2, seen.left);
  seen.right_u = row[2];
  CopyInformation(row, num_columns, 3, 9, &seen.sqrt_information);
  return seen;
}

inline BearingObservation ReadBearing(const double* row, int num_columns) {
  BearingObservation seen;
  std::copy_n(row, 3, seen.direction);
  CopyInformation(row, num_columns, 3, 3, &seen.sqrt_information);
  return seen;
}

inline InverseDepthReprojectionFamily::Measurement ReadInverseDepth(const double* row,
                                                                    int num_columns) {
  InverseDepthReprojectionFamily::Measurement seen;
  std::copy_n(row, 2, seen.anchor_point);
  std::copy_n(row + 2, 2, seen.observed_point);
  CopyInformation(row, num_columns, 4, 3, &seen.sqrt_information);
  return seen;
}

inline RelativePoseFamily::Measurement ReadRelativePose(const double* row, int /*num_columns*/) {
  RelativePoseFamily::Measurement measured;
  std::copy_n(row, 4, measured.q_ab);
  std::copy_n(row + 4, 3, measured.p_ab);
  std::copy_n(row + 7, 36, measured.sqrt_information);
  return measured;
}

inline PlanarRelativePoseFamily::Measurement ReadPlanar(const double* row, int num_columns) {
  PlanarRelativePoseFamily::Measurement measured;
  std::copy_n(row, 3, measured.motion);
  CopyInformation(row, num_columns, 3, 9, &measured.sqrt_information);
  return measured;
}

inline PosePriorFamily::Measurement ReadPosePrior(const double* row, int /*num_columns*/) {
  PosePriorFamily::Measurement prior;
  std::copy_n(row, 7, prior.pose);
  std::copy_n(row + 7, 36, prior.sqrt_information);
  return prior;
}

inline SpeedBiasPriorFamily::Measurement ReadSpeedBiasPrior(const double* row,
                                                            int /*num_columns*/) {
  SpeedBiasPriorFamily::Measurement prior;
  std::copy_n(row, 9, prior.speed_bias);
  std::copy_n(row + 9, 81, prior.sqrt_information);
  return prior;
}

inline DiagonalPriorFamily::Measurement ReadDiagonalPrior(const double* row, int num_columns) {
  const double* middle = row + num_columns / 2;
  return {{row, middle}, {middle, row + num_columns}};
}

}  // namespace inceres::python
