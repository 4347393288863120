// The examples of the site's guides, compiled and run as they stand there.

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <fstream>
#include <functional>
#include <iostream>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "inceres/factors/bal_reprojection.h"
#include "inceres/factors/diagonal_prior.h"
#include "inceres/factors/planar_relative_pose.h"
#include "inceres/io/bal.h"
#include "inceres/io/bal_graph.h"
#include "inceres/io/g2o_graph.h"
#include "inceres/io/pose_graph_start.h"
#include "inceres/problem/losses.h"
#include "inceres/solver/callbacks.h"
#include "inceres/solver/covariance.h"
#include "inceres/solver/gnc.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/solver.h"
#include "support/pose_graph_world.h"
#include "support/temp_dir.h"

namespace {

using inceres::FactorGraph;
using inceres::VariableId;

// Three poses along a line and back to the first, which is off by a little.
constexpr const char* kGraph = R"(VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 1 1.1 0 0 0 0 0 1
VERTEX_SE3:QUAT 2 2.1 0.1 0 0 0 0 1
EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 4 0 0 4 0 4
EDGE_SE3:QUAT 1 2 1 0 0 0 0 0 1 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 4 0 0 4 0 4
EDGE_SE3:QUAT 0 2 2.3 0 0 0 0 0 1 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 4 0 0 4 0 4
)";

// clang-format off
int SolvePoseGraph(const std::string& path, FactorGraph* made) {
// [quoted in docs/pose_graphs.md]
inceres::FactorGraph graph;
inceres::G2oGraph ids;
const inceres::Status read = inceres::ReadG2o(path, &graph, &ids);  // planar or spatial
if (!read.ok()) {
  std::cerr << read.message << '\n';  // file:line: tag: field: what is wrong
  return 1;
}
graph.SetConstant(ids.poses[0], true);  // relative poses leave the whole free to move
inceres::SolverOptions options;
options.strategy = inceres::TrustRegionStrategyKind::kDogleg;
options.progress = inceres::LogTo(std::cout);
const inceres::Summary summary = inceres::Solve(options, &graph);
// [end of quote]
  EXPECT_EQ(summary.termination, inceres::Termination::kConvergence) << summary.message;
  *made = graph;
  return 0;
}

int FindWrongLoops(const std::string& path, inceres::GncSummary* found) {
// [quoted in docs/pose_graphs.md]
inceres::PoseGraph poses;
inceres::FactorGraph graph;
inceres::G2oGraph ids;
inceres::Status status = inceres::ReadG2o(path, &poses);
status = status.ok() ? inceres::AddPoseGraph(poses, nullptr, &graph, &ids) : status;
if (!status.ok()) {
  std::cerr << status.message << '\n';
  return 1;
}
graph.SetConstant(ids.poses[0], true);
const std::vector<int> loops = inceres::LoopEdges(poses);
std::vector<inceres::FactorId> suspects;
for (const int edge : loops) {
  suspects.push_back(ids.EdgeFactor(edge));
}
inceres::GncOptions options;
options.solver.strategy = inceres::TrustRegionStrategyKind::kDogleg;
options.start = inceres::ChordalGncStart(poses, ids, loops);
const inceres::GncSummary summary = inceres::SolveGnc(options, suspects, &graph);
for (const inceres::GncVerdict& verdict : summary.verdicts) {
  std::cout << verdict.factor.index << (verdict.inlier ? " is right\n" : " is wrong\n");
}
// [end of quote]
  *found = summary;
  return 0;
}

bool IsPlausible(const inceres::IncrementalSolver& solver, VariableId a, VariableId b,
                 const inceres::PlanarRelativePoseFamily::Measurement& loop) {
// [quoted in docs/pose_graphs.md]
inceres::LiveCovariance joint;  // of both poses: 6 × 6
const inceres::Status known = solver.JointCovariance(a, b, {}, &joint);
if (!known.ok()) {
  std::cerr << known.message << '\n';  // edited since the last Update, or the gauge is free
  return false;
}
inceres::PlanarRelativePoseFamily family;
family.Add(loop);  // whitened: its own noise is the identity
const double* const poses[2] = {solver.Values(a), solver.Values(b)};
Eigen::Vector3d r;
Eigen::Matrix<double, 3, 3, Eigen::RowMajor> J_a, J_b;
double* jacobians[2] = {J_a.data(), J_b.data()};
family.EvaluateOne(0, poses, r.data(), jacobians);
Eigen::Matrix<double, 3, 6> J;
J << J_a, J_b;
using RowMajor = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;
const Eigen::Matrix3d innovation =
    Eigen::Matrix3d::Identity() + J * Eigen::Map<RowMajor>(joint.values.data()) * J.transpose();
const bool is_plausible =
    r.dot(innovation.ldlt().solve(r)) <= inceres::ChiSquareQuantile(0.999, 3);
// [end of quote]
  return is_plausible;
}

