#include "tools/pose_graph/pose_graph_run.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

#include "inceres/io/pose_graph_start.h"
#include "inceres/solver/solver.h"
#include "src/base/stopwatch.h"
#include "tools/problems/wrong_loops.h"

namespace inceres::tools {
namespace {

// Of the threshold of an inlier: a wrong loop's squared error is more than this where poses belong.
constexpr double kWrongness = 4.0;
// The solution without wrong loops is sought to the end.
constexpr double kReferenceTolerance = 1e-12;

Status StartPoses(PoseGraphStart start, int num_threads, PoseGraph* graph) {
  switch (start) {
    case PoseGraphStart::kFile:
      return Status::Ok();
    case PoseGraphStart::kSpanningTree:
      return StartAlongSpanningTree(graph);
    case PoseGraphStart::kChordal:
      return StartByChordalRelaxation(graph, num_threads);
  }
  return Status::Ok();
}

// The graph as factors, its first pose held if the file holds none.
Status MakeFactors(const PoseGraphPlan& plan, const PoseGraph& poses, FactorGraph* graph,
                   G2oGraph* ids) {
  Status status = AddPoseGraph(poses, plan.graph, graph, ids);
  if (status.ok() && poses.fixed.empty()) {
    graph->SetConstant(ids->poses[0], true);
  }
  return status;
}

void TakePoses(const FactorGraph& graph, const G2oGraph& ids, PoseGraph* poses) {
  for (int i = 0; i < poses->NumVertices(); ++i) {
    std::copy_n(graph.Values(ids.poses[static_cast<std::size_t>(i)]), poses->PoseSize(),
                poses->PoseData(i));
  }
}

Status Unsolved(const std::string& message) {
  return Status::Error(StatusCode::kSingular, "not solved: " + message);
}

Status SolvePlainly(const PoseGraphPlan& plan, FactorGraph* graph, PoseGraphRun* run) {
  run->solve = Solve(plan.solver, graph);
  run->initial_cost = run->solve.initial_cost;
  run->final_cost = run->solve.final_cost;
  return run->solve.IsSolutionUsable() ? Status::Ok()
                                       : Unsolved(run->solve.message + " " + run->solve.detail);
}

Status SolveRobustly(const PoseGraphPlan& plan, const G2oGraph& ids, FactorGraph* graph,
                     PoseGraphRun* run) {
  std::vector<int> suspected = run->loops;
  if (plan.suspect_all) {
    suspected.clear();
    for (int i = 0; i < static_cast<int>(run->before.edges.size()); ++i) {
      suspected.push_back(i);
    }
  }
  std::vector<FactorId> suspects;
  suspects.reserve(suspected.size());
  for (const int edge : suspected) {
    suspects.push_back(ids.EdgeFactor(edge));
  }
  GncOptions options = plan.gnc_options;
  options.solver = plan.solver;
  if (plan.chordal_rounds) {
    options.start = ChordalGncStart(run->before, ids, suspected, plan.solver.num_threads);
  }
  run->gnc = SolveGnc(options, suspects, graph);
  run->initial_cost = run->gnc->initial_cost;
  run->final_cost = run->gnc->final_cost;
  if (!run->gnc->IsSolutionUsable()) {
    return Unsolved(run->gnc->message);
  }
  for (std::size_t k = 0; k < suspected.size(); ++k) {
    run->is_outlier[static_cast<std::size_t>(suspected[k])] = !run->gnc->verdicts[k].inlier;
  }
  return Status::Ok();
}

double Extent(const PoseGraph& graph) {
  double sum = 0.0;
  for (int k = 0; k < graph.dimension; ++k) {
    double low = std::numeric_limits<double>::max(), high = -low;
    for (int i = 0; i < graph.NumVertices(); ++i) {
      low = std::min(low, graph.PoseData(i)[k]);
      high = std::max(high, graph.PoseData(i)[k]);
    }
    sum += (high - low) * (high - low);
  }
  return std::sqrt(sum);
}

OutlierScore Score(const PoseGraphRun& run, const PoseGraph& reference) {
  OutlierScore score;
  for (const int edge : run.loops) {
    const bool found = run.is_outlier[static_cast<std::size_t>(edge)];
    const bool wrong = edge >= run.first_wrong_edge;
    ++(wrong ? score.num_wrong : score.num_right);
    score.num_wrong_found += wrong && found ? 1 : 0;
    score.num_right_lost += !wrong && found ? 1 : 0;
  }
  double sum = 0.0;
  for (int i = 0; i < reference.NumVertices(); ++i) {
    for (int k = 0; k < reference.dimension; ++k) {
      const double difference = run.after.PoseData(i)[k] - reference.PoseData(i)[k];
      sum += difference * difference;
    }
  }
  score.rms_difference = std::sqrt(sum / std::max(1, reference.NumVertices()));
  score.extent = Extent(reference);
  return score;
}

}  // namespace

Status WithWrongLoops(const PoseGraphPlan& plan, PoseGraph* graph, PoseGraph* reference) {
  *reference = *graph;
  if (plan.outliers == 0.0) {
    return Status::Ok();
  }
  FactorGraph factors;
  G2oGraph ids;
  Status status = MakeFactors(plan, *graph, &factors, &ids);
  if (!status.ok()) {
    return status;
  }
  SolverOptions options = plan.solver;
  options.max_num_iterations = std::max(options.max_num_iterations, 200);
  options.function_tolerance = kReferenceTolerance;
  const Summary solved = Solve(options, &factors);
  if (!solved.IsSolutionUsable()) {
    return Unsolved("without wrong loops: " + solved.message);
  }
  TakePoses(factors, ids, reference);
  WrongLoopOptions wrong;
  wrong.fraction = plan.outliers;
  wrong.seed = plan.seed;
  wrong.least_squared_error =
      kWrongness * plan.gnc_options.threshold_scale *
      ChiSquareQuantile(plan.gnc_options.inlier_probability, graph->TangentSize());
  return AddWrongLoops(wrong, *reference, graph);
}

PoseGraph WithoutOutliers(const PoseGraphRun& run) {
  PoseGraph kept = run.after;
  kept.edges.clear();
  for (std::size_t i = 0; i < run.after.edges.size(); ++i) {
    if (!run.is_outlier[i]) {
      kept.edges.push_back(run.after.edges[i]);
    }
  }
  return kept;
}

Status RunPoseGraph(const PoseGraphPlan& plan, const PoseGraph& graph, PoseGraphRun* run) {
  run->before = graph;
  run->first_wrong_edge = static_cast<int>(graph.edges.size());
  PoseGraph reference;
  Status status = WithWrongLoops(plan, &run->before, &reference);
  if (!status.ok()) {
    return status;
  }
  run->loops = LoopEdges(run->before);
  run->is_outlier.assign(run->before.edges.size(), false);
  const double start = internal::NowInSeconds();
  status = StartPoses(plan.start, plan.solver.num_threads, &run->before);
  FactorGraph factors;
  G2oGraph ids;
  status = status.ok() ? MakeFactors(plan, run->before, &factors, &ids) : status;
  if (status.ok()) {
    status = plan.gnc ? SolveRobustly(plan, ids, &factors, run) : SolvePlainly(plan, &factors, run);
  }
  if (!status.ok()) {
    return status;
  }
  run->seconds = internal::NowInSeconds() - start;
  run->after = run->before;
  TakePoses(factors, ids, &run->after);
  if (plan.outliers > 0.0) {
    run->score = Score(*run, reference);
  }
  if (plan.certificate) {
    ChordalBound bound;
    const Status bounded = BoundChordalCost(WithoutOutliers(*run), &bound);
    run->bound_failure = bounded.message;
    run->bound = bounded.ok() ? std::optional<ChordalBound>(bound) : std::nullopt;
  }
  return status;
}

}  // namespace inceres::tools
