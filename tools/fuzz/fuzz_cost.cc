#include "tools/fuzz/fuzz_cost.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace inceres::fuzz {
namespace {

constexpr double kNearest = 0.05;     // of a point that a camera sees
constexpr double kTipRadius = 1e-2;   // radius of the rounded tip of kDistance's cone
constexpr double kFocalLength = 1.0;  // of cameras that do not estimate it
constexpr double kFieldOfView = 0.5;  // tangent of half of it, where rays are drawn

// Counts a call for as long as it lasts.
class Call {
 public:
  Call() : watch_(TheCallWatch()) {
    if (!watch_.may_call) {
      ++watch_.calls_too_late;
    }
    if (++watch_.active > 1 && !watch_.may_overlap) {
      ++watch_.overlapping_calls;
    }
  }
  ~Call() { --watch_.active; }
  Call(const Call&) = delete;
  Call& operator=(const Call&) = delete;

 private:
  CallWatch& watch_;
};

std::size_t At(int i) {
  return static_cast<std::size_t>(i);
}

}  // namespace

CallWatch& TheCallWatch() {
  static CallWatch watch;
  return watch;
}

FuzzCost::FuzzCost(Kind kind, const std::vector<int>& sizes, int num_residuals, double weight,
                   double curvature, Dice* dice)
    : kind_(kind), weight_(weight), curvature_(curvature) {
  for (const int block_size : sizes) {
    mutable_parameter_block_sizes()->push_back(block_size);
    num_parameters_ += block_size;
  }
  set_num_residuals(num_residuals);
  b_.resize(At(num_residuals));
  if (kind == Kind::kSmooth) {
    A_.resize(At(num_residuals * num_parameters_));
    for (double& a : A_) {
      a = dice->Signed();
    }
  } else if (kind == Kind::kRay) {
    A_ = {kFieldOfView * dice->Signed(), kFieldOfView * dice->Signed()};
  }
}

void FuzzCost::Measure(const std::vector<const double*>& truth, double noise, Dice* dice) {
  std::fill(b_.begin(), b_.end(), 0.0);
  std::vector<double> prediction(b_.size());
  const double weight = weight_;
  weight_ = 1.0;
  EvaluateSound(truth.data(), prediction.data(), nullptr);
  weight_ = weight;
  for (std::size_t i = 0; i < b_.size(); ++i) {
    b_[i] = prediction[i] + noise * dice->Signed();
  }
}

void FuzzCost::Shift(double size, Dice* dice) {
  for (double& b : b_) {
    b += size * dice->Signed();
  }
}

double FuzzCost::Magnitude(double const* const* parameters) const {
  double sum = 0.0;
  for (int i = 0; i < num_residuals(); ++i) {
    double terms = std::abs(b_[At(i)]);
    const double* a = kind_ == Kind::kSmooth ? &A_[At(i * num_parameters_)] : nullptr;
    for (int k = 0; k < static_cast<int>(parameter_block_sizes().size()); ++k) {
      for (int j = 0; j < size(k); ++j) {
        terms += (a != nullptr ? std::abs(*a++) : 1.0) * (std::abs(parameters[k][j]) + curvature_);
      }
    }
    sum += 0.5 * weight_ * weight_ * terms * terms;
  }
  return sum;
}

void FuzzCost::SetFault(Fault fault, const double* x, double margin, Dice* dice) {
  fault_ = fault;
  direction_.resize(At(size(0)));
  limit_ = margin;
  for (std::size_t j = 0; j < direction_.size(); ++j) {
    direction_[j] = dice->Signed();
    limit_ += direction_[j] * x[j];
  }
}

bool FuzzCost::IsFaulty(const double* x) const {
  double distance = 0.0;
  for (std::size_t j = 0; fault_ != Fault::kNone && j < direction_.size(); ++j) {
    distance += direction_[j] * x[j];
  }
  return fault_ != Fault::kNone && distance > limit_;
}

bool FuzzCost::Evaluate(double const* const* parameters, double* residuals,
                        double** jacobians) const {
  const Call call;
  const bool faulty = IsFaulty(parameters[0]);
  if (faulty && fault_ == Fault::kRefuse) {
    return false;
  }
  const bool evaluated = EvaluateSound(parameters, residuals, jacobians);
  if (evaluated && faulty && fault_ == Fault::kNanResidual) {
    residuals[num_residuals() - 1] = std::numeric_limits<double>::quiet_NaN();
  }
  if (evaluated && faulty && fault_ == Fault::kInfResidual) {
    residuals[num_residuals() - 1] = std::numeric_limits<double>::infinity();
  }
  if (evaluated && faulty && fault_ == Fault::kNanJacobian && jacobians != nullptr &&
      jacobians[0] != nullptr) {
    jacobians[0][0] = std::numeric_limits<double>::quiet_NaN();
  }
  return evaluated;
}

bool FuzzCost::EvaluateSound(double const* const* parameters, double* residuals,
                             double** jacobians) const {
  switch (kind_) {
    case Kind::kProjection:
    case Kind::kUnguarded:
      return Projection(parameters, residuals, jacobians);
    case Kind::kSmooth:
      Smooth(parameters, residuals, jacobians);
      break;
    case Kind::kDistance:
      Distance(parameters, residuals, jacobians);
      break;
    case Kind::kRay:
      Ray(parameters, residuals, jacobians);
      break;
  }
  return true;
}