double MinimumOf(FactorGraph graph) {
// [quoted in docs/errors.md]
const inceres::Summary summary = inceres::Solve(inceres::SolverOptions(), &graph);
switch (summary.termination) {
  case inceres::Termination::kConvergence:
  case inceres::Termination::kUserSuccess:
    break;
  case inceres::Termination::kNoConvergence:  // a limit: the state is the best one found
    std::cerr << "stopped early: " << summary.message << '\n';
    break;
  case inceres::Termination::kFailure:        // the state is what it was
  case inceres::Termination::kUserFailure:
    std::cerr << summary.message << ' ' << summary.detail << '\n';
}
// [end of quote]
  return summary.final_cost;
}

bool Edit(inceres::IncrementalSolver* living, VariableId camera) {
  inceres::IncrementalSolver& solver = *living;
// [quoted in docs/errors.md]
inceres::GraphEdit edit(solver.graph());
edit.RemoveVariable(camera);
const inceres::Status status = solver.Apply(edit);
if (!status.ok()) {
  std::cerr << status.message << '\n';  // names the id at fault; nothing has changed
}
// [end of quote]
  return status.ok();
}

inceres::SolverOptions Exact() {
// [quoted in docs/tolerances.md]
inceres::SolverOptions options;
options.function_tolerance = 1e-12;   // stop when a step gains less than this share of the cost
options.gradient_tolerance = 0.0;     // 0: never for this reason
options.parameter_tolerance = 0.0;
options.max_num_iterations = 200;
// [end of quote]
  return options;
}

inceres::IncrementalOptions FrontEnd() {
// [quoted in docs/real_time.md]
inceres::IncrementalOptions options;
options.max_factor_evaluations = 200000;  // the budget: the same on every machine, every time
options.max_solver_time_in_seconds = 0.03;  // the deadline: for what the budget did not foresee
options.function_tolerance = 1e-4;        // the next frame comes soon
inceres::IncrementalSolver solver(options);
// [end of quote]
  return options;
}

inceres::UpdateSummary UpdateUntil(inceres::IncrementalSolver* living,
                                   std::atomic<bool>* frame_has_come) {
  inceres::IncrementalSolver& solver = *living;
// [quoted in docs/real_time.md]
std::thread watch([&] {
  while (!*frame_has_come) {
    std::this_thread::yield();  // wait for whatever your program waits for
  }
  solver.RequestStop();         // from any thread: the Update ends at its next iteration
});
const inceres::UpdateSummary summary = solver.Update();
// [end of quote]
  watch.join();
  return summary;
}

// [quoted in docs/real_time.md]
class Deadline : public inceres::UpdateObserver {
 public:
  explicit Deadline(std::function<bool()> is_over) : is_over_(std::move(is_over)) {}
  inceres::ObserverAction EndOfIteration(const inceres::UpdateIteration& /*iteration*/) override {
    return is_over_() ? inceres::ObserverAction::kTerminateSuccessfully
                      : inceres::ObserverAction::kContinue;
  }

 private:
  std::function<bool()> is_over_;
};
// [end of quote]

inceres::Summary SolveInexactly(const std::string& path, inceres::FactorGraph* made) {
  inceres::FactorGraph& graph = *made;
// [quoted in docs/large.md]
const inceres::Status read = inceres::ReadBal(path, &graph);  // points are landmarks
if (!read.ok()) {
  std::cerr << read.message << '\n';  // file:line: field: what is wrong
}
inceres::SolverOptions options;
options.reduced_solver = inceres::ReducedSolverKind::kAutomaticInexact;  // PCG where it is cheaper
options.num_threads = 4;
const inceres::Summary summary = inceres::Solve(options, &graph);
// [end of quote]
  EXPECT_TRUE(read.ok()) << read.message;
  return summary;
}

