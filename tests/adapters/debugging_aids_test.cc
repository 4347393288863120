// check_gradients and trust_region_minimizer_iterations_to_dump next to stock Ceres.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "adapters/captured_log.h"
#include "adapters/compare_with_stock.h"
#include "adapters/test_problems.h"

namespace inceres {
namespace {

using testing::BothSolved;
using testing::TestProblem;
using testing::WithoutAddresses;

ceres::Solver::Options OptionsOf(ceres::LinearSolverType type) {
  ceres::Solver::Options options;
  options.linear_solver_type = type;
  options.max_num_iterations = 6;
  return options;
}

// Residual blocks 0 and 2 claim twice their slope; block 1 is right.
std::unique_ptr<TestProblem> WrongSlopes() {
  auto test = std::make_unique<TestProblem>();
  for (int k = 0; k < 3; ++k) {
    double* x = test->Add({1.0 + k, 2.0});
    test->problem.AddResidualBlock(
        new testing::TargetCost({5.0, -1.0},
                                [k](double const* const* p, double* r, double** J) {
                                  r[0] = p[0][0] - 5.0;
                                  r[1] = p[0][1] + 1.0;
                                  if (J != nullptr && J[0] != nullptr) {
                                    J[0][0] = k == 1 ? 1.0 : 2.0;
                                    J[0][3] = 1.0;
                                    J[0][1] = J[0][2] = 0.0;
                                  }
                                  return true;
                                }),
        nullptr, x);
  }
  return test;
}

TEST(CheckGradients, RightOnesLeaveTheTraceAsItIs) {
  for (const ceres::LinearSolverType type : {ceres::DENSE_SCHUR, ceres::DENSE_QR}) {
    ceres::Solver::Options options = OptionsOf(type);
    options.check_gradients = true;
    options.gradient_check_relative_precision = 1e-4;
    const auto bundle = [] { return testing::MakeBundle(3, 12, true); };
    const BothSolved both = testing::SolveBoth(bundle, options);
    EXPECT_FALSE(both.report.used_stock) << both.report.fallback_reason;
    testing::ExpectSameSummary(both, 1e-7, /*same_elimination=*/true);
    EXPECT_EQ(both.ours.termination_type, both.stock.termination_type);
    EXPECT_TRUE(both.report.options_without_effect.empty());
  }
}

TEST(CheckGradients, WrongOnesEndTheSolveWithStocksMessage) {
  ceres::Solver::Options options = OptionsOf(ceres::DENSE_QR);
  options.check_gradients = true;
  const BothSolved both = testing::SolveBoth(WrongSlopes, options);
  EXPECT_FALSE(both.report.used_stock) << both.report.fallback_reason;
  EXPECT_EQ(both.ours.termination_type, ceres::FAILURE);
  EXPECT_EQ(both.stock.termination_type, ceres::FAILURE);
  EXPECT_NE(both.ours.message.find("Residual block id 2"), std::string::npos);
  EXPECT_EQ(both.ours.message.find("Residual block id 1"), std::string::npos);
  EXPECT_EQ(WithoutAddresses(both.ours.message), WithoutAddresses(both.stock.message));
  EXPECT_EQ(both.ours.iterations.size(), both.stock.iterations.size());
  EXPECT_EQ(both.ours.final_cost, both.stock.final_cost);
  EXPECT_EQ(both.our_problem->blocks, WrongSlopes()->blocks);
}

TEST(CheckGradients, TheMessageDoesNotDependOnThreadsAndTheProblemIsAsBefore) {
  std::string messages[2];
  const auto test = WrongSlopes();
  for (const int threads : {1, 2}) {
    ceres::Solver::Options options = OptionsOf(ceres::SPARSE_NORMAL_CHOLESKY);
    options.check_gradients = true;
    options.num_threads = threads;
    ceres::Solver::Summary summary;
    inceres::Solve(options, &test->problem, &summary);
    messages[threads - 1] = summary.message;
  }
  EXPECT_EQ(messages[0], messages[1]);
  EXPECT_FALSE(messages[0].empty());
  ceres::Solver::Summary summary;  // unchecked, the cost functions are the caller's
  inceres::Solve(OptionsOf(ceres::SPARSE_NORMAL_CHOLESKY), &test->problem, &summary);
  EXPECT_TRUE(summary.IsSolutionUsable());
}

// r = atan x, whose Gauss–Newton steps from far out lead farther out: inner iterations try some
// beyond 5, where the slope is told wrongly, and refuse them. And a block that stays where it is.
std::unique_ptr<TestProblem> WrongFarOut(int* num_calls_far_out) {
  auto test = std::make_unique<TestProblem>();
  const auto arc_tangent = [=](double const* const* p, double* r, double** J) {
    const double x = p[0][0];
    const bool far_out = std::abs(x) > 5.0;
    *num_calls_far_out += far_out ? 1 : 0;
    r[0] = std::atan(x);
    if (J != nullptr && J[0] != nullptr) {
      J[0][0] = (far_out ? 2.0 : 1.0) / (1.0 + x * x);
    }
    return true;
  };
  test->problem.AddResidualBlock(new lambdas::Cost(1, {1}, arc_tangent), nullptr, test->Add({2.0}));
  double* y = test->Add({4.0});
  for (const double target : {3.0, 5.0}) {
    test->problem.AddResidualBlock(new testing::TargetCost(std::vector<double>{target}), nullptr,
                                   y);
  }
  return test;
}

TEST(CheckGradients, InnerIterationsAreCheckedWhereStockChecksThem) {
  for (const ceres::LinearSolverType type : {ceres::DENSE_QR, ceres::SPARSE_NORMAL_CHOLESKY}) {
    ceres::Solver::Options options = OptionsOf(type);
    options.use_inner_iterations = true;
    options.check_gradients = true;
    options.gradient_check_relative_precision = 1e-4;
    int num_calls_far_out = 0;
    const BothSolved both =
        testing::SolveBoth([&] { return WrongFarOut(&num_calls_far_out); }, options);
    EXPECT_FALSE(both.report.used_stock) << both.report.fallback_reason;
    EXPECT_EQ(both.stock.termination_type, ceres::CONVERGENCE) << both.stock.message;
    EXPECT_EQ(both.ours.termination_type, ceres::CONVERGENCE) << both.ours.message;
    EXPECT_TRUE(both.ours.inner_iterations_used);
    EXPECT_EQ(both.ours.iterations.size(), both.stock.iterations.size());
    EXPECT_NEAR(both.ours.final_cost, both.stock.final_cost, 1e-9);
    EXPECT_GT(num_calls_far_out, 0);
  }
}

TEST(CheckGradients, ASolveInIncrementalModeIsExact) {
  const auto test = WrongSlopes();
  ceres::Solver::Options options = OptionsOf(ceres::DENSE_SCHUR);
  options.check_gradients = true;
  SolveOptions ours;
  ours.mode = SolveMode::kIncremental;
  SolveReport report;
  ceres::Solver::Summary summary;
  inceres::Solve(options, &test->problem, &summary, ours, &report);
  EXPECT_EQ(summary.termination_type, ceres::FAILURE);
  EXPECT_NE(report.exact_reason.find("check_gradients"), std::string::npos);
}

// The text says six decimals.
void ExpectSameNumbers(std::vector<double> ours, std::vector<double> stock, bool sorted) {
  if (sorted) {
    std::sort(ours.begin(), ours.end());
    std::sort(stock.begin(), stock.end());
  }
  ASSERT_EQ(ours.size(), stock.size());
  for (std::size_t k = 0; k < ours.size(); ++k) {
    EXPECT_NEAR(ours[k], stock[k], 2e-6 * (1.0 + std::abs(stock[k]))) << k;
  }
}

class Dump : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = (std::filesystem::temp_directory_path() / "inceres_dump_XXXXXX").string();
    ASSERT_NE(mkdtemp(pattern.data()), nullptr);
    folder_ = pattern;
    std::filesystem::create_directory(folder_ / "stock");
    std::filesystem::create_directory(folder_ / "ours");
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  // Each solves with a directory of its own.
  void SolveBoth(const testing::Recipe& recipe, const ceres::Solver::Options& options,
                 const testing::Adjust& adjust = nullptr) {
    for (const char* who : {"stock", "ours"}) {
      ceres::Solver::Options mine = options;
      mine.trust_region_problem_dump_directory = (folder_ / who).string();
      const auto test = recipe();
      if (adjust != nullptr) {
        adjust(test.get(), &mine);
      }
      ceres::Solver::Summary summary;
      SolveReport report;
      if (who[0] == 's') {
        ceres::Solve(mine, &test->problem, &summary);
      } else {
        inceres::Solve(mine, &test->problem, &summary, SolveOptions(), &report);
        EXPECT_FALSE(report.used_stock) << report.fallback_reason;
        EXPECT_TRUE(report.options_without_effect.empty());
      }
    }
  }

