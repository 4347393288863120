#include "tools/pose_graph/pose_graph_report.h"

#include <algorithm>

#include "inceres/factors/relative_pose.h"
#include "src/base/formatted.h"

namespace inceres::tools {
namespace {

using internal::Formatted;

// Where nothing can move, both counts are -1, as in Ceres.
int NumIterations(const PoseGraphRun& run) {
  return run.gnc.has_value()
             ? run.gnc->num_iterations
             : std::max(0, run.solve.num_successful_steps + run.solve.num_unsuccessful_steps - 1);
}

std::string TerminationOf(const PoseGraphRun& run) {
  return ToString(run.gnc.has_value() ? run.gnc->termination : run.solve.termination);
}

std::string MessageOf(const PoseGraphRun& run) {
  return run.gnc.has_value() ? run.gnc->message : run.solve.message;
}

nlohmann::json GncJson(const PoseGraphRun& run) {
  nlohmann::json rounds = nlohmann::json::array(), outliers = nlohmann::json::array();
  for (const GncRound& round : run.gnc->rounds) {
    rounds.push_back({{"mu", round.mu},
                      {"cost", round.cost},
                      {"iterations", round.num_iterations},
                      {"num_full", round.num_full},
                      {"num_none", round.num_none}});
  }
  for (std::size_t i = 0; i < run.is_outlier.size(); ++i) {
    if (run.is_outlier[i]) {
      const PoseGraphEdge& edge = run.after.edges[i];
      outliers.push_back({{"edge", i},
                          {"from", run.after.ids[static_cast<std::size_t>(edge.from)]},
                          {"to", run.after.ids[static_cast<std::size_t>(edge.to)]}});
    }
  }
  return {{"num_suspects", run.gnc->verdicts.size()},
          {"num_outliers", run.gnc->num_outliers},
          {"rounds", rounds},
          {"outliers", outliers}};
}

}  // namespace

std::string Describe(const PoseGraphRun& run) {
  return Formatted("%d poses in %dD, %zu edges, %zu loops", run.before.NumVertices(),
                   run.before.dimension, run.before.edges.size(), run.loops.size());
}

std::vector<std::pair<std::string, std::string>> Figures(const PoseGraphRun& run) {
  std::vector<std::pair<std::string, std::string>> rows = {
      {"problem", Describe(run)},
      {"cost", Formatted("%.10e -> %.10e", run.initial_cost, run.final_cost)},
      {"iterations", std::to_string(NumIterations(run))},
      {"termination", TerminationOf(run) + ": " + MessageOf(run)}};
  rows.emplace_back("time", Formatted("%.6f s", run.seconds));
  if (run.gnc.has_value()) {
    rows.emplace_back("weighted problems", std::to_string(run.gnc->rounds.size()));
    rows.emplace_back("found to be wrong", Formatted("%d of %zu suspects", run.gnc->num_outliers,
                                                     run.gnc->verdicts.size()));
  }
  if (run.score.has_value() && !run.gnc.has_value()) {
    rows.emplace_back("wrong loops", Formatted("%d, not looked for (--gnc)", run.score->num_wrong));
  } else if (run.score.has_value()) {
    rows.emplace_back("wrong loops found",
                      Formatted("%d of %d", run.score->num_wrong_found, run.score->num_wrong));
    rows.emplace_back("right loops lost",
                      Formatted("%d of %d", run.score->num_right_lost, run.score->num_right));
  }
  if (run.score.has_value()) {
    rows.emplace_back("RMS from without them",
                      Formatted("%.6g, %.4g %% of the extent", run.score->rms_difference,
                                100.0 * run.score->rms_difference / run.score->extent));
  }
  if (run.bound.has_value()) {
    rows.emplace_back("chordal cost", Formatted("%.10e (isotropic noise)", run.bound->cost));
    rows.emplace_back("  its lower bound",
                      Formatted("%.10e, gap %.3g", run.bound->lower_bound, run.bound->gap));
    rows.emplace_back("  smallest eigenvalue", Formatted("%.3e", run.bound->smallest_eigenvalue));
    rows.emplace_back("  rotations apart",
                      Formatted("%.3g rad at most, from this solution", run.bound->largest_angle));
  }
  return rows;
}

nlohmann::json PoseGraphJson(const std::string& input, const PoseGraphPlan& plan,
                             const PoseGraphRun& run) {
  nlohmann::json json = {{"input", input},
                         {"dimension", run.before.dimension},
                         {"num_poses", run.before.NumVertices()},
                         {"num_edges", run.before.edges.size()},
                         {"num_loops", run.loops.size()},
                         {"convention", ToString(plan.graph.convention)},
                         {"threads", plan.solver.num_threads},
                         {"initial_cost", run.initial_cost},
                         {"final_cost", run.final_cost},
                         {"iterations", NumIterations(run)},
                         {"termination", TerminationOf(run)},
                         {"message", MessageOf(run)},
                         {"seconds", run.seconds}};
  if (run.gnc.has_value()) {
    json["gnc"] = GncJson(run);
  }
  if (run.score.has_value()) {
    json["outliers"] = {{"fraction", plan.outliers},
                        {"seed", plan.seed},
                        {"num_wrong", run.score->num_wrong},
                        {"num_wrong_found", run.score->num_wrong_found},
                        {"num_right", run.score->num_right},
                        {"num_right_lost", run.score->num_right_lost},
                        {"rms_difference", run.score->rms_difference},
                        {"extent", run.score->extent}};
  }
  if (run.bound.has_value()) {
    json["chordal_bound"] = {{"cost", run.bound->cost},
                             {"lower_bound", run.bound->lower_bound},
                             {"gap", run.bound->gap},
                             {"smallest_eigenvalue", run.bound->smallest_eigenvalue},
                             {"largest_angle", run.bound->largest_angle}};
  }
  return json;
}

}  // namespace inceres::tools
