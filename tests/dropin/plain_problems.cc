#include "dropin/plain_problems.h"

#include <array>
#include <cmath>
#include <deque>

#include <ceres/autodiff_cost_function.h>
#include <ceres/loss_function.h>
#include <ceres/rotation.h>
#include <ceres/sized_cost_function.h>

namespace plain {
namespace {

struct CurvePoint {
  double t;
  double y;
  template <typename T>
  bool operator()(const T* x, T* residual) const {
    residual[0] = y - exp(x[0] * t + x[1]) - x[2];
    return true;
  }
};

using Pose = std::array<double, 3>;

// The pose as seen from the one before, with analytic Jacobians; `measured` may change while it is
// out of the problem.
class Between : public ceres::SizedCostFunction<3, 3, 3> {
 public:
  Pose measured{};
  bool Evaluate(const double* const* x, double* residuals, double** jacobians) const override {
    const double c = std::cos(x[0][2]);
    const double s = std::sin(x[0][2]);
    const double dx = x[1][0] - x[0][0];
    const double dy = x[1][1] - x[0][1];
    residuals[0] = 10.0 * (c * dx + s * dy - measured[0]);
    residuals[1] = 10.0 * (-s * dx + c * dy - measured[1]);
    residuals[2] = 10.0 * (x[1][2] - x[0][2] - measured[2]);
    if (jacobians == nullptr) {
      return true;
    }
    if (jacobians[0] != nullptr) {
      const double J[9] = {-c, -s, -s * dx + c * dy, s, -c, -c * dx - s * dy, 0.0, 0.0, -1.0};
      for (int i = 0; i < 9; ++i) {
        jacobians[0][i] = 10.0 * J[i];
      }
    }
    if (jacobians[1] != nullptr) {
      const double J[9] = {c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0};
      for (int i = 0; i < 9; ++i) {
        jacobians[1][i] = 10.0 * J[i];
      }
    }
    return true;
  }
};

// Where a pose is, roughly.
class Fix : public ceres::SizedCostFunction<3, 3> {
 public:
  explicit Fix(const Pose& at) : at_(at) {}
  bool Evaluate(const double* const* x, double* residuals, double** jacobians) const override {
    for (int i = 0; i < 3; ++i) {
      residuals[i] = x[0][i] - at_[i];
    }
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      for (int i = 0; i < 9; ++i) {
        jacobians[0][i] = i % 4 == 0 ? 1.0 : 0.0;
      }
    }
    return true;
  }

 private:
  Pose at_;
};

// Repeatable noise.
double Noise(int i) {
  return 0.1 * std::sin(12.9898 * i + 78.233 * i * i);
}

}  // namespace

void Curve::AddTo(ceres::Problem* problem) {
  for (int i = 0; i < 53; ++i) {
    const double t = 0.1 * i;
    const double y = std::exp(0.3 * t + 0.1) + 0.5 + Noise(i);
    problem->AddResidualBlock(
        new ceres::AutoDiffCostFunction<CurvePoint, 1, 3>(new CurvePoint{t, y}), nullptr, x.data());
  }
}

void Curve::Restart() {
  x = {0.0, 0.0, 0.0};
}

ceres::Solver::Options CurveOptions() {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.function_tolerance = 1e-9;
  return options;
}

struct Chain::Impl {
  std::deque<std::unique_ptr<Pose>> poses;
  std::deque<ceres::ResidualBlockId> betweens;
  std::deque<Between*> betweens_of;
  int frame = 0;
};

Chain::Chain() : impl_(std::make_unique<Impl>()) {
}

Chain::~Chain() = default;

