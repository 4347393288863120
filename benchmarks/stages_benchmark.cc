// The stages of a solve of Ladybug-49, on one thread, as the solver runs them: with the flops and
// the bytes that the mathematics asks for, and the share of the machine's peak. Where the file is
// missing (INCERES_DATA_DIR, ../shared/data) a simulated street of its size stands in; every report
// says by its label which of the two it is, and compare_runs.py compares like with like.
//
// Of H and S one triangle is counted, and of their diagonal blocks the same: a landmark block of 3
// is formed whole, what is above the diagonal of the others' last quads too, uncounted.
//
//   build/bin/stages_benchmark

#include <memory>
#include <string>
#include <vector>

#include <Eigen/CholmodSupport>
#include <benchmark/benchmark.h>

#include "benchmarks/roofline.h"
#include "inceres/io/bal.h"
#include "inceres/problem/ambient_family.h"
#include "linear/dense_cholesky.h"
#include "linear/sparse_cholesky.h"
#include "linearize/robustify.h"
#include "linearize/row_products.h"
#include "schur/elimination.h"
#include "support/core_pipeline.h"
#include "support/test_data.h"
#include "tools/problems/problem_source.h"
#include "tools/sim/street_scene.h"

namespace inceres::bench {
namespace {

using namespace internal;  // NOLINT(google-build-using-namespace): benchmarks of internal parts

// A problem with all parts of the core up to the elimination, linearized at its start.
struct Linearized {
  explicit Linearized(const BalProblem& problem) {
    if (tools::BalSource(problem).MakeGraph({}, &graph).ok()) {
      core = std::make_unique<test::CorePipeline>(*graph);
      elimination = std::make_unique<Elimination>(core->evaluator, core->incidences, core->plans,
                                                  core->hessian);
      for (int j = 0; j < core->layout.size(); ++j) {
        damping.push_back(1e-4 * core->hessian.diagonal()[static_cast<std::size_t>(j)] + 1e-6);
      }
    }
  }
  bool ok() const { return core != nullptr && core->status.ok(); }
  double num_factors() const { return graph->NumFactors(0); }
  const double* LandmarkDamping() const { return damping.data() + core->layout.frame_size(); }
  std::vector<double> Step() const {
    return std::vector<double>(static_cast<std::size_t>(core->layout.size()), 1e-3);
  }

  std::unique_ptr<FactorGraph> graph;
  std::unique_ptr<test::CorePipeline> core;
  std::unique_ptr<Elimination> elimination;
  std::vector<double> damping;
};

constexpr double kCamera = 9.0;
constexpr double kPoint = 3.0;
constexpr double kRows = 2.0;
constexpr double kEntries = kRows * (kCamera + kPoint);  // of one factor's Jacobian

BalProblem Street(const std::string& preset) {
  StreetSceneOptions options;
  StreetScene scene;
  const bool fine =
      GetStreetScenePreset(preset, &options).ok() && GenerateStreetScene(options, &scene).ok();
  return fine ? scene.problem : BalProblem();
}

// Ladybug-49, or what stands in for it.
struct LadybugProblem {
  LadybugProblem() {
    const std::string path = test::FindData("bal/problem-49-7776-pre.txt");
    if (path.empty() || !ReadBal(path, &problem).ok()) {
      problem = Street("ladybug-like");
      name = "generated street";
    }
  }

