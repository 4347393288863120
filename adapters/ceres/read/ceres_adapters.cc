#include "adapters/ceres/read/ceres_adapters.h"

#include <cmath>
#include <cstring>

namespace inceres::internal {
namespace {

constexpr int kMaxExponent = 12;

std::vector<double> FingerprintOf(const ceres::LossFunction& loss) {
  std::vector<double> values;
  values.reserve(3 * (2 * kMaxExponent + 1));
  for (int k = -kMaxExponent; k <= kMaxExponent; ++k) {
    double rho[3] = {0.0, 0.0, 0.0};
    loss.Evaluate(std::ldexp(1.0, 2 * k), rho);
    values.insert(values.end(), rho, rho + 3);
  }
  return values;
}

bool SameBits(const std::vector<double>& a, const std::vector<double>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(double)) == 0;
}

}  // namespace

const std::shared_ptr<const Loss>& LossTable::Get(const ceres::LossFunction* loss) {
  if (loss == nullptr) {
    return null_;
  }
  if (loss == last_loss_) {
    return *last_;
  }
  Entry& entry = entries_[loss];
  if (entry.solve != solve_) {
    std::vector<double> fingerprint = FingerprintOf(*loss);
    if (entry.adapter == nullptr || !SameBits(fingerprint, entry.fingerprint)) {
      entry.adapter = std::make_shared<CeresLoss>(loss);
      entry.fingerprint = std::move(fingerprint);
    }
    entry.solve = solve_;
  }
  last_loss_ = loss;
  last_ = &entry.adapter;
  return entry.adapter;
}

void LossTable::End() {
  for (auto it = entries_.begin(); it != entries_.end();) {
    it = it->second.solve == solve_ ? std::next(it) : entries_.erase(it);
  }
  last_loss_ = nullptr;
}

}  // namespace inceres::internal
