// Covariances by inceres and by stock Ceres's algorithms on one problem, side by side.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include <ceres/covariance.h>
#include <ceres/manifold.h>
#include <ceres/solver.h>
#include <gflags/gflags.h>
#include <nlohmann/json.hpp>

#include "adapters/ceres/covariance/problem_covariance.h"
#include "inceres/ceres/covariance.h"
#include "src/base/stopwatch.h"
#include "tools/ab/statistics.h"
#include "tools/command_line/command_line.h"
#include "tools/command_line/heartbeat.h"
#include "tools/command_line/json_report.h"
#include "tools/command_line/output.h"
#include "tools/problems/problem_source.h"

DEFINE_string(problem, "", "the problem: bal:FILE (text, .gz or .bz2).");
DEFINE_string(gauge, "held",
              "held: the first camera is constant, and one coordinate of the second camera's "
              "position; points: every hundredth point is constant, at least ten of them, as "
              "surveyed control points are; free: nothing is.");
DEFINE_bool(hold_intrinsics, false,
            "hold focal length and distortion of every camera: 6 parameters are left of 9.");
DEFINE_bool(
    inceres_autodiff, false,
    "give inceres a problem with inceres::AutoDiffCostFunction of the same functors; stock keeps "
    "ceres::AutoDiffCostFunction.");
DEFINE_bool(only_ours, false,
            "stock is left out altogether: what inceres would hand over to it has no result.");
DEFINE_int32(iterations, 0, "iterations of Levenberg-Marquardt ahead of it, at least 0.");
DEFINE_bool(points, false, "ask for the covariance of every point too, not of cameras alone.");
DEFINE_string(algorithms, "sparse_qr",
              "comma-separated algorithms of stock: sparse_qr (SuiteSparseQR), eigen_qr (Eigen's "
              "sparse QR), dense_svd; empty: none.");
DEFINE_int32(repeats, 3, "rounds in which each runs once, at least 1.");
DEFINE_int32(num_threads, 1, "threads that evaluate, at least 1.");

