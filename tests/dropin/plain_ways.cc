// What a program does that knows nothing but Ceres.
#include "dropin/plain_ways.h"

#include <dlfcn.h>

#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <ceres/c_api.h>
#include <ceres/ceres.h>

#include "dropin/plain_problems.h"

namespace {

using plain::Curve;

void Print(const ceres::Solver::Summary& summary) {
  std::printf("termination %d: %s\n", static_cast<int>(summary.termination_type),
              summary.message.c_str());
  std::printf("cost %.17g -> %.17g, steps %d + %d\n", summary.initial_cost, summary.final_cost,
              summary.num_successful_steps, summary.num_unsuccessful_steps);
  for (const ceres::IterationSummary& iteration : summary.iterations) {
    std::printf("iteration %d: cost %.17g radius %.17g step %.17g\n", iteration.iteration,
                iteration.cost, iteration.trust_region_radius, iteration.step_norm);
  }
}

void Print(const char* name, const std::vector<double>& values) {
  std::printf("%s", name);
  for (const double value : values) {
    std::printf(" %.17g", value);
  }
  std::printf("\n");
}

void SolveAndPrint(const ceres::Solver::Options& options, ceres::Problem* problem,
                   const std::vector<double>& x) {
  ceres::Solver::Summary summary;
  ceres::Solve(options, problem, &summary);
  Print(summary);
  Print("x", x);
}

void FreeFunction() {
  Curve curve;
  ceres::Problem problem;
  curve.AddTo(&problem);
  SolveAndPrint(plain::CurveOptions(), &problem, curve.x);
}

void Member() {
  Curve curve;
  ceres::Problem problem;
  curve.AddTo(&problem);
  ceres::Solver solver;
  ceres::Solver::Summary summary;
  solver.Solve(plain::CurveOptions(), &problem, &summary);
  Print(summary);
  Print("x", curve.x);
}

// By way of the virtual table, which is in Ceres's library.
void Virtual() {
  Curve curve;
  ceres::Problem problem;
  curve.AddTo(&problem);
  const std::unique_ptr<ceres::Solver> solver(new ceres::Solver);
  ceres::Solver::Summary summary;
  solver->Solve(plain::CurveOptions(), &problem, &summary);
  Print(summary);
  Print("x", curve.x);
}

// Six unknowns on four residuals, or five while the last is constant and one on a sphere.
struct Mixed {
  template <typename T>
  bool operator()(const T* a, const T* b, const T* c, T* residuals) const {
    residuals[0] = a[0] + 2.0 * b[0] - c[0];
    residuals[1] = a[1] * b[1] + c[0];
    residuals[2] = a[2] - b[0] * b[1] + 0.5 * c[0];
    residuals[3] = 3.0 * b[1] - a[0] * a[2];
    return true;
  }
};

int LineResidual(void* data, double** parameters, double* residuals, double** jacobians) {
  const double* point = static_cast<double*>(data);
  residuals[0] = point[1] - std::exp(parameters[0][0] * point[0]);
  if (jacobians != nullptr && jacobians[0] != nullptr) {
    jacobians[0][0] = -point[0] * std::exp(parameters[0][0] * point[0]);
  }
  return 1;
}

void CApi() {
  double points[4][2] = {{0.0, 1.1}, {1.0, 1.3}, {2.0, 1.9}, {3.0, 2.4}};
  double x = 0.0;
  double* blocks[1] = {&x};
  int sizes[1] = {1};
  ceres_problem_t* problem = ceres_create_problem();
  for (auto& point : points) {
    ceres_problem_add_residual_block(problem, LineResidual, point, nullptr, nullptr, 1, 1, sizes,
                                     blocks);
  }
  ceres_solve(problem);
  ceres_free_problem(problem);
  Print("x", {x});
}

class MyProblem : public ceres::Problem {
 public:
  MyProblem() = default;
  explicit MyProblem(const Options& options) : ceres::Problem(options) {}
};

void Derived() {
  Curve curve;
  MyProblem problem;
  curve.AddTo(&problem);
  SolveAndPrint(plain::CurveOptions(), &problem, curve.x);
}

class CountingCallback : public ceres::EvaluationCallback {
 public:
  void PrepareForEvaluation(bool evaluate_jacobians, bool new_evaluation_point) override {
    ++count;
    static_cast<void>(evaluate_jacobians);
    static_cast<void>(new_evaluation_point);
  }
  int count = 0;
};

void PrintWithCallback(ceres::Problem* problem, Curve* curve, const CountingCallback& callback) {
  SolveAndPrint(plain::CurveOptions(), problem, curve->x);
  std::printf("prepared %d times\n", callback.count);
}

void EvaluationCallback() {
  Curve curve;
  CountingCallback callback;
  ceres::Problem::Options options;
  options.evaluation_callback = &callback;
  MyProblem problem(options);
  curve.AddTo(&problem);
  PrintWithCallback(&problem, &curve, callback);
}

// The callback goes with the Problem, and the address it leaves serves another Problem.
void MovedProblem() {
  Curve curve;
  CountingCallback callback;
  ceres::Problem::Options options;
  options.evaluation_callback = &callback;
  ceres::Problem first(options);
  curve.AddTo(&first);
  ceres::Problem second(std::move(first));
  PrintWithCallback(&second, &curve, callback);
  ceres::Problem third;
  third = std::move(second);
  curve.Restart();
  PrintWithCallback(&third, &curve, callback);
  second = ceres::Problem();
  Curve other;
  other.AddTo(&second);
  SolveAndPrint(plain::CurveOptions(), &second, other.x);
  std::printf("prepared %d times\n", callback.count);
}

// A living problem: residual blocks come and go, values move, between solves.
void Living() {
  ceres::Problem::Options problem_options;
  problem_options.enable_fast_removal = true;
  ceres::Problem problem(problem_options);
  plain::Chain chain;
  for (int frame = 0; frame < 12; ++frame) {
    chain.Grow(&problem);
    ceres::Solver::Summary summary;
    ceres::Solve(plain::ChainOptions(), &problem, &summary);
    std::printf("frame %d: cost %.12g, %s\n", frame, summary.final_cost,
                summary.IsSolutionUsable() ? "usable" : "not usable");
  }
  Print("x", chain.Values());
}

// A large problem; of its values the costs tell enough.
void LargeProblem() {
  plain::Photos photos;
  ceres::Problem problem;
  photos.AddTo(&problem);
  ceres::Solver::Summary summary;
  ceres::Solve(plain::PhotosOptions(), &problem, &summary);
  Print(summary);
}

void LineSearch() {
  Curve curve;
  ceres::Problem problem;
  curve.AddTo(&problem);
  ceres::Solver::Options options = plain::CurveOptions();
  options.minimizer_type = ceres::LINE_SEARCH;
  SolveAndPrint(options, &problem, curve.x);
}

// Of three blocks, one of them on a sphere, one constant, in all of Ceres's ways.
void Covariances() {
  Curve curve;
  ceres::Problem problem;
  curve.AddTo(&problem);
  ceres::Solver::Summary summary;
  ceres::Solve(plain::CurveOptions(), &problem, &summary);
  double first[3] = {1.0, 2.0, 2.0};
  double second[2] = {1.0, 2.0};
  double held = 4.0;
  problem.AddParameterBlock(first, 3, new ceres::SphereManifold<3>);
  problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Mixed, 4, 3, 2, 1>(new Mixed),
                           new ceres::HuberLoss(1.0), first, second, &held);
  problem.SetParameterBlockConstant(&held);
  ceres::Covariance covariance{ceres::Covariance::Options()};
  std::vector<double> values(64, 0.0);
  std::printf("%d\n", covariance.Compute({{first, second}, {second, second}}, &problem) ? 1 : 0);
  std::printf("%d", covariance.GetCovarianceBlock(first, second, values.data()) ? 1 : 0);
  Print(" block", values);
  std::printf("%d",
              covariance.GetCovarianceBlockInTangentSpace(second, first, values.data()) ? 1 : 0);
  Print(" tangent block, turned", values);
  std::printf("%d", covariance.GetCovarianceBlock(first, &held, values.data()) ? 1 : 0);
  Print(" block of a constant", values);
  const std::vector<const double*> blocks = {second, &held, first};
  std::printf("%d\n", covariance.Compute(blocks, &problem) ? 1 : 0);
  std::printf("%d", covariance.GetCovarianceMatrix(blocks, values.data()) ? 1 : 0);
  Print(" matrix", values);
  std::printf("%d", covariance.GetCovarianceMatrixInTangentSpace(blocks, values.data()) ? 1 : 0);
  Print(" tangent matrix", values);
}

