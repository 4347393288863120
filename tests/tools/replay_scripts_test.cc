// The protocols of the two replays, counted on small problems.
#include "tools/replay/replay_scripts.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <set>

#include <gtest/gtest.h>

#include "inceres/problem/rotation.h"
#include "inceres/solver/solver.h"
#include "tools/replay/replay_graph.h"
#include "tools/sim/vio_scene.h"
#include "tools/small_keyframes.h"
#include "tools/small_problems.h"

namespace inceres::tools {
namespace {

using Kind = ReplayVariable::Kind;
using Bal = BalReprojectionFamily::Measurement;
using Prior = DiagonalPriorFamily::Measurement;
using Reprojection = InverseDepthReprojectionFamily::Measurement;
using RelativePose = RelativePoseFamily::Measurement;

// Point p is seen by cameras p mod 4 and the next two, in an order that is not that of the cameras.
BalProblem Chain() {
  BalProblem bal = SmallBal(6, 8);
  std::vector<BalObservation> kept;
  for (auto it = bal.observations.rbegin(); it != bal.observations.rend(); ++it) {
    const int offset = it->camera - it->point % 4;
    if (offset >= 0 && offset <= 2) {
      kept.push_back(*it);
    }
  }
  bal.observations = kept;
  return bal;
}

template <typename Measurement>
int CountFactors(const ReplayStep& step) {
  return static_cast<int>(
      std::count_if(step.factors.begin(), step.factors.end(), [](const ReplayFactor& factor) {
        return std::holds_alternative<Measurement>(factor.measurement);
      }));
}

TEST(BalReplay, PointsEnterWithTheirSecondCamera) {
  const BalProblem bal = Chain();
  const ReplayScript script = MakeBalReplay(bal, {});
  EXPECT_FALSE(script.dogleg);
  ASSERT_EQ(script.steps.size(), 5u);
  // Points p with p mod 4 = c enter with camera c + 1: two of them, with two observations each; the
  // third comes a step later.
  const int points[5] = {2, 2, 2, 2, 0};
  const int observations[5] = {4, 6, 6, 6, 2};
  std::set<std::pair<double, double>> seen;
  for (std::size_t i = 0; i < 5; ++i) {
    const ReplayStep& step = script.steps[i];
    const int cameras = i == 0 ? 2 : 1;
    EXPECT_EQ(static_cast<int>(step.variables.size()), cameras + points[i]) << i;
    EXPECT_EQ(CountFactors<Bal>(step), observations[i]) << i;
    EXPECT_EQ(CountFactors<Prior>(step), 1 + points[i]) << i;  // the first camera, fixed, has none
    EXPECT_FALSE(step.closes_loop);
    for (const ReplayFactor& factor : step.factors) {
      if (const Bal* measurement = std::get_if<Bal>(&factor.measurement)) {
        EXPECT_EQ(ToString(factor.loss), "huber:1");
        EXPECT_TRUE(seen.emplace(measurement->x, measurement->y).second) << "an observation twice";
      } else {
        EXPECT_EQ(ToString(factor.loss), "none");
      }
    }
  }
  EXPECT_EQ(seen.size(), bal.observations.size());
}

TEST(BalReplay, FactorsNameTheVariablesOfTheirObservation) {
  const BalProblem bal = Chain();
  std::vector<ReplayVariable> variables;
  for (const ReplayStep& step : MakeBalReplay(bal, {}).steps) {
    variables.insert(variables.end(), step.variables.begin(), step.variables.end());
    for (const ReplayFactor& factor : step.factors) {
      for (const int variable : factor.variables) {
        ASSERT_LT(static_cast<std::size_t>(variable), variables.size())
            << "a variable before it arrived";
      }
      if (const Bal* m = std::get_if<Bal>(&factor.measurement)) {
        // The observations are perfect, the start values near the truth: a wrong camera or point
        // would be tens of pixels off.
        double r[2];
        BalReprojectionError{{m->x, m->y}}(
            variables[static_cast<std::size_t>(factor.variables[0])].start.data(),
            variables[static_cast<std::size_t>(factor.variables[1])].start.data(), r);
        EXPECT_LT(std::hypot(r[0], r[1]), 15.0);
      }
    }
  }
}

TEST(BalReplay, NoiseAndPriors) {
  const BalProblem bal = SmallBal(40, 200);
  const ReplayScript script = MakeBalReplay(bal, {});
  double sum[3] = {
      0.0, 0.0,
      0.0};  // squares of rotation, translation and point noise over what the prior says they are
  double count[3] = {0.0, 0.0, 0.0};
  double sigma[3] = {0.0, 0.0, 0.0};
  for (const ReplayStep& step : script.steps) {
    for (const ReplayFactor& factor : step.factors) {
      const Prior* prior = std::get_if<Prior>(&factor.measurement);
      if (prior == nullptr) {
        continue;
      }
      const bool camera = prior->mean.size() == 6;
      ASSERT_EQ(prior->mean.size(), camera ? 6u : 3u);
      // All cameras but the first come one by one after all points and two cameras arrived in step
      // 1.
      const int number = factor.variables[0];
      const int index = camera ? (number == 1 ? 1 : number - 200) : number - 2;
      const double* solved = camera ? bal.CameraData(index) : bal.PointData(index);
      for (std::size_t k = 0; k < prior->mean.size(); ++k) {
        const std::size_t kind = camera ? (k < 3 ? 0 : 1) : 2;
        sigma[kind] = 0.1 / prior->sqrt_information[k];
        const double noise = (prior->mean[k] - solved[k]) / sigma[kind];
        if (camera || std::fabs(noise) <
                          10.0) {  // points come in the order of the observations, which is theirs
          sum[kind] += noise * noise;
          count[kind] += 1.0;
        }
      }
    }
  }
  EXPECT_EQ(count[0], 3 * 39);
  EXPECT_EQ(count[1], 3 * 39);
  EXPECT_EQ(count[2], 3 * 200);
  EXPECT_NEAR(sigma[0], 1e-3, 1e-15);
  EXPECT_NEAR(sigma[2], 20.0 * sigma[1], 1e-12);
  for (std::size_t kind = 0; kind < 3; ++kind) {
    EXPECT_NEAR(std::sqrt(sum[kind] / count[kind]), 1.0, 0.2) << kind;
  }
}

TEST(BalReplay, Options) {
  const BalProblem bal = Chain();
  const ReplayScript plain = MakeBalReplay(bal, {});
  const auto start = [](const ReplayScript& script) { return script.steps[0].variables[1].start; };
  EXPECT_EQ(plain.steps[0].variables[0].kind, Kind::kBalCameraPose);
  EXPECT_TRUE(plain.steps[0].variables[0].constant);
  EXPECT_FALSE(plain.steps[0].variables[1].constant);
  EXPECT_TRUE(std::equal(bal.CameraData(0), bal.CameraData(0) + 9,
                         plain.steps[0].variables[0].start.begin()));
  EXPECT_NE(start(plain)[0], bal.CameraData(1)[0]);
  EXPECT_EQ(start(plain)[6], bal.CameraData(1)[6]);

  BalReplayOptions options;
  EXPECT_EQ(start(MakeBalReplay(bal, options)), start(plain));
  options.seed = 2;
  EXPECT_NE(start(MakeBalReplay(bal, options)), start(plain));
  options = {};
  options.free_intrinsics = true;
  options.priors = false;
  const ReplayScript torture = MakeBalReplay(bal, options);
  EXPECT_EQ(start(torture), start(plain));
  EXPECT_EQ(torture.steps[0].variables[1].kind, Kind::kBalCamera);
  for (const ReplayStep& step : torture.steps) {
    EXPECT_EQ(CountFactors<Prior>(step), 0);
  }
}

TEST(KeyframeReplay, FeaturesEnterAtTheirFirstObservation) {
  KeyframeSequence sequence = SmallKeyframes(13);
  const ReplayScript script = MakeKeyframeReplay(sequence);
  EXPECT_TRUE(script.dogleg);
  ASSERT_EQ(script.steps.size(), 12u);
  EXPECT_TRUE(script.steps[0].variables[0].constant);
  std::set<int> entered;
  for (std::size_t i = 0; i < script.steps.size(); ++i) {
    const ReplayStep& step = script.steps[i];
    const Keyframe& keyframe = sequence.keyframes[i + 1];
    int fresh = 0;
    int measured = 0;
    for (const KeyframeObservation& observation : keyframe.observations) {
      if (entered.insert(observation.feature).second) {
        ++fresh;
        measured +=
            sequence.features[static_cast<std::size_t>(observation.feature)].inverse_depth > 0.0
                ? 1
                : 0;
      }
    }
    EXPECT_EQ(static_cast<int>(step.variables.size()), fresh + (i == 0 ? 2 : 1));
    EXPECT_EQ(CountFactors<Reprojection>(step), static_cast<int>(keyframe.observations.size()));
    EXPECT_EQ(CountFactors<RelativePose>(step), static_cast<int>(keyframe.betweens.size()));
    EXPECT_EQ(CountFactors<Prior>(step), measured);
    EXPECT_EQ(step.closes_loop, i == 11);  // keyframe 12 sees keyframe 0
  }
  EXPECT_GT(entered.size(), 10u);
}

TEST(KeyframeReplay, StartOfAnInverseDepth) {
  KeyframeSequence sequence = SmallKeyframes(2);
  sequence.keyframes[1].observations.resize(3);
  for (int k = 0; k < 3; ++k) {
    sequence.keyframes[1].observations[static_cast<std::size_t>(k)].feature = k;
  }
  sequence.features[0].inverse_depth = sequence.features[1].inverse_depth = 0.8;
  sequence.features[2].inverse_depth = 0.0;
  sequence.keyframes[1].depth_guesses = {{0, 0.3}};
  const ReplayScript script = MakeKeyframeReplay(sequence);
  ASSERT_EQ(script.steps[0].variables.size(), 5u);
  EXPECT_EQ(script.steps[0].variables[2].start[0], 0.3);  // guessed
  EXPECT_EQ(script.steps[0].variables[3].start[0], 0.8);  // measured
  EXPECT_EQ(script.steps[0].variables[4].start[0], 0.5);  // neither
  const auto prior = std::find_if(
      script.steps[0].factors.begin(), script.steps[0].factors.end(),
      [](const ReplayFactor& factor) { return std::holds_alternative<Prior>(factor.measurement); });
  ASSERT_NE(prior, script.steps[0].factors.end());
  EXPECT_EQ(std::get<Prior>(prior->measurement).mean[0], 0.8);
  EXPECT_DOUBLE_EQ(std::get<Prior>(prior->measurement).sqrt_information[0], 10.0);
}

VioSequence SmallVio() {
  VioSceneOptions options;
  options.num_frames = 20;
  options.num_points = 60;
  options.trajectory.period = 4.0;
  VioSequence sequence;
  EXPECT_TRUE(GenerateVioScene(options, &sequence).ok());
  return sequence;
}

TEST(VioReplay, PointsEnterWithTheirSecondFrameAndFramesWithTheirImuFactor) {
  const VioSequence sequence = SmallVio();
  ReplayScript script;
  ASSERT_TRUE(MakeVioReplay(sequence, {}, &script).ok());
  EXPECT_TRUE(script.dogleg);
  ASSERT_EQ(script.steps.size(), 19u);
  EXPECT_TRUE(script.steps[0].variables[0].constant) << "the camera on the IMU";
  EXPECT_TRUE(script.steps[0].variables[1].constant) << "the first pose";
  EXPECT_FALSE(script.steps[0].variables[2].constant);
  std::map<int, int> sightings;  // of each point so far
  std::vector<Kind> kinds;
  int observations = 0;
  for (std::size_t i = 0; i < script.steps.size(); ++i) {
    const ReplayStep& step = script.steps[i];
    int fresh = 0, due = 0;
    for (std::size_t f = i == 0 ? 0 : i + 1; f <= i + 1; ++f) {
      for (const VioObservation& observation : sequence.frames[f].observations) {
        const int count = ++sightings[observation.point];
        fresh += count == 2 ? 1 : 0;
        due += count == 2 ? 2 : count > 2 ? 1 : 0;
      }
    }
    EXPECT_EQ(static_cast<int>(step.variables.size()), fresh + (i == 0 ? 5 : 2)) << i;
    EXPECT_EQ(CountFactors<PointSighting>(step), due) << i;
    EXPECT_EQ(CountFactors<std::shared_ptr<const ImuPreintegrator>>(step), 1) << i;
    EXPECT_EQ(CountFactors<Prior>(step), i == 0 ? 1 : 0) << i;
    observations += due;
    for (const ReplayVariable& variable : step.variables) {
      kinds.push_back(variable.kind);
    }
    for (const ReplayFactor& factor : step.factors) {
      const bool sighting = std::holds_alternative<PointSighting>(factor.measurement);
      EXPECT_EQ(ToString(factor.loss), sighting ? "huber:1" : "none");
      for (const int variable : factor.variables) {
        ASSERT_LT(static_cast<std::size_t>(variable), kinds.size())
            << "a variable before it arrived";
      }
      if (sighting) {
        EXPECT_EQ(kinds[static_cast<std::size_t>(factor.variables[2])], Kind::kPoint);
      }
    }
  }
  EXPECT_EQ(observations, sequence.NumObservations());
}

// At the truth what is left is the noise: about half a unit of cost a residual.
TEST(VioReplay, FactorsNameTheVariablesOfTheirMeasurement) {
  VioSequence sequence = SmallVio();
  for (VioFrame& frame : sequence.frames) {
    frame.start = frame.truth;
  }
  for (VioPoint& point : sequence.points) {
    point.start = point.truth;
  }
  VioReplayOptions options;
  options.prior = false;
  options.loss = LossSpec();
  ReplayScript script;
  ASSERT_TRUE(MakeVioReplay(sequence, options, &script).ok());
  FactorGraph graph;
  ReplayGraph builder(false);
  for (const ReplayStep& step : script.steps) {
    EXPECT_EQ(CountFactors<Prior>(step), 0);
    ASSERT_TRUE(builder.Add(step, &graph).ok());
  }
  SolverOptions solver_options;
  solver_options.max_num_iterations = 0;
  const Summary summary = Solve(solver_options, &graph);
  const int residuals = 2 * sequence.NumObservations() + 15 * 19;
  EXPECT_NEAR(summary.initial_cost, 0.5 * residuals, 3.0 * std::sqrt(0.5 * residuals));
}

TEST(VioReplay, NamesTheFrameWhoseSamplesCannotBeIntegrated) {
  VioSequence sequence = SmallVio();
  sequence.frames[7].imu[3].time = sequence.frames[7].imu[2].time;
  ReplayScript script;
  const Status status = MakeVioReplay(sequence, {}, &script);
  EXPECT_FALSE(status.ok());
  EXPECT_EQ(status.message.substr(0, 9), "frame 7: ") << status.message;
  EXPECT_TRUE(script.steps.empty());
}

double MeanTrackOf(const ReplayScript& script, std::size_t first, std::size_t last) {
  double observations = 0.0, points = 0.0;
  for (std::size_t i = first; i < last; ++i) {
    observations += CountFactors<Bal>(script.steps[i]);
    points += static_cast<double>(
        std::count_if(script.steps[i].variables.begin(), script.steps[i].variables.end(),
                      [](const ReplayVariable& v) { return v.kind == Kind::kPoint; }));
  }
  return observations / points;
}

// How many cameras lie between the first and the last that a factor ties together through one
// point, at most.
int LongestTie(const ReplayScript& script) {
  std::vector<int> camera, first_seen;  // by variable
  int cameras = 0, longest = 0;
  for (const ReplayStep& step : script.steps) {
    for (const ReplayVariable& variable : step.variables) {
      camera.push_back(variable.kind == Kind::kPoint ? -1 : cameras++);
      first_seen.push_back(1 << 30);
    }
    for (const ReplayFactor& factor : step.factors) {
      if (factor.variables.size() == 2) {
        const int by = camera[static_cast<std::size_t>(factor.variables[0])];
        int& first = first_seen[static_cast<std::size_t>(factor.variables[1])];
        first = std::min(first, by);
        longest = std::max(longest, by - first);
      }
    }
  }
  return longest;
}

TEST(PathReplay, IsAlikeFromOneEndToTheOther) {
  PathReplayOptions options;
  options.num_cameras = 900;
  ReplayScript script;
  ASSERT_TRUE(MakePathReplay(options, &script).ok());
  ASSERT_EQ(script.steps.size(), 899u);
  EXPECT_LT(LongestTie(script), 30);
  EXPECT_NEAR(MeanTrackOf(script, 100, 400), MeanTrackOf(script, 500, 800), 0.4);
  EXPECT_NEAR(MeanTrackOf(script, 0, 899), 6.4, 0.3);
  int factors = 0;
  for (const ReplayStep& step : script.steps) {
    EXPECT_FALSE(step.closes_loop);
    factors += CountFactors<Bal>(step);
  }
  EXPECT_NEAR(factors / 900.0, 41.0, 3.0);
  // Nowhere is the origin farther away than anywhere else: it would be a lever for noise in the
  // rotations.
  for (const ReplayStep& step : script.steps) {
    const ReplayVariable& camera =
        *std::find_if(step.variables.rbegin(), step.variables.rend(),
                      [](const ReplayVariable& v) { return v.kind != Kind::kPoint; });
    EXPECT_NEAR(std::hypot(camera.start[3], camera.start[4], camera.start[5]), 200.0 / (2.0 * M_PI),
                5.0);
  }
}

TEST(PathReplay, LoopsAndSeeds) {
  PathReplayOptions options;
  options.num_cameras = 460;
  options.loops = true;
  ReplayScript script;
  ASSERT_TRUE(MakePathReplay(options, &script).ok());
  EXPECT_GT(LongestTie(script), 250) << "the third lap sees points of the first";
  int before = 0, laps[3] = {0, 0, 0};
  for (std::size_t i = 0; i < script.steps.size(); ++i) {
    before += script.steps[i].closes_loop && i < 115 ? 1 : 0;
    laps[std::min<std::size_t>(i / 145, 2)] += script.steps[i].closes_loop ? 1 : 0;
  }
  EXPECT_EQ(before, 0) << "nothing to come back to yet";
  EXPECT_GT(laps[1] + laps[2], 20);
  EXPECT_LT(laps[0] + laps[1] + laps[2], 150) << "most of the way there is no loop";

  ReplayScript other;
  ASSERT_TRUE(MakePathReplay(options, &other).ok());
  EXPECT_EQ(other.steps[5].variables[0].start, script.steps[5].variables[0].start);
  options.seed = 2;
  ASSERT_TRUE(MakePathReplay(options, &other).ok());
  EXPECT_NE(other.steps[5].variables[0].start, script.steps[5].variables[0].start);
  options.num_cameras = 100;
  const Status status = MakePathReplay(options, &other);
  EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
  EXPECT_EQ(status.message, "a path of 100 cameras: to close a loop it needs at least 165");
}

}  // namespace
}  // namespace inceres::tools
