#include "inceres/io/stereo_odometry.h"

#include <cmath>
#include <filesystem>
#include <string>

#include <gtest/gtest.h>

#include "support/temp_dir.h"
#include "support/test_data.h"

namespace inceres {
namespace {

using test::TempDir;
using test::WriteBytes;

const std::string kIdentity = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n";

class StereoOdometryTest : public ::testing::Test {
 protected:
  StereoOdometryTest() {
    Write("calibration", "700 710 0 600 180 0.5\n");
    // The second camera stands at (1, 2, 3), turned by 90° about z.
    Write("camera_poses", "0 " + kIdentity + "\n1 0 -1 0 1 1 0 0 2 0 0 1 3 0 0 0 1\n");
    Write("stereo_factors", "1 9 10 4 12 1 2 3\n0 5 20 8 22 4 5 6\n0 9 30 12 32 7 8 9\n");
  }

  std::string File(const std::string& name) { return dir_.File("VO_" + name + "07.txt"); }
  void Write(const std::string& name, const std::string& text) { WriteBytes(File(name), text); }
  Status Read() { return ReadStereoOdometry(Folder(), &odometry_); }
  std::string Folder() { return std::filesystem::path(dir_.File("x")).parent_path().string(); }

  // With this text in that file.
  void ExpectError(const std::string& name, const std::string& text, int line,
                   const std::string& what) {
    const TempDir other;
    std::filesystem::copy_file(File(name), other.File("kept"));
    Write(name, text);
    odometry_ = StereoOdometry();
    odometry_.point_ids.resize(77);
    const Status status = Read();
    EXPECT_EQ(status.code, StatusCode::kIo) << what;
    EXPECT_EQ(status.message, File(name) + ":" + std::to_string(line) + ": " + what);
    EXPECT_EQ(odometry_.point_ids.size(), 77u);
    EXPECT_TRUE(odometry_.poses.empty());
    std::filesystem::copy_file(other.File("kept"), File(name),
                               std::filesystem::copy_options::overwrite_existing);
  }

