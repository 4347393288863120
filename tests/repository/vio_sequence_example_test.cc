// The example of docs/visual_inertial.md that reads a simulated sequence, compiled and run as it
// stands there.

#include <algorithm>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/factors/imu_preintegrator.h"
#include "inceres/io/vio_sequence.h"
#include "support/temp_dir.h"
#include "tools/sim/vio_scene.h"

namespace {

TEST(VisualInertialPage, ReadsASequenceAndIntegratesItsSamples) {
  const inceres::test::TempDir dir;
  const std::string path = dir.File("cubic.vio");
  inceres::VioSceneOptions scene;
  inceres::VioSequence simulated;
  ASSERT_TRUE(inceres::GetVioScenePreset("cubic", &scene).ok());
  ASSERT_TRUE(inceres::GenerateVioScene(scene, &simulated).ok());
  ASSERT_TRUE(inceres::WriteVioSequence(path, simulated).ok());
  // clang-format off
// [quoted in docs/visual_inertial.md]
inceres::VioSequence sequence;
inceres::Status status = inceres::ReadVioSequence(path, &sequence);
inceres::ImuOptions options;
options.noise = sequence.imu_noise;
std::copy(sequence.gravity.begin(), sequence.gravity.end(), options.conventions.gravity);
std::vector<inceres::ImuPreintegrator> measurements;
for (std::size_t i = 1; status.ok() && i < sequence.frames.size(); ++i) {
  // From frame i - 1 to frame i, at the biases it starts with.
  const inceres::VioState& start = sequence.frames[i - 1].start;
  measurements.emplace_back(options);
  status = measurements.back().Integrate(sequence.frames[i].imu, start.gyr_bias.data(),
                                         start.acc_bias.data());
}
// [end of quote]
  // clang-format on
  ASSERT_TRUE(status.ok()) << status.message;
  ASSERT_EQ(measurements.size(), 49u);
  EXPECT_DOUBLE_EQ(measurements.back().delta().dt, 0.25);
}

}  // namespace
