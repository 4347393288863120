// Lesson 9, a pose graph: two laps of odometry that drifts, and a place recognized now and then.
//
//     09_pose_graph [picture.svg]
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <iostream>
#include <memory>
#include <vector>

#include "examples/eight.h"
#include "examples/picture.h"
#include "inceres/factors/relative_pose.h"
#include "inceres/problem/rotation.h"
#include "inceres/solver/solver.h"

namespace {

using Poses = std::vector<eight::Pose>;

// [quoted in docs/lessons/09_pose_graph.md]
// The measurement as the family has it: R_ab and a's center seen from b; whitened.
inceres::RelativePoseFamily::Measurement Whitened(const eight::Pose& b_from_a) {
  inceres::RelativePoseFamily::Measurement measurement;
  eight::Pose inverse;
  inceres::InvertPose(b_from_a.data(), inverse.data());
  std::copy_n(&b_from_a[3], 4, measurement.q_ab);
  std::copy_n(inverse.data(), 3, measurement.p_ab);
  for (int k = 0; k < 6; ++k) {
    const double sigma = k < 3 ? eight::kSigmaTurn[k] : eight::kSigmaPosition;
    measurement.sqrt_information[7 * k] = 1.0 / sigma;
  }
  return measurement;
}

// Gives the poses before and after.
inceres::Summary Optimize(Poses* before, Poses* after) {
  inceres::FactorGraph graph;
  const auto edges = graph.AddFamily(std::make_shared<inceres::RelativePoseFamily>());
  const auto manifold = std::make_shared<inceres::PoseManifold>();
  const auto huber = std::make_shared<inceres::HuberLoss>(3.0);
  std::vector<inceres::VariableId> ids;
  for (int i = 0; i < 2 * eight::kLap; ++i) {
    // Dead reckoning: each pose starts where odometry puts it.
    const eight::Pose step = i == 0 ? eight::Pose() : eight::Measure(i - 1, i);
    const eight::Pose start = i == 0 ? eight::TruePose(0) : eight::After(before->back(), step);
    before->push_back(start);
    ids.push_back(graph.AddVariable(start.data(), 7, inceres::Role::kFrame, manifold));
    if (i > 0) {
      graph.AddFactor(edges, Whitened(step), {ids[ids.size() - 2], ids.back()});
    }
    // Recognized: a lap ago we were here, and half a lap ago where the eight crosses itself.
    for (const int lag : {eight::kLap, eight::kLap / 2}) {
      if (i >= lag && i % (lag == eight::kLap ? 5 : lag) == 0) {
        const auto place = ids[static_cast<std::size_t>(i - lag)];
        graph.AddFactor(edges, Whitened(eight::Measure(i - lag, i)), {place, ids.back()}, huber);
      }
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
    const eight::Pose error = eight::Between(eight::TruePose(static_cast<int>(i)), poses[i]);
    sum += error[0] * error[0] + error[1] * error[1] + error[2] * error[2];
  }
  return std::sqrt(sum / static_cast<double>(poses.size()));
}

bool Draw(const Poses& before, const Poses& after, const char* path) {
  Picture picture(path, -26.0, -18.0, 52.0, 36.0);
  const auto draw = [&picture](const Poses& poses, const char* color, double y, const char* name) {
    std::vector<std::array<double, 2>> places;
    for (const eight::Pose& pose : poses) {
      places.push_back({pose[0], pose[1]});
    }
    picture.Line(places, color);
    picture.Text(-25.0, y, name, color);
  };
  draw(before, "#c0392b", 15.0, "odometry");
  draw(after, "#2980b9", 12.5, "with loop closures");
  return picture.Close();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 2 || (argc == 2 && argv[1][0] == '-')) {
    std::fprintf(stderr, "usage: 09_pose_graph [PICTURE.svg]\n");
    return 2;
  }
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