// Of a problem that leaves directions open, which both tell in their own words.
void OpenCovariance() {
  Curve curve;
  ceres::Problem problem;
  curve.AddTo(&problem);
  double blocks[6] = {1.0, 2.0, 2.0, 1.0, 2.0, 4.0};
  problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Mixed, 4, 3, 2, 1>(new Mixed), nullptr,
                           blocks, blocks + 3, blocks + 5);
  ceres::Covariance covariance{ceres::Covariance::Options()};
  std::printf("%d\n", covariance.Compute(std::vector<const double*>{blocks}, &problem) ? 1 : 0);
}

// One object computes twice: for a problem that is left to Ceres, as a value that is not finite has
// it, and in vain. Asked then it ends the process.
void CovarianceAfterFailure() {
  double blocks[6] = {1.0, 2.0, 2.0, 1.0, 2.0, 4.0};
  double nowhere = std::numeric_limits<double>::infinity();
  ceres::Problem closed, open;
  for (ceres::Problem* const problem : {&closed, &open}) {
    problem->AddResidualBlock(new ceres::AutoDiffCostFunction<Mixed, 4, 3, 2, 1>(new Mixed),
                              nullptr, blocks, blocks + 3, blocks + 5);
  }
  closed.SetParameterBlockConstant(blocks + 3);
  closed.SetParameterBlockConstant(blocks + 5);
  closed.AddParameterBlock(&nowhere, 1);
  ceres::Covariance covariance{ceres::Covariance::Options()};
  const std::vector<const double*> wanted = {blocks};
  double values[9] = {};
  for (ceres::Problem* const problem : {&closed, &open}) {
    std::printf("%d\n", covariance.Compute(wanted, problem) ? 1 : 0);
    std::fflush(stdout);
    std::printf("%d\n", covariance.GetCovarianceBlock(blocks, blocks, values) ? 1 : 0);
    std::fflush(stdout);
  }
}