namespace inceres::tools {
namespace {

const ToolHelp kHelp = {
    "Compare covariances by inceres with those of stock Ceres.",
    "Computes the covariance of every camera of a problem, and on request of every point, by "
    "inceres and by algorithms of stock Ceres, in interleaved rounds, and compares seconds, values "
    "and verdicts on the rank.",
    {{"by the algorithm Ceres takes by default, with a report",
      "covariance_compare --problem bal:problem-49-7776-pre.txt --json out.json"},
     {"at the minimum, by two algorithms",
      "covariance_compare --problem bal:problem-49-7776-pre.txt --iterations 20 --algorithms "
      "sparse_qr,eigen_qr"},
     {"ours with inceres::AutoDiffCostFunction, stock with its own",
      "covariance_compare --problem bal:problem-49-7776-pre.txt --inceres_autodiff"},
     {"all points too, without Ceres",
      "covariance_compare --problem bal:problem.txt --only_ours --points"},
     {"cameras of 6 parameters along a path, held by control points",
      "covariance_compare --problem bal:problem.txt --hold_intrinsics --gauge points "
      "--only_ours"}},
    {{kExitUsedStock, "inceres leaves the problem to stock Ceres: no measurement"}}};

constexpr int kCameraSize = 9;
constexpr int kTranslation = 3;  // of a camera, its first entry
constexpr int kFocalLength = 6;
constexpr int kPointSize = 3;
constexpr int kMaxControlPointStride = 100;
constexpr int kLeastControlPoints = 10;

using Pairs = std::vector<std::pair<const double*, const double*>>;

struct Result {
  std::string name;
  bool computed = false;
  bool used_stock = false;  // or, with --only_ours, would have
  std::string message;
  std::vector<double> seconds;
  std::vector<double> values;  // all blocks one after the other
};

// A problem over parameters of its own, and what of it is requested.
struct Instance {
  ProblemSource::CeresInstance ceres;
  Pairs pairs;
};

// One that computes: fills all of the result but its name, and adds a time.
using Contender = std::function<void(const Pairs&, ceres::Problem*, Result*)>;

std::size_t SizeOf(const ceres::Problem& problem, const double* block) {
  return static_cast<std::size_t>(problem.ParameterBlockTangentSize(block));
}

template <typename AnyCovariance>
void Run(AnyCovariance* covariance, const Pairs& pairs, ceres::Problem* problem, Result* result) {
  result->seconds.push_back(
      internal::SecondsOf([&] { result->computed = covariance->Compute(pairs, problem); }));
  result->values.clear();
  for (const auto& [a, b] : pairs) {
    if (!result->computed) {
      break;
    }
    std::vector<double> block(SizeOf(*problem, a) * SizeOf(*problem, b));
    result->computed = covariance->GetCovarianceBlockInTangentSpace(a, b, block.data());
    result->values.insert(result->values.end(), block.begin(), block.end());
  }
}

void RunOurs(const Pairs& pairs, ceres::Problem* problem, Result* result) {
  ceres::Covariance::Options options;
  options.num_threads = FLAGS_num_threads;
  Covariance covariance(options);
  Run(&covariance, pairs, problem, result);
  result->used_stock = covariance.report().used_stock;
  result->message = covariance.report().message;
}

// What RunOurs does where nothing goes to stock.
void RunOursAlone(const Pairs& pairs, ceres::Problem* problem, Result* result) {
  using internal::ProblemCovariance;
  ceres::Covariance::Options options;
  options.num_threads = FLAGS_num_threads;
  const double start = internal::NowInSeconds();
  ProblemCovariance covariance;
  const auto outcome = covariance.Compute(options, pairs, *problem, nullptr);
  result->seconds.push_back(internal::NowInSeconds() - start);
  result->computed = outcome == ProblemCovariance::Outcome::kComputed;
  result->used_stock = outcome == ProblemCovariance::Outcome::kDeclined;
  result->message = covariance.message();
  result->values.clear();
  for (const auto& [a, b] : pairs) {
    std::vector<double> block(SizeOf(*problem, a) * SizeOf(*problem, b));
    if (result->computed && covariance.GetBlock(a, b, /*ambient=*/false, block.data())) {
      result->values.insert(result->values.end(), block.begin(), block.end());
    }
  }
}

Contender Stock(ceres::CovarianceAlgorithmType algorithm,
                ceres::SparseLinearAlgebraLibraryType library) {
  return [=](const Pairs& pairs, ceres::Problem* problem, Result* result) {
    ceres::Covariance::Options options;
    options.num_threads = FLAGS_num_threads;
    options.algorithm_type = algorithm;
    options.sparse_linear_algebra_library_type = library;
    ceres::Covariance covariance(options);
    Run(&covariance, pairs, problem, result);
    result->message = result->computed ? "" : "returned false";
  };
}

Status FindContenders(std::vector<Contender>* contenders, std::vector<Result>* results) {
  *contenders = {FLAGS_only_ours ? Contender(RunOursAlone) : Contender(RunOurs)};
  results->resize(1);
  results->back().name = "inceres";
  std::istringstream names(FLAGS_only_ours ? "" : FLAGS_algorithms);
  for (std::string name; std::getline(names, name, ',');) {
    if (name == "sparse_qr") {
      contenders->push_back(Stock(ceres::SPARSE_QR, ceres::SUITE_SPARSE));
    } else if (name == "eigen_qr") {
      contenders->push_back(Stock(ceres::SPARSE_QR, ceres::EIGEN_SPARSE));
    } else if (name == "dense_svd") {
      contenders->push_back(Stock(ceres::DENSE_SVD, ceres::SUITE_SPARSE));
    } else {
      return Invalid("--algorithms: '" + name + "' is unknown; see --help");
    }
    results->emplace_back();
    results->back().name = "ceres " + name;
  }
  return Status::Ok();
}

// The largest difference of an entry, relative to √(Σ_ii Σ_jj), where both have computed.
double LargestDifference(const Pairs& pairs, const ceres::Problem& problem, const Result& ours,
                         const Result& other) {
  double largest = 0.0;
  std::size_t at = 0;
  for (const auto& pair : pairs) {
    const std::size_t size = SizeOf(problem, pair.first);
    for (std::size_t i = 0; i < size; ++i) {
      for (std::size_t j = 0; j < size; ++j) {
        const double scale =
            std::sqrt(other.values[at + i * size + i]) * std::sqrt(other.values[at + j * size + j]);
        const std::size_t k = at + i * size + j;
        if (scale > 0.0) {
          largest = std::max(largest, std::abs(ours.values[k] - other.values[k]) / scale);
        }
      }
    }
    at += size * size;
  }
  return largest;
}

// Of each camera what is constant: intrinsics, and of the second one coordinate for the scale. A
// camera or a point that nobody observes is no block of the problem.
void HoldCameras(const BalProblem& bal, ProblemSource::CeresInstance* instance) {
  for (int i = 0; i < bal.num_cameras; ++i) {
    double* camera = instance->parameters.data() + static_cast<std::ptrdiff_t>(i) * kCameraSize;
    std::vector<int> constant;
    if (FLAGS_gauge == "held" && i == 1) {
      constant.push_back(kTranslation);
    }
    for (int k = kFocalLength; FLAGS_hold_intrinsics && k < kCameraSize; ++k) {
      constant.push_back(k);
    }
    if (!constant.empty() && instance->problem->HasParameterBlock(camera)) {
      instance->problem->SetManifold(camera, new ceres::SubsetManifold(kCameraSize, constant));
    }
  }
  if (FLAGS_gauge == "held" && instance->problem->HasParameterBlock(instance->parameters.data())) {
    instance->problem->SetParameterBlockConstant(instance->parameters.data());
  }
}

void HoldControlPoints(const BalProblem& bal, ProblemSource::CeresInstance* instance) {
  double* points =
      instance->parameters.data() + static_cast<std::ptrdiff_t>(bal.num_cameras) * kCameraSize;
  const int stride = std::clamp(bal.num_points / kLeastControlPoints, 1, kMaxControlPointStride);
  for (std::ptrdiff_t i = 0; i < bal.num_points; i += stride) {
    if (instance->problem->HasParameterBlock(points + i * kPointSize)) {
      instance->problem->SetParameterBlockConstant(points + i * kPointSize);
    }
  }
}

Pairs Requested(const BalProblem& bal, const ProblemSource::CeresInstance& instance) {
  Pairs pairs;
  const auto add = [&](const double* block) {
    if (instance.problem->HasParameterBlock(block)) {
      pairs.emplace_back(block, block);
    }
  };
  const double* cameras = instance.parameters.data();
  for (std::ptrdiff_t i = FLAGS_gauge == "held" ? 1 : 0; i < bal.num_cameras; ++i) {
    add(cameras + i * kCameraSize);
  }
  const double* points = cameras + static_cast<std::ptrdiff_t>(bal.num_cameras) * kCameraSize;
  for (std::ptrdiff_t i = 0; FLAGS_points && i < bal.num_points; ++i) {
    add(points + i * kPointSize);
  }
  return pairs;
}

Status Solve(ceres::Problem* problem) {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_SCHUR;
  options.max_num_iterations = FLAGS_iterations;
  options.num_threads = FLAGS_num_threads;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, problem, &summary);
  return summary.IsSolutionUsable()
             ? Status::Ok()
             : Status::Error(StatusCode::kEvaluationFailed, "not solved: " + summary.message);
}

// Whether there is something to compare. A Jacobian that is rank deficient is a verdict.
Status CheckOurs(const Result& ours, ceres::Problem* problem) {
  if (ours.used_stock) {
    return Status::Error(
        StatusCode::kUnavailable,
        "NO MEASUREMENT: inceres leaves this problem to stock Ceres. Reason: " + ours.message);
  }
  std::vector<double> gradient;
  return ours.computed || problem->Evaluate({}, nullptr, nullptr, &gradient, nullptr)
             ? Status::Ok()
             : Status::Error(StatusCode::kEvaluationFailed, ours.message);
}

void Print(const std::vector<Result>& results, const nlohmann::json& report) {
  std::fprintf(Out(), "%-18s %10s %8s %12s  %s\n", "", "seconds", "ratio", "difference", "verdict");
  for (std::size_t k = 0; k < results.size(); ++k) {
    const nlohmann::json& row = report["results"][k];
    char difference[16] = "-";
    if (!row["largest_difference"].is_null()) {
      std::snprintf(difference, sizeof(difference), "%.1e",
                    row["largest_difference"].get<double>());
    }
    std::fprintf(Out(), "%-18s %10.4f %8.3f %12s  %s%s%s\n", results[k].name.c_str(),
                 row["seconds"].get<double>(), row["ratio"].get<double>(), difference,
                 results[k].computed ? "computed" : "not computed",
                 results[k].message.empty() ? "" : ": ", results[k].message.c_str());
  }
}

nlohmann::json MakeReport(const ProblemSource& source, const Instance& instance,
                          const std::vector<Result>& results) {
  nlohmann::json report = {{"problem", FLAGS_problem},
                           {"description", source.Describe()},
                           {"gauge", FLAGS_gauge},
                           {"hold_intrinsics", FLAGS_hold_intrinsics},
                           {"inceres_autodiff", FLAGS_inceres_autodiff},
                           {"iterations", FLAGS_iterations},
                           {"num_threads", FLAGS_num_threads},
                           {"blocks", instance.pairs.size()}};
  const double ours = Summarize(results[0].seconds).median;
  for (const Result& result : results) {
    const bool comparable = &result != &results[0] && result.computed && results[0].computed;
    const double seconds = Summarize(result.seconds).median;
    nlohmann::json row = {{"name", result.name},
                          {"computed", result.computed},
                          {"used_stock", result.used_stock},
                          {"message", result.message},
                          {"seconds", seconds},
                          {"all_seconds", result.seconds},
                          {"ratio", ours / seconds},
                          {"largest_difference", nullptr}};
    if (comparable) {
      row["largest_difference"] =
          LargestDifference(instance.pairs, *instance.ceres.problem, results[0], result);
    }
    report["results"].push_back(row);
  }
  return report;
}

Status CheckFlags() {
  const Status numbers = CheckNumbers({{"repeats", FLAGS_repeats, 1},
                                       {"num_threads", FLAGS_num_threads, 1},
                                       {"iterations", FLAGS_iterations, 0}},
                                      {});
  if (!numbers.ok()) {
    return numbers;
  }
  if (FLAGS_problem.rfind("bal:", 0) != 0) {
    return Invalid("--problem must be bal:FILE");
  }
  return FLAGS_gauge == "held" || FLAGS_gauge == "points" || FLAGS_gauge == "free"
             ? Status::Ok()
             : Invalid("--gauge must be held, points or free, not '" + FLAGS_gauge + "'");
}

Status MakeInstance(const ProblemSource& source, Instance* instance) {
  const Status status = source.MakeCeresInstance(LossSpec(), &instance->ceres);
  if (!status.ok()) {
    return status;
  }
  const BalProblem& bal = static_cast<const BalSource&>(source).bal();
  HoldCameras(bal, &instance->ceres);
  if (FLAGS_gauge == "points") {
    HoldControlPoints(bal, &instance->ceres);
  }
  instance->pairs = Requested(bal, instance->ceres);
  return status;
}

// Both at the same point, where `instance` has come to.
Status MakeOwnInstance(const Instance& instance, Instance* own) {
  std::unique_ptr<ProblemSource> source;
  Status status = OpenProblem(FLAGS_problem, &source, BalJacobians::kInceresAutoDiff);
  status = status.ok() ? MakeInstance(*source, own) : status;
  if (status.ok()) {
    std::copy(instance.ceres.parameters.begin(), instance.ceres.parameters.end(),
              own->ceres.parameters.begin());
  }
  return status;
}

Status RunAll() {
  std::vector<Contender> contenders;
  std::vector<Result> results;
  Status status = CheckFlags();
  status = status.ok() ? FindContenders(&contenders, &results) : status;
  std::unique_ptr<ProblemSource> source;
  status = status.ok() ? OpenProblem(FLAGS_problem, &source) : status;
  Instance instance;
  status = status.ok() ? MakeInstance(*source, &instance) : status;
  if (status.ok() && FLAGS_iterations > 0) {
    status = Solve(instance.ceres.problem.get());
  }
  Instance own;  // ours, where it is not the same
  if (status.ok() && FLAGS_inceres_autodiff) {
    status = MakeOwnInstance(instance, &own);
  }
  if (!status.ok()) {
    return status;
  }
  const Heartbeat heartbeat(ProgressOutput(), "computing covariances");
  for (int round = 0; round < FLAGS_repeats; ++round) {
    for (std::size_t k = 0; k < contenders.size(); ++k) {
      const Instance& its = k == 0 && FLAGS_inceres_autodiff ? own : instance;
      contenders[k](its.pairs, its.ceres.problem.get(), &results[k]);
    }
  }
  status = CheckOurs(results[0], instance.ceres.problem.get());
  if (!status.ok()) {
    return status;
  }
  const nlohmann::json report = MakeReport(*source, instance, results);
  std::fprintf(Out(), "%s, %zu blocks\n\n", source->Describe().c_str(), instance.pairs.size());
  Print(results, report);
  return WriteJsonReport(report);
}

}  // namespace
}  // namespace inceres::tools

int main(int argc, char** argv) {
  return inceres::tools::RunTool(inceres::tools::kHelp, argc, argv, inceres::tools::RunAll,
                                 inceres::tools::kExitUsedStock);
}
