#include "inceres/io/keyframes.h"

#include <cmath>
#include <string>

#include <gtest/gtest.h>

#include "support/temp_dir.h"
#include "support/test_data.h"

namespace inceres {
namespace {

using test::TempDir;
using test::WriteBytes;

class KeyframesTest : public ::testing::Test {
 protected:
  Status ReadText(const std::string& text) {
    WriteBytes(dir_.File("a.kf"), text);
    return ReadKeyframes(dir_.File("a.kf"), &sequence_);
  }

  void ExpectError(const std::string& text, int line, const std::string& what) {
    sequence_ = KeyframeSequence();
    sequence_.features.resize(77);
    const Status status = ReadText(text);
    EXPECT_EQ(status.code, StatusCode::kIo) << what;
    EXPECT_EQ(status.message, dir_.File("a.kf") + ":" + std::to_string(line) + ": " + what);
    EXPECT_EQ(sequence_.features.size(), 77u);
    EXPECT_TRUE(sequence_.keyframes.empty());
  }

  TempDir dir_;
  KeyframeSequence sequence_;
};

const std::string kIdentity = " 1 0 0 0 1 0 0 0 1 ";
// A quarter turn about z: the first axis of the world becomes the second of the camera.
const std::string kQuarter = " 0 -1 0 1 0 0 0 0 1 ";

std::string Diagonal(double w) {
  std::string text;
  for (int k = 0; k < 36; ++k) {
    text += " " + std::to_string(k % 7 == 0 ? w : 0.0);
  }
  return text;
}

const std::string kFirst =
    "KEYFRAME 0" + kIdentity + "0 0 0\nFEATURE 0 3 0.1 0.2 0\nFEATURE 0 1 0.3 0.4 0.5\n";
const std::string kSecond = "KEYFRAME 1" + kQuarter + "1 2 3\n";

TEST_F(KeyframesTest, ReadsAllRecords) {
  const Status status =
      ReadText("# comment\r\n\r\n" + kFirst + kSecond +
               "DEPTH_GUESS 0 1 0.25\nFEATURE 1 1 -0.1 -0.2 0.75\nOBS 1 0 1 0.5 0.6 0.7 4 1 9\n"
               "BETWEEN 0 1" +
               kQuarter + "7 8 9" + Diagonal(4.0) + "\n");
  ASSERT_TRUE(status.ok()) << status.message;
  ASSERT_EQ(sequence_.keyframes.size(), 2u);
  ASSERT_EQ(sequence_.features.size(), 3u);
  EXPECT_EQ(sequence_.features[1].anchor, 0);
  EXPECT_EQ(sequence_.features[1].index, 1);
  EXPECT_EQ(sequence_.features[1].y, 0.4);
  EXPECT_EQ(sequence_.features[1].inverse_depth, 0.5);
  EXPECT_EQ(sequence_.features[2].anchor, 1);
  EXPECT_EQ(sequence_.keyframes[0].features, (std::vector<int>{0, 1}));
  EXPECT_TRUE(sequence_.keyframes[0].observations.empty());

  const Keyframe& second = sequence_.keyframes[1];
  // camera_from_world turns by +90° about z, so world_from_camera by −90°.
  const double half = std::sqrt(0.5);
  const double pose[7] = {1.0, 2.0, 3.0, 0.0, 0.0, -half, half};
  for (std::size_t k = 0; k < 7; ++k) {
    EXPECT_NEAR(second.pose[k], pose[k], 1e-15) << k;
  }
  ASSERT_EQ(second.depth_guesses.size(), 1u);
  EXPECT_EQ(second.depth_guesses[0].feature, 1);
  EXPECT_EQ(second.depth_guesses[0].inverse_depth, 0.25);
  ASSERT_EQ(second.observations.size(), 1u);
  EXPECT_EQ(second.observations[0].feature, 1);
  EXPECT_EQ(second.observations[0].x, 0.5);
  EXPECT_EQ(second.observations[0].inverse_depth, 0.7);
  EXPECT_EQ(second.observations[0].information, (std::array<double, 3>{4.0, 1.0, 9.0}));
  ASSERT_EQ(second.betweens.size(), 1u);
  EXPECT_EQ(second.betweens[0].a, 0);
  EXPECT_EQ(second.betweens[0].b, 1);
  EXPECT_NEAR(second.betweens[0].q_ab[2], half, 1e-15);
  EXPECT_EQ(second.betweens[0].p_ab[1], 8.0);
  EXPECT_EQ(second.betweens[0].information[7], 4.0);
  EXPECT_EQ(sequence_.NumObservations(), 1);
  EXPECT_EQ(sequence_.NumBetweens(), 1);
}

TEST_F(KeyframesTest, ErrorsOfOrder) {
  ExpectError("# nothing\n", 2, "the file has no keyframes");
  ExpectError("FEATURE 0 0 1 1 0\n", 1, "FEATURE: tag: before the first KEYFRAME");
  ExpectError(kFirst + "POINT 1\n", 4,
              "POINT: tag: not known; known are KEYFRAME, DEPTH_GUESS, FEATURE, OBS and BETWEEN");
  ExpectError(kFirst + kFirst, 4, "KEYFRAME: i: keyframe 0 where 1 comes next");
  ExpectError(kFirst + "FEATURE 1 0 1 1 0\n", 4, "FEATURE: i: 1 is not the keyframe above, 0");
  ExpectError(kFirst + "FEATURE 0 3 1 1 0\n", 4, "FEATURE: k: feature 3 is twice in keyframe 0");
  ExpectError(kFirst + "DEPTH_GUESS 1 3 1\n", 4, "DEPTH_GUESS: i: keyframe 1 has not arrived yet");
  ExpectError(kFirst + "DEPTH_GUESS 0 2 1\n", 4, "DEPTH_GUESS: k: keyframe 0 has no feature 2");
  ExpectError(kFirst + kSecond + "OBS 0 0 1 0 0 0 1 0 1\n", 5,
              "OBS: i: 0 is not the keyframe above, 1");
  ExpectError(kFirst + kSecond + "OBS 1 1 1 0 0 0 1 0 1\n", 5,
              "OBS: a: the observing keyframe itself");
  ExpectError(kFirst + kSecond + "OBS 1 0 2 0 0 0 1 0 1\n", 5,
              "OBS: k: keyframe 0 has no feature 2");
  ExpectError(kFirst + kSecond + "BETWEEN 0 2" + kIdentity + "0 0 0" + Diagonal(1.0), 5,
              "BETWEEN: b: keyframe 2 has not arrived yet");
  ExpectError(kFirst + kSecond + "BETWEEN 1 1" + kIdentity + "0 0 0" + Diagonal(1.0), 5,
              "BETWEEN: b: keyframe 1 with itself");
}

TEST_F(KeyframesTest, ErrorsOfNumbers) {
  ExpectError("KEYFRAME 0 1 0 0 0 1 0 0 0\n", 1, "KEYFRAME: R(8): missing, the line ends here");
  ExpectError("KEYFRAME 0 1 0 0 0 1 0 0 0 -1 0 0 0\n", 1, "KEYFRAME: R: not a rotation matrix");
  ExpectError("KEYFRAME 0 2 0 0 0 2 0 0 0 2 0 0 0\n", 1, "KEYFRAME: R: not a rotation matrix");
  ExpectError("KEYFRAME 0 0 0 0 0 0 0 0 0 0 0 0 0\n", 1, "KEYFRAME: R: not a rotation matrix");
  ExpectError("KEYFRAME 0" + kIdentity + "0 nan 0\n", 1,
              "KEYFRAME: p(1): 'nan' is not a finite number");
  ExpectError("KEYFRAME 0" + kIdentity + "0 0 0 5\n", 1,
              "KEYFRAME: after the last field: unexpected '5'");
  ExpectError("KEYFRAME -1" + kIdentity + "0 0 0\n", 1, "KEYFRAME: i: -1 is negative");
  ExpectError("KEYFRAME 99999999999" + kIdentity + "0 0 0\n", 1,
              "KEYFRAME: i: 99999999999 is too large");
  ExpectError(kFirst + "FEATURE 0 5 1 1 -2\n", 4, "FEATURE: d_obs: negative");
  ExpectError(kFirst + "FEATURE 0 5 1\n", 4, "FEATURE: y: missing, the line ends here");
  ExpectError(kFirst + "DEPTH_GUESS 0 3 0\n", 4, "DEPTH_GUESS: d: not positive");
  ExpectError(kFirst + kSecond + "OBS 1 0 1 0 0 0 1 2 1\n", 5, "OBS: w: not positive definite");
  ExpectError(kFirst + kSecond + "OBS 1 0 1 0 0 0 1 x 1\n", 5, "OBS: w01: 'x' is not a number");
  ExpectError(kFirst + kSecond + "BETWEEN 0 1" + kIdentity + "0 0 0" + Diagonal(0.0), 5,
              "BETWEEN: w: not positive definite");
  std::string skewed = Diagonal(1.0);
  skewed.replace(skewed.rfind("0.0"), 3, "0.5");
  ExpectError(kFirst + kSecond + "BETWEEN 0 1" + kIdentity + "0 0 0" + skewed, 5,
              "BETWEEN: w: not symmetric: row 5, column 4");
  EXPECT_EQ(ReadKeyframes(dir_.File("none.kf"), &sequence_).message,
            dir_.File("none.kf") + ": cannot open for reading: No such file or directory");
}

TEST_F(KeyframesTest, Fr3Office) {
  const std::string name = "keyframes/fr3_office.kf";
  const std::string path = test::FindData(name);
  if (path.empty()) {
    GTEST_SKIP() << test::MissingData(name);
  }
  const Status status = ReadKeyframes(path, &sequence_);
  ASSERT_TRUE(status.ok()) << status.message;
  EXPECT_EQ(sequence_.keyframes.size(), 93u);
  EXPECT_EQ(sequence_.features.size(), 10859u);
  EXPECT_EQ(sequence_.NumObservations(), 12482);
  EXPECT_EQ(sequence_.NumBetweens(), 133);
  std::size_t guesses = 0;
  for (const Keyframe& keyframe : sequence_.keyframes) {
    guesses += keyframe.depth_guesses.size();
    double norm = 0.0;
    for (std::size_t k = 3; k < 7; ++k) {
      norm += keyframe.pose[k] * keyframe.pose[k];
    }
    EXPECT_NEAR(norm, 1.0, 1e-14);
  }
  EXPECT_EQ(guesses, 10806u);
}

}  // namespace
}  // namespace inceres
