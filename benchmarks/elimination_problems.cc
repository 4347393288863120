// Problems in which much depends on which blocks are eliminated first, and on zeros in Jacobians,
// solved as a user's binary that links Ceres would: run it as it is, or with the drop-in preloaded.
// See elimination_figures.py.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <memory>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include <ceres/ceres.h>
#include <ceres/rotation.h>
#include <sys/resource.h>

namespace {

constexpr char kUsage[] =
    "elimination_problems [--NAME VALUE]...\n"
    "\n"
    "Builds one problem, solves it on one thread and prints a line of JSON.\n"
    "\n"
    "  --solver S        of Ceres's linear solvers, sparse_schur by default\n"
    "  --ordering O      auto (default), points (first) or cameras (first)\n"
    "  --iterations N    at most, 6 by default\n"
    "  --seed N          1 by default\n"
    "Bundle adjustment, cameras of 6 on a circle, points of 3 inside it:\n"
    "  --cameras N, --points N, --track N    points, each seen by so many neighbors of a random "
    "camera\n"
    "  --long_points N, --long_track N       and by so many cameras anywhere\n"
    "  --intrinsics 1    shared by all cameras and variable, 0 by default\n"
    "A closed curve of N control points fitted to M points, every residual block of which touches "
    "all of them:\n"
    "  --curve N, --observations M, --dynamic 0 or 1 (dynamic_sparsity; 1 by default)\n";

class Arguments {
 public:
  Arguments(int argc, char** argv) {
    for (int k = 1; k < argc; k += 2) {
      const auto known = values_.find(std::strncmp(argv[k], "--", 2) == 0 ? argv[k] + 2 : "");
      if (known == values_.end() || k + 1 == argc) {
        std::fprintf(stderr, "elimination_problems: what is %s?\n\n%s", argv[k], kUsage);
        std::exit(2);
      }
      known->second = argv[k + 1];
    }
  }

  const std::string& Text(const std::string& name) const { return values_.at(name); }
  int Number(const std::string& name) const {
    const std::string& text = Text(name);
    char* end = nullptr;
    const long value = std::strtol(text.c_str(), &end, 10);
    if (text.empty() || *end != '\0' || value < 0 || value > 10'000'000) {
      std::fprintf(stderr, "elimination_problems: --%s %s: a number from 0 to 10000000 is wanted\n",
                   name.c_str(), text.c_str());
      std::exit(2);
    }
    return static_cast<int>(value);
  }

 private:
  std::map<std::string, std::string> values_ = {{"solver", "sparse_schur"},
                                                {"ordering", "auto"},
                                                {"iterations", "6"},
                                                {"seed", "1"},
                                                {"cameras", "100"},
                                                {"points", "0"},
                                                {"track", "4"},
                                                {"long_points", "0"},
                                                {"long_track", "50"},
                                                {"intrinsics", "0"},
                                                {"curve", "0"},
                                                {"observations", "0"},
                                                {"dynamic", "1"}};
};

struct Reprojection {
  template <typename T>
  bool operator()(const T* intrinsics, const T* camera, const T* point, T* residuals) const {
    T p[3];
    ceres::AngleAxisRotatePoint(camera, point, p);
    const T x = (p[0] + camera[3]) / (p[2] + camera[5]);
    const T y = (p[1] + camera[4]) / (p[2] + camera[5]);
    const T r2 = x * x + y * y;
    const T distortion = 1.0 + r2 * (intrinsics[1] + r2 * intrinsics[2]);
    residuals[0] = intrinsics[0] * distortion * x - u;
    residuals[1] = intrinsics[0] * distortion * y - v;
    return true;
  }
  double u = 0.0, v = 0.0;
};

// The point of a quadratic B-spline at parameter t, less an observation: of all control points
// three count.
class CurveCost final : public ceres::CostFunction {
 public:
  CurveCost(int num_control_points, double x, double y) : observation_{x, y} {
    set_num_residuals(2);
    mutable_parameter_block_sizes()->assign(static_cast<std::size_t>(num_control_points) + 1, 2);
    mutable_parameter_block_sizes()->front() = 1;
  }

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const auto n = static_cast<int>(parameter_block_sizes().size()) - 1;
    double t = std::fmod(parameters[0][0], n);
    t += t < 0.0 ? n : 0.0;
    const int first = std::min(static_cast<int>(t), n - 1);
    const double u = t - first;
    const double weights[3] = {0.5 * (1.0 - u) * (1.0 - u), 0.5 + u * (1.0 - u), 0.5 * u * u};
    const double slopes[3] = {u - 1.0, 1.0 - 2.0 * u, u};
    double tangent[2] = {0.0, 0.0};
    for (int d = 0; d < 2; ++d) {
      residuals[d] = -observation_[d];
      for (int k = 0; k < 3; ++k) {
        residuals[d] += weights[k] * parameters[1 + (first + k) % n][d];
        tangent[d] += slopes[k] * parameters[1 + (first + k) % n][d];
      }
    }
    if (jacobians == nullptr) {
      return true;
    }
    if (jacobians[0] != nullptr) {
      std::copy_n(tangent, 2, jacobians[0]);
    }
    for (int k = 1; k <= n; ++k) {
      if (jacobians[k] != nullptr) {
        std::fill_n(jacobians[k], 4, 0.0);
      }
    }
    for (int k = 0; k < 3; ++k) {
      if (double* jacobian = jacobians[1 + (first + k) % n]) {
        jacobian[0] = jacobian[3] = weights[k];
      }
    }
    return true;
  }

