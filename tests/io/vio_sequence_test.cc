#include "inceres/io/vio_sequence.h"

#include <cmath>
#include <functional>
#include <limits>
#include <string>

#include <gtest/gtest.h>

#include "support/temp_dir.h"
#include "tools/sim/vio_scene.h"

namespace inceres {
namespace {

using test::ReadBytes;
using test::TempDir;
using test::WriteBytes;

const std::string kHeader =
    "VIO 1\n"
    "CAMERA 640 480  400 410 320 240  0 0 0 0  0 0 0 0 0 0 1\n"
    "NOISE 1 2e-4 2e-3 2e-5 3e-3\n"
    "GRAVITY 0 0 -9.81\n";
const std::string kState = " 1 2 3 0 0 0 1 0.1 0.2 0.3 0.01 0.02 0.03 0.04 0.05 0.06";
const std::string kPoint = "POINT 0 1 2 3 4 5 6\n";
const std::string kFirst =
    kHeader + "IMU 0 1 2 3 4 5 6\nFRAME 0 0" + kState + kState + "\n" + kPoint + "OBS 0 10 20 0\n";

class VioSequenceTest : public ::testing::Test {
 protected:
  Status ReadText(const std::string& text) {
    WriteBytes(dir_.File("a.vio"), text);
    return ReadVioSequence(dir_.File("a.vio"), &sequence_);
  }

  void ExpectError(const std::string& text, int line, const std::string& what) {
    sequence_ = VioSequence();
    sequence_.points.resize(77);
    const Status status = ReadText(text);
    EXPECT_EQ(status.code, StatusCode::kIo) << what;
    EXPECT_EQ(status.message, dir_.File("a.vio") + ":" + std::to_string(line) + ": " + what);
    EXPECT_EQ(sequence_.points.size(), 77u);
    EXPECT_TRUE(sequence_.frames.empty());
  }

