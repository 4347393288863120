// Conjugate gradients in exact mode beside stock Ceres: for each problem, linear solver and
// preconditioner the steps of both, and the iterations of conjugate gradients in each step that
// begins where the costs of both agree to 1e-9. Rounding grows from step to step, so the same is
// asked of stock Ceres and of itself with the residual blocks in reverse order: where that comes
// apart, there is nothing left to compare with.
//
//   build/bin/iterative_traces [--steps N] [--iterations N] [--only TEXT] PROBLEM...
//
// Ten steps unless told, with Ceres's most iterations of conjugate gradients for each, which are
// 500; --only: of the preconditioners those with TEXT in their names, as SUBSET. A bound on both
// makes large problems with dear iterations comparable in minutes.
//
// PROBLEM: as ab_compare takes it, bal:FILE or vio:cubic. Prints a table; a row that is not "same"
// is followed by the iterations of each step. Exit code 1 if ours leaves stock where stock does not
// leave itself, 2 for arguments that cannot be read.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include <ceres/ceres.h>
#include <glog/logging.h>

#include "inceres/ceres/solve.h"
#include "tools/problems/problem_source.h"

namespace {

using inceres::tools::ProblemSource;

// How far costs may lie apart, relative, for the steps from there to be compared.
constexpr double kSameCost = 1e-9;

// Which residual blocks a SUBSET preconditioner takes.
enum class Subset {
  kNone,
  kFourFifths,         // all but every fifth
  kWithoutFirstFrame,  // all but those of the block that the first one touches first
};

struct Way {
  ceres::LinearSolverType solver;
  ceres::PreconditionerType preconditioner;
  Subset subset = Subset::kNone;
};

constexpr Way kWays[] = {
    {ceres::ITERATIVE_SCHUR, ceres::IDENTITY},
    {ceres::ITERATIVE_SCHUR, ceres::JACOBI},
    {ceres::ITERATIVE_SCHUR, ceres::SCHUR_JACOBI},
    {ceres::ITERATIVE_SCHUR, ceres::CLUSTER_JACOBI},
    {ceres::ITERATIVE_SCHUR, ceres::CLUSTER_TRIDIAGONAL},
    {ceres::CGNR, ceres::SUBSET, Subset::kFourFifths},
    {ceres::CGNR, ceres::SUBSET, Subset::kWithoutFirstFrame},
};

std::string NameOf(const Way& way) {
  std::string name = ceres::PreconditionerTypeToString(way.preconditioner);
  if (way.subset == Subset::kFourFifths) {
    name += ", all but every fifth";
  } else if (way.subset == Subset::kWithoutFirstFrame) {
    name += ", a frame without any";
  }
  return name;
}

struct Trace {
  std::vector<double> costs;    // after each step, the start first
  std::vector<int> iterations;  // of conjugate gradients that led there; 0 at the start
  std::string obstacle;         // why there is none
};

Trace TraceOf(const ceres::Solver::Summary& summary) {
  Trace trace;
  for (const ceres::IterationSummary& iteration : summary.iterations) {
    trace.costs.push_back(iteration.cost);
    trace.iterations.push_back(iteration.linear_solver_iterations);
  }
  if (!summary.IsSolutionUsable()) {
    trace.obstacle = summary.message;
  }
  return trace;
}

std::vector<ceres::ResidualBlockId> Residuals(const ceres::Problem& problem) {
  std::vector<ceres::ResidualBlockId> ids;
  problem.GetResidualBlocks(&ids);
  return ids;
}

// The same blocks in the same order, and the residual blocks last to first. Cost functions, losses
// and manifolds stay those of `problem`.
std::unique_ptr<ceres::Problem> Reversed(const ceres::Problem& problem) {
  ceres::Problem::Options options;
  options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  auto reversed = std::make_unique<ceres::Problem>(options);
  std::vector<double*> blocks;
  problem.GetParameterBlocks(&blocks);
  for (double* block : blocks) {
    reversed->AddParameterBlock(block, problem.ParameterBlockSize(block),
                                const_cast<ceres::Manifold*>(problem.GetManifold(block)));
    if (problem.IsParameterBlockConstant(block)) {
      reversed->SetParameterBlockConstant(block);
    }
  }
  std::vector<ceres::ResidualBlockId> ids = Residuals(problem);
  std::reverse(ids.begin(), ids.end());
  for (const ceres::ResidualBlockId id : ids) {
    std::vector<double*> touched;
    problem.GetParameterBlocksForResidualBlock(id, &touched);
    reversed->AddResidualBlock(
        const_cast<ceres::CostFunction*>(problem.GetCostFunctionForResidualBlock(id)),
        const_cast<ceres::LossFunction*>(problem.GetLossFunctionForResidualBlock(id)), touched);
  }
  return reversed;
}

// `is_reversed`: the subset is that of the problem before.
void ChooseSubset(Subset subset, const ceres::Problem& problem, bool is_reversed,
                  ceres::Solver::Options* options) {
  std::vector<ceres::ResidualBlockId> ids = Residuals(problem);
  if (is_reversed) {
    std::reverse(ids.begin(), ids.end());
  }
  double* first_frame = nullptr;
  for (std::size_t k = 0; k < ids.size(); ++k) {
    std::vector<double*> touched;
    problem.GetParameterBlocksForResidualBlock(ids[k], &touched);
    first_frame = first_frame == nullptr ? touched.front() : first_frame;
    const bool is_in = subset == Subset::kFourFifths ? k % 5 != 0
                                                     : std::find(touched.begin(), touched.end(),
                                                                 first_frame) == touched.end();
    if (is_in) {
      options->residual_blocks_for_subset_preconditioner.insert(ids[k]);
    }
  }
}

enum class Who { kOurs, kStock, kStockReversed };

struct Arguments {
  int num_steps = 10;
  int max_iterations = ceres::Solver::Options().max_linear_solver_iterations;
  std::string only;
  std::vector<std::string> problems;
};

Trace SolveAs(Who who, const Way& way, const Arguments& arguments, const ProblemSource& source) {
  ProblemSource::CeresInstance instance;
  const inceres::Status made = source.MakeCeresInstance({}, &instance);
  Trace failed;
  if (!made.ok()) {
    failed.obstacle = made.message;
    return failed;
  }
  std::unique_ptr<ceres::Problem> reversed;
  if (who == Who::kStockReversed) {
    reversed = Reversed(*instance.problem);
  }
  ceres::Problem* const problem = reversed != nullptr ? reversed.get() : instance.problem.get();
  ceres::Solver::Options options;
  options.linear_solver_type = way.solver;
  options.preconditioner_type = way.preconditioner;
  options.max_num_iterations = arguments.num_steps;
  options.max_linear_solver_iterations = arguments.max_iterations;
  options.logging_type = ceres::SILENT;
  if (way.solver == ceres::ITERATIVE_SCHUR) {
    options.linear_solver_ordering = instance.landmarks_first;
  }
  if (way.subset != Subset::kNone) {
    ChooseSubset(way.subset, *problem, reversed != nullptr, &options);
  }
  ceres::Solver::Summary summary;
  if (who != Who::kOurs) {
    ceres::Solve(options, problem, &summary);
    return TraceOf(summary);
  }
  inceres::SolveOptions asked;
  asked.strict = true;
  inceres::SolveReport report;
  inceres::Solve(options, problem, &summary, asked, &report);
  return TraceOf(summary);
}

// What two traces have in common.
struct Agreement {
  std::size_t num_steps = 0;  // that begin where the costs agree
  int iterations[2] = {};     // of conjugate gradients in these, of the two
  std::size_t num_other = 0;  // of these with another number of them
  std::size_t first_other = 0;
};

Agreement Compare(const Trace& a, const Trace& b) {
  Agreement agreement;
  const std::size_t count = std::min(a.costs.size(), b.costs.size());
  for (std::size_t k = 1; k < count; ++k) {
    if (std::abs(a.costs[k - 1] - b.costs[k - 1]) > kSameCost * b.costs[k - 1]) {
      break;
    }
    ++agreement.num_steps;
    agreement.iterations[0] += a.iterations[k];
    agreement.iterations[1] += b.iterations[k];
    if (a.iterations[k] != b.iterations[k] && agreement.num_other++ == 0) {
      agreement.first_other = k;
    }
  }
  return agreement;
}

std::size_t NumSteps(const Trace& trace) {
  return trace.costs.empty() ? 0 : trace.costs.size() - 1;
}

void PrintSteps(const char* name, const Trace& trace) {
  std::printf("    %s:", name);
  for (std::size_t k = 1; k < trace.costs.size(); ++k) {
    std::printf(" %d (%.12g)", trace.iterations[k], trace.costs[k]);
  }
  std::printf("\n");
}

// False if ours leaves stock where stock does not leave itself.
bool PrintRow(const std::string& problem, const Way& way, const Trace& ours, const Trace& stock,
              const Trace& reversed) {
  const std::string solver = ceres::LinearSolverTypeToString(way.solver);
  if (!ours.obstacle.empty() || !stock.obstacle.empty()) {
    std::printf("| %s | %s | %s | %s | %s | | | | |\n", problem.c_str(), solver.c_str(),
                NameOf(way).c_str(), ours.obstacle.c_str(), stock.obstacle.c_str());
    return false;
  }
  const Agreement mine = Compare(ours, stock), own = Compare(reversed, stock);
  const bool same = mine.num_other == 0;
  const bool stock_differs = own.num_other > 0 && own.first_other <= mine.first_other;
  const bool excused = same || stock_differs || own.num_steps <= mine.first_other;
  std::printf(
      "| %s | %s | %s | %zu | %zu | %zu | %d | %d | %s | %zu%s |\n", problem.c_str(),
      solver.c_str(), NameOf(way).c_str(), NumSteps(ours), NumSteps(stock), mine.num_steps,
      mine.iterations[0], mine.iterations[1],
      same ? "same" : ("from step " + std::to_string(mine.first_other)).c_str(), own.num_steps,
      own.num_other == 0 ? "" : (", other from " + std::to_string(own.first_other)).c_str());
  if (!same) {
    PrintSteps("ours", ours);
    PrintSteps("stock", stock);
    PrintSteps("stock, reversed", reversed);
  }
  std::fflush(stdout);
  return excused;
}

bool CompareProblem(const std::string& name, const Arguments& arguments, bool* all_same) {
  std::unique_ptr<ProblemSource> source;
  const inceres::Status status = inceres::tools::OpenProblem(name, &source);
  if (!status.ok()) {
    std::fprintf(stderr, "%s\n", status.message.c_str());
    return false;
  }
  const std::string file = name.substr(name.find_last_of('/') + 1);
  for (const Way& way : kWays) {
    if (NameOf(way).find(arguments.only) == std::string::npos) {
      continue;
    }
    const Trace stock = SolveAs(Who::kStock, way, arguments, *source);
    const Trace reversed = SolveAs(Who::kStockReversed, way, arguments, *source);
    const Trace ours = SolveAs(Who::kOurs, way, arguments, *source);
    *all_same = PrintRow(file, way, ours, stock, reversed) && *all_same;
  }
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  google::InitGoogleLogging(argv[0]);
  constexpr int kUsage = 2;
  Arguments arguments;
  for (int k = 1; k < argc; ++k) {
    const bool has_value = k + 1 < argc;
    if (std::strcmp(argv[k], "--steps") == 0 && has_value) {
      arguments.num_steps = std::atoi(argv[++k]);
    } else if (std::strcmp(argv[k], "--iterations") == 0 && has_value) {
      arguments.max_iterations = std::atoi(argv[++k]);
    } else if (std::strcmp(argv[k], "--only") == 0 && has_value) {
      arguments.only = argv[++k];
    } else {
      arguments.problems.emplace_back(argv[k]);
    }
  }
  if (arguments.problems.empty() || arguments.num_steps < 1 || arguments.max_iterations < 1) {
    std::fprintf(stderr,
                 "usage: iterative_traces [--steps N] [--iterations N] [--only TEXT] PROBLEM...\n");
    return kUsage;
  }
  std::printf(
      "| problem | linear solver | preconditioner | steps | of stock | compared | iterations in "
      "these | of stock | | stock with itself |\n|---|---|---|---|---|---|---|---|---|---|\n");
  bool all_same = true;
  for (const std::string& problem : arguments.problems) {
    if (!CompareProblem(problem, arguments, &all_same)) {
      return kUsage;
    }
  }
  return all_same ? 0 : 1;
}