  std::vector<std::string> Files(const char* who) const {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(folder_ / who)) {
      names.push_back(entry.path().filename().string());
    }
    std::sort(names.begin(), names.end());
    return names;
  }

  std::string Text(const char* who, const std::string& name) const {
    std::ostringstream text;
    text << std::ifstream(folder_ / who / name).rdbuf();
    std::string result = text.str();
    const std::string folder = (folder_ / who).string();
    for (std::size_t at; (at = result.find(folder)) != std::string::npos;) {
      result.replace(at, folder.size(), "FOLDER");
    }
    return result;
  }

  std::vector<double> Numbers(const char* who, const std::string& name) const {
    std::istringstream text(Text(who, name));
    std::vector<double> numbers;
    for (double value; text >> value;) {
      numbers.push_back(value);
    }
    return numbers;
  }

  // Of the iteration, in whatever order each has its rows and columns.
  void ExpectSameSystem(int iteration) const {
    const std::string base = "ceres_solver_iteration_00" + std::to_string(iteration);
    for (const char* part : {"_D.txt", "_b.txt", "_x.txt"}) {
      const std::string name = base + part;
      ExpectSameNumbers(Numbers("ours", name), Numbers("stock", name), /*sorted=*/true);
    }
    std::vector<double> values[2];
    for (const int who : {0, 1}) {
      const std::vector<double> numbers = Numbers(who == 0 ? "ours" : "stock", base + "_A.txt");
      for (std::size_t k = 2; k < numbers.size(); k += 3) {
        values[who].push_back(numbers[k]);
      }
    }
    ExpectSameNumbers(values[0], values[1], /*sorted=*/true);
  }

