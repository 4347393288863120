#include "conformance/support.h"

#include <dlfcn.h>

#include <atomic>
#include <cmath>
#include <cstdlib>
#include <iostream>
#include <mutex>
#include <random>
#include <sstream>

#include <glog/logging.h>

namespace conformance {
namespace {

std::atomic<int> num_calls_by_us{0};
std::atomic<int> num_calls_by_stock{0};

std::string LibraryAt(const void* address) {
  Dl_info info;
  return dladdr(address, &info) != 0 && info.dli_fname != nullptr ? info.dli_fname : "";
}

// Inlined code of a cost function is part of this program; what calls it is the solver's library.
void NoteCaller(const void* return_address) {
  thread_local const void* last_address = nullptr;
  thread_local bool last_is_ours = false;
  if (return_address != last_address) {
    last_address = return_address;
    const std::string library = LibraryAt(return_address);
    last_is_ours = library.substr(library.rfind('/') + 1).find("inceres") != std::string::npos;
  }
  ++(last_is_ours ? num_calls_by_us : num_calls_by_stock);
}

class LogLines : public google::LogSink {
 public:
  explicit LogLines(Outcome* outcome) : outcome_(outcome) { google::AddLogSink(this); }
  ~LogLines() override { google::RemoveLogSink(this); }
  void send(google::LogSeverity severity, const char*, const char*, int, const tm*,
            const char* message, std::size_t length) override {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (severity == google::GLOG_ERROR) {
      outcome_->errors.emplace_back(message, length);
    } else if (severity == google::GLOG_WARNING) {
      outcome_->warnings.emplace_back(message, length);
    }
  }

 private:
  Outcome* outcome_;
  std::mutex mutex_;
};

class CapturedOutput {
 public:
  CapturedOutput() : previous_(std::cout.rdbuf(text_.rdbuf())) {}
  ~CapturedOutput() { std::cout.rdbuf(previous_); }
  std::string text() const { return text_.str(); }

 private:
  std::ostringstream text_;
  std::streambuf* previous_;
};

bool SolvedByUs() {
  return ThisRun() == Way::kActive || ThisRun() == Way::kIncremental;
}

}  // namespace

Way ThisRun() {
  const char* way = std::getenv("INCERES_CONFORMANCE");
  const std::string name = way == nullptr ? "bare" : way;
  CHECK(name == "bare" || name == "fallback" || name == "active" || name == "incremental")
      << "INCERES_CONFORMANCE=" << name;
  return name == "bare"       ? Way::kBare
         : name == "fallback" ? Way::kFallback
         : name == "active"   ? Way::kActive
                              : Way::kIncremental;
}

std::string LibraryOfSolve() {
  return LibraryAt(
      dlsym(RTLD_DEFAULT, "_ZN5ceres6Solver5SolveERKNS0_7OptionsEPNS_7ProblemEPNS0_7SummaryE"));
}

bool Cost::Evaluate(double const* const* parameters, double* residuals, double** jacobians) const {
  NoteCaller(__builtin_return_address(0));
  return lambdas::Cost::Evaluate(parameters, residuals, jacobians);
}

Cost* Target(std::vector<double> target, double weight) {
  const int size = static_cast<int>(target.size());
  return new Cost(
      size, {size}, [=](double const* const* parameters, double* residuals, double** jacobians) {
        for (int i = 0; i < size; ++i) {
          residuals[i] = weight * (parameters[0][i] - target[static_cast<std::size_t>(i)]);
          for (int k = 0; k < size && jacobians != nullptr && jacobians[0] != nullptr; ++k) {
            jacobians[0][i * size + k] = i == k ? weight : 0.0;
          }
        }
        return true;
      });
}

Cost* Scalar(std::function<double(double)> f, std::function<double(double)> derivative) {
  return new Cost(1, {1},
                  [=](double const* const* parameters, double* residuals, double** jacobians) {
                    residuals[0] = f(parameters[0][0]);
                    if (jacobians != nullptr && jacobians[0] != nullptr) {
                      jacobians[0][0] = derivative(parameters[0][0]);
                    }
                    return true;
                  });
}

Cost* OnlyAt(double x) {
  return new Cost(1, {1}, [x](double const* const* p, double* residuals, double** jacobians) {
    residuals[0] = 10.0 - p[0][0];
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      jacobians[0][0] = -1.0;
    }
    return p[0][0] == x;
  });
}

