#include "inceres/io/planar_map.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include <Eigen/Cholesky>

#include "base/sort_unique.h"
#include "inceres/factors/pose_prior.h"
#include "io/pose_graph.h"
#include "io/record_reader.h"

namespace inceres {
namespace internal {

// Planar maps in the text form that GTSAM has Victoria Park in, and the factor graphs that they
// become; inceres/io/planar_map.h has the grammar.
//
// A line refers to poses and landmarks by the numbers of the file, in any order. So lines are read
// as they come and only afterwards numbered densely, when all numbers are known; edges and
// sightings are in the order of their lines, which is how each finds its own again. Poses then get
// a place along the odometry, and landmarks one from the pose that sees them first.
//
// Covariances of odometry are inverted as they are read, for an edge holds an information matrix;
// those of sightings are kept as they are, and their inverse is tried only, so that a message can
// name the line.

namespace {

// The inverse of a covariance, by columns that are rows; false if that is not positive definite.
// The factor shows whether it is positive definite. The mean with the transpose makes the result
// symmetric to the bit; rounding leaves it otherwise so to a few digits less.
template <int size>
bool InvertCovariance(const double* covariance, double* information) {
  using Matrix = Eigen::Matrix<double, size, size, Eigen::RowMajor>;
  const Eigen::LLT<Matrix> cholesky{Matrix(Eigen::Map<const Matrix>(covariance))};
  if (cholesky.info() != Eigen::Success) {
    return false;
  }
  Eigen::Map<Matrix> inverse(information);
  inverse = cholesky.solve(Matrix::Identity());
  inverse = (0.5 * (inverse + inverse.transpose())).eval();
  // A matrix of NaN has a factor for Eigen, and one that is nearly singular an inverse that
  // overflows.
  return inverse.allFinite();
}

// Among numbers of the file, ascending and each once.
int IndexOf(std::int64_t id, const std::vector<std::int64_t>& ids) {
  return static_cast<int>(std::lower_bound(ids.begin(), ids.end(), id) - ids.begin());
}

// Calls follow each other in one direction: Read, ReadRecord for each line, NumberAll, PlacePoses,
// PlaceLandmarks. A failure ends all of it; ReadFile hands over the map only if there was none.
class PlanarMapReader : RecordReader {
 public:
  using RecordReader::RecordReader;

  Status Read(PlanarMap* map) {
    map_ = map;
    map_->poses.dimension = 2;
    if (ForEachTaggedLine([this] { return ReadRecord(); }) && NumberAll() && PlacePoses()) {
      PlaceLandmarks();
    }
    return status_;
  }

 private:
  // Ids are resolved at the end: lines come in any order.
  struct Line {
    std::int64_t pose, other, line;
    bool is_odometry;
  };

  // The kind of the line decides what the second number is and which fields follow.
  bool ReadRecord() {
    Line line{0, 0, scanner_.line(), tag_ == "ODOMETRY"};
    if (!line.is_odometry && tag_ != "LANDMARK" && tag_ != "BR") {
      return Fail("tag", "not known; known are ODOMETRY, LANDMARK and BR");
    }
    int pose = 0, other = 0;
    if (!ReadIndex(line.is_odometry ? "from" : "pose", &pose) ||
        !ReadIndex(line.is_odometry ? "to" : "landmark", &other)) {
      return false;
    }
    if (line.is_odometry && pose == other) {
      return Fail("to", "odometry from pose " + std::to_string(pose) + " to itself");
    }
    line.pose = pose;
    line.other = other;
    lines_.push_back(line);
    poses_.push_back(pose);
    // The first number is a pose in all three; one that is seen from but that odometry does not
    // reach is found by PlaceAlongEdges.
    (line.is_odometry ? poses_ : landmarks_).push_back(other);
    return line.is_odometry ? ReadOdometry() : tag_ == "BR" ? ReadBearing() : ReadPlace();
  }

  bool ReadOdometry() {
    PoseGraphEdge& edge = map_->poses.edges.emplace_back();
    double u[6];
    if (!ReadFields({{"motion", 3, edge.measurement.data()}, {"covariance", 6, u}})) {
      return false;
    }
    // The upper triangle row by row, as the file has it.
    const double covariance[9] = {u[0], u[1], u[2], u[1], u[3], u[4], u[2], u[4], u[5]};
    return InvertCovariance<3>(covariance, edge.information.data()) ||
           Fail("covariance", "not positive definite");
  }

  // A position in the pose's axes.
  bool ReadPlace() {
    PlanarMapSighting& sighting = map_->sightings.emplace_back();
    double u[3];
    if (!ReadFields({{"position", 2, sighting.z}, {"covariance", 3, u}})) {
      return false;
    }
    const double covariance[4] = {u[0], u[1], u[1], u[2]};
    std::copy_n(covariance, 4, sighting.covariance);
    double information[4];
    return InvertCovariance<2>(covariance, information) ||
           Fail("covariance", "not positive definite");
  }