  TempDir dir_;
  VioSequence sequence_;
};

TEST_F(VioSequenceTest, ReadsAllRecords) {
  const Status status =
      ReadText("# comment\r\n\r\n" + kFirst + "IMU 0.5 1 1 1 2 2 2\nIMU 1 3 3 3 4 4 4\nFRAME 1 1" +
               kState + kState + "\nPOINT 1 7 8 9 7 8 9\nOBS 0 11 21 1\nOBS 1 12 22 0\n");
  ASSERT_TRUE(status.ok()) << status.message;
  EXPECT_EQ(sequence_.camera.height, 480);
  EXPECT_EQ(sequence_.camera.intrinsics[1], 410.0);
  EXPECT_EQ(sequence_.camera.imu_from_camera[6], 1.0);
  EXPECT_EQ(sequence_.imu_noise.acc_bias_walk, 3e-3);
  EXPECT_EQ(sequence_.gravity[2], -9.81);
  ASSERT_EQ(sequence_.frames.size(), 2u);
  ASSERT_EQ(sequence_.frames[0].imu.size(), 1u);
  ASSERT_EQ(sequence_.frames[1].imu.size(), 3u);
  EXPECT_EQ(sequence_.frames[1].imu[0].acc[2], 6.0) << "the sample of the frame before";
  EXPECT_EQ(sequence_.frames[1].imu[2].gyr[0], 3.0);
  EXPECT_EQ(sequence_.frames[1].time, 1.0);
  EXPECT_EQ(sequence_.frames[1].start.velocity[1], 0.2);
  EXPECT_EQ(sequence_.frames[1].truth.gyr_bias[2], 0.03);
  EXPECT_EQ(sequence_.frames[1].truth.acc_bias[0], 0.04);
  ASSERT_EQ(sequence_.frames[1].observations.size(), 2u);
  EXPECT_EQ(sequence_.frames[1].observations[1].point, 1);
  EXPECT_EQ(sequence_.frames[1].observations[1].y, 22.0);
  EXPECT_EQ(sequence_.points[0].start[2], 3.0);
  EXPECT_EQ(sequence_.points[0].truth[2], 6.0);
  EXPECT_EQ(sequence_.NumObservations(), 3);
  EXPECT_EQ(sequence_.NumOutliers(), 1);
  EXPECT_TRUE(sequence_.Validate().ok());
}

TEST_F(VioSequenceTest, WritingAndReadingGivesTheSameBytesAndCompressedToo) {
  VioSceneOptions options;
  ASSERT_TRUE(GetVioScenePreset("cubic", &options).ok());
  options.outlier_fraction = 0.1;
  VioSequence scene, other;
  ASSERT_TRUE(GenerateVioScene(options, &scene).ok());
  ASSERT_TRUE(WriteVioSequence(dir_.File("a.vio"), scene).ok());
  const std::string bytes = ReadBytes(dir_.File("a.vio"));
  ASSERT_TRUE(GenerateVioScene(options, &other).ok());
  ASSERT_TRUE(WriteVioSequence(dir_.File("other.vio"), other).ok());
  EXPECT_EQ(ReadBytes(dir_.File("other.vio")), bytes) << "the same seed, the same bytes";
  for (const std::string name : {"a.vio", "a.vio.gz", "a.vio.bz2"}) {
    VioSequence again;
    ASSERT_TRUE(WriteVioSequence(dir_.File(name), scene).ok());
    const Status status = ReadVioSequence(dir_.File(name), &again);
    ASSERT_TRUE(status.ok()) << status.message;
    EXPECT_EQ(again.NumOutliers(), 79);
    EXPECT_EQ(again.frames[7].truth.pose, scene.frames[7].truth.pose);
    EXPECT_EQ(again.frames[7].start.velocity, scene.frames[7].start.velocity);
    EXPECT_EQ(again.frames[7].imu[3].acc[1], scene.frames[7].imu[3].acc[1]);
    ASSERT_TRUE(WriteVioSequence(dir_.File("again.vio"), again).ok());
    EXPECT_EQ(ReadBytes(dir_.File("again.vio")), bytes) << name;
  }
}

TEST_F(VioSequenceTest, ErrorsOfOrder) {
  ExpectError("# nothing\n", 2, "the file has no frames");
  ExpectError("CAMERA 1\n", 1, "CAMERA: tag: where the file should begin with VIO 1");
  ExpectError("VIO 2\n", 1, "VIO: version: 2 is not known, only 1");
  ExpectError("VIO 1\nIMU 0 1 2 3 4 5 6\n", 2, "IMU: tag: before CAMERA");
  ExpectError(kHeader + "GRAVITY 0 0 1\n", 5, "GRAVITY: tag: in the file twice");
  ExpectError(
      kHeader + "STEREO 1\n", 5,
      "STEREO: tag: not known; known are CAMERA, NOISE, GRAVITY, POINT, IMU, FRAME and OBS");
  ExpectError(kHeader + "OBS 0 1 2 0\n", 5, "OBS: tag: before the first FRAME");
  ExpectError(kHeader + "FRAME 0 0" + kState + kState, 5,
              "FRAME: t: the last IMU sample above is not one at the time of this frame, 0.000000");
  ExpectError(kHeader + "IMU 0 1 2 3 4 5 6\nFRAME 1 0" + kState + kState, 6,
              "FRAME: i: 1 where 0 comes next");
  ExpectError(kHeader + "IMU 0 1 2 3 4 5 6\nIMU 0 1 2 3 4 5 6\n", 6,
              "IMU: t: 0.000000 is not after the sample's before, 0.000000");
  ExpectError(kFirst + "FRAME 1 0" + kState + kState, 9,
              "FRAME: t: the last IMU sample above is not one at the time of this frame, 0.000000");
  ExpectError(kFirst + "POINT 2 1 2 3 4 5 6\n", 9, "POINT: k: 2 where 1 comes next");
  ExpectError(kFirst + "OBS 1 1 2 0\n", 9, "OBS: k: point 1 has not arrived yet");
  ExpectError(kFirst + "OBS 0 1 2 0\n", 9,
              "OBS: k: point 0 after point 0; a frame sees points once, in ascending order");
  ExpectError(kFirst + "IMU 1 1 2 3 4 5 6\n", 10, "IMU samples after the last frame");
}

TEST_F(VioSequenceTest, ErrorsOfNumbers) {
  ExpectError("VIO 1\nCAMERA 640 480 400 0 320 240 0 0 0 0 0 0 0 0 0 0 1\n", 2,
              "CAMERA: f_y: not positive");
  ExpectError("VIO 1\nCAMERA 0 480 400 400 320 240 0 0 0 0 0 0 0 0 0 0 1\n", 2,
              "CAMERA: width: not positive");
  ExpectError("VIO 1\nCAMERA 640 480 400 400 320 240 0 0 0 0 0 0 0 0 0 1 1\n", 2,
              "CAMERA: q_bc: not a unit quaternion");
  ExpectError("VIO 1\nCAMERA 640 480 400 400 320 240 0 0 0 0 0 0 0 0 0 1\n", 2,
              "CAMERA: q_bc(3): missing, the line ends here");
  ExpectError("VIO 1\nNOISE 1 2e-4 0 2e-5 3e-3\n", 2, "NOISE: acc: not positive");
  ExpectError("VIO 1\nGRAVITY 0 0 nan\n", 2, "GRAVITY: g(2): 'nan' is not a finite number");
  ExpectError(kHeader + "IMU x 1 2 3 4 5 6\n", 5, "IMU: t: 'x' is not a number");
  ExpectError(kHeader + "IMU 0 1 2 3 4 5\n", 5, "IMU: acc(2): missing, the line ends here");
  ExpectError(kHeader + "IMU 0 1 2 3 4 5 6 7\n", 5, "IMU: after the last field: unexpected '7'");
  const std::string sample = kHeader + "IMU 0 1 2 3 4 5 6\n";
  ExpectError(sample + "FRAME 0 0" + kState + " 1 2 3 0 0 1 1 0 0 0 0 0 0 0 0 0\n", 6,
              "FRAME: truth q: not a unit quaternion");
  ExpectError(sample + "FRAME 0 0" + kState + " 1 2 3 0 0 0 1 0 0 0 0 0 0 0 0\n", 6,
              "FRAME: truth b_a(2): missing, the line ends here");
  ExpectError(sample + "FRAME -1 0\n", 6, "FRAME: i: -1 is negative");
  ExpectError(kFirst + kPoint.substr(0, 5) + " 1 2 3 4 5\n", 9,
              "POINT: truth(1): missing, the line ends here");
  ExpectError(kFirst + "POINT 1 0 0 0 0 0 0\nOBS 1 1 2 2\n", 10,
              "OBS: outlier: 2 is neither 0 nor 1");
  ExpectError(kFirst + "POINT 1 0 0 0 0 0 0\nOBS 1 1e999 2 0\n", 10,
              "OBS: x: '1e999' is too large");
  EXPECT_EQ(ReadVioSequence(dir_.File("none.vio"), &sequence_).message,
            dir_.File("none.vio") + ": cannot open for reading: No such file or directory");
}

TEST_F(VioSequenceTest, AFileCutOffAnywhereNeverCrashesAndNeverChangesTheSequenceOnFailure) {
  const std::string whole =
      kFirst + "IMU 1 1 2 3 4 5 6\nFRAME 1 1" + kState + kState + "\nOBS 0 1 2 0\n";
  for (std::size_t size = 0; size < whole.size(); ++size) {
    sequence_ = VioSequence();
    sequence_.points.resize(77);
    if (const Status status = ReadText(whole.substr(0, size)); !status.ok()) {
      EXPECT_EQ(status.code, StatusCode::kIo);
      EXPECT_EQ(sequence_.points.size(), 77u);
    } else {
      EXPECT_TRUE(sequence_.Validate().ok()) << size;
    }
  }
}

TEST_F(VioSequenceTest, NothingInvalidIsWritten) {
  ASSERT_TRUE(
      ReadText(kFirst + "IMU 1 1 2 3 4 5 6\nFRAME 1 1" + kState + kState + "\nOBS 0 1 2 0\n").ok());
  const double nan = std::nan("");
  const std::pair<std::function<void(VioSequence*)>, const char*> faults[] = {
      {[](VioSequence* s) { s->frames.clear(); }, "no frames"},
      {[](VioSequence* s) { s->camera.height = 0; }, "camera.height: not positive"},
      {[&](VioSequence* s) { s->camera.distortion[1] = nan; },
       "camera.intrinsics, distortion or imu_from_camera: not finite"},
      {[&](VioSequence* s) { s->pixel_noise = 0.0; }, "noise: pixel: not positive"},
      {[&](VioSequence* s) { s->imu_noise.gyr_bias_walk = -1.0; },
       "noise: gyr_bias_walk: not positive"},
      {[&](VioSequence* s) { s->gravity[0] = nan; }, "gravity is not finite"},
      {[&](VioSequence* s) { s->points[0].truth[1] = nan; }, "points[0] is not finite"},
      {[&](VioSequence* s) { s->frames[1].start.pose[3] = 0.1; },
       "frames[1].start is not finite, or its q no unit quaternion"},
      {[&](VioSequence* s) { s->frames[1].truth.acc_bias[2] = nan; },
       "frames[1].truth is not finite, or its q no unit quaternion"},
      {[&](VioSequence* s) { s->frames[1].time = 1.1; },
       "frames[1].imu has no sample at the time of the frame"},
      {[&](VioSequence* s) { s->frames[1].imu[1].gyr[1] = nan; }, "frames[1].imu[1] is not finite"},
      {[&](VioSequence* s) { s->frames[1].imu[0].time = 1.0; },
       "frames[1].imu[1].time is not after the sample's before"},
      {[&](VioSequence* s) { s->frames[1].imu[0].acc[0] = 1.0; },
       "frames[1].imu does not go on from the last sample of the frame before"},
      {[&](VioSequence* s) { s->frames[1].observations[0].point = 1; },
       "frames[1].observations: point 1 is not there, or out of order, or seen twice"},
      {[&](VioSequence* s) { s->frames[1].observations[0].x = nan; },
       "frames[1].observations: point 0 is seen where it is not finite"}};
  for (const auto& [spoil, what] : faults) {
    VioSequence spoilt = sequence_;
    spoil(&spoilt);
    const Status status = WriteVioSequence(dir_.File("spoilt.vio"), spoilt);
    EXPECT_EQ(status.code, StatusCode::kInvalidArgument) << what;
    EXPECT_EQ(status.message, std::string("VioSequence: ") + what);
    EXPECT_EQ(ReadBytes(dir_.File("spoilt.vio")), "");
  }
  EXPECT_EQ(WriteVioSequence(dir_.File("no/such/directory.vio"), sequence_).code, StatusCode::kIo);
}

TEST_F(VioSequenceTest, ProjectsAsDocumented) {
  ASSERT_TRUE(ReadText(kFirst).ok());
  sequence_.camera.distortion = {0.1, 0.2, 0.01, 0.02};
  sequence_.camera.imu_from_camera = {0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
  const double half = std::sqrt(0.5);
  double x = 0.0, y = 0.0;
  // A quarter turn about z: 2 along the y axis of the world is 2 along the x axis of the IMU.
  ASSERT_TRUE(sequence_.Project({1.0, 0.0, 0.0, 0.0, 0.0, half, half}, {0.0, 2.0, 5.0}, &x, &y));
  const double a = 0.5, b = 0.25, r2 = a * a + b * b, s = 1.0 + 0.1 * r2 + 0.2 * r2 * r2;
  EXPECT_NEAR(x, 400.0 * (s * a + 2.0 * 0.01 * a * b + 0.02 * (r2 + 2.0 * a * a)) + 320.0, 1e-10);
  EXPECT_NEAR(y, 410.0 * (s * b + 0.01 * (r2 + 2.0 * b * b) + 2.0 * 0.02 * a * b) + 240.0, 1e-10);
  EXPECT_FALSE(sequence_.Project({0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0}, {0.0, 0.0, 1.0}, &x, &y))
      << "in the camera's plane";
}

TEST_F(VioSequenceTest, UnprojectsWhatItProjects) {
  ASSERT_TRUE(ReadText(kFirst).ok());
  for (const std::array<double, 4>& distortion :
       {std::array<double, 4>{}, {-0.28, 0.07, 2e-4, -3e-4}, {0.1, 0.2, 0.01, 0.02}}) {
    sequence_.camera.distortion = distortion;
    for (double a = -0.7; a < 0.75; a += 0.1) {
      for (double b = -0.5; b < 0.55; b += 0.1) {
        // Camera and IMU as one.
        sequence_.camera.imu_from_camera = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0};
        double x = 0.0, y = 0.0;
        ASSERT_TRUE(sequence_.Project({0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0}, {2.0 * a, 2.0 * b, 2.0},
                                      &x, &y));
        std::array<double, 2> point{};
        const double pixel[2] = {x, y};
        ASSERT_TRUE(sequence_.camera.Pinhole().Unproject(pixel, point.data())) << a << ", " << b;
        EXPECT_NEAR(point[0], a, 1e-13);
        EXPECT_NEAR(point[1], b, 1e-13);
      }
    }
  }
  // r (1 − 0.4 r²) has a maximum: nothing is seen further out than that, and nothing said of it.
  sequence_.camera.distortion = {-0.4, 0.0, 0.0, 0.0};
  std::array<double, 2> point{7.0, 7.0};
  const double outside[2] = {1e4, 240.0};
  EXPECT_FALSE(sequence_.camera.Pinhole().Unproject(outside, point.data()));
  EXPECT_EQ(point[0], 7.0);
}

}  // namespace
}  // namespace inceres