 private:
  double observation_[2];
};

// Keeps neighbors near each other.
struct Spring {
  template <typename T>
  bool operator()(const T* a, const T* b, T* residuals) const {
    residuals[0] = 1e-2 * (a[0] - b[0]);
    residuals[1] = 1e-2 * (a[1] - b[1]);
    return true;
  }
};

// A problem with the memory of its blocks.
struct Built {
  ceres::Problem problem;
  std::vector<double> intrinsics, cameras, points;  // of a curve: its control points and parameters
  int point_size = 3;
};

class BundleBuilder {
 public:
  BundleBuilder(const Arguments& arguments, Built* built)
      : num_cameras_(arguments.Number("cameras")),
        random_(static_cast<unsigned>(arguments.Number("seed"))),
        built_(*built) {
    built_.intrinsics = {500.0, 0.0, 0.0};
    built_.cameras.resize(6 * static_cast<std::size_t>(num_cameras_));
    for (int c = 0; c < num_cameras_; ++c) {
      built_.cameras[6 * static_cast<std::size_t>(c) + 1] = 2.0 * M_PI * c / num_cameras_;
      built_.cameras[6 * static_cast<std::size_t>(c) + 5] = 10.0;
    }
    const std::size_t num_points =
        static_cast<std::size_t>(arguments.Number("points") + arguments.Number("long_points"));
    built_.points.resize(3 * num_points);
    std::generate(built_.points.begin(), built_.points.end(), [this] { return normal_(random_); });
    std::size_t point = 0;
    for (int p = 0; p < arguments.Number("points"); ++p, ++point) {
      const int first = std::uniform_int_distribution<int>(0, num_cameras_ - 1)(random_);
      for (int k = 0; k < std::min(arguments.Number("track"), num_cameras_); ++k) {
        Observe((first + k) % num_cameras_, point);
      }
    }
    std::vector<int> order(static_cast<std::size_t>(num_cameras_));
    std::iota(order.begin(), order.end(), 0);
    for (int p = 0; p < arguments.Number("long_points"); ++p, ++point) {
      std::shuffle(order.begin(), order.end(), random_);
      for (int k = 0; k < std::min(arguments.Number("long_track"), num_cameras_); ++k) {
        Observe(order[static_cast<std::size_t>(k)], point);
      }
    }
    Disturb(arguments.Number("intrinsics") != 0);
  }

 private:
  double* Camera(int c) { return &built_.cameras[6 * static_cast<std::size_t>(c)]; }

  void Observe(int camera, std::size_t point) {
    double* x = &built_.points[3 * point];
    double seen[2];
    Reprojection exact;
    exact(built_.intrinsics.data(), Camera(camera), x, seen);
    built_.problem.AddResidualBlock(
        new ceres::AutoDiffCostFunction<Reprojection, 2, 3, 6, 3>(
            new Reprojection{seen[0] + 0.3 * normal_(random_), seen[1] + 0.3 * normal_(random_)}),
        nullptr, built_.intrinsics.data(), Camera(camera), x);
  }

  void Disturb(bool intrinsics_are_variable) {
    for (double& x : built_.points) {
      x += 0.03 * normal_(random_);
    }
    int constant = -1;
    for (int c = 0; c < num_cameras_; ++c) {
      for (int k = 0; k < 6; ++k) {
        Camera(c)[k] += 2e-3 * normal_(random_);
      }
      constant = constant < 0 && built_.problem.HasParameterBlock(Camera(c)) ? c : constant;
    }
    if (constant >= 0) {
      built_.problem.SetParameterBlockConstant(Camera(constant));
    }
    if (!intrinsics_are_variable) {
      built_.problem.SetParameterBlockConstant(built_.intrinsics.data());
    }
  }

