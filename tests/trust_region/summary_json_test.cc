#include <limits>
#include <locale>
#include <string>

#include <gtest/gtest.h>

#include "inceres/solver/solver.h"
#include "support/classic_problems.h"

#ifdef INCERES_HAVE_NLOHMANN_JSON
#include <nlohmann/json.hpp>
#endif

namespace inceres {
namespace {

Summary SolvedCurve() {
  FactorGraph graph;
  test::MakeCurveFit(&graph);
  Summary summary = Solve(SolverOptions(), &graph);
  summary.fixed_cost = 0.125;
  return summary;
}

// Decimal commas and grouped thousands, as a program's global locale may ask for.
struct CommaNumbers : std::numpunct<char> {
  char do_decimal_point() const override { return ','; }
  char do_thousands_sep() const override { return '.'; }
  std::string do_grouping() const override { return "\3"; }
};

TEST(SummaryJson, DoesNotDependOnTheLocale) {
  Summary summary;
  summary.final_cost = 12345.5;
  summary.work.bytes = 1234567;
  const std::locale before =
      std::locale::global(std::locale(std::locale::classic(), new CommaNumbers));
  const std::string json = summary.ToJson();
  std::locale::global(before);
  EXPECT_NE(json.find("\"final_cost\": 12345.5,"), std::string::npos) << json;
  EXPECT_NE(json.find("\"bytes\": 1234567}"), std::string::npos) << json;
}

#ifdef INCERES_HAVE_NLOHMANN_JSON

TEST(SummaryJson, HoldsWhatTheSummaryHolds) {
  const Summary summary = SolvedCurve();
  const nlohmann::json json = nlohmann::json::parse(summary.ToJson());
  EXPECT_EQ(json["termination"], "CONVERGENCE");
  EXPECT_EQ(json["message"], summary.message);
  EXPECT_EQ(json["initial_cost"].get<double>(), summary.initial_cost);
  EXPECT_EQ(json["final_cost"].get<double>(), summary.final_cost);
  EXPECT_EQ(json["fixed_cost"].get<double>(), 0.125);
  EXPECT_EQ(json["num_successful_steps"], summary.num_successful_steps);
  EXPECT_EQ(json["reduced_solver"], summary.reduced_solver);
  EXPECT_EQ(json["kernels"], summary.kernels);
  EXPECT_EQ(json["work"]["num_frames"], 2);
  EXPECT_EQ(json["seconds"]["total"].get<double>(), summary.seconds.total);
  ASSERT_EQ(json["iterations"].size(), summary.iterations.size());
  for (std::size_t k = 0; k < summary.iterations.size(); ++k) {
    EXPECT_EQ(json["iterations"][k]["cost"].get<double>(), summary.iterations[k].cost);
    EXPECT_EQ(json["iterations"][k]["successful"].get<bool>(),
              summary.iterations[k].step_is_successful);
  }
}

TEST(SummaryJson, OddStringsAndNumbersStayValid) {
  Summary summary;
  summary.message = "quote \" backslash \\ newline \n tab \t bell \a ü";
  summary.final_cost = std::numeric_limits<double>::quiet_NaN();
  summary.initial_cost = std::numeric_limits<double>::infinity();
  const nlohmann::json json = nlohmann::json::parse(summary.ToJson());
  EXPECT_EQ(json["message"], "quote \" backslash \\ newline   tab   bell   ü");
  EXPECT_TRUE(json["final_cost"].is_null());
  EXPECT_TRUE(json["initial_cost"].is_null());
  EXPECT_TRUE(json["iterations"].empty());
}

#else

// Without a parser: quotes and brackets pair up outside of strings.
TEST(SummaryJson, IsWellNested) {
  const std::string json = SolvedCurve().ToJson();
  std::string open;
  bool in_string = false;
  for (std::size_t k = 0; k < json.size(); ++k) {
    const char c = json[k];
    if (in_string) {
      in_string = c != '"';
      k += c == '\\' ? 1 : 0;
    } else if (c == '"') {
      in_string = true;
    } else if (c == '{' || c == '[') {
      open += c;
    } else if (c == '}' || c == ']') {
      ASSERT_FALSE(open.empty());
      EXPECT_EQ(open.back(), c == '}' ? '{' : '[');
      open.pop_back();
    }
  }
  EXPECT_TRUE(open.empty());
  EXPECT_FALSE(in_string);
}

#endif

}  // namespace
}  // namespace inceres
