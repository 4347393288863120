// Ways to solve for a step, predicted and measured: what the constants of trust_region/step_way.cc
// are calibrated by, and how good the automatic choice is.
//
//   build/bin/step_ways [--steps N] [--repeats N] FILE...    at most fifty steps, once, unless told
//
// FILE: a BAL problem, as bal_generate writes it. Each is solved by built-in factors on one thread,
// each way in turn, as often as told, until it converges: ways whose steps are better take fewer.
// Seconds are processor time of the steps, H and set-up apart, the lowest of the repeats.
// Predictions are in flops of the dense Cholesky, whose time is taken first; one with > is a lower
// bound, for another way is below it, one with < an upper one. Under each table what the automatic
// choice takes, over the best of the ways; at the end the geometric mean of predicted over
// measured, by way. Exit code: 0, 1 if the choice was above 1.1 somewhere, 2 if a problem could not
// be read or solved.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "inceres/io/bal_graph.h"
#include "inceres/solver/solver.h"
#include "linear/pattern_rows.h"
#include "linear/reduced_prediction.h"
#include "linear/select_solver.h"
#include "schur/scene_shape.h"
#include "trust_region/step_way.h"

namespace {

using inceres::FactorGraph;
using inceres::LinearModelKind;
using inceres::ReducedSolverKind;
using inceres::SolverOptions;
using inceres::Summary;
using inceres::internal::Executor;
using inceres::internal::kNumStepWays;
using inceres::internal::StepCosts;
using inceres::internal::StepWay;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kLimit = 1.1;
constexpr std::array<const char*, kNumStepWays> kNames = {
    "factor", "blocks, without S", "blocks, on S", "two levels, without S", "two levels, on S"};

struct Arguments {
  int num_steps = 50;
  int num_repeats = 1;
  std::vector<std::string> files;
};

// Of this process, which has one thread.
double ProcessorSeconds() {
  return static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

// Of the dense Cholesky of a full system of 1,503 unknowns, the lowest of twenty.
double SecondsPerFlop() {
  constexpr int kBlocks = 167, kBlockSize = 9, kRounds = 20;
  std::vector<int> offsets, columns;
  for (int i = 0; i <= kBlocks; ++i) {
    offsets.push_back(i * kBlockSize);
  }
  inceres::BlockPattern pattern = inceres::internal::PatternWithoutBlocks(offsets);
  for (int i = 0; i < kBlocks; ++i) {
    columns.push_back(i);
    inceres::internal::AppendRow(columns, &pattern);
  }
  const std::vector<double> values(static_cast<std::size_t>(pattern.value_begin.back()), 1e-3);
  const std::vector<double> diagonal(static_cast<std::size_t>(pattern.size()), 10.0);
  const Executor executor(1);
  inceres::Status status;
  const auto solver =
      MakeReducedSolver(ReducedSolverKind::kDense, nullptr, pattern, executor, &status);
  double seconds = kInfinity;
  for (int round = 0; round < kRounds && status.ok(); ++round) {
    const double start = ProcessorSeconds();
    status = solver->Factorize({pattern, values.data(), diagonal.data()}, {});
    seconds = std::min(seconds, ProcessorSeconds() - start);
  }
  return seconds / inceres::internal::PredictFullSystem(pattern.size()).cost;
}

struct Measured {
  double seconds = kInfinity;  // of all steps
  double num_steps = 0.0;
  double iterations = 0.0;  // of conjugate gradients
  double cost = 0.0;
  std::string solver;
};

SolverOptions OptionsOf(StepWay way, const Arguments& arguments) {
  SolverOptions options;
  options.max_num_iterations = arguments.num_steps;
  if (way != StepWay::kFactor) {
    options.linear_model = LinearModelKind::kIterativeSchur;
    options.conjugate_gradients = inceres::internal::OptionsOf(way, options.conjugate_gradients);
  }
  return options;
}

// False if it failed.
bool Measure(const SolverOptions& options, const FactorGraph& graph, Measured* measured) {
  FactorGraph copy = graph;
  const double start = ProcessorSeconds();
  const Summary summary = inceres::Solve(options, &copy);
  const double processor_seconds = ProcessorSeconds() - start;
  if (!summary.IsSolutionUsable()) {
    std::fprintf(stderr, "%s\n", summary.message.c_str());
    return false;
  }
  // Stages are told in time that passes; of the processor's they have the same share.
  const inceres::StageSeconds& stages = summary.seconds;
  const double share =
      (stages.elimination + stages.factorization + stages.back_substitution) / stages.total;
  measured->seconds = std::min(measured->seconds, share * processor_seconds);
  measured->num_steps = summary.work.num_linear_solves;
  measured->iterations = static_cast<double>(summary.work.num_conjugate_gradients);
  measured->cost = summary.final_cost;
  measured->solver = summary.reduced_solver;
  return true;
}

// And prints what they are predicted from.
StepCosts Predict(const std::string& file, const FactorGraph& graph) {
  const Executor executor(1);
  const inceres::internal::Layout layout(graph, /*eliminate_landmarks=*/true);
  const inceres::internal::Evaluator evaluator(graph, layout, executor);
  const inceres::internal::LandmarkIncidences incidences(evaluator);
  const inceres::internal::SceneShape scene(evaluator, incidences);
  const inceres::internal::SceneShape::Sample sample = scene.TakeSample();
  std::printf(
      "\n%s: %.0f unknowns, fill %.3f, length %d; millions of numbers that a product reads %.3f, "
      "of products %.3f, of their flops %.1f; writes a product %.3f\n",
      file.c_str(), scene.size(), sample.fill, scene.FindExtent().length,
      1e-6 * scene.numbers_read(), 1e-6 * scene.num_products(), 1e-6 * scene.product_flops(),
      sample.writes_per_product);
  return PredictSteps(evaluator);
}

// Sums of logarithms of predicted over measured.
struct Bias {
  double sum = 0.0;
  int count = 0;
};

struct Problem {
  std::array<Measured, kNumStepWays> ways;
  Measured automatic;
};

bool MeasureAll(const FactorGraph& graph, const Arguments& arguments, Problem* problem) {
  for (int round = 0; round < arguments.num_repeats; ++round) {
    for (int way = 0; way < kNumStepWays; ++way) {
      if (!Measure(OptionsOf(static_cast<StepWay>(way), arguments), graph,
                   &problem->ways[static_cast<std::size_t>(way)])) {
        return false;
      }
    }
    SolverOptions automatic = OptionsOf(StepWay::kFactor, arguments);
    automatic.reduced_solver = ReducedSolverKind::kAutomaticInexact;
    if (!Measure(automatic, graph, &problem->automatic)) {
      return false;
    }
  }
  return true;
}

// What the automatic choice takes over the best of the ways.
double Print(const StepCosts& predicted, const Problem& problem, double seconds_per_flop,
             std::array<Bias, kNumStepWays>* biases) {
  const double least = *std::min_element(predicted.of.begin(), predicted.of.end());
  double best = kInfinity;
  std::printf(
      "\n| way | predicted, s a step | measured | predicted over measured | iterations a "
      "step | steps | s | final cost |\n|---|---|---|---|---|---|---|---|\n");
  for (std::size_t k = 0; k < problem.ways.size(); ++k) {
    const Measured& measured = problem.ways[k];
    const double cost = predicted.of[k] * seconds_per_flop;
    const double a_step = measured.seconds / measured.num_steps;
    const bool is_bound =
        k == static_cast<std::size_t>(StepWay::kFactor) && predicted.factor_is_bound;
    best = std::min(best, measured.seconds);
    std::printf("| %s | %s%.4f | %.4f | %.2f | %.1f | %.0f | %.3f | %.6g |\n", kNames[k],
                is_bound ? (predicted.of[k] > least ? ">" : "<") : "", cost, a_step, cost / a_step,
                measured.iterations / measured.num_steps, measured.num_steps, measured.seconds,
                measured.cost);
    if (!is_bound && std::isfinite(cost)) {
      (*biases)[k].sum += std::log(cost / a_step);
      ++(*biases)[k].count;
    }
  }
  // Where it goes one of the ways it is that solve, bit for bit, and was measured twice.
  Measured automatic = problem.automatic;
  for (const Measured& way : problem.ways) {
    if (way.solver == automatic.solver && way.cost == automatic.cost) {
      automatic.seconds = std::min(automatic.seconds, way.seconds);
      best = std::min(best, automatic.seconds);
    }
  }
  std::printf("\nautomatic: %s, %.0f steps, %.3f s, %.2f of the best, final cost %.6g\n",
              automatic.solver.c_str(), automatic.num_steps, automatic.seconds,
              automatic.seconds / best, automatic.cost);
  std::fflush(stdout);
  return automatic.seconds / best;
}

bool Read(int argc, char** argv, Arguments* arguments) {
  for (int k = 1; k < argc; ++k) {
    const bool has_value = k + 1 < argc;
    if (std::strcmp(argv[k], "--steps") == 0 && has_value) {
      arguments->num_steps = std::atoi(argv[++k]);
    } else if (std::strcmp(argv[k], "--repeats") == 0 && has_value) {
      arguments->num_repeats = std::atoi(argv[++k]);
    } else {
      arguments->files.emplace_back(argv[k]);
    }
  }
  return !arguments->files.empty() && arguments->num_steps > 0 && arguments->num_repeats > 0;
}

}  // namespace

int main(int argc, char** argv) {
  constexpr int kFailed = 2;
  Arguments arguments;
  if (!Read(argc, argv, &arguments)) {
    std::fprintf(stderr, "usage: step_ways [--steps N] [--repeats N] FILE...\n");
    return kFailed;
  }
  const double seconds_per_flop = SecondsPerFlop();
  std::printf("dense Cholesky: %.1f GFlop/s\n", 1e-9 / seconds_per_flop);
  std::array<Bias, kNumStepWays> biases;
  double largest = 0.0;
  for (const std::string& file : arguments.files) {
    FactorGraph graph;
    const inceres::Status read = inceres::ReadBal(file, &graph);
    Problem problem;
    if (!read.ok() || !MeasureAll(graph, arguments, &problem)) {
      std::fprintf(stderr, "%s: %s\n", file.c_str(), read.message.c_str());
      return kFailed;
    }
    largest = std::max(largest, Print(Predict(file, graph), problem, seconds_per_flop, &biases));
  }
  std::printf("\n| way | predicted over measured, geometric mean |\n|---|---|\n");
  for (std::size_t k = 0; k < biases.size(); ++k) {
    std::printf("| %s | %.2f |\n", kNames[k],
                std::exp(biases[k].sum / std::max(1, biases[k].count)));
  }
  return largest <= kLimit ? 0 : 1;
}