  const int num_cameras_;
  std::mt19937 random_;
  std::normal_distribution<double> normal_;
  Built& built_;
};

void BuildCurve(const Arguments& arguments, Built* built) {
  const int n = arguments.Number("curve");
  const int m = arguments.Number("observations");
  std::mt19937 random(static_cast<unsigned>(arguments.Number("seed")));
  std::normal_distribution<double> normal;
  built->point_size = 1;
  built->cameras.resize(2 * static_cast<std::size_t>(n));
  for (int k = 0; k < n; ++k) {
    built->cameras[2 * static_cast<std::size_t>(k)] = 3.0 * std::cos(2.0 * M_PI * k / n);
    built->cameras[2 * static_cast<std::size_t>(k) + 1] = 3.0 * std::sin(2.0 * M_PI * k / n);
  }
  built->points.resize(static_cast<std::size_t>(m));
  for (int i = 0; i < m; ++i) {
    const double angle = 2.0 * M_PI * i / m;
    built->points[static_cast<std::size_t>(i)] = n * (angle / (2.0 * M_PI)) + 0.5 * normal(random);
    std::vector<double*> blocks = {&built->points[static_cast<std::size_t>(i)]};
    for (int k = 0; k < n; ++k) {
      blocks.push_back(&built->cameras[2 * static_cast<std::size_t>(k)]);
    }
    built->problem.AddResidualBlock(new CurveCost(n, 5.0 * std::cos(angle) + 0.02 * normal(random),
                                                  2.0 * std::sin(angle) + 0.02 * normal(random)),
                                    nullptr, blocks);
  }
  for (int k = 0; k < n; ++k) {
    built->problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Spring, 2, 2, 2>(new Spring),
                                    nullptr, &built->cameras[2 * static_cast<std::size_t>(k)],
                                    &built->cameras[2 * static_cast<std::size_t>((k + 1) % n)]);
  }
}

std::shared_ptr<ceres::ParameterBlockOrdering> OrderingOf(const std::string& name, Built* built) {
  if (name == "auto") {
    return nullptr;
  }
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  const bool points_first = name == "points";
  std::vector<double*> blocks;
  built->problem.GetParameterBlocks(&blocks);
  for (double* block : blocks) {
    const bool point =
        block >= built->points.data() && block < built->points.data() + built->points.size();
    const bool camera =
        block >= built->cameras.data() && block < built->cameras.data() + built->cameras.size();
    ordering->AddElementToGroup(block, (points_first ? point : camera) ? 0 : 1);
  }
  return ordering;
}

}  // namespace

int main(int argc, char** argv) {
  const Arguments arguments(argc, argv);
  Built built;
  ceres::Solver::Options options;
  if (arguments.Number("curve") > 0) {
    BuildCurve(arguments, &built);
    options.dynamic_sparsity = arguments.Number("dynamic") != 0;
  } else {
    BundleBuilder(arguments, &built);
  }
  std::string solver = arguments.Text("solver");
  std::transform(solver.begin(), solver.end(), solver.begin(),
                 [](char c) { return static_cast<char>(std::toupper(c)); });
  const std::string& ordering = arguments.Text("ordering");
  if (!ceres::StringToLinearSolverType(solver, &options.linear_solver_type) ||
      (ordering != "auto" && ordering != "points" && ordering != "cameras")) {
    std::fprintf(stderr, "elimination_problems: --solver %s, --ordering %s: one is unknown\n\n%s",
                 solver.c_str(), ordering.c_str(), kUsage);
    return 2;
  }
  options.linear_solver_ordering = OrderingOf(ordering, &built);
  options.max_num_iterations = arguments.Number("iterations");
  options.function_tolerance = 1e-12;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &built.problem, &summary);
  rusage usage = {};
  getrusage(RUSAGE_SELF, &usage);
  std::printf(
      "{\"seconds\": %.6f, \"peak_bytes\": %lld, \"initial_cost\": %.12g, \"final_cost\": %.12g, "
      "\"iterations\": %d, "
      "\"usable\": %s}\n",
      summary.total_time_in_seconds, static_cast<long long>(usage.ru_maxrss) * 1024,
      summary.initial_cost, summary.final_cost, static_cast<int>(summary.iterations.size()),
      summary.IsSolutionUsable() ? "true" : "false");
  return summary.IsSolutionUsable() ? 0 : 1;
}