  // z is distance, angle, as the factor has it; the file has the angle first, with standard
  // deviations that are taken to be independent.
  bool ReadBearing() {
    PlanarMapSighting& sighting = map_->sightings.emplace_back();
    sighting.kind = PlanarSighting::kRangeBearing;
    double deviations[2];
    if (!ReadFields({{"bearing", 1, sighting.z + 1},
                     {"range", 1, sighting.z},
                     {"bearing_std", 1, deviations + 1},
                     {"range_std", 1, deviations}})) {
      return false;
    }
    // At distance 0 the angle means nothing, and its derivative is infinite.
    if (!(sighting.z[0] > 0.0)) {
      return Fail("range", "not positive");
    }
    const char* const names[] = {"range_std", "bearing_std"};
    for (int k = 0; k < 2; ++k) {
      // Entries 0 and 3 are the diagonal of 2 × 2. The square of a deviation may underflow or
      // overflow where the deviation itself does not.
      sighting.covariance[3 * k] = deviations[k] * deviations[k];
      if (!(deviations[k] > 0.0 && std::isnormal(sighting.covariance[3 * k]))) {
        return Fail(names[k], "not positive");
      }
    }
    return true;
  }

  bool NumberAll() {
    if (lines_.empty()) {
      return FailAt(scanner_.line(), "the file has no measurements");
    }
    SortUnique(&poses_);
    SortUnique(&landmarks_);
    std::size_t edge = 0, sighting = 0;
    for (const Line& line : lines_) {
      if (line.is_odometry) {
        map_->poses.edges[edge].from = IndexOf(line.pose, poses_);
        map_->poses.edges[edge++].to = IndexOf(line.other, poses_);
        continue;
      }
      // Poses and landmarks share their numbers, so one cannot be both.
      if (std::binary_search(poses_.begin(), poses_.end(), line.other)) {
        return FailAt(line.line,
                      "landmark: " + std::to_string(line.other) + " is a pose on another line");
      }
      map_->sightings[sighting].pose = IndexOf(line.pose, poses_);
      map_->sightings[sighting++].landmark = IndexOf(line.other, landmarks_);
    }
    map_->poses.ids = poses_;
    map_->landmark_ids = landmarks_;
    return true;
  }

  // All poses hang on the first one by odometry, or the map has no common frame of reference.
  bool PlacePoses() {
    const int lost = PlaceAlongEdges(&map_->poses);
    return lost == map_->poses.NumVertices() ||
           FailAt(scanner_.line(), "no odometry leads from pose " + std::to_string(poses_.front()) +
                                       " to pose " +
                                       std::to_string(poses_[static_cast<std::size_t>(lost)]));
  }

  // p + R(θ) z of the first sighting in the order of the file; later ones do not move it.
  void PlaceLandmarks() {
    map_->landmarks.assign(2 * map_->landmark_ids.size(), 0.0);
    std::vector<bool> placed(map_->landmark_ids.size(), false);
    for (const PlanarMapSighting& sighting : map_->sightings) {
      const auto index = static_cast<std::size_t>(sighting.landmark);
      if (placed[index]) {
        continue;
      }
      placed[index] = true;
      const double* pose = map_->poses.PoseData(sighting.pose);
      const bool polar = sighting.kind == PlanarSighting::kRangeBearing;
      const double x = polar ? sighting.z[0] * std::cos(sighting.z[1]) : sighting.z[0];
      const double y = polar ? sighting.z[0] * std::sin(sighting.z[1]) : sighting.z[1];
      const double c = std::cos(pose[2]), s = std::sin(pose[2]);
      map_->landmarks[2 * index] = pose[0] + c * x - s * y;
      map_->landmarks[2 * index + 1] = pose[1] + s * x + c * y;
    }
  }

