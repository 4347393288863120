#pragma once

#include <deque>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include <ceres/ceres.h>
#include <gtest/gtest.h>

#include "support/ceres_lambdas.h"

/// The conformance suite is a program as a user has it: it knows nothing of inceres and links only
/// Ceres. It runs as it is, with inceres_dropin preloaded and told to look at everything and hand
/// it to stock Ceres, and with it active; its verdicts must be the same.
namespace conformance {

using lambdas::Callback;
using Options = ceres::Solver::Options;
using Summary = ceres::Solver::Summary;

/// Ceres's release as 100 major + minor.
inline constexpr int kRelease = 100 * CERES_VERSION_MAJOR + CERES_VERSION_MINOR;

/// The message of a solve whose start cannot be evaluated.
inline constexpr const char* kStartFailed = kRelease >= 202
                                                ? "Initial residual and Jacobian evaluation failed."
                                                : "Residual and Jacobian evaluation failed.";

/// A Schur structure that Ceres has an eliminator for, as it reports it: unless it was built
/// without any.
#ifdef CERES_RESTRICT_SCHUR_SPECIALIZATION
inline std::string Specialized(const std::string& /*sizes*/) {
  return "d,d,d";
}
#else
inline std::string Specialized(const std::string& sizes) {
  return sizes;
}
#endif

/// What the environment variable INCERES_CONFORMANCE says this run is.
enum class Way { kBare, kFallback, kActive, kIncremental };
Way ThisRun();

/// Where the program finds ceres::Solver::Solve: the file name of the library.
std::string LibraryOfSolve();

/// A cost function made of a lambda. It notes which library calls it.
class Cost : public lambdas::Cost {
 public:
  using lambdas::Cost::Cost;
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;
};

/// r = weight (x − target), of any size.
Cost* Target(std::vector<double> target, double weight = 1.0);
/// r = f(x), one number of one number, with its derivative.
Cost* Scalar(std::function<double(double)> f, std::function<double(double)> derivative);
/// r = 10 − x, which can be evaluated at this x alone: every step fails.
Cost* OnlyAt(double x);
/// A smooth residual of several blocks, r_i = Σ a_ik x_k + 0.1 sin(x_0 + i) − b_i with fixed
/// numbers drawn from `seed`.
Cost* Coupled(int num_residuals, const std::vector<int>& sizes, int seed);

/// A problem with the memory of its parameter blocks.
struct World {
  explicit World(const ceres::Problem::Options& options = ceres::Problem::Options())
      : problem(options) {}
  virtual ~World() = default;  // ExpectNoEffect holds what derives from it by a pointer to this
  double* Add(std::vector<double> values) { return blocks.emplace_back(std::move(values)).data(); }

  std::deque<std::vector<double>> blocks;
  ceres::Problem problem;
};

/// r = 10 − x from x = 0.5: Ceres's first example. With Λ = 1e-4: 45.125 → 4.5116e-7 → 5.0e-16.
struct Line : World {
  explicit Line(double start = 0.5);
  double* x;
};

/// r = x² from x = 1: the first full step has a relative decrease of 15/16.
struct Parabola : World {
  Parabola();
  double* x;
};

/// r = (1 − x, 10 (y − x²)) from (−1.2, 1), one block of size 2: some steps are rejected.
struct Rosenbrock : World {
  Rosenbrock();
  double* x;
};

/// r = 1 with a slope whose square underflows: the step from x = 0 exists, its model change is 0,
/// so no step is valid.
struct NeverValid : World {
  NeverValid();
  double* x;
};

/// Cameras of size 6 first, then points of size 3, each seen by all cameras (residual size 2), and
/// a prior on each block.
struct Bundle : World {
  explicit Bundle(int num_cameras = 3, int num_points = 8);
  std::vector<double*> cameras;
  std::vector<double*> points;
};

/// Who must have called the cost functions in an active run. kAnyone: where going to stock Ceres is
/// right.
enum class Solver { kOurs, kAnyone };

/// A summary, what was printed to std::cout and what went to the log.
struct Outcome {
  Summary summary;
  std::string printed;
  std::vector<std::string> errors;    ///< LOG(ERROR)
  std::vector<std::string> warnings;  ///< LOG(WARNING)
};

/// ceres::Solve, with a check of who called the cost functions.
Outcome Solve(const Options& options, ceres::Problem* problem, Solver solver = Solver::kOurs);

/// Options for small problems: DENSE_QR, everything else as Ceres has it.
Options Small();
/// DENSE_SCHUR, everything else as Ceres has it.
Options Schur();

/// Solves Rosenbrock's problem (or, for a Schur type, the bundle) with and without the change of
/// options: the traces must agree to rounding. Returns the changed one's summary.
Summary ExpectNoEffect(const Options& base, const std::function<void(Options*)>& change);

/// a = b to a relative tolerance.
void ExpectClose(double a, double b, double tolerance = 1e-9);

/// For messages whose numbers differ in their last digits.
bool StartsWith(const std::string& text, const std::string& start);

}  // namespace conformance