  BalProblem problem;
  const char* name = "Ladybug-49";
};

const LadybugProblem& LadybugOrStreet() {
  static const LadybugProblem problem;
  return problem;
}

Linearized& Ladybug() {
  static Linearized problem(LadybugOrStreet().problem);
  return problem;
}

template <typename Run>
void Measure(benchmark::State& state, double flops, double bytes, const Run& run) {
  if (!Ladybug().ok()) {
    state.SkipWithError("the scene could not be generated");
    return;
  }
  state.SetLabel(LadybugOrStreet().name);
  for (auto _ : state) {
    run();
  }
  CountWork(state, flops, bytes);
}

// Residuals alone. The arithmetic is that of the camera model, about 60 flops a factor.
void BM_EvaluateResiduals(benchmark::State& state) {
  double cost = 0.0;
  Evaluator& evaluator = Ladybug().core->evaluator;
  Measure(state, 60.0 * Ladybug().num_factors(), 8.0 * Ladybug().num_factors() * (kRows + kPoint),
          [&] { benchmark::DoNotOptimize(evaluator.EvaluateCandidateCost(&cost).ok()); });
}
BENCHMARK(BM_EvaluateResiduals)->Unit(benchmark::kMicrosecond);

// Residuals and tangent Jacobians: about 300 flops a factor.
void BM_EvaluateJacobians(benchmark::State& state) {
  double cost = 0.0;
  Evaluator& evaluator = Ladybug().core->evaluator;
  Measure(
      state, 300.0 * Ladybug().num_factors(),
      8.0 * Ladybug().num_factors() * (kRows + kPoint + kEntries), [&] {
        benchmark::DoNotOptimize(evaluator.EvaluateJacobians(/*known_point=*/false, &cost).ok());
      });
}
BENCHMARK(BM_EvaluateJacobians)->Unit(benchmark::kMicrosecond);

void BM_AccumulateHessian(benchmark::State& state) {
  Hessian& hessian = Ladybug().core->hessian;
  const double products = kRows * (Triangle(kCamera) + Triangle(kPoint) + kCamera + kPoint);
  Measure(state, 2.0 * products * Ladybug().num_factors(),
          8.0 * (kEntries + kRows) * Ladybug().num_factors(), [&] { hessian.Accumulate(); });
}
BENCHMARK(BM_AccumulateHessian)->Unit(benchmark::kMicrosecond);

// Y of all landmarks, S and b: the products of S are most of it.
void BM_Eliminate(benchmark::State& state) {
  Linearized& ladybug = Ladybug();
  const auto products = static_cast<double>(ladybug.core->plans.schur.terms.size());
  const double diagonal = ladybug.num_factors();  // a camera sees a point once
  const double entries = (products - diagonal) * kCamera * kCamera + diagonal * Triangle(kCamera);
  const double flops =
      2.0 * (entries * kPoint + ladybug.num_factors() * kPoint * (kRows * kCamera + 12.0));
  const double bytes = 8.0 * (ladybug.num_factors() * (kEntries + kPoint * kCamera) +
                              static_cast<double>(ladybug.core->plans.pattern.value_begin.back()));
  Measure(state, flops, bytes, [&] {
    benchmark::DoNotOptimize(ladybug.elimination->Eliminate(ladybug.LandmarkDamping()).ok());
  });
  state.counters["block_products"] = products;
}
BENCHMARK(BM_Eliminate)->Unit(benchmark::kMicrosecond);

void BM_BackSubstitute(benchmark::State& state) {
  Linearized& ladybug = Ladybug();
  if (!ladybug.ok() || !ladybug.elimination->Eliminate(ladybug.LandmarkDamping()).ok()) {
    state.SkipWithError("the landmarks could not be eliminated");
    return;
  }
  std::vector<double> step = ladybug.Step();
  // Ladybug's landmarks are several chunks: from the Jacobians, not from Y.
  Measure(state, 2.0 * kEntries * ladybug.num_factors(), 8.0 * kEntries * ladybug.num_factors(),
          [&] {
            ladybug.elimination->BackSubstitute(step.data(),
                                                step.data() + ladybug.core->layout.frame_size());
          });
}
BENCHMARK(BM_BackSubstitute)->Unit(benchmark::kMicrosecond);

void BM_PredictDecrease(benchmark::State& state) {
  Linearized& ladybug = Ladybug();
  const std::vector<double> step = ladybug.Step();
  JacobianProduct product(ladybug.core->evaluator);
  Measure(state, 2.0 * kEntries * ladybug.num_factors(),
          8.0 * (kEntries + kRows) * ladybug.num_factors(),
          [&] { benchmark::DoNotOptimize(product.Multiply(step.data()).model_decrease); });
}
BENCHMARK(BM_PredictDecrease)->Unit(benchmark::kMicrosecond);

template <typename Solver>
void MeasureFactorization(benchmark::State& state, Linearized* problem, Solver* solver) {
  if (!problem->ok() || !problem->elimination->Eliminate(problem->LandmarkDamping()).ok() ||
      !solver->Analyze(ReducedMatrix(problem->core->plans.pattern, nullptr, nullptr)).ok()) {
    state.SkipWithError("the reduced system could not be formed");
    return;
  }
  for (auto _ : state) {
    benchmark::DoNotOptimize(solver
                                 ->Factorize({problem->core->plans.pattern,
                                              problem->elimination->S(), problem->damping.data()},
                                             {})
                                 .ok());
  }
  CountWork(state, solver->PredictedFlops(),
            8.0 * static_cast<double>(problem->core->plans.pattern.value_begin.back()));
  state.counters["unknowns"] = problem->core->plans.pattern.size();
}

void BM_DenseCholesky(benchmark::State& state) {
  DenseCholesky solver(Ladybug().core->executor);
  state.SetLabel(LadybugOrStreet().name);
  MeasureFactorization(state, &Ladybug(), &solver);
}
BENCHMARK(BM_DenseCholesky)->Unit(benchmark::kMicrosecond);

// A street where most pairs of cameras see nothing in common.
Linearized& Path() {
  static Linearized path(Street("path-1000"));
  return path;
}

void BM_SparseCholesky(benchmark::State& state) {
  SparseCholesky solver(Path().core->executor);
  MeasureFactorization(state, &Path(), &solver);
}
BENCHMARK(BM_SparseCholesky)->Unit(benchmark::kMicrosecond);

Eigen::SparseMatrix<double> LowerTriangle(const BlockPattern& pattern, const double* values,
                                          const std::vector<double>& diagonal) {
  std::vector<Eigen::Triplet<double>> entries;
  for (int i = 0; i < pattern.num_blocks(); ++i) {
    for (int k = pattern.row_begin[i]; k < pattern.row_begin[i + 1]; ++k) {
      const double* value = values + pattern.value_begin[k];
      for (int row = pattern.offsets[i]; row < pattern.offsets[i + 1]; ++row) {
        for (int column = pattern.offsets[pattern.columns[k]];
             column < pattern.offsets[pattern.columns[k] + 1]; ++column) {
          entries.emplace_back(
              row, column,
              *value++ + (row == column ? diagonal[static_cast<std::size_t>(row)] : 0.0));
        }
      }
    }
  }
  Eigen::SparseMatrix<double> S(pattern.size(), pattern.size());
  S.setFromTriplets(entries.begin(), entries.end());
  return S.triangularView<Eigen::Lower>();
}

// CHOLMOD on the same S, as Ceres's SPARSE_SCHUR runs it. It asks OpenMP for four threads whatever
// the machine has; with OMP_MAX_ACTIVE_LEVELS=0 it stays on one.
void BM_Cholmod(benchmark::State& state) {
  Linearized& path = Path();
  if (!path.ok() || !path.elimination->Eliminate(path.LandmarkDamping()).ok()) {
    state.SkipWithError("the reduced system could not be formed");
    return;
  }
  const Eigen::SparseMatrix<double> S =
      LowerTriangle(path.core->plans.pattern, path.elimination->S(), path.damping);
  Eigen::CholmodDecomposition<Eigen::SparseMatrix<double>> factor;
  factor.analyzePattern(S);
  for (auto _ : state) {
    factor.factorize(S);
  }
  if (factor.info() != Eigen::Success) {
    state.SkipWithError("CHOLMOD could not factor the reduced system");
  }
}
BENCHMARK(BM_Cholmod)->Unit(benchmark::kMicrosecond);

// The ambient Jacobian of a pose (quaternion and translation) into its tangent space, or copied
// where it is the same.
void BM_ProjectToTangentSpace(benchmark::State& state) {
  constexpr int kAmbient = 7;
  constexpr int kTangent = 6;
  constexpr int kStride = 8;
  constexpr int kResidual = 2;
  TangentMap map;
  map.kind = state.range(0) == 0 ? TangentMap::Kind::kIdentity : TangentMap::Kind::kDense;
  map.ambient_size = map.kind == TangentMap::Kind::kIdentity ? kTangent : kAmbient;
  map.tangent_size = kTangent;
  const std::vector<double> M(kAmbient * kTangent, 0.5);
  map.plus_jacobian = M.data();
  const std::vector<double> J(kResidual * kAmbient, 0.25);
  double out[kResidual * kStride] = {};
  for (auto _ : state) {
    ProjectToTangentSpace(map, J.data(), kResidual, out, kStride);
    benchmark::DoNotOptimize(out);
  }
  const double flops =
      map.kind == TangentMap::Kind::kDense ? 2.0 * kResidual * kAmbient * kTangent : 0.0;
  CountWork(
      state, flops,
      8.0 * (kResidual * (map.ambient_size + kTangent) + (flops > 0.0 ? kAmbient * kTangent : 0)));
  state.SetLabel(flops > 0.0 ? "dense" : "identity");
}
BENCHMARK(BM_ProjectToTangentSpace)->Arg(0)->Arg(1);

// A loss that weighs every factor by almost one: its Jacobians are rewritten, and stay of about the
// same size however often. With a positive second derivative, large enough not to be rounded away,
// they also get the second-order term.
class AlmostSquare final : public Loss {
 public:
  explicit AlmostSquare(double second_derivative) : second_derivative_(second_derivative) {}
  void Evaluate(double s, double rho[3]) const override {
    rho[0] = s;
    rho[1] = 1.0 + 1e-15;
    rho[2] = second_derivative_;
  }