  std::filesystem::path folder_;
};

TEST_F(Dump, FilesOfADenseSolverAreStocks) {
  for (const auto strategy : {ceres::LEVENBERG_MARQUARDT, ceres::DOGLEG}) {
    ceres::Solver::Options options = OptionsOf(ceres::DENSE_QR);
    options.trust_region_strategy_type = strategy;
    options.trust_region_minimizer_iterations_to_dump = {3, 1, 77};
    SolveBoth([] { return testing::MakeBundle(3, 8, true); }, options);
    const std::vector<std::string> files = Files("stock");
    EXPECT_EQ(files, Files("ours"));
    EXPECT_EQ(files.size(), 10U);
    for (const std::string& name : files) {
      if (name.substr(name.size() - 2) == ".m") {
        EXPECT_EQ(Text("ours", name), Text("stock", name));
      } else {
        ExpectSameNumbers(Numbers("ours", name), Numbers("stock", name), /*sorted=*/false);
      }
    }
  }
}

TEST_F(Dump, SystemsOfSparseSolversAreStocksUpToTheOrderOfRowsAndColumns) {
  for (const ceres::LinearSolverType type :
       {ceres::DENSE_SCHUR, ceres::SPARSE_SCHUR, ceres::SPARSE_NORMAL_CHOLESKY}) {
    ceres::Solver::Options options = OptionsOf(type);
    options.trust_region_minimizer_iterations_to_dump = {1, 2};
    SolveBoth([] { return testing::MakeWindow(4, 15, /*huber=*/true); }, options);
    EXPECT_EQ(Files("ours"), Files("stock"));
    ExpectSameSystem(2);
    EXPECT_EQ(Text("ours", "ceres_solver_iteration_001.m"),
              Text("stock", "ceres_solver_iteration_001.m"));
  }
}

// Of residual blocks that touch all control points the three that count are written: none of the
// others, whatever counted iterations before.
TEST_F(Dump, SystemsOfSparseSolversWithDynamicSparsityAreStocks) {
  for (const bool huber : {false, true}) {
    ceres::Solver::Options options = OptionsOf(ceres::SPARSE_NORMAL_CHOLESKY);
    options.dynamic_sparsity = true;
    options.trust_region_minimizer_iterations_to_dump = {1, 2, 3, 4};
    SolveBoth([=] { return testing::MakeClosedCurve(1, huber); }, options);
    EXPECT_EQ(Files("stock").size(), 20U);
    EXPECT_EQ(Files("ours"), Files("stock"));
    for (const int iteration : {1, 2, 3, 4}) {
      ExpectSameSystem(iteration);
    }
  }
}

