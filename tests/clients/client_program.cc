// A program that does with Ceres what well-known programs do with it: their block sizes, options
// and order of calls, on scenes of a size that they solve every day. Its argument names one.
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <ceres/ceres.h>

#include "clients/scenes.h"

namespace clients {
namespace {

using Options = ceres::Solver::Options;
using Pairs = std::vector<std::pair<const double*, const double*>>;

double g_seconds = 0.0;

void SolveAndPrint(const Options& options, ceres::Problem* problem) {
  const auto start = std::chrono::steady_clock::now();
  ceres::Solver::Summary summary;
  ceres::Solve(options, problem, &summary);
  g_seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  std::printf("termination %d steps %d %d inner %d constrained %d\n",
              static_cast<int>(summary.termination_type), summary.num_successful_steps,
              summary.num_unsuccessful_steps, summary.num_inner_iteration_steps,
              summary.is_constrained ? 1 : 0);
  std::printf("cost %.12g %.12g\n", summary.initial_cost, summary.final_cost);
}

template <std::size_t kSize>
void Print(const char* name, const std::vector<std::array<double, kSize>>& blocks) {
  std::printf("%s", name);
  for (std::size_t i = 0; i < blocks.size(); i += 1 + blocks.size() / 5) {
    for (const double value : blocks[i]) {
      std::printf(" %.9g", value);
    }
  }
  std::printf("\n");
}

std::size_t At(int i) {
  return static_cast<std::size_t>(i);
}

// COLMAP: quaternions and translations apart, the first pose held, one coordinate of the second;
// tolerances by the gradient alone.
void Colmap(bool local) {
  Reconstruction scene(local ? 8 : 60, local ? 2000 : 6000, 5, local ? 0.02 : 0.0);
  ceres::SoftLOneLoss loss(1.0);
  ceres::Problem::Options ownership;
  ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(ownership);
  for (const Observation& o : scene.observations) {
    problem.AddResidualBlock(QuaternionReprojection(o), local ? &loss : nullptr,
                             scene.rotations[At(o.camera)].data(),
                             scene.translations[At(o.camera)].data(),
                             scene.points[At(o.point)].data(), scene.intrinsics.data());
  }
  for (auto& rotation : scene.rotations) {
    problem.SetManifold(rotation.data(), new ceres::QuaternionManifold);
  }
  problem.SetManifold(scene.intrinsics.data(), new ceres::SubsetManifold(4, {1, 2}));
  problem.SetParameterBlockConstant(scene.rotations[0].data());
  problem.SetParameterBlockConstant(scene.translations[0].data());
  problem.SetManifold(scene.translations[1].data(), new ceres::SubsetManifold(3, {0}));
  Options options;
  options.function_tolerance = 0.0;
  options.gradient_tolerance = local ? 10.0 : 1.0;
  options.parameter_tolerance = 0.0;
  options.max_num_iterations = local ? 25 : 50;
  options.max_linear_solver_iterations = 100;
  options.max_num_consecutive_invalid_steps = 10;
  options.max_consecutive_nonmonotonic_steps = 10;
  options.linear_solver_type = local ? ceres::DENSE_SCHUR : ceres::SPARSE_SCHUR;
  options.preconditioner_type = ceres::SCHUR_JACOBI;
  SolveAndPrint(options, &problem);
  Print("translations", scene.translations);
  Print("points", scene.points);
}

// The BA object of AliceVision is told of every point that is evaluated.
struct Told : ceres::EvaluationCallback {
  void PrepareForEvaluation(bool /*jacobians*/, bool new_point) override {
    count += new_point ? 1 : 0;
  }
  int count = 0;
};

void AliceVision() {
  Reconstruction scene(30, 4000, 5, 0.02);
  Told told;
  ceres::Problem::Options with_callback;
  with_callback.evaluation_callback = &told;
  ceres::Problem problem(with_callback);
  Options options;
  options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  auto& ordering = *options.linear_solver_ordering;
  for (const Observation& o : scene.observations) {
    double* pose = scene.poses[At(o.camera)].data();
    double* point = scene.points[At(o.point)].data();
    problem.AddResidualBlock(PoseReprojection(o), new ceres::HuberLoss(16.0), pose,
                             scene.intrinsics.data(), point);
    ordering.AddElementToGroup(point, 0);
    ordering.AddElementToGroup(pose, 1);
  }
  ordering.AddElementToGroup(scene.intrinsics.data(), 2);
  problem.SetParameterBlockConstant(scene.poses[0].data());
  problem.SetManifold(scene.poses[1].data(), new ceres::SubsetManifold(6, {3}));
  for (int k = 0; k < 3; ++k) {
    problem.SetParameterLowerBound(scene.intrinsics.data(), k, scene.intrinsics[At(k)] * 0.9);
    problem.SetParameterUpperBound(scene.intrinsics.data(), k, scene.intrinsics[At(k)] * 1.1);
  }
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_num_iterations = 50;
  options.logging_type = ceres::SILENT;
  options.num_threads = 2;
  SolveAndPrint(options, &problem);
  std::printf("told %d\n", told.count);
  Print("poses", scene.poses);
}

void OpenMvg() {
  Reconstruction scene(40, 5000, 5, 0.02);
  ceres::Problem problem;
  for (const Observation& o : scene.observations) {
    problem.AddResidualBlock(PoseReprojection(o), new ceres::HuberLoss(16.0),
                             scene.poses[At(o.camera)].data(), scene.intrinsics.data(),
                             scene.points[At(o.point)].data());
  }
  problem.SetManifold(scene.intrinsics.data(), new ceres::SubsetManifold(4, {1, 2}));
  problem.SetParameterBlockConstant(scene.poses[0].data());
  problem.SetManifold(scene.poses[1].data(), new ceres::SubsetManifold(6, {3}));
  Options options;
  options.max_num_iterations = 500;
  options.preconditioner_type = ceres::JACOBI;
  options.linear_solver_type = ceres::SPARSE_SCHUR;
  options.sparse_linear_algebra_library_type = ceres::SUITE_SPARSE;
  options.parameter_tolerance = 1e-8;
  options.logging_type = ceres::SILENT;
  options.num_threads = 2;
  SolveAndPrint(options, &problem);
  Print("poses", scene.poses);
}

// Theia: three groups, and inner iterations over the same groups the other way round.
void Theia() {
  Reconstruction scene(30, 3000, 5, 0.0);
  ceres::Problem problem;
  Options options;
  options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  auto& ordering = *options.linear_solver_ordering;
  for (const Observation& o : scene.observations) {
    double* pose = scene.poses[At(o.camera)].data();
    double* point = scene.points[At(o.point)].data();
    problem.AddResidualBlock(PoseReprojection(o), nullptr, pose, scene.intrinsics.data(), point);
    ordering.AddElementToGroup(point, 0);
    ordering.AddElementToGroup(scene.intrinsics.data(), 1);
    ordering.AddElementToGroup(pose, 2);
  }
  problem.SetParameterBlockConstant(scene.poses[0].data());
  problem.SetManifold(scene.poses[1].data(), new ceres::SubsetManifold(6, {3}));
  problem.SetManifold(scene.intrinsics.data(), new ceres::SubsetManifold(4, {1, 2}));
  options.inner_iteration_ordering = std::make_shared<ceres::ParameterBlockOrdering>(ordering);
  options.inner_iteration_ordering->Reverse();
  options.use_inner_iterations = true;
  options.linear_solver_type = ceres::SPARSE_SCHUR;
  options.preconditioner_type = ceres::SCHUR_JACOBI;
  options.visibility_clustering_type = ceres::CANONICAL_VIEWS;
  options.max_num_iterations = 500;
  options.max_solver_time_in_seconds = 3600.0;
  options.max_trust_region_radius = 1e12;
  options.logging_type = ceres::SILENT;
  SolveAndPrint(options, &problem);
  Print("poses", scene.poses);
}

// OpenSfM: dynamic AutoDiff, a scale that stays positive, then the covariance of every shot.
void OpenSfm() {
  Reconstruction scene(20, 1500, 5, 0.02);
  double scale = 1.0;
  ceres::Problem problem;
  for (const Observation& o : scene.observations) {
    problem.AddResidualBlock(ScaledReprojection(o), new ceres::SoftLOneLoss(1.0),
                             scene.poses[At(o.camera)].data(), scene.intrinsics.data(),
                             scene.points[At(o.point)].data(), &scale);
  }
  problem.SetParameterLowerBound(&scale, 0, 0.0);
  problem.SetParameterUpperBound(&scale, 0, std::numeric_limits<double>::max());
  problem.SetParameterBlockConstant(&scale);
  problem.SetParameterBlockConstant(scene.poses[0].data());
  problem.SetManifold(scene.poses[1].data(), new ceres::SubsetManifold(6, {3}));
  problem.SetManifold(scene.intrinsics.data(), new ceres::SubsetManifold(4, {1, 2}));
  problem.SetParameterLowerBound(scene.intrinsics.data(), 0, 0.0);
  Options options;
  options.linear_solver_type = ceres::SPARSE_SCHUR;
  options.max_num_iterations = 50;
  SolveAndPrint(options, &problem);
  const auto start = std::chrono::steady_clock::now();
  Pairs pairs;
  for (std::size_t i = 2; i < scene.poses.size(); ++i) {
    pairs.emplace_back(scene.poses[i].data(), scene.poses[i].data());
  }
  ceres::Covariance covariance((ceres::Covariance::Options()));
  std::printf("covariance %d", covariance.Compute(pairs, &problem) ? 1 : 0);
  double block[36] = {};
  covariance.GetCovarianceBlock(pairs.back().first, pairs.back().second, block);
  g_seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  for (int k = 0; k < 6; ++k) {
    std::printf(" %.9g", std::sqrt(block[7 * k]));
  }
  std::printf("\n");
  Print("poses", scene.poses);
}

// Cartographer's pose graph: everything as Ceres has it, and a robust loss on loops.
void Cartographer() {
  PlanarGraph graph(2000);
  ceres::Problem problem;
  for (const RelativePose& constraint : graph.constraints) {
    const bool is_loop = constraint.to != constraint.from + 1;
    problem.AddResidualBlock(
        PlanarConstraint(constraint), is_loop ? new ceres::HuberLoss(10.0) : nullptr,
        graph.poses[At(constraint.from)].data(), graph.poses[At(constraint.to)].data());
  }
  problem.SetParameterBlockConstant(graph.poses[0].data());
  Options options;
  options.use_nonmonotonic_steps = false;
  options.max_num_iterations = 50;
  options.num_threads = 2;
  SolveAndPrint(options, &problem);
  Print("poses", graph.poses);
}

// slam_toolbox: one problem that lives on, three scalar blocks a pose, solved at every loop.
void SlamToolbox() {
  PlanarGraph graph(900);
  ceres::Problem::Options fast;
  fast.enable_fast_removal = true;
  ceres::Problem problem(fast);
  Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.dynamic_sparsity = true;
  options.use_nonmonotonic_steps = true;
  options.max_consecutive_nonmonotonic_steps = 3;
  options.function_tolerance = 1e-3;
  options.parameter_tolerance = 1e-3;
  options.gradient_tolerance = 1e-6;
  options.min_trust_region_radius = 1e-16;
  options.max_trust_region_radius = 1e8;
  options.initial_trust_region_radius = 1e4;
  options.max_num_consecutive_invalid_steps = 3;
  options.num_threads = 2;
  for (std::size_t k = 0; k < graph.constraints.size(); ++k) {
    const RelativePose& constraint = graph.constraints[k];
    double* a = graph.poses[At(constraint.from)].data();
    double* b = graph.poses[At(constraint.to)].data();
    problem.AddResidualBlock(ScalarConstraint(constraint), nullptr, a, a + 1, a + 2, b, b + 1,
                             b + 2);
    if (k == 0) {
      for (int i = 0; i < 3; ++i) {
        problem.SetParameterBlockConstant(a + i);
      }
    }
    if (k > 0 && k % 200 == 0) {
      SolveAndPrint(options, &problem);
    }
  }
  SolveAndPrint(options, &problem);
  Print("poses", graph.poses);
}

// OpenVINS when it starts: a small window, Dog-Leg, a Cauchy loss; then covariances by DENSE_SVD.
void OpenVins() {
  Reconstruction scene(8, 60, 6, 0.0);
  ceres::Problem problem;
  for (auto& rotation : scene.rotations) {
    problem.AddParameterBlock(rotation.data(), 4, new ceres::QuaternionManifold);
  }
  for (const Observation& o : scene.observations) {
    problem.AddResidualBlock(QuaternionReprojection(o), new ceres::CauchyLoss(1.0),
                             scene.rotations[At(o.camera)].data(),
                             scene.translations[At(o.camera)].data(),
                             scene.points[At(o.point)].data(), scene.intrinsics.data());
  }
  problem.SetParameterBlockConstant(scene.intrinsics.data());
  problem.SetParameterBlockConstant(scene.rotations[0].data());
  problem.SetParameterBlockConstant(scene.translations[0].data());
  problem.SetManifold(scene.translations[1].data(), new ceres::SubsetManifold(3, {0}));
  Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.trust_region_strategy_type = ceres::DOGLEG;
  options.num_threads = 2;
  options.max_num_iterations = 50;
  options.function_tolerance = 1e-5;
  options.gradient_tolerance = 1e-4 * options.function_tolerance;
  SolveAndPrint(options, &problem);
  ceres::Covariance::Options svd;
  svd.algorithm_type = ceres::DENSE_SVD;
  svd.null_space_rank = -1;
  svd.apply_loss_function = false;
  ceres::Covariance covariance(svd);
  const double* last = scene.translations.back().data();
  double block[9] = {};
  const bool computed = covariance.Compute(Pairs{{last, last}}, &problem) &&
                        covariance.GetCovarianceBlockInTangentSpace(last, last, block);
  std::printf("covariance %d %.9g %.9g %.9g\n", computed ? 1 : 0, std::sqrt(block[0]),
              std::sqrt(block[4]), std::sqrt(block[8]));
  Print("translations", scene.translations);
}

// fuse: a graph of default options, and a covariance computed anew for every request.
void Fuse() {
  PlanarGraph graph(300);
  ceres::Problem problem;
  for (const RelativePose& constraint : graph.constraints) {
    problem.AddResidualBlock(PlanarConstraint(constraint), nullptr,
                             graph.poses[At(constraint.from)].data(),
                             graph.poses[At(constraint.to)].data());
  }
  problem.SetParameterBlockConstant(graph.poses[0].data());
  SolveAndPrint(Options(), &problem);
  for (const int i : {100, 200, 299}) {
    const auto start = std::chrono::steady_clock::now();
    const double* pose = graph.poses[At(i)].data();
    ceres::Covariance covariance((ceres::Covariance::Options()));
    const bool computed = covariance.Compute(Pairs{{pose, pose}}, &problem);
    double block[9] = {};
    covariance.GetCovarianceBlock(pose, pose, block);
    g_seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    std::printf("covariance %d %.9g %.9g %.9g\n", computed ? 1 : 0, std::sqrt(block[0]),
                std::sqrt(block[4]), std::sqrt(block[8]));
  }
}

// The Ames Stereo Pipeline: numeric differences, conjugate gradients.
void Asp() {
  Reconstruction scene(20, 1500, 5, 0.02);
  ceres::Problem problem;
  for (const Observation& o : scene.observations) {
    problem.AddResidualBlock(NumericReprojection(o), new ceres::CauchyLoss(0.5),
                             scene.poses[At(o.camera)].data(), scene.intrinsics.data(),
                             scene.points[At(o.point)].data());
  }
  problem.SetParameterBlockConstant(scene.intrinsics.data());
  problem.SetParameterBlockConstant(scene.poses[0].data());
  problem.SetManifold(scene.poses[1].data(), new ceres::SubsetManifold(6, {3}));
  Options options;
  options.linear_solver_type = ceres::ITERATIVE_SCHUR;
  options.use_explicit_schur_complement = false;
  options.preconditioner_type = ceres::SCHUR_JACOBI;
  options.gradient_tolerance = 1e-16;
  options.function_tolerance = 1e-16;
  options.parameter_tolerance = 1e-12;
  options.max_num_iterations = 15;
  options.max_num_consecutive_invalid_steps = 20;
  SolveAndPrint(options, &problem);
  Print("poses", scene.poses);
}

}  // namespace
}  // namespace clients

int main(int argc, char** argv) {
  using namespace clients;  // NOLINT(google-build-using-namespace): the names of the programs
  const std::map<std::string, std::function<void()>> programs = {
      {"colmap_local", [] { Colmap(true); }},
      {"colmap_global", [] { Colmap(false); }},
      {"alicevision", AliceVision},
      {"openmvg", OpenMvg},
      {"theia", Theia},
      {"opensfm", OpenSfm},
      {"cartographer", Cartographer},
      {"slam_toolbox", SlamToolbox},
      {"openvins", OpenVins},
      {"fuse", Fuse},
      {"asp", Asp}};
  const auto found = programs.find(argc == 2 ? argv[1] : "");
  if (found == programs.end()) {
    std::fprintf(stderr, "usage: %s PROGRAM\n", argv[0]);
    return 2;
  }
  found->second();
  std::printf("seconds %.6f\n", g_seconds);
  return 0;
}