void Chain::Grow(ceres::Problem* problem) {
  Impl& chain = *impl_;
  const int i = chain.frame++;
  const Pose truth = {0.7 * i, 0.3 * std::sin(0.4 * i), 0.1 * i};
  chain.poses.push_back(std::make_unique<Pose>(
      Pose{truth[0] + Noise(i), truth[1] + Noise(i + 1), truth[2] + Noise(i + 2)}));
  double* pose = chain.poses.back()->data();
  problem->AddResidualBlock(
      new Fix({truth[0] + Noise(3 * i), truth[1] + Noise(5 * i), truth[2] + Noise(7 * i)}),
      new ceres::HuberLoss(0.1), pose);
  if (i == 0) {
    return;
  }
  double* before = chain.poses[chain.poses.size() - 2]->data();
  auto* between = new Between;
  between->measured = {0.7 + 0.1 * Noise(i), 0.1 * Noise(i + 5), 0.1};
  chain.betweens_of.push_back(between);
  chain.betweens.push_back(problem->AddResidualBlock(between, nullptr, before, pose));
  if (chain.poses.size() > 6) {
    problem->RemoveParameterBlock(chain.poses.front()->data());
    chain.poses.pop_front();
    chain.betweens.pop_front();
    chain.betweens_of.pop_front();
  }
}

std::vector<double> Chain::Values() const {
  std::vector<double> values;
  for (const auto& pose : impl_->poses) {
    values.insert(values.end(), pose->begin(), pose->end());
  }
  return values;
}

ceres::Solver::Options ChainOptions() {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.function_tolerance = 1e-12;
  options.parameter_tolerance = 1e-14;
  options.gradient_tolerance = 1e-14;
  return options;
}

namespace {

constexpr int kNumPhotos = 1000;
constexpr int kNumPhotoPoints = 1000;
constexpr int kViewsOfPoint = 20;
constexpr int kNearest = 200;
constexpr double kSpacing = 0.05;
constexpr double kFocal = 500.0;

// The same numbers with every standard library: the leading bits of a linear congruence.
class Numbers {
 public:
  double Between(double low, double high) {
    state_ = state_ * 6364136223846793005ULL + 1442695040888963407ULL;
    return low + (high - low) * static_cast<double>(state_ >> 11) / 9007199254740992.0;
  }

 private:
  unsigned long long state_ = 2011;
};

struct PhotoView {
  double pixel[2];
  template <typename T>
  bool operator()(const T* camera, const T* point, T* residuals) const {
    T x[3];
    ceres::AngleAxisRotatePoint(camera, point, x);
    for (int k = 0; k < 2; ++k) {
      residuals[k] = kFocal * (x[k] + camera[3 + k]) / (x[2] + camera[5]) - pixel[k];
    }
    return true;
  }
};

}  // namespace

Photos::Photos() {
  Numbers numbers;
  for (int i = 0; i < kNumPhotos; ++i) {
    for (int k = 0; k < 6; ++k) {
      cameras_.push_back((k == 3 ? -kSpacing * i : 0.0) + numbers.Between(-0.01, 0.01));
    }
  }
  for (int p = 0; p < kNumPhotoPoints; ++p) {
    const double center = numbers.Between(0.0, kNumPhotos - kNearest);
    const double at[3] = {kSpacing * (center + 0.5 * kNearest), numbers.Between(-5.0, 5.0),
                          numbers.Between(20.0, 40.0)};
    for (int v = 0; v < kViewsOfPoint; ++v) {
      // One of each stretch of ten: no camera twice.
      const double share = kNearest / kViewsOfPoint;
      const int camera = static_cast<int>(center + share * (v + numbers.Between(0.0, 0.9)));
      const double x[2] = {at[0] - kSpacing * camera, at[1]};
      views_.push_back({camera,
                        p,
                        {kFocal * x[0] / at[2] + numbers.Between(-0.5, 0.5),
                         kFocal * x[1] / at[2] + numbers.Between(-0.5, 0.5)}});
    }
    for (const double coordinate : at) {
      points_.push_back(coordinate + numbers.Between(-0.05, 0.05));
    }
  }
}

void Photos::AddTo(ceres::Problem* problem) {
  for (const View& view : views_) {
    problem->AddResidualBlock(new ceres::AutoDiffCostFunction<PhotoView, 2, 6, 3>(
                                  new PhotoView{{view.pixel[0], view.pixel[1]}}),
                              nullptr, cameras_.data() + 6 * view.camera,
                              points_.data() + 3 * view.point);
  }
}

ceres::Solver::Options PhotosOptions() {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::ITERATIVE_SCHUR;
  options.preconditioner_type = ceres::SCHUR_JACOBI;
  options.max_num_iterations = 5;
  options.logging_type = ceres::SILENT;
  return options;
}

}  // namespace plain