// By a function of Ceres's own, as a module calls it that does not find anybody in front of Ceres.
void SetBound(ceres::Problem* problem, double* values, const char* symbol, double bound) {
  void* const ceres = dlopen(INCERES_CERES_SONAME, RTLD_LAZY | RTLD_NOLOAD);
  const auto set = reinterpret_cast<void (*)(ceres::Problem*, double*, int, double)>(
      ceres != nullptr ? dlsym(ceres, symbol) : nullptr);
  if (set != nullptr) {
    set(problem, values, 1, bound);
  }
}

void BoundBehind() {
  Curve curve;
  ceres::Problem problem;
  curve.AddTo(&problem);
  SetBound(&problem, curve.x.data(), "_ZN5ceres7Problem22SetParameterLowerBoundEPdid", -0.01);
  SetBound(&problem, curve.x.data(), "_ZN5ceres7Problem22SetParameterUpperBoundEPdid", 0.01);
  SolveAndPrint(plain::CurveOptions(), &problem, curve.x);
}

constexpr std::pair<const char*, void (*)()> kWays[] = {
    {"covariance", Covariances},
    {"open_covariance", OpenCovariance},
    {"covariance_after_failure", CovarianceAfterFailure},
    {"bound_behind", BoundBehind},
    {"free", FreeFunction},
    {"member", Member},
    {"virtual", Virtual},
    {"c_api", CApi},
    {"derived", Derived},
    {"evaluation_callback", EvaluationCallback},
    {"moved", MovedProblem},
    {"living", Living},
    {"line_search", LineSearch},
    {"large", LargeProblem},
};

}  // namespace

int SolveInWay(const char* way) {
  for (const auto& [name, run] : kWays) {
    if (std::strcmp(way, name) == 0) {
      run();
      std::fflush(stdout);
      const auto num_solves =
          reinterpret_cast<long long (*)()>(dlsym(RTLD_DEFAULT, "inceres_dropin_num_solves"));
      if (num_solves != nullptr) {
        std::fprintf(stderr, "inceres solved %lld times\n", num_solves());
      }
      return 0;
    }
  }
  std::fprintf(stderr, "there is no way \"%s\" of solving\n", way);
  return 2;
}