inceres::Summary SolveAsInGtsam(const double* camera_values, const double* point_values) {
  const double x = 10.0, y = 20.0;
// [quoted in docs/from_gtsam.md]
inceres::FactorGraph graph;  // NonlinearFactorGraph and Values in one
const auto seen = graph.AddFamily(std::make_shared<inceres::BalReprojectionFamily>());
const auto priors = graph.AddFamily(std::make_shared<inceres::DiagonalPriorFamily>(9));
// values.insert(X(0), …); values.insert(L(0), …)
const auto camera = graph.AddVariable(camera_values, 9, inceres::Role::kFrame);
const auto point = graph.AddVariable(point_values, 3, inceres::Role::kLandmark);
// graph.emplace_shared<…>(…), with a noiseModel::Robust
graph.AddFactor(seen, {x, y}, {camera, point}, std::make_shared<inceres::HuberLoss>(1.0));
// graph.addPrior(X(0), …): 1 / sigma for each entry
const std::vector<double> mean(camera_values, camera_values + 9), weights(9, 100.0);
graph.AddFactor(priors, {mean, weights}, {camera});
const inceres::Summary summary = inceres::Solve(inceres::SolverOptions(), &graph);
const double* solved = graph.Values(camera);  // result.at<…>(X(0))
// [end of quote]
  EXPECT_NE(solved, nullptr);
  return summary;
}

bool UncertaintyOf(const FactorGraph& graph, VariableId pose, std::array<double, 36>* out) {
  std::array<double, 36>& covariance = *out;
// [quoted in docs/from_gtsam.md, docs/from_g2o.md]
inceres::GraphCovariance covariances;  // Marginals; computeMarginals
const inceres::Status status = covariances.Compute(graph, {{pose, pose}});
const bool known = status.ok() && covariances.Get(pose, pose, covariance.data());
// [end of quote]
  return known;
}

FactorGraph LineOfPoses() {
  const inceres::test::TempDir folder;
  const std::string path = folder.File("line.g2o");
  std::ofstream(path) << kGraph;
  FactorGraph graph;
  EXPECT_EQ(SolvePoseGraph(path, &graph), 0);
  return graph;
}

// A camera at the origin that looks at a point, and values from which it is found.
constexpr double kCamera[9] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 500.0, 0.0, 0.0};
constexpr double kPoint[3] = {0.11, 0.19, -5.0};

inceres::BalProblem SmallProblem() {
  inceres::BalProblem problem;
  problem.num_cameras = 2;
  problem.num_points = 1;
  problem.cameras.assign(kCamera, kCamera + 9);
  problem.cameras.insert(problem.cameras.end(), kCamera, kCamera + 9);
  problem.cameras[9 + 3] = 1.0;
  problem.points.assign(kPoint, kPoint + 3);
  problem.observations = {{0, 0, 10.0, 20.0}, {1, 0, 110.0, 20.0}};
  return problem;
}

// A camera that an anchor and a point hold, added to a solver that lives on.
VariableId AddCamera(inceres::IncrementalSolver* solver) {
  const auto priors = solver->AddFamily(std::make_shared<inceres::DiagonalPriorFamily>(9));
  inceres::GraphEdit edit(solver->graph());
  const VariableId camera = edit.AddVariable(kCamera, 9, inceres::Role::kFrame);
  const std::vector<double> mean(9, 1.0), weights(9, 1.0);
  edit.AddFactor(priors, {mean, weights}, {camera});
  EXPECT_TRUE(solver->Apply(edit).ok());
  return camera;
}

TEST(GuidesExamples, APoseGraphEndsBetweenWhatItsEdgesSay) {
  const FactorGraph graph = LineOfPoses();
  // The chain says 2, the loop 2.3: each of the three edges takes a third of the difference.
  EXPECT_NEAR(graph.Values(1)[0], 1.1, 1e-6);
  EXPECT_NEAR(graph.Values(2)[0], 2.2, 1e-6);
  EXPECT_NEAR(MinimumOf(graph), 0.5 * 3 * 0.01, 1e-7);
  std::array<double, 36> covariance{};
  ASSERT_TRUE(UncertaintyOf(graph, 2, &covariance));
  EXPECT_NEAR(covariance[0], 2.0 / 3.0, 1e-6);  // two edges in a row, beside one
}

TEST(GuidesExamples, AFileThatIsNotThereIsTold) {
  FactorGraph graph;
  EXPECT_EQ(SolvePoseGraph("/no/such/file.g2o", &graph), 1);
}