  TempDir dir_;
  StereoOdometry odometry_;
};

TEST_F(StereoOdometryTest, ReadsAllThreeFiles) {
  const Status status = Read();
  ASSERT_TRUE(status.ok()) << status.message;
  EXPECT_EQ(odometry_.camera.f_x, 700.0);
  EXPECT_EQ(odometry_.camera.f_y, 710.0);
  EXPECT_EQ(odometry_.camera.c_x, 600.0);
  EXPECT_EQ(odometry_.camera.c_y, 180.0);
  EXPECT_EQ(odometry_.camera.baseline, 0.5);
  ASSERT_EQ(odometry_.poses.size(), 2u);
  const double half = std::sqrt(0.5);
  const double pose[7] = {1, 2, 3, 0, 0, half, half};
  for (std::size_t k = 0; k < 7; ++k) {
    EXPECT_NEAR(odometry_.poses[1][k], pose[k], 1e-15) << k;
  }
  EXPECT_EQ(odometry_.point_ids, (std::vector<std::int64_t>{9, 5}));
  ASSERT_EQ(odometry_.sightings.size(), 3u);
  const int poses[3] = {0, 0, 1}, points[3] = {1, 0, 0};  // by pose, then as they stand in the file
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(odometry_.sightings[i].pose, poses[i]);
    EXPECT_EQ(odometry_.sightings[i].point, points[i]);
  }
  const StereoSighting& last = odometry_.sightings[2];
  EXPECT_EQ(last.left[0], 10.0);
  EXPECT_EQ(last.right_u, 4.0);
  EXPECT_EQ(last.left[1], 12.0);
  EXPECT_EQ(last.in_camera[0], 1.0);
  EXPECT_EQ(last.in_camera[2], 3.0);
}

TEST_F(StereoOdometryTest, ErrorsOfTheFolder) {
  EXPECT_EQ(ReadStereoOdometry(dir_.File("none"), &odometry_).message,
            dir_.File("none") + ": cannot be read: No such file or directory");
  WriteBytes(dir_.File("VO_calibration.txt"), "1 1 0 0 0 1\n");
  EXPECT_EQ(Read().message,
            Folder() + ": 2 calibration files, VO_calibration*.txt, where one is wanted");
  std::filesystem::remove(dir_.File("VO_calibration.txt"));
  std::filesystem::remove(File("stereo_factors"));
  EXPECT_EQ(Read().message,
            File("stereo_factors") + ": cannot open for reading: No such file or directory");
  std::filesystem::remove(File("calibration"));
  const Status status = Read();
  EXPECT_EQ(status.code, StatusCode::kIo);
  EXPECT_EQ(status.message,
            Folder() + ": no calibration files, VO_calibration*.txt, where one is wanted");
}

TEST_F(StereoOdometryTest, ErrorsOfTheCalibration) {
  ExpectError("calibration", "\n", 2, "the file has no calibration");
  ExpectError("calibration", "# no comments\n", 1, "f_x: '#' is not a number");
  ExpectError("calibration", "700 710 0 600 180\n", 1, "baseline: missing, the line ends here");
  ExpectError("calibration", "700 710 0 600 180 0\n", 1, "baseline: not positive");
  ExpectError("calibration", "700 -710 0 600 180 1\n", 1, "f_y: not positive");
  ExpectError("calibration", "700 710 1 600 180 0.5\n", 1,
              "skew: not 0: the images must be rectified");
  ExpectError("calibration", "700 710 0 600 180 0.5 1\n", 1,
              "after the last field: unexpected '1'");
  ExpectError("calibration", "700 710 0 600 180 0.5\n700 710 0 600 180 0.5\n", 2,
              "f_x: a second calibration");
}

TEST_F(StereoOdometryTest, ErrorsOfThePoses) {
  ExpectError("camera_poses", "", 1, "the file has no poses");
  ExpectError("camera_poses", "0 " + kIdentity + "2 " + kIdentity, 2,
              "i: pose 2 where 1 comes next");
  ExpectError("camera_poses", "-1 " + kIdentity, 1, "i: -1 is negative");
  ExpectError("camera_poses", "0 1 0 0 0 0 1 0 nan 0 0 1 0 0 0 0 1\n", 1,
              "T(1, 3): 'nan' is not a finite number");
  ExpectError("camera_poses", "0 1 0 0 0 0 1 0 0 0 0 -1 0 0 0 0 1\n", 1,
              "T: not a rotation matrix");
  ExpectError("camera_poses", "0 1 0 0 0 0 1 0 0 0 0 1 0 0 0 1 1\n", 1,
              "T: the last row is not 0 0 0 1");
}

TEST_F(StereoOdometryTest, ErrorsOfTheSightings) {
  ExpectError("stereo_factors", "\n\n", 3, "the file has no sightings");
  ExpectError("stereo_factors", "2 5 20 8 22 4 5 6\n", 1, "i: there is no pose 2");
  ExpectError("stereo_factors", "0 -5 20 8 22 4 5 6\n", 1, "p: -5 is negative");
  ExpectError("stereo_factors", "0 5 20 8 22 4 5 6\n0 5 20 8 22 4 5 6\n", 2,
              "p: pose 0 sees point 5 twice");
  ExpectError("stereo_factors", "0 5 20 x 22 4 5 6\n", 1, "u_r: 'x' is not a number");
  ExpectError("stereo_factors", "0 5 20 8 22 4 5 -6\n", 1,
              "Z: not positive: the point is not in front of the camera");
}

TEST(PublicStereoOdometry, Reads) {
  const std::string folder = test::FindData("stereo");
  if (folder.empty()) {
    GTEST_SKIP() << test::MissingData("stereo");
  }
  StereoOdometry odometry;
  const Status status = ReadStereoOdometry(folder, &odometry);
  ASSERT_TRUE(status.ok()) << status.message;
  EXPECT_EQ(odometry.poses.size(), 77u);
  EXPECT_EQ(odometry.point_ids.size(), 15638u);
  EXPECT_EQ(odometry.sightings.size(), 52544u);
}

}  // namespace
}  // namespace inceres
