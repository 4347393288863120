#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "inceres/export.h"
#include "inceres/factors/landmark_position.h"
#include "inceres/io/g2o_graph.h"
#include "inceres/io/read_options.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/status.h"

namespace inceres {

/// A landmark seen from a pose of a planar map.
struct PlanarMapSighting {
  int pose = 0;                                     ///< dense index of the pose
  int landmark = 0;                                 ///< dense index of the landmark
  PlanarSighting kind = PlanarSighting::kPosition;  ///< what z is
  double z[2] = {0.0, 0.0};                         ///< x and y, or distance and angle
  double covariance[4] = {1.0, 0.0, 0.0, 1.0};      ///< of z, row by row
};

/// A planar trajectory and the landmarks that are seen from it, as read from a file.
struct INCERES_EXPORT PlanarMap {
  PoseGraph poses;                         ///< dimension 2, by id; odometry is its edges
  std::vector<std::int64_t> landmark_ids;  ///< id in the file of each landmark, ascending
  /// num_landmarks x 2: where its first sighting puts it, from where that pose stands
  std::vector<double> landmarks;
  std::vector<PlanarMapSighting> sightings;  ///< in the order of the file

  /// Landmarks of the file.
  int NumLandmarks() const { return static_cast<int>(landmark_ids.size()); }
};

/// Reads a planar map in the text form that GTSAM has Victoria Park in (optionally .gz or .bz2):
///
///     ODOMETRY from to x y theta C_xx C_xy C_xt C_yy C_yt C_tt    to seen from `from`
///     LANDMARK pose landmark x y C_xx C_xy C_yy                   a place in the pose's axes
///     BR pose landmark bearing range bearing_std range_std        an angle and a distance
///
/// with meters, radians and covariances (not their inverses, which g2o's files have), blank lines
/// and lines that start with '#'. Poses and landmarks share their numbers. Poses stand in the order
/// of their ids: the first at the origin, each later one where odometry puts it.
///
/// Every failure is kIo with a message `file:line: tag: field: what is wrong`: a missing file, an
/// unknown tag, a missing or surplus field, a number that is not finite, a distance that is not
/// positive, a covariance that is not positive definite, an id that is a pose on one line and a
/// landmark on another, odometry from a pose to itself, odometry that does not lead to every pose,
/// and a file without any line. `*map` is then unchanged.
///
/// Cost: one pass over the file. Threads: no shared state. Source: GTSAM's load2D (dataset.cpp),
/// for what the columns mean; Guivant & Nebot, "Optimization of the simultaneous localization and
/// map-building algorithm for real-time implementation", 2001, for the data.
INCERES_EXPORT Status ReadPlanarMap(const std::string& path, PlanarMap* map,
                                    const ReadOptions& options = ReadOptions());

/// How a planar map becomes a factor graph.
struct PlanarMapOptions {
  ReadOptions file;                           ///< of the reader of the file
  std::shared_ptr<const Loss> odometry_loss;  ///< of every odometry factor; null: ½‖f‖²
  std::shared_ptr<const Loss> sighting_loss;  ///< of every sighting; null: ½‖f‖²
  /// Sightings that are positions become a distance and an angle, with their covariance carried
  /// over to first order: what a laser measures.
  bool range_and_bearing = false;
  Role landmark_role = Role::kLandmark;  ///< kFrame: landmarks are not eliminated first
};

/// Which variables and factors of a graph a planar map has become.
struct PlanarMapGraph {
  G2oGraph poses;                                ///< the trajectory; factor i of `planar` is edge i
  std::vector<VariableId> landmarks;             ///< by dense index
  std::vector<FactorId> sightings;               ///< by their order in the file
  FamilyHandle<PlanarLandmarkFamily> positions;  ///< of sightings that are places
  FamilyHandle<PlanarLandmarkFamily> bearings;   ///< of those that are distance and angle
};

/// Adds the poses of a map as frames, its landmarks, and all measurements as factors. The gauge is
/// free: hold the first pose. kInvalidArgument, graph and ids unchanged, if the poses are not
/// planar, a covariance is not positive definite, or sizes or indices do not fit together; the
/// message names the culprit. `ids` may be null. Cost: one pass. Threads: one writer.
INCERES_EXPORT Status AddPlanarMap(const PlanarMap& map, const PlanarMapOptions& options,
                                   FactorGraph* graph, PlanarMapGraph* ids);

/// Reads a planar map into a graph: ReadPlanarMap, then AddPlanarMap. On an error of either, graph
/// and ids are unchanged.
INCERES_EXPORT Status ReadPlanarMap(const std::string& path, FactorGraph* graph,
                                    PlanarMapGraph* ids = nullptr,
                                    const PlanarMapOptions& options = PlanarMapOptions());

}  // namespace inceres
