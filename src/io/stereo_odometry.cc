#include "inceres/io/stereo_odometry.h"

#include <algorithm>
#include <filesystem>
#include <set>
#include <string>
#include <system_error>
#include <unordered_map>
#include <utility>

#include "io/record_reader.h"

// The reader of stereo odometries (docs/file_formats.md, "Stereo odometry"): a folder with a
// calibration, poses and sightings. The files have no tags, so each has a reader of its own, and
// they are read in the order in which one needs the other: sightings name poses. Nothing is handed
// out unless all three are good.

namespace inceres {
namespace internal {
namespace {

// The name whose * decides which files belong together.
constexpr char kCalibration[] = "VO_calibration";
constexpr char kSuffix[] = ".txt";

class CalibrationReader : private RecordReader {
 public:
  using RecordReader::RecordReader;

  Status Read(StereoCamera* camera) {
    // Counted before it is read: a second line is refused whatever it says.
    int count = 0;
    const auto read = [&] {
      return ++count > 1 ? Fail("f_x", "a second calibration") : ReadCamera(camera);
    };
    if (ForEachLine(read) && count == 0) {
      FailAt(scanner_.line(), "the file has no calibration");
    }
    return status_;
  }

 private:
  // In the order of the line. A focal length or baseline that is not positive has no meaning.
  bool ReadCamera(StereoCamera* camera) {
    // Not kept: it has to be 0.
    double skew = 0.0;
    const std::pair<const char*, double*> fields[] = {
        {"f_x", &camera->f_x}, {"f_y", &camera->f_y}, {"skew", &skew},
        {"c_x", &camera->c_x}, {"c_y", &camera->c_y}, {"baseline", &camera->baseline}};
    for (const auto& [name, value] : fields) {
      if (!ReadNumbers(name, 1, value)) {
        return false;
      }
      // By address: the table has no column for it. The principal point may be anywhere.
      const bool positive =
          value == &camera->f_x || value == &camera->f_y || value == &camera->baseline;
      if (positive && !(*value > 0.0)) {
        return Fail(name, "not positive");
      }
    }
    // The model of StereoCamera has none.
    return skew == 0.0 || Fail("skew", "not 0: the images must be rectified");
  }
};

class PosesReader : private RecordReader {
 public:
  using RecordReader::RecordReader;

  Status Read(std::vector<std::array<double, 7>>* poses) {
    if (ForEachLine([&] { return ReadPose(poses); }) && poses->empty()) {
      FailAt(scanner_.line(), "the file has no poses");
    }
    return status_;
  }

 private:
  // 4 × 4, row-major, world_from_camera, which is how PoseManifold stores poses too: the last
  // column is the camera's center.
  bool ReadPose(std::vector<std::array<double, 7>>* poses) {
    std::int64_t number = 0;
    if (!ReadId("i", &number)) {
      return false;
    }
    // The number is the index: without gaps, and in order.
    if (number != static_cast<std::int64_t>(poses->size())) {
      return Fail("i", "pose " + std::to_string(number) + " where " +
                           std::to_string(poses->size()) + " comes next");
    }
    double T[16];
    for (int k = 0; k < 16; ++k) {
      const std::string name = "T(" + std::to_string(k / 4) + ", " + std::to_string(k % 4) + ")";
      if (!ReadNumbers(name, 1, T + k)) {
        return false;
      }
    }
    // Rotation by rows; the quaternion is filled in below.
    std::array<double, 7> pose{T[3], T[7], T[11], 0.0, 0.0, 0.0, 1.0};
    const double R[9] = {T[0], T[1], T[2], T[4], T[5], T[6], T[8], T[9], T[10]};
    const bool rotation = QuaternionOf(R, pose.data() + 3);
    // The last row is compared exactly: 0 and 1 lose nothing when they are printed.
    if (!rotation || T[12] != 0.0 || T[13] != 0.0 || T[14] != 0.0 || T[15] != 1.0) {
      return Fail("T", rotation ? "the last row is not 0 0 0 1" : "not a rotation matrix");
    }
    poses->push_back(pose);
    return true;
  }
};

class SightingsReader : private RecordReader {
 public:
  using RecordReader::RecordReader;

  // Into an odometry that has its poses.
  Status Read(StereoOdometry* odometry) {
    if (!ForEachLine([&] { return ReadSighting(odometry); })) {
      return status_;
    }
    if (odometry->sightings.empty()) {
      FailAt(scanner_.line(), "the file has no sightings");
    }
    // A file may be ordered by point; a back-end that is fed pose by pose wants all of one pose
    // together. Stable: those of one pose stay in the order of the file.
    std::stable_sort(
        odometry->sightings.begin(), odometry->sightings.end(),
        [](const StereoSighting& a, const StereoSighting& b) { return a.pose < b.pose; });
    return status_;
  }

