#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "linear/cluster_cholesky.h"
#include "linear/coarse_space.h"
#include "schur/frame_aggregates.h"
#include "schur/gauge_modes.h"
#include "schur/projected_products.h"
#include "trust_region/preconditioner.h"

namespace inceres::internal {

/// A fine part D, the blocks of A = S + Λ_c within aggregates of frames, and a coarse one: how each
/// aggregate moves as a whole, V, with the Galerkin product VᵀA V. In letters, with Q = V (VᵀA V)⁻¹
/// Vᵀ:
///
///     M⁻¹ = (I − Q A) D⁻¹ (I − A Q) + Q
///
/// symmetric, and positive definite for any D and any inverse of VᵀA V that are. A V is kept, so
/// that applying M takes no product with S. Where the landmarks are Euclidean V has the seven gauge
/// modes of each aggregate; else, or where they do not fit, one column for each parameter of a
/// frame (of the first seven). A shared frame has all of its parameters in V.
///
/// Aggregates stay for good, V until the next linearization, VᵀA V until the damping changes.
/// Sources: Mandel, "Balancing domain decomposition", Comm. Numer. Meth. Eng. 9(3), 1993; Tang,
/// Nabben, Vuik & Erlangga, "Comparison of two-level preconditioners derived from deflation, domain
/// decomposition and multigrid methods", J. Sci. Comput. 39, 2009; Konolige & Brown, "Multigrid for
/// bundle adjustment", 2020 (gauge modes).
class TwoLevelPreconditioner final : public Preconditioner {
 public:
  /// blocks[k]: block k of the plans' pattern of what conjugate gradients multiply by, S if it is
  /// formed, else C; null: zero. S has the blocks that the aggregates keep.
  TwoLevelPreconditioner(const Evaluator& evaluator, const LandmarkIncidences& incidences,
                         const FramePlans& plans, const Hessian& hessian,
                         const Elimination& elimination, const FrameAggregates& aggregates,
                         const std::vector<const double*>& blocks, bool forms_S, Status* status);

  void Refresh() override { modes_are_stale_ = true; }
  Status Prepare(const double* damping) override;
  void Apply(const double* r, double* z) override;
  std::int64_t Bytes() const override;

 private:
  void ComputeModes();

  const Evaluator& evaluator_;
  const Elimination& elimination_;
  std::vector<const double*> C_diagonal_;  // per frame
  std::unique_ptr<GaugeModes> modes_;
  std::unique_ptr<ModeColumns> columns_;
  std::unique_ptr<AggregateReach> reach_;
  std::unique_ptr<CoarseSpace> space_;
  std::unique_ptr<ClusterCholesky> fine_;
  std::unique_ptr<ProjectedProducts> products_;
  std::vector<double> deflated_;
  bool modes_are_stale_ = true;
};

}  // namespace inceres::internal