// Thousands of residual blocks, camera by camera.
std::unique_ptr<testing::TestProblem> MakeBundleCameraByCamera() {
  constexpr std::size_t kCameras = 3;
  std::unique_ptr<testing::TestProblem> test = testing::MakeBundle(kCameras, 1400, true);
  std::vector<ceres::ResidualBlockId> by_point;
  test->problem.GetResidualBlocks(&by_point);
  for (std::size_t c = 0; c < kCameras; ++c) {
    for (std::size_t k = c; k < by_point.size(); k += kCameras) {
      std::vector<double*> blocks;
      test->problem.GetParameterBlocksForResidualBlock(by_point[k], &blocks);
      test->problem.AddResidualBlock(
          const_cast<ceres::CostFunction*>(
              test->problem.GetCostFunctionForResidualBlock(by_point[k])),
          nullptr, blocks);
    }
  }
  for (const ceres::ResidualBlockId id : by_point) {
    test->problem.RemoveResidualBlock(id);
  }
  return test;
}

// Their Jacobians are kept landmark by landmark then, and only as long as they are needed.
TEST_F(Dump, SystemsOfIterativeSchurAreStocksWhateverTheOrderOfResidualBlocks) {
  ceres::Solver::Options options = OptionsOf(ceres::ITERATIVE_SCHUR);
  options.trust_region_minimizer_iterations_to_dump = {1};
  SolveBoth(MakeBundleCameraByCamera, options);
  EXPECT_EQ(Files("ours"), Files("stock"));
  const std::string base = "ceres_solver_iteration_001";
  for (const char* part : {"_D.txt", "_b.txt"}) {
    ExpectSameNumbers(Numbers("ours", base + part), Numbers("stock", base + part), /*sorted=*/true);
  }
  EXPECT_EQ(Numbers("ours", base + "_A.txt").size(), Numbers("stock", base + "_A.txt").size());
}

// Points are eliminated here where that is cheaper; a type that eliminates none does not show it.
TEST_F(Dump, ColumnsOfATypeThatIsNotSchurAreInTheOrderOfTheProblem) {
  ceres::Solver::Options options = OptionsOf(ceres::DENSE_NORMAL_CHOLESKY);
  options.trust_region_minimizer_iterations_to_dump = {1};
  SolveBoth([] { return testing::MakeBundle(3, 20, true); }, options);
  EXPECT_EQ(Files("ours"), Files("stock"));
  for (const char* part : {"_A.txt", "_D.txt", "_b.txt", "_x.txt"}) {
    const std::string name = std::string("ceres_solver_iteration_001") + part;
    ExpectSameNumbers(Numbers("ours", name), Numbers("stock", name), /*sorted=*/false);
  }
}

// Of ITERATIVE_SCHUR also those that are too large for landmarks: cameras here, the first one held.
TEST_F(Dump, ColumnsOfWhatASchurTypeEliminatesComeFirst) {
  constexpr int kCameras = 4;
  for (const std::size_t size_of_first : {3U, 9U}) {
    ceres::Solver::Options options = OptionsOf(ceres::ITERATIVE_SCHUR);
    options.trust_region_minimizer_iterations_to_dump = {1};
    SolveBoth([] { return testing::MakeBundle(kCameras, 8, true); }, options,
              [=](testing::TestProblem* test, ceres::Solver::Options* mine) {
                mine->linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
                for (std::vector<double>& block : test->blocks) {
                  mine->linear_solver_ordering->AddElementToGroup(
                      block.data(), block.size() == size_of_first ? 0 : 1);
                }
              });
    const double num_first = size_of_first == 3 ? 8 * 3 : (kCameras - 1) * 9;
    const std::vector<double> A = Numbers("ours", "ceres_solver_iteration_001_A.txt");
    std::vector<std::size_t> in_row(2 * 8 * kCameras, 0);
    for (std::size_t k = 0; k < A.size(); k += 3) {
      in_row[static_cast<std::size_t>(A[k])] += A[k + 1] < num_first ? 1 : 0;
    }
    for (std::size_t row = 0; row < in_row.size(); ++row) {
      const bool of_first_camera = row / 2 % kCameras == 0;
      EXPECT_EQ(in_row[row], size_of_first == 9 && of_first_camera ? 0U : size_of_first) << row;
    }
  }
}

