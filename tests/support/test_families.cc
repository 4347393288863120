#include "support/test_families.h"

#include <cmath>

namespace inceres::test {

SmoothFamily::SmoothFamily(int residual_size, std::vector<Slot> slots)
    : AmbientFamily(residual_size, std::move(slots)) {
  for (int s = 0; s < num_slots(); ++s) {
    num_entries_ += slot(s).ambient_size;
  }
}

// Per row: c, then A, B and φ of each entry.
SmoothFamily::Measurement SmoothFamily::MakeMeasurement(Random* random) const {
  Measurement measurement;
  for (int r = 0; r < residual_size(); ++r) {
    measurement.push_back(0.0);
    for (int k = 0; k < num_entries_; ++k) {
      measurement.push_back(random->Unit());
      measurement.push_back(0.3 * random->Unit());
      measurement.push_back(3.0 * random->Unit());
    }
  }
  return measurement;
}

void SmoothFamily::SetResiduals(int i, const double* const* parameters, const double* residuals) {
  std::vector<double> f(static_cast<std::size_t>(residual_size()));
  EvaluateOne(i, parameters, f.data(), nullptr);
  for (int r = 0; r < residual_size(); ++r) {
    measurements_[static_cast<std::size_t>(i)]
                 [static_cast<std::size_t>(r * (1 + 3 * num_entries_))] +=
        residuals[r] - f[static_cast<std::size_t>(r)];
  }
}

bool SmoothFamily::EvaluateOne(int i, const double* const* parameters, double* residuals,
                               double** jacobians) const {
  const double* next = measurements_[static_cast<std::size_t>(i)].data();
  for (int r = 0; r < residual_size(); ++r) {
    residuals[r] = *next++;
    for (int s = 0; s < num_slots(); ++s) {
      const int size = slot(s).ambient_size;
      for (int k = 0; k < size; ++k, next += 3) {
        const double x = parameters[s][k];
        residuals[r] += next[0] * x + next[1] * std::sin(x + next[2]);
        if (jacobians != nullptr && jacobians[s] != nullptr) {
          jacobians[s][r * size + k] = next[0] + next[1] * std::cos(x + next[2]);
        }
      }
    }
  }
  return true;
}

}  // namespace inceres::test
