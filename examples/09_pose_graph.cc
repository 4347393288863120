// Lesson 9, a pose graph: two laps of odometry that drifts, and a place recognized now and then.
//
//     09_pose_graph [picture.svg]
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <memory>
#include <vector>

#include "examples/noise.h"
#include "inceres/factors/relative_pose.h"
#include "inceres/problem/pose_composition.h"
#include "inceres/solver/solver.h"

namespace {

using Pose = std::array<double, 7>;  // p, q (x, y, z, w), on PoseManifold
using Poses = std::vector<Pose>;

constexpr int kLap = 60;

Noise noise(9);

// A lap of an eight, 40 m long, with a hill.
Pose TruePose(int i) {
  const double s = 2.0 * M_PI * i / kLap;
  const double turn[3] = {0.0, 0.0, std::atan2(20.0 * std::cos(2.0 * s), 20.0 * std::cos(s))};
  Pose pose = {20.0 * std::sin(s), 10.0 * std::sin(2.0 * s), 2.0 * std::sin(s)};
  inceres::ExpQuaternion(turn, &pose[3]);
  return pose;
}

Pose Between(const Pose& a, const Pose& b) {  // b as seen from a
  Pose inverse, between;
  inceres::InvertPose(a.data(), inverse.data());
  inceres::ComposePoses(inverse.data(), b.data(), between.data());
  return between;
}

Pose After(const Pose& a, const Pose& step) {
  Pose pose;
  inceres::ComposePoses(a.data(), step.data(), pose.data());
  return pose;
}

// How b was seen from a: 5 cm and about half a degree beside the truth.
Pose Measure(int a, int b) {
  Pose error = {noise.Normal(0.05), noise.Normal(0.05), noise.Normal(0.05)};
  const double turn[3] = {noise.Normal(0.003), noise.Normal(0.003), noise.Normal(0.01)};
  inceres::ExpQuaternion(turn, &error[3]);
  return After(Between(TruePose(a), TruePose(b)), error);
}

// [quoted in docs/lessons/09_pose_graph.md]
// The measurement as the family has it: R_ab and a's center seen from b; whitened.
inceres::RelativePoseFamily::Measurement Whitened(const Pose& b_from_a) {
  inceres::RelativePoseFamily::Measurement measurement;
  Pose inverse;
  inceres::InvertPose(b_from_a.data(), inverse.data());
  std::copy_n(&b_from_a[3], 4, measurement.q_ab);
  std::copy_n(inverse.data(), 3, measurement.p_ab);
  for (int k = 0; k < 6; ++k) {
    measurement.sqrt_information[7 * k] = k < 2 ? 1 / 0.003 : k < 3 ? 1 / 0.01 : 1 / 0.05;
  }
  return measurement;
}

// Gives the poses before and after.
inceres::Summary Optimize(Poses* before, Poses* after) {
  inceres::FactorGraph graph;
  const auto edges = graph.AddFamily(std::make_shared<inceres::RelativePoseFamily>());
  const auto manifold = std::make_shared<inceres::PoseManifold>();
  std::vector<inceres::VariableId> ids;
  for (int i = 0; i < 2 * kLap; ++i) {
    // Dead reckoning: each pose starts where odometry puts it.
    const Pose step = i == 0 ? Pose() : Measure(i - 1, i);
    const Pose start = i == 0 ? TruePose(0) : After(before->back(), step);
    before->push_back(start);
    ids.push_back(graph.AddVariable(start.data(), 7, inceres::Role::kFrame, manifold));
    if (i > 0) {
      graph.AddFactor(edges, Whitened(step), {ids[ids.size() - 2], ids.back()});
    }
    if (i >= kLap && i % 10 == 0) {  // recognized: a lap ago we were here
      const auto loss = std::make_shared<inceres::HuberLoss>(3.0);
      graph.AddFactor(edges, Whitened(Measure(i - kLap, i)),
                      {ids[static_cast<std::size_t>(i - kLap)], ids.back()}, loss);
    }
  }
  graph.SetConstant(ids.front(), true);  // relative measurements leave it free where all begins
  const inceres::Summary summary = inceres::Solve(inceres::SolverOptions(), &graph);
  for (const inceres::VariableId id : ids) {
    after->emplace_back();
    std::copy_n(graph.Values(id), 7, after->back().begin());
  }
  return summary;
}
// [end of quote]

double RootMeanSquareError(const Poses& poses) {
  double sum = 0.0;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const Pose difference = Between(TruePose(static_cast<int>(i)), poses[i]);
    sum += difference[0] * difference[0] + difference[1] * difference[1] +
           difference[2] * difference[2];
  }
  return std::sqrt(sum / static_cast<double>(poses.size()));
}

bool Draw(const Poses& before, const Poses& after, const char* path) {
  std::ofstream svg(path);
  svg << "<svg xmlns='http://www.w3.org/2000/svg' viewBox='-26 -22 52 44' font-size='1.6'>\n"
      << "<rect x='-26' y='-22' width='52' height='44' fill='white'/>\n";
  const auto draw = [&svg](const Poses& poses, const char* color, double y, const char* name) {
    svg << "<text x='-25' y='" << y << "' fill='" << color << "'>" << name << "</text>\n"
        << "<polyline fill='none' stroke-width='0.3' stroke='" << color << "' points='";
    for (const Pose& pose : poses) {
      svg << pose[0] << ',' << -pose[1] << ' ';
    }
    svg << "'/>\n";
  };
  draw(before, "#c0392b", -20.0, "odometry");
  draw(after, "#2980b9", -18.0, "with loop closures");
  svg << "</svg>\n";
  return static_cast<bool>(svg.flush());
}

}  // namespace

int main(int argc, char** argv) {
  Poses before, after;
  const inceres::Summary summary = Optimize(&before, &after);
  if (!summary.IsSolutionUsable()) {
    std::cerr << summary.message << '\n';
    return 1;
  }
  std::printf("%zu poses, %d iterations, cost %.0f to %.0f, solved by %s\n", after.size(),
              summary.num_successful_steps, summary.initial_cost, summary.final_cost,
              summary.reduced_solver.c_str());
  std::printf("off the truth: odometry %.2f m, with loop closures %.2f m\n",
              RootMeanSquareError(before), RootMeanSquareError(after));
  return argc < 2 || Draw(before, after, argv[1]) ? 0 : 1;
}