  PlanarMap* map_ = nullptr;
  std::vector<Line> lines_;
  // Numbers of the file: in the order of the lines, then, at their indices, each once.
  std::vector<std::int64_t> poses_;
  std::vector<std::int64_t> landmarks_;
};

// A position as a distance and an angle: the covariance is J C Jᵀ.
// J is the derivative of (√(x² + y²), atan2(y, x)). At the origin it is infinite, and
// MakeMeasurement refuses the covariance.
PlanarMapSighting AsRangeAndBearing(const PlanarMapSighting& position) {
  PlanarMapSighting polar = position;
  const double x = position.z[0], y = position.z[1], range = std::hypot(x, y);
  polar.kind = PlanarSighting::kRangeBearing;
  polar.z[0] = range;
  polar.z[1] = std::atan2(y, x);
  Eigen::Matrix2d J;
  J << x / range, y / range, -y / (range * range), x / (range * range);
  // By rows or by columns: it is symmetric.
  Eigen::Map<Eigen::Matrix2d> covariance(polar.covariance);
  covariance = (J * covariance * J.transpose()).eval();
  return polar;
}

// What a map from elsewhere than a file may have wrong: indices and covariances. U with UᵀU = C⁻¹
// whitens.
Status MakeMeasurement(const PlanarMap& map, const PlanarMapSighting& sighting, std::size_t number,
                       PlanarLandmarkFamily::Measurement* measurement) {
  const std::string name = "sighting " + std::to_string(number) + ": ";
  if (sighting.pose < 0 || sighting.pose >= map.poses.NumVertices() || sighting.landmark < 0 ||
      sighting.landmark >= map.NumLandmarks()) {
    return Status::Error(StatusCode::kInvalidArgument,
                         name + "the map has no such pose or landmark");
  }
  double information[4];
  if (!InvertCovariance<2>(sighting.covariance, information) ||
      !SqrtInformation(information, 2, measurement->sqrt_information)) {
    return Status::Error(StatusCode::kInvalidArgument,
                         name + "the covariance is not positive definite");
  }
  std::copy_n(sighting.z, 2, measurement->z);
  return Status::Ok();
}

}  // namespace
}  // namespace internal

Status ReadPlanarMap(const std::string& path, PlanarMap* map, const ReadOptions& options) {
  return internal::ReadFile<internal::PlanarMapReader>(path, map, options);
}

// Everything that can fail comes before anything is added: measurements are made first, then poses
// are added as a whole or not at all, and the rest cannot fail.
Status AddPlanarMap(const PlanarMap& map, const PlanarMapOptions& options, FactorGraph* graph,
                    PlanarMapGraph* ids) {
  if (map.poses.dimension != 2) {
    return Status::Error(
        StatusCode::kInvalidArgument,
        "PlanarMap: poses.dimension is " + std::to_string(map.poses.dimension) + ", not 2");
  }
  if (map.landmarks.size() != 2 * map.landmark_ids.size()) {
    return Status::Error(StatusCode::kInvalidArgument,
                         "PlanarMap: landmarks has " + std::to_string(map.landmarks.size()) +
                             " values instead of " + std::to_string(2 * map.landmark_ids.size()));
  }
  std::vector<PlanarMapSighting> sightings = map.sightings;
  std::vector<PlanarLandmarkFamily::Measurement> measurements(sightings.size());
  for (std::size_t i = 0; i < sightings.size(); ++i) {
    if (options.range_and_bearing && sightings[i].kind == PlanarSighting::kPosition) {
      sightings[i] = internal::AsRangeAndBearing(sightings[i]);
    }
    Status made = internal::MakeMeasurement(map, sightings[i], i, &measurements[i]);
    if (!made.ok()) {
      return made;
    }
  }
  PlanarMapGraph added;
  Status status = AddPoseGraph(map.poses, options.odometry_loss, graph, &added.poses);
  if (!status.ok()) {
    return status;
  }
  for (int i = 0; i < map.NumLandmarks(); ++i) {
    added.landmarks.push_back(
        graph->AddVariable(map.landmarks.data() + 2 * i, 2, options.landmark_role));
  }
  // Both families are there even if one has no factors, so that the handles are good.
  added.positions =
      graph->AddFamily(std::make_shared<PlanarLandmarkFamily>(PlanarSighting::kPosition));
  added.bearings =
      graph->AddFamily(std::make_shared<PlanarLandmarkFamily>(PlanarSighting::kRangeBearing));
  for (std::size_t i = 0; i < sightings.size(); ++i) {
    const PlanarMapSighting& s = sightings[i];
    const auto& family = s.kind == PlanarSighting::kPosition ? added.positions : added.bearings;
    const int index = graph->AddFactor(family, measurements[i],
                                       {added.poses.poses[static_cast<std::size_t>(s.pose)],
                                        added.landmarks[static_cast<std::size_t>(s.landmark)]},
                                       options.sighting_loss);
    added.sightings.push_back({family.id, index, -1});
  }
  if (ids != nullptr) {
    *ids = std::move(added);
  }
  return Status::Ok();
}

// The message of AddPlanarMap names a sighting but not the file.
Status ReadPlanarMap(const std::string& path, FactorGraph* graph, PlanarMapGraph* ids,
                     const PlanarMapOptions& options) {
  PlanarMap map;
  Status status = ReadPlanarMap(path, &map, options.file);
  if (!status.ok()) {
    return status;
  }
  status = AddPlanarMap(map, options, graph, ids);
  if (!status.ok()) {
    status.message = path + ": " + status.message;
  }
  return status;
}

}  // namespace inceres