 private:
  bool ReadSighting(StereoOdometry* odometry) {
    // Pose and point, before anything is stored.
    std::int64_t pose = 0, id = 0;
    if (!ReadId("i", &pose)) {
      return false;
    }
    if (pose >= static_cast<std::int64_t>(odometry->poses.size())) {
      return Fail("i", "there is no pose " + std::to_string(pose));
    }
    if (!ReadId("p", &id)) {
      return false;
    }
    // Two sightings of one point from one pose would be two factors on the same two variables, one
    // of which is most likely a mistake.
    if (!seen_.emplace(pose, id).second) {
      return Fail("p",
                  "pose " + std::to_string(pose) + " sees point " + std::to_string(id) + " twice");
    }
    StereoSighting sighting;
    // One v for both images, which are rectified.
    const std::pair<const char*, double*> fields[] = {
        {"u_l", sighting.left},    {"u_r", &sighting.right_u},    {"v", sighting.left + 1},
        {"X", sighting.in_camera}, {"Y", sighting.in_camera + 1}, {"Z", sighting.in_camera + 2}};
    for (const auto& [name, value] : fields) {
      if (!ReadNumbers(name, 1, value)) {
        return false;
      }
    }
    if (!(sighting.in_camera[2] > 0.0)) {
      return Fail("Z", "not positive: the point is not in front of the camera");
    }
    // Points are numbered in the order of the file; ids may be any.
    const auto [point, fresh] =
        index_of_point_.emplace(id, static_cast<int>(odometry->point_ids.size()));
    if (fresh) {
      odometry->point_ids.push_back(id);
    }
    // In range: it was held against the number of poses.
    sighting.pose = static_cast<int>(pose);
    sighting.point = point->second;
    odometry->sightings.push_back(sighting);
    return true;
  }

  // An entry for each sighting, as long as the file is read.
  std::set<std::pair<std::int64_t, std::int64_t>> seen_;  // pose, id of the point
  std::unordered_map<std::int64_t, int> index_of_point_;
};

// What stands for the * of the names: from the only calibration in the folder.
// Entries of a folder come in no order, so there must be exactly one that fits.
Status FindVariant(const std::string& folder, std::string* variant) {
  std::error_code error;
  int count = 0;
  // By error codes: what the library throws would leave a function that returns a Status.
  for (std::filesystem::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    // Without the zeros at the ends of the literals.
    const std::size_t prefix = sizeof(kCalibration) - 1, suffix = sizeof(kSuffix) - 1;
    // The length first: in a short name both could match the same letters.
    if (name.size() >= prefix + suffix && name.compare(0, prefix, kCalibration) == 0 &&
        name.compare(name.size() - suffix, suffix, kSuffix) == 0) {
      *variant = name.substr(prefix, name.size() - prefix - suffix);
      ++count;
    }
  }
  if (error) {
    return Status::Error(StatusCode::kIo, folder + ": cannot be read: " + error.message());
  }
  return count == 1
             ? Status::Ok()
             : Status::Error(StatusCode::kIo,
                             folder + ": " + (count == 0 ? "no" : std::to_string(count)) +
                                 " calibration files, VO_calibration*.txt, where one is wanted");
}

// The variant is found first and put into all three names; a file that is missing is told by its
// own full name. Names end in .txt: nothing is decoded.
Status ReadAll(const std::string& folder, StereoOdometry* odometry) {
  std::string variant;
  if (Status status = FindVariant(folder, &variant); !status.ok()) {
    return status;
  }
  const auto path = [&](const char* name) {
    return (std::filesystem::path(folder) / (name + variant + kSuffix)).string();
  };
  Status status = ReadInto<CalibrationReader>(path(kCalibration), &odometry->camera);
  status = status.ok() ? ReadInto<PosesReader>(path("VO_camera_poses"), &odometry->poses) : status;
  return status.ok() ? ReadInto<SightingsReader>(path("VO_stereo_factors"), odometry) : status;
}

}  // namespace
}  // namespace internal

Status ReadStereoOdometry(const std::string& folder, StereoOdometry* odometry) {
  StereoOdometry read;
  Status status = internal::ReadAll(folder, &read);
  if (status.ok()) {
    *odometry = std::move(read);
  }
  return status;
}

}  // namespace inceres