 private:
  double second_derivative_;
};

void MeasureRobustification(benchmark::State& state, double second_derivative,
                            double flops_an_entry) {
  Linearized& ladybug = Ladybug();
  Linearization& cache = ladybug.core->evaluator.families()[0];
  const AlmostSquare loss(second_derivative);
  Measure(state, (flops_an_entry * kEntries + 2.0 * kRows) * ladybug.num_factors(),
          16.0 * (kEntries + kRows) * ladybug.num_factors(), [&] {
            for (int i = 0; i < cache.num_factors; ++i) {
              double* const f = cache.residuals.data() + std::ptrdiff_t{2} * i;
              const LossValue value(&loss, f, 2);
              RobustifyFactor(value, 2, 2, cache.slots.data(), i,
                              cache.tangent_offsets.data() + std::ptrdiff_t{2} * i,
                              LossCurvature::kPositive, f);
              benchmark::DoNotOptimize(value);
            }
          });
}

// ρ'' ≤ 0, as of all losses that let outliers go.
void BM_Robustify(benchmark::State& state) {
  MeasureRobustification(state, -1e-15, 1.0);
}
BENCHMARK(BM_Robustify)->Unit(benchmark::kMicrosecond);

void BM_RobustifySecondOrder(benchmark::State& state) {
  MeasureRobustification(state, 1e-12, 5.0);
}
BENCHMARK(BM_RobustifySecondOrder)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace inceres::bench