void FuzzCost::Smooth(double const* const* parameters, double* residuals,
                      double** jacobians) const {
  const int m = num_residuals();
  for (int i = 0; i < m; ++i) {
    residuals[i] = -weight_ * b_[At(i)];
  }
  int column = 0;
  for (int k = 0; k < static_cast<int>(parameter_block_sizes().size()); ++k) {
    for (int j = 0; j < size(k); ++j, ++column) {
      const double x = parameters[k][j];
      const double phi = x + curvature_ * std::sin(x);
      const double slope = 1.0 + curvature_ * std::cos(x);
      for (int i = 0; i < m; ++i) {
        const double a = weight_ * A_[At(i * num_parameters_ + column)];
        residuals[i] += a * phi;
        if (jacobians != nullptr && jacobians[k] != nullptr) {
          jacobians[k][i * size(k) + j] = a * slope;
        }
      }
    }
  }
}

bool FuzzCost::Projection(double const* const* parameters, double* residuals,
                          double** jacobians) const {
  using Vector3 = std::array<double, 3>;
  const double* camera = parameters[0];
  const int camera_size = size(0);
  const Vector3 omega =
      camera_size >= 6 ? Vector3{camera[3], camera[4], camera[5]} : Vector3{0.0, 0.0, 0.0};
  const double f = camera_size == 7 ? camera[6] : kFocalLength;
  const auto cross = [](const Vector3& a, const Vector3& b) {
    return Vector3{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
  };
  Vector3 q;
  for (std::size_t j = 0; j < 3; ++j) {
    q[j] = parameters[1][j] - camera[j];
  }
  const Vector3 turned = cross(omega, q);
  const Vector3 p = {q[0] + turned[0], q[1] + turned[1], q[2] + turned[2]};
  if (kind_ == Kind::kProjection && p[2] < kNearest) {
    return false;
  }
  const double inverse = 1.0 / p[2];
  const Vector3 ray = {p[0] * inverse, p[1] * inverse, 1.0};
  for (std::size_t i = 0; i < 2; ++i) {
    residuals[i] = weight_ * (f * ray[i] - b_[i]);
  }
  if (jacobians == nullptr) {
    return true;
  }
  for (std::size_t i = 0; i < 2; ++i) {
    // Of residual i by a movement d of p.
    const auto derivative = [&](const Vector3& d) {
      return weight_ * f * inverse * (d[i] - ray[i] * d[2]);
    };
    for (std::size_t j = 0; j < 3; ++j) {
      Vector3 e = {0.0, 0.0, 0.0};
      e[j] = 1.0;
      const Vector3 e_turned = cross(omega, e);
      const double by_point =
          derivative({e[0] + e_turned[0], e[1] + e_turned[1], e[2] + e_turned[2]});
      if (jacobians[1] != nullptr) {
        jacobians[1][i * 3 + j] = by_point;
      }
      if (jacobians[0] != nullptr) {
        jacobians[0][i * At(camera_size) + j] = -by_point;
        if (camera_size >= 6) {
          jacobians[0][i * At(camera_size) + 3 + j] = derivative(cross(e, q));
        }
      }
    }
    if (jacobians[0] != nullptr && camera_size == 7) {
      jacobians[0][i * 7 + 6] = weight_ * ray[i];
    }
  }
  return true;
}

void FuzzCost::Distance(double const* const* parameters, double* residuals,
                        double** jacobians) const {
  double squared = kTipRadius * kTipRadius;
  for (int j = 0; j < size(0); ++j) {
    const double d = parameters[1][j] - parameters[0][j];
    squared += d * d;
  }
  const double distance = std::sqrt(squared);
  residuals[0] = weight_ * (distance - b_[0]);
  for (int j = 0; jacobians != nullptr && j < size(0); ++j) {
    const double slope = weight_ * (parameters[1][j] - parameters[0][j]) / distance;
    if (jacobians[0] != nullptr) {
      jacobians[0][j] = -slope;
    }
    if (jacobians[1] != nullptr) {
      jacobians[1][j] = slope;
    }
  }
}

void FuzzCost::Ray(double const* const* parameters, double* residuals, double** jacobians) const {
  const double depth = 1.0 / parameters[2][0];
  const std::array<double, 3> ray = {A_[0], A_[1], 1.0};
  std::array<double, 3> p;
  for (std::size_t j = 0; j < 3; ++j) {
    p[j] = parameters[0][j] + depth * ray[j] - parameters[1][j];
  }
  const double inverse = 1.0 / p[2];
  for (std::size_t i = 0; i < 2; ++i) {
    residuals[i] = weight_ * (p[i] * inverse - b_[i]);
    // Of residual i by p.
    std::array<double, 3> by_p = {0.0, 0.0, -weight_ * p[i] * inverse * inverse};
    by_p[i] = weight_ * inverse;
    double by_depth = 0.0;
    for (std::size_t j = 0; j < 3; ++j) {
      by_depth += by_p[j] * ray[j];
      if (jacobians != nullptr && jacobians[0] != nullptr) {
        jacobians[0][i * At(size(0)) + j] = by_p[j];
      }
      if (jacobians != nullptr && jacobians[1] != nullptr) {
        jacobians[1][i * At(size(1)) + j] = -by_p[j];
      }
    }
    if (jacobians != nullptr && jacobians[2] != nullptr) {
      jacobians[2][i] = -depth * depth * by_depth;
    }
  }
}

}  // namespace inceres::fuzz
