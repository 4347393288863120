#include <iterator>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/solver/update_summary.h"
#include "incremental/incremental_bundle.h"

#ifdef INCERES_HAVE_NLOHMANN_JSON
#include <nlohmann/json.hpp>
#endif

namespace inceres {
namespace {

// Every field its own number, in the order of the struct.
UpdateSummary Numbered() {
  UpdateSummary s;
  s.termination = Termination::kConvergence;
  s.message = "a \"quoted\" word";
  s.failed_step = "a factor";
  s.batch_solver = "dense Cholesky";
  s.ended_by_batch_rule = s.rests_on_refusals = true;
  double real = 0.5;
  for (double* field : {&s.initial_cost, &s.final_cost, &s.remaining_decrease, &s.seconds,
                        &s.batch_seconds, &s.linearize_seconds, &s.solve_seconds, &s.select_seconds,
                        &s.landmark_seconds, &s.evaluate_seconds, &s.accept_seconds}) {
    *field = real++;
  }
  int count = 1000;
  int relinearized = 0;
  for (int* field :
       {&s.num_iterations, &s.num_batch_iterations, &s.num_unsuccessful_steps,
        &s.num_shortened_steps, &relinearized, &s.num_reweighed_factors, &s.num_recentered_factors,
        &s.num_eliminated_landmarks, &s.num_updated_landmarks, &s.num_factored_rows,
        &s.num_reorderings, &s.num_solved_rows, &s.num_pcg_iterations, &s.num_landmark_refinements,
        &s.num_visited_landmarks, &s.num_moved_frames, &s.num_rebuilds, &s.num_drifted_frames,
        &s.num_undetermined_landmarks}) {
    *field = count++;
  }
  s.num_relinearized_factors = relinearized;
  s.batch_stages.elimination = 77.5;
  s.num_evaluated_factors = 5000000001;
  s.bytes = 5000000002;
  s.iterations.resize(2);
  UpdateIteration& row = s.iterations[1];
  row.step = UpdateStep::kLandmarks;
  row.step_is_successful = row.refreshed = true;
  real = 100.5;
  for (double* field : {&row.cost, &row.cost_change, &row.model_cost_change, &row.relative_decrease,
                        &row.step_norm, &row.gradient_max_norm, &row.gradient_norm, &row.damping,
                        &row.trust_region_radius, &row.iteration_time_in_seconds,
                        &row.step_solver_time_in_seconds, &row.cumulative_time_in_seconds}) {
    *field = real++;
  }
  count = 2000;
  for (int* field : {&row.iteration, &row.num_moved_frames, &row.num_visited_landmarks,
                     &relinearized, &row.linear_solver_iterations}) {
    *field = count++;
  }
  row.num_relinearized_factors = relinearized;
  row.num_evaluated_factors = 5000000003;
  return s;
}

constexpr const char* kReals[] = {"initial_cost",     "final_cost",     "undone",
                                  "seconds",          "batch_seconds",  "linearise_seconds",
                                  "solve_seconds",    "select_seconds", "landmark_seconds",
                                  "evaluate_seconds", "accept_seconds"};
constexpr const char* kCounts[] = {"num_iterations",
                                   "num_batch_iterations",
                                   "num_rejected_steps",
                                   "num_shortened_steps",
                                   "num_relinearised_factors",
                                   "num_reweighed_factors",
                                   "num_recentred_factors",
                                   "num_eliminated_landmarks",
                                   "num_updated_landmarks",
                                   "num_factored_rows",
                                   "num_reorderings",
                                   "num_solved_rows",
                                   "num_pcg_iterations",
                                   "num_landmark_passes",
                                   "num_visited_landmarks",
                                   "num_moved_frames",
                                   "num_rebuilds",
                                   "num_drifted_frames",
                                   "num_parked_landmarks"};

constexpr const char* kRowReals[] = {
    "cost",      "cost_change",       "predicted_change", "relative_decrease",
    "step_norm", "gradient_max_norm", "gradient_norm",    "damping",
    "radius",    "seconds",           "solve_seconds",    "cumulative_seconds"};
constexpr const char* kRowCounts[] = {"iteration", "num_moved_frames", "num_visited_landmarks",
                                      "num_relinearised_factors", "num_linear_solver_iterations"};

// What the struct holds beside the fields in the lists is a termination, three texts, two flags,
// two 64-bit counts, stages and the trace. Counts stand in pairs, the last one ahead of the 64-bit
// ones by itself.
TEST(UpdateSummaryJson, IsTestedForEveryField) {
  EXPECT_EQ(sizeof(UpdateSummary),
            3 * sizeof(std::string) + sizeof(std::vector<UpdateIteration>) + sizeof(StageSeconds) +
                8 * (1 + 1 + std::size(kReals) + (std::size(kCounts) + 1) / 2 + 2))
      << "a field came or went: name it in the lists above and in ToJson";
  // A step with three flags fills eight bytes with the first count, and so does the last count
  // alone; in between are three.
  EXPECT_EQ(sizeof(UpdateIteration), 8 * (std::size(kRowReals) + 2 + 2 + 1 + 1))
      << "the same for a row of the trace";
}

#ifdef INCERES_HAVE_NLOHMANN_JSON

TEST(UpdateSummaryJson, HoldsEveryField) {
  const nlohmann::json json = nlohmann::json::parse(Numbered().ToJson());
  EXPECT_EQ(json["termination"], "CONVERGENCE");
  EXPECT_EQ(json["message"], "a \"quoted\" word");
  EXPECT_EQ(json["failed_step"], "a factor");
  EXPECT_EQ(json["batch_solver"], "dense Cholesky");
  EXPECT_EQ(json["ended_by_batch_rule"], true);
  EXPECT_EQ(json["rests_on_refusals"], true);
  double real = 0.5;
  for (const char* name : kReals) {
    ASSERT_TRUE(json.contains(name)) << name;
    EXPECT_EQ(json[name].get<double>(), real++) << name;
  }
  int count = 1000;
  for (const char* name : kCounts) {
    ASSERT_TRUE(json.contains(name)) << name;
    EXPECT_EQ(json[name].get<int>(), count++) << name;
  }
  EXPECT_EQ(json["num_evaluated_factors"].get<std::int64_t>(), 5000000001);
  EXPECT_EQ(json["bytes"].get<std::int64_t>(), 5000000002);
  EXPECT_EQ(json["batch_stages"]["elimination"].get<double>(), 77.5);
  EXPECT_EQ(json.size(), 6 + std::size(kReals) + std::size(kCounts) + 2 + 1 + 1);
}

TEST(UpdateSummaryJson, HoldsEveryFieldOfTheTrace) {
  const nlohmann::json rows = nlohmann::json::parse(Numbered().ToJson())["iterations"];
  ASSERT_EQ(rows.size(), 2U);
  EXPECT_EQ(rows[0]["step"], "none");
  const nlohmann::json& row = rows[1];
  EXPECT_EQ(row["step"], "landmarks");
  EXPECT_TRUE(row["accepted"].get<bool>());
  EXPECT_FALSE(row["shortened"].get<bool>());
  EXPECT_TRUE(row["refreshed"].get<bool>());
  double real = 100.5;
  for (const char* name : kRowReals) {
    ASSERT_TRUE(row.contains(name)) << name;
    EXPECT_EQ(row[name].get<double>(), real++) << name;
  }
  int count = 2000;
  for (const char* name : kRowCounts) {
    ASSERT_TRUE(row.contains(name)) << name;
    EXPECT_EQ(row[name].get<int>(), count++) << name;
  }
  EXPECT_EQ(row["num_evaluated_factors"].get<std::int64_t>(), 5000000003);
  EXPECT_EQ(row.size(), 4 + std::size(kRowReals) + std::size(kRowCounts) + 1);
}

#else

TEST(UpdateSummaryJson, NamesEveryField) {
  const std::string json = Numbered().ToJson();
  for (const char* name : kReals) {
    EXPECT_NE(json.find('"' + std::string(name) + "\": "), std::string::npos) << name;
  }
  for (const char* name : kRowReals) {
    EXPECT_NE(json.find('"' + std::string(name) + "\": "), std::string::npos) << name;
  }
  for (const char* name : kRowCounts) {
    EXPECT_NE(json.find('"' + std::string(name) + "\": "), std::string::npos) << name;
  }
  for (const char* name : kCounts) {
    EXPECT_NE(json.find('"' + std::string(name) + "\": "), std::string::npos) << name;
  }
}

#endif

// What an Update fills in, on a problem in which every stage has work.
TEST(UpdateSummary, IsUsableAsASummaryIs) {
  for (const auto& [termination, usable] : {std::pair{Termination::kConvergence, true},
                                            {Termination::kNoConvergence, true},
                                            {Termination::kFailure, false},
                                            {Termination::kUserSuccess, true},
                                            {Termination::kUserFailure, false}}) {
    UpdateSummary update;
    Summary batch;
    update.termination = batch.termination = termination;
    EXPECT_EQ(update.IsSolutionUsable(), usable) << ToString(termination);
    EXPECT_EQ(batch.IsSolutionUsable(), usable) << ToString(termination);
  }
}

TEST(UpdateSummary, CountsWhatAnUpdateDid) {
  IncrementalOptions options;
  options.batch_share = 1.0;
  test::IncrementalBundle bundle(options, 12);
  bundle.Grow(10, 60, 3);
  const UpdateSummary first = bundle.solver.Update();
  EXPECT_EQ(first.termination, Termination::kConvergence);
  EXPECT_GT(first.num_iterations, 0);
  EXPECT_GE(first.num_relinearized_factors, bundle.num_factors());
  EXPECT_GT(first.num_evaluated_factors, 0);
  EXPECT_GE(first.num_eliminated_landmarks, 60);
  EXPECT_GT(first.num_updated_landmarks, 0);
  EXPECT_GE(first.num_factored_rows, 10);
  EXPECT_GE(first.num_solved_rows, 10);
  EXPECT_GT(first.num_visited_landmarks, 0);
  EXPECT_GT(first.num_moved_frames, 0);
  EXPECT_GT(first.bytes, 0);
  EXPECT_GT(first.seconds, 0.0);
  EXPECT_LE(first.linearize_seconds + first.solve_seconds + first.select_seconds +
                first.landmark_seconds + first.evaluate_seconds + first.accept_seconds,
            first.seconds);
}

}  // namespace
}  // namespace inceres
