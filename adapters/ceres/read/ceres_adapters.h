#pragma once

#include <memory>
#include <unordered_map>
#include <vector>

#include <ceres/loss_function.h>

#include "adapters/ceres/read/ceres_version.h"
#include "inceres/problem/losses.h"
#include "inceres/problem/manifolds.h"

namespace inceres::internal {

/// A user's manifold behind the core's interface.
class CeresManifold : public Manifold {
 public:
  explicit CeresManifold(const UserManifold* manifold) : manifold_(manifold) {}
  int AmbientSize() const override { return AmbientSizeOf(*manifold_); }
  int TangentSize() const override { return TangentSizeOf(*manifold_); }
  [[nodiscard]] bool Plus(const double* x, const double* delta,
                          double* x_plus_delta) const override {
    return manifold_->Plus(x, delta, x_plus_delta);
  }
  [[nodiscard]] bool PlusJacobian(const double* x, double* jacobian) const override {
    return PlusJacobianOf(*manifold_, x, jacobian);
  }

 private:
  const UserManifold* manifold_;
};

/// A ceres::LossFunction behind the core's interface.
class CeresLoss : public Loss {
 public:
  explicit CeresLoss(const ceres::LossFunction* loss) : loss_(loss) {}
  void Evaluate(double s, double rho[3]) const override { loss_->Evaluate(s, rho); }

 private:
  const ceres::LossFunction* loss_;
};

/// One adapter for each distinct object of the user's; the last one is remembered, for neighbors
/// mostly share.
template <typename Base, typename Adapter, typename Foreign>
class AdapterTable {
 public:
  /// Null for null.
  const std::shared_ptr<const Base>& Get(const Foreign* foreign) {
    if (foreign == nullptr) {
      return null_;
    }
    if (foreign != last_foreign_) {
      std::shared_ptr<const Base>& adapter = adapters_[foreign];
      if (adapter == nullptr) {
        adapter = std::make_shared<Adapter>(foreign);
      }
      last_foreign_ = foreign;
      last_ = &adapter;
    }
    return *last_;
  }

 private:
  std::unordered_map<const Foreign*, std::shared_ptr<const Base>> adapters_;
  std::shared_ptr<const Base> null_;
  const Foreign* last_foreign_ = nullptr;
  const std::shared_ptr<const Base>* last_ = nullptr;
};

using ManifoldTable = AdapterTable<Manifold, CeresManifold, UserManifold>;

/// One adapter for each of the user's losses, over several solves. A loss that comes back at the
/// same address keeps its adapter only if it still gives the same values at 25 arguments from 4⁻¹²
/// to 4¹²: a factor whose adapter is not the one Get returns has another loss.
class LossTable {
 public:
  /// Begins a solve: each loss is looked at again.
  void Begin() {
    ++solve_;
    last_loss_ = nullptr;
  }
  /// The adapter of a loss of this solve; null for null. Cost: one hash lookup where the loss
  /// differs from the one before.
  const std::shared_ptr<const Loss>& Get(const ceres::LossFunction* loss);
  /// Ends a solve: what was not asked for is forgotten, for it may be gone.
  void End();
  void Forget(const ceres::LossFunction* loss) { entries_.erase(loss); }

 private:
  struct Entry {
    std::shared_ptr<const Loss> adapter;
    std::vector<double> fingerprint;
    int solve = -1;
  };

  std::unordered_map<const ceres::LossFunction*, Entry> entries_;
  int solve_ = 0;
  const ceres::LossFunction* last_loss_ = nullptr;
  const std::shared_ptr<const Loss>* last_ = nullptr;
  std::shared_ptr<const Loss> null_;
};

}  // namespace inceres::internal
