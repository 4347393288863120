#pragma once

#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "incremental/incremental_system.h"
#include "linear/live_factor.h"

namespace inceres::internal {

/// What covariances of some variables are made of, besides S: with V of a frame a unit matrix and
/// of a landmark −W (P + λD)⁻¹ = −Y U_inv, the joint one is VᵀS⁻¹V plus (P + λD)⁻¹ in the diagonal
/// blocks of landmarks. Held frames have no rows.
class LiveColumns {
 public:
  /// These are frames that are not held, or landmarks in S.
  LiveColumns(const IncrementalSystem& system, const std::vector<VariableId>& ids);

  const SparseColumns& V() const { return V_; }
  /// First column of each, one more: the total.
  const std::vector<int>& offsets() const { return offsets_; }
  /// product += the diagonal blocks of landmarks.
  void AddLandmarks(Eigen::MatrixXd* product) const;

 private:
  void ListRows();
  void AddRow(int row);
  void FillLandmark(int landmark, int column);

  const IncrementalSystem& system_;
  std::vector<VariableId> ids_;
  std::vector<int> offsets_{0};
  SparseColumns V_;
};

/// The largest share that damping has of what holds a landmark where all frames are known, over all
/// directions: it takes as much of a variance, at most.
double LargestDampingShare(const IncrementalSchur& schur, std::int32_t landmark);

/// product += W (P⁻¹ − (P + λD)⁻¹) Wᵀ x of a landmark: what its damping adds to S. x as S is;
/// `rows` is room for rows. A direction that only the damping holds has no W.
void AddLandmarkDamping(const IncrementalSchur& schur, std::int32_t landmark,
                        const Eigen::VectorXd& x, std::vector<BlockRow>* rows,
                        Eigen::VectorXd* product);

/// x = M⁻¹r with M = H + Λ of all variables of the system, by its elimination and a factor of S +
/// μD: the damped system as it was linearized. r and x by quads of the system's padded vectors.
Status SolveDamped(const IncrementalSystem& system, const LiveFactor& factor, const double* r,
                   double* x);

}  // namespace inceres::internal