Cost* Coupled(int num_residuals, const std::vector<int>& sizes, int seed) {
  std::mt19937 engine(static_cast<unsigned>(seed));
  const auto draw = [&] { return static_cast<double>(engine() % 2001) / 1000.0 - 1.0; };
  std::vector<std::vector<double>> a;
  for (const int size : sizes) {
    a.emplace_back(static_cast<std::size_t>(num_residuals * size));
    for (double& entry : a.back()) {
      entry = draw();
    }
  }
  std::vector<double> b(static_cast<std::size_t>(num_residuals));
  for (double& entry : b) {
    entry = draw();
  }
  return new Cost(
      num_residuals, sizes,
      [=](double const* const* parameters, double* residuals, double** jacobians) {
        for (int i = 0; i < num_residuals; ++i) {
          residuals[i] = 0.1 * std::sin(parameters[0][0] + i) - b[static_cast<std::size_t>(i)];
          for (std::size_t k = 0; k < sizes.size(); ++k) {
            double* jacobian = jacobians == nullptr ? nullptr : jacobians[k];
            for (int c = 0; c < sizes[k]; ++c) {
              const double entry = a[k][static_cast<std::size_t>(i * sizes[k] + c)];
              residuals[i] += entry * parameters[k][c];
              if (jacobian != nullptr) {
                jacobian[i * sizes[k] + c] =
                    entry + (k == 0 && c == 0 ? 0.1 * std::cos(parameters[0][0] + i) : 0.0);
              }
            }
          }
        }
        return true;
      });
}

Line::Line(double start) : x(Add({start})) {
  problem.AddResidualBlock(Scalar([](double v) { return 10.0 - v; }, [](double) { return -1.0; }),
                           nullptr, x);
}

Parabola::Parabola() : x(Add({1.0})) {
  problem.AddResidualBlock(Scalar([](double v) { return v * v; }, [](double v) { return 2.0 * v; }),
                           nullptr, x);
}

NeverValid::NeverValid() : x(Add({0.0})) {
  problem.AddResidualBlock(Scalar([](double) { return 1.0; }, [](double) { return 1e-200; }),
                           nullptr, x);
}

Rosenbrock::Rosenbrock() : x(Add({-1.2, 1.0})) {
  auto* cost =
      new Cost(2, {2}, [](double const* const* parameters, double* residuals, double** jacobians) {
        const double* v = parameters[0];
        residuals[0] = 1.0 - v[0];
        residuals[1] = 10.0 * (v[1] - v[0] * v[0]);
        if (jacobians != nullptr && jacobians[0] != nullptr) {
          jacobians[0][0] = -1.0;
          jacobians[0][1] = 0.0;
          jacobians[0][2] = -20.0 * v[0];
          jacobians[0][3] = 10.0;
        }
        return true;
      });
  problem.AddResidualBlock(cost, nullptr, x);
}

Bundle::Bundle(int num_cameras, int num_points) {
  for (int c = 0; c < num_cameras; ++c) {
    cameras.push_back(Add(std::vector<double>(6, 0.1 * c)));
    problem.AddResidualBlock(Target(std::vector<double>(6, 0.2)), nullptr, cameras.back());
  }
  for (int p = 0; p < num_points; ++p) {
    points.push_back(Add({1.0, 0.1 * p, -0.5}));
    for (int c = 0; c < num_cameras; ++c) {
      problem.AddResidualBlock(Coupled(2, {6, 3}, 100 * c + p), nullptr,
                               cameras[static_cast<std::size_t>(c)], points.back());
    }
  }
}

Outcome Solve(const Options& options, ceres::Problem* problem, Solver solver) {
  Outcome outcome;
  const int by_us = num_calls_by_us;
  const int by_stock = num_calls_by_stock;
  {
    const LogLines log(&outcome);
    const CapturedOutput output;
    ceres::Solve(options, problem, &outcome.summary);
    outcome.printed = output.text();
  }
  if (!SolvedByUs()) {
    EXPECT_EQ(num_calls_by_us, by_us)
        << "inceres has called a cost function in a run that is stock Ceres's";
  } else if (solver == Solver::kOurs) {
    EXPECT_EQ(num_calls_by_stock, by_stock)
        << "stock Ceres has called a cost function of a problem that is ours";
  }
  return outcome;
}

Options Small() {
  Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  return options;
}

Options Schur() {
  Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  return options;
}

void ExpectClose(double a, double b, double tolerance) {
  EXPECT_LE(std::abs(a - b), tolerance * std::max(std::abs(a), std::abs(b))) << a << " and " << b;
}

bool StartsWith(const std::string& text, const std::string& start) {
  return text.rfind(start, 0) == 0;
}

Summary ExpectNoEffect(const Options& base, const std::function<void(Options*)>& change) {
  Options changed = base;
  change(&changed);
  Summary summaries[2];
  for (const bool with : {false, true}) {
    std::unique_ptr<World> world;
    if (base.linear_solver_type == ceres::DENSE_QR) {
      world = std::make_unique<Rosenbrock>();
    } else {
      world = std::make_unique<Bundle>();
    }
    summaries[with] = Solve(with ? changed : base, &world->problem).summary;
    EXPECT_EQ(summaries[with].termination_type, ceres::CONVERGENCE) << summaries[with].message;
  }
  const auto& before = summaries[0].iterations;
  const auto& after = summaries[1].iterations;
  EXPECT_EQ(before.size(), after.size());
  for (std::size_t i = 0; i < std::min(before.size(), after.size()); ++i) {
    EXPECT_NEAR(before[i].cost, after[i].cost, 1e-9 * before[0].cost) << "iteration " << i;
    ExpectClose(before[i].trust_region_radius, after[i].trust_region_radius, 1e-6);
  }
  return summaries[1];
}

}  // namespace conformance
