// docs/ceres_contract.md, "Callback and logging options": progress table, dumps, gradient checks.
// Test names are the fields'.
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <regex>

#include "conformance/support.h"

namespace conformance {
namespace {

constexpr const char* kHeading =
    "iter      cost      cost_change  |gradient|   |step|    tr_ratio  tr_radius  ls_iter  "
    "iter_time  total_time\n";

// The two times of a row replaced.
std::string WithoutTimes(const std::string& table) {
  const std::regex times("[0-9]\\.[0-9]{2}e[-+][0-9]{2}    [0-9]\\.[0-9]{2}e[-+][0-9]{2}\n");
  return std::regex_replace(table, times, "TIMES\n");
}

// The column |step| before a step was accepted.
constexpr const char* kFirstStep = kRelease >= 202 ? "0.00e+00" : "9.50e+00";

TEST(Options24, minimizer_progress_to_stdout) {
  Line line;
  Options options = Small();
  options.minimizer_progress_to_stdout = true;
  EXPECT_EQ(WithoutTimes(Solve(options, &line.problem).printed),
            std::string(kHeading) +
                "   0  4.512500e+01    0.00e+00    9.50e+00   0.00e+00   0.00e+00  1.00e+04        "
                "0    TIMES\n"
                "   1  4.511598e-07    4.51e+01    9.50e-04   " +
                kFirstStep +
                "   1.00e+00  3.00e+04        1    TIMES\n"
                "   2  5.012552e-16    4.51e-07    3.17e-08   9.50e-04   1.00e+00  9.00e+04        "
                "1    TIMES\n");
}

TEST(Options24, minimizer_progress_to_stdout_is_off_by_default) {
  Line line;
  EXPECT_EQ(Solve(Small(), &line.problem).printed, "");
}

// A step that cannot be evaluated, and the fixed cost in the cost column.
TEST(Options24, minimizer_progress_to_stdout_of_a_rejected_step) {
  World world;
  double* x = world.Add({0.5});
  double* c = world.Add({1.0});
  world.problem.AddResidualBlock(OnlyAt(0.5), nullptr, x);
  world.problem.AddResidualBlock(Target({3.0}), nullptr, c);
  world.problem.SetParameterBlockConstant(c);
  Options options = Small();
  options.minimizer_progress_to_stdout = true;
  options.max_num_iterations = 2;
  EXPECT_EQ(WithoutTimes(Solve(options, &world.problem).printed),
            std::string(kHeading) +
                "   0  4.712500e+01    0.00e+00    9.50e+00   0.00e+00   0.00e+00  1.00e+04        "
                "0    TIMES\n"
                "   1  1.797693e+308   -1.80e+308    9.50e+00   " +
                kFirstStep +
                "  -1.80e+308  5.00e+03        1    TIMES\n"
                "   2  1.797693e+308   -1.80e+308    9.50e+00   " +
                kFirstStep + "  -1.80e+308  1.25e+03        1    TIMES\n");
}

// The iteration that ends by function or parameter tolerance prints no row.
TEST(Options24, minimizer_progress_to_stdout_without_the_last_iteration) {
  Parabola parabola;
  Options options = Small();
  options.minimizer_progress_to_stdout = true;
  options.function_tolerance = 0.95;
  const std::string printed = WithoutTimes(Solve(options, &parabola.problem).printed);
  EXPECT_EQ(printed, std::string(kHeading) +
                         "   0  5.000000e-01    0.00e+00    2.00e+00   0.00e+00   0.00e+00  "
                         "1.00e+04        0    TIMES\n");
}

TEST(Options24, logging_type) {
  Line line;
  Options options = Small();
  options.logging_type = ceres::SILENT;
  options.minimizer_progress_to_stdout = true;
  EXPECT_EQ(Solve(options, &line.problem).printed, "");
}

// It does not silence LOG(ERROR) "Terminating: …".
TEST(Options24, logging_type_silent_and_a_failure) {
  World world;
  double* x = world.Add({0.5});
  auto* cost = new Cost(1, {1}, [](auto...) { return false; });
  world.problem.AddResidualBlock(cost, nullptr, x);
  for (const auto type : {ceres::SILENT, ceres::PER_MINIMIZER_ITERATION}) {
    Options options = Small();
    options.logging_type = type;
    const Outcome outcome = Solve(options, &world.problem);
    EXPECT_EQ(outcome.errors,
              std::vector<std::string>{std::string("Terminating: ") + kStartFailed});
  }
}

// Dumps.

struct DumpFolder {
  DumpFolder()
      : path(std::filesystem::temp_directory_path() /
             ("inceres_conformance_" + std::to_string(::getpid()))) {
    std::filesystem::create_directory(path);
  }
  ~DumpFolder() { std::filesystem::remove_all(path); }
  std::vector<std::string> Files() const {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(path)) {
      names.push_back(entry.path().filename().string());
    }
    std::sort(names.begin(), names.end());
    return names;
  }
  std::filesystem::path path;
};

TEST(Options24, trust_region_minimizer_iterations_to_dump) {
  const DumpFolder folder;
  Line line;
  Options options = Small();
  options.trust_region_minimizer_iterations_to_dump = {1};
  options.trust_region_problem_dump_directory = folder.path.string();
  EXPECT_EQ(Solve(options, &line.problem, Solver::kAnyone).summary.termination_type,
            ceres::CONVERGENCE);
  const std::string base = "ceres_solver_iteration_001";
  EXPECT_EQ(folder.Files(), (std::vector<std::string>{base + ".m", base + "_A.txt", base + "_D.txt",
                                                      base + "_b.txt", base + "_x.txt"}));
}

TEST(Options24, trust_region_problem_dump_directory) {
  const DumpFolder folder;
  ExpectNoEffect(
      Small(), [&](Options* o) { o->trust_region_problem_dump_directory = folder.path.string(); });
  EXPECT_TRUE(folder.Files().empty()) << "no iteration was named";
}

TEST(Options24, trust_region_problem_dump_format_type) {
  const DumpFolder folder;
  Line line;
  Options options = Small();
  options.trust_region_minimizer_iterations_to_dump = {1};
  options.trust_region_problem_dump_directory = folder.path.string();
  options.trust_region_problem_dump_format_type = ceres::CONSOLE;
  EXPECT_EQ(Solve(options, &line.problem, Solver::kAnyone).summary.termination_type,
            ceres::CONVERGENCE);
  EXPECT_TRUE(folder.Files().empty());
}

// Gradient checks: what they are is next to stock in adapters/debugging_aids_test.cc.

struct WrongJacobian : World {
  explicit WrongJacobian(double relative_error) : x(Add({0.5})) {
    problem.AddResidualBlock(
        Scalar([](double v) { return 10.0 - v; }, [=](double) { return -1.0 - relative_error; }),
        nullptr, x);
  }
  double* x;
};

Summary Checked(double relative_error, const std::function<void(Options*)>& change) {
  WrongJacobian world(relative_error);
  Options options = Small();
  options.check_gradients = true;
  change(&options);
  return Solve(options, &world.problem, Solver::kAnyone).summary;
}

TEST(Options24, gradient_check_relative_precision) {
  const auto precision = [](double value) {
    return [=](Options* o) { o->gradient_check_relative_precision = value; };
  };
  EXPECT_EQ(Checked(1e-4, precision(1e-2)).termination_type, ceres::CONVERGENCE);
  const Summary summary = Checked(1e-4, precision(1e-6));
  EXPECT_EQ(summary.termination_type, ceres::FAILURE);
  EXPECT_NE(summary.message.find("Gradient Error detected"), std::string::npos) << summary.message;
}

TEST(Options24, gradient_check_numeric_derivative_relative_step_size) {
  const auto step = [](Options* o) {
    o->gradient_check_numeric_derivative_relative_step_size = 1e-4;
  };
  EXPECT_EQ(Checked(0.0, step).termination_type, ceres::CONVERGENCE);
}

}  // namespace
}  // namespace conformance