// What was written is a linear least-squares problem that x solves: AᵀA x + D² x = Aᵀb up to sign.
TEST_F(Dump, TheStepSolvesTheSystem) {
  ceres::Solver::Options options = OptionsOf(ceres::SPARSE_SCHUR);
  options.trust_region_minimizer_iterations_to_dump = {1};
  SolveBoth([] { return testing::MakeBundle(4, 20, true); }, options);
  const std::vector<double> A = Numbers("ours", "ceres_solver_iteration_001_A.txt");
  const std::vector<double> D = Numbers("ours", "ceres_solver_iteration_001_D.txt");
  const std::vector<double> b = Numbers("ours", "ceres_solver_iteration_001_b.txt");
  const std::vector<double> x = Numbers("ours", "ceres_solver_iteration_001_x.txt");
  std::vector<double> left = b;  // A x + b
  for (std::size_t k = 0; k < A.size(); k += 3) {
    left[static_cast<std::size_t>(A[k])] += A[k + 2] * x[static_cast<std::size_t>(A[k + 1])];
  }
  std::vector<double> gradient(x.size());
  double largest = 0.0;
  for (std::size_t j = 0; j < x.size(); ++j) {
    gradient[j] = D[j] * D[j] * x[j];
  }
  std::vector<double> at_zero(x.size(), 0.0);
  for (std::size_t k = 0; k < A.size(); k += 3) {
    const auto row = static_cast<std::size_t>(A[k]);
    gradient[static_cast<std::size_t>(A[k + 1])] += A[k + 2] * left[row];
    at_zero[static_cast<std::size_t>(A[k + 1])] += A[k + 2] * b[row];
  }
  for (const double entry : at_zero) {
    largest = std::max(largest, std::abs(entry));
  }
  for (const double entry : gradient) {
    EXPECT_LT(std::abs(entry), 1e-3 * largest + 1e-4);
  }
}

TEST_F(Dump, ToTheLogAsStock) {
  ceres::Solver::Options options = OptionsOf(ceres::DENSE_QR);
  options.trust_region_minimizer_iterations_to_dump = {1};
  options.trust_region_problem_dump_format_type = ceres::CONSOLE;
  testing::CapturedLog log(google::GLOG_INFO);
  SolveBoth([] { return testing::MakeCurveFit(0.0); }, options);
  EXPECT_TRUE(Files("ours").empty());
  std::vector<std::string> dumped;
  for (const std::string& line : log.messages()) {
    for (const char* start : {"A^T: ", "A's appended diagonal:", "b: ", "x: "}) {
      if (line.rfind(start, 0) == 0) {
        dumped.push_back(line);
      }
    }
  }
  ASSERT_EQ(dumped.size(), 8U);
  for (std::size_t k = 0; k < 4; ++k) {
    EXPECT_EQ(dumped[k].substr(0, dumped[k].find('\n')),
              dumped[k + 4].substr(0, dumped[k + 4].find('\n')));
    EXPECT_NEAR(static_cast<double>(dumped[k].size()), static_cast<double>(dumped[k + 4].size()),
                0.05 * static_cast<double>(dumped[k].size()) + 8.0);
  }
}

TEST_F(Dump, AFolderThatIsNotThereIsAnErrorInTheLog) {
  ceres::Solver::Options options = OptionsOf(ceres::DENSE_SCHUR);
  options.trust_region_minimizer_iterations_to_dump = {1};
  options.trust_region_problem_dump_directory = (folder_ / "missing").string();
  testing::CapturedLog log;
  const auto test = testing::MakeBundle(3, 12, true);
  ceres::Solver::Summary summary;
  inceres::Solve(options, &test->problem, &summary);
  EXPECT_TRUE(summary.IsSolutionUsable());
  const auto lines = log.messages();
  EXPECT_TRUE(std::any_of(lines.begin(), lines.end(), [](const std::string& line) {
    return line.find("Unable to dump trust region problem. Filename base: ") == 0 &&
           line.find("missing/ceres_solver_iteration_001") != std::string::npos;
  }));
}

}  // namespace
}  // namespace inceres