TEST(GuidesExamples, WrongLoopsAreFound) {
  const inceres::test::TempDir dir;
  const std::string path = dir.File("graph.g2o");
  const inceres::test::PoseGraphWorld world(3, 120, 30, 12, 0.02, 3);
  ASSERT_TRUE(inceres::WriteG2o(path, world.truth).ok());
  inceres::GncSummary found;
  ASSERT_EQ(FindWrongLoops(path, &found), 0);
  ASSERT_EQ(found.verdicts.size(), 90u + 12u);
  for (std::size_t k = 90; k < 102; ++k) {
    EXPECT_FALSE(found.verdicts[k].inlier) << k;
  }
  EXPECT_LE(found.num_outliers, 12 + 4);
  EXPECT_EQ(FindWrongLoops("/no/such/file.g2o", &found), 1);
}

// Poses a meter apart, each known from the one before to 0.1: the tenth is known to 0.3 along the
// way, and where it may be grows across it with each angle.
TEST(GuidesExamples, AWrongLoopIsNotPlausible) {
  inceres::IncrementalSolver solver{inceres::IncrementalOptions()};
  const auto family = solver.AddFamily(std::make_shared<inceres::PlanarRelativePoseFamily>());
  inceres::GraphEdit edit(solver.graph());
  inceres::PlanarRelativePoseFamily::Measurement step;
  step.motion[0] = 1.0;
  for (const int k : {0, 4, 8}) {
    step.sqrt_information[k] = 10.0;
  }
  std::vector<VariableId> poses;
  for (int i = 0; i < 10; ++i) {
    const double pose[3] = {1.0 * i, 0.0, 0.0};
    poses.push_back(edit.AddVariable(pose, 3, inceres::Role::kFrame));
    if (i > 0) {
      edit.AddFactor(family, step, {poses[poses.size() - 2], poses.back()});
    }
  }
  edit.SetConstant(poses[0], true);
  ASSERT_TRUE(solver.Apply(edit).ok());
  inceres::PlanarRelativePoseFamily::Measurement loop = step;
  EXPECT_FALSE(IsPlausible(solver, poses[0], poses[9], loop));  // before an Update
  solver.Update();
  loop.motion[0] = 9.5;  // 0.5 off, where 0.1 √10 is a standard deviation
  EXPECT_TRUE(IsPlausible(solver, poses[0], poses[9], loop));
  EXPECT_TRUE(IsPlausible(solver, poses[9], poses[0],
                          {{-9.0, 0.0, 0.0}, {10, 0, 0, 0, 10, 0, 0, 0, 10}}));
  loop.motion[0] = 11.0;
  EXPECT_FALSE(IsPlausible(solver, poses[0], poses[9], loop));
  loop.motion[0] = 9.0;
  loop.motion[1] = 3.0;  // across, which each angle of 0.1 moves by up to 0.9
  EXPECT_TRUE(IsPlausible(solver, poses[0], poses[9], loop));
}

TEST(GuidesExamples, AnEditOfWhatIsGoneIsRefused) {
  inceres::IncrementalSolver solver{inceres::IncrementalOptions()};
  const VariableId camera = AddCamera(&solver);
  EXPECT_TRUE(Edit(&solver, camera));
  EXPECT_FALSE(Edit(&solver, camera));
}

TEST(GuidesExamples, OptionsAreValid) {
  EXPECT_TRUE(Exact().Validate().ok());
  EXPECT_TRUE(FrontEnd().Validate().ok());
}

TEST(GuidesExamples, AnUpdateStopsWhenAsked) {
  inceres::IncrementalSolver solver{inceres::IncrementalOptions()};
  AddCamera(&solver);
  std::atomic<bool> frame_has_come{true};
  EXPECT_NE(UpdateUntil(&solver, &frame_has_come).termination, inceres::Termination::kFailure);
}

TEST(GuidesExamples, ADeadlineKeepsTheState) {
  inceres::IncrementalSolver solver{inceres::IncrementalOptions()};
  AddCamera(&solver);
  Deadline deadline([] { return true; });
  inceres::UpdateSummary summary;
  solver.Update(&summary, &deadline);
  EXPECT_EQ(summary.termination, inceres::Termination::kUserSuccess);
}

TEST(GuidesExamples, ABalFileIsSolved) {
  const inceres::test::TempDir folder;
  const std::string path = folder.File("two_cameras.txt");
  ASSERT_TRUE(inceres::WriteBal(path, SmallProblem()).ok());
  FactorGraph graph;
  const inceres::Summary summary = SolveInexactly(path, &graph);
  EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
  EXPECT_LT(summary.final_cost, 1e-6);
}

TEST(GuidesExamples, WhatGtsamUsersWriteIsSolved) {
  const inceres::Summary summary = SolveAsInGtsam(kCamera, kPoint);
  EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
  EXPECT_LT(summary.final_cost, 1e-3);
}

}  // namespace
