#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "inceres/export.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/status.h"

namespace inceres {

class IncrementalSolver;

/// How GraphCovariance inverts.
enum class CovarianceAlgorithm {
  kSchur,  ///< normal equations, landmarks eliminated, a sparse factor: large problems
  /// The Jacobian itself, landmarks and frames eliminated by orthogonal transformations, a sparse
  /// factor: where kSchur loses too many digits, as far along a path that is held at its beginning.
  /// What Ceres calls SPARSE_QR. Takes several times as long, and the memory of the rows; does not
  /// say what is open but for landmarks.
  kQr,
  /// Singular values of the whole Jacobian, dense: small problems, with a pseudo-inverse where it
  /// is rank deficient. What Ceres calls DENSE_SVD, and as there the rank is judged by as many
  /// singular values as J has: with fewer residuals than degrees of freedom what no residual can
  /// determine counts as left out, and adds no variance.
  kDenseSvd,
};

/// Options of GraphCovariance.
struct INCERES_EXPORT CovarianceOptions {
  int num_threads = 1;  ///< ≥ 1: evaluation; the result is the same to the last bit
  CovarianceAlgorithm algorithm = CovarianceAlgorithm::kSchur;  ///< how it inverts
  /// ≥ −1, of kDenseSvd: how many of the smallest singular values are left out, for example 7 of a
  /// bundle adjustment with a free gauge; −1: all that are small.
  int null_space_rank = 0;
  /// In [0, 1), of kDenseSvd: a singular value is small if its square is less than this share of
  /// that of the largest. One that is small and not left out is kSingular.
  double min_reciprocal_condition_number = 1e-14;
  /// > 1, of kSchur and kQr: a variance that exceeds the one with all else known by more than this
  /// factor counts as infinite. At 1e12 four digits are left of it, of kQr ten.
  double max_inflation = 1e12;
  /// In [0, 1), of kQr: what the columns before it leave of a column of J must exceed this share of
  /// the largest column's norm. 0: no rule. SuiteSparseQR's, which depends on the units of
  /// variables, is 20 (m + n) ε for m residuals and n degrees of freedom.
  double min_column_remainder = 0.0;

  /// What is wrong with these options, the first culprit named.
  Status Validate() const;
};

/// What the factors leave open, of a problem that has no covariance.
struct INCERES_EXPORT RankDeficiency {
  /// A direction in which the cost does not change, with the frames that move along it: each with
  /// its share of the squared length, measured in units of the diagonal of C, the frames' block of
  /// H, largest first, those above 0.01 and at most eight.
  struct Direction {
    std::vector<std::pair<VariableId, double>> shares;  ///< of each frame, the largest first
  };
  std::vector<VariableId> landmarks;  ///< that their own factors do not determine
  std::vector<Direction> directions;  ///< of all else, at most 32; a free gauge has 6 or 7
  bool has_more = false;              ///< there are more than these directions

  /// "2 directions are open", "32 directions or more are open"; empty if none is.
  std::string CountDirections() const;
  /// "2 directions are open: variable 3 (0.81), variable 4 (0.19); variable 7 (1.00)".
  std::string ToString() const;
};

/// Covariances of estimates, in their tangent spaces: blocks of H⁻¹ = (JᵀJ)⁻¹ at the current
/// values, with Jacobians corrected for robust losses (and pinned where variables are), undamped.
/// With S = C − W P⁻¹ Wᵀ,
///
///     cov(a, b) = V_aᵀ S⁻¹ V_b + [a = b is a landmark] P_b⁻¹,
///     V = E_a of a frame, −W P⁻¹ of a landmark,
///
/// so a landmark's covariance is the full one, not that for known frames. Of factors that are
/// whitened; otherwise it is a multiple.
///
/// What is not determined has no covariance: a free gauge, or a landmark without enough views
/// anywhere in the problem, is kSingular with the variable, not a large number. Through H, not J
/// (kQr: through J): a stiff factor of 1e14 beside weak ones of 1e-2 that it ties together exceeds
/// max_inflation. kQr takes the landmarks of a frame for free, and so bears stiff factors of
/// theirs. Where landmarks use up all that factors say of a frame, what is left is rounding, and
/// kSingular for both, as where their elimination leaves a variance fewer than four digits.
///
/// Cost: one linearization, elimination and factorization of the whole problem, and then whichever
/// is predicted to take less: a solve with the factor of S for each degree of freedom of what is
/// asked for, or all entries of S⁻¹ where that factor has any, in the time of about three
/// factorizations. The latter has all frames and landmarks, and all pairs of frames that share a
/// landmark or a factor; pairs beyond take solves again. Memory: once more the factor of S.
/// One caller; threads as options say. Source: Triggs et al. 1999, section 9; Takahashi, Fagan &
/// Chen 1973; docs/visual_inertial.md.
class INCERES_EXPORT GraphCovariance {
 public:
  /// Pairs of variables, in either order.
  using Pairs = std::vector<std::pair<VariableId, VariableId>>;

  /// Holds no covariances yet.
  explicit GraphCovariance(const CovarianceOptions& options = {}) : options_(options) {}

  /// Computes the blocks of these pairs, in one or the other order, and forgets all others. Blocks
  /// of constants are zero, as in Ceres. On an error there are none: an id that does not exist or
  /// that no factor touches is kInvalidArgument.
  Status Compute(const FactorGraph& graph, const Pairs& pairs);
  /// Of what the solver holds now.
  Status Compute(const IncrementalSolver& solver, const Pairs& pairs);

  /// Writes cov(a, b), row-major, tangent sizes of a × b. False if it was not computed.
  bool Get(VariableId a, VariableId b, double* covariance) const;

  /// What was found open when the last Compute returned kSingular; else empty. kQr names landmarks
  /// only. Its cost is a
  /// factorization and some two hundred solves, then only.
  const RankDeficiency& deficiency() const { return deficiency_; }

 private:
  template <typename System>
  Status Fill(const FactorGraph& graph, const Pairs& pairs, System* system);
  Status ComputeAt(const FactorGraph& graph, const Status& valid, const std::vector<double>& state,
                   const Pairs& pairs);

  struct Block {
    int rows = 0;
    int columns = 0;
    std::vector<double> values;  // row-major
  };
  CovarianceOptions options_;
  std::map<std::pair<VariableId, VariableId>, Block> blocks_;
  RankDeficiency deficiency_;
};

}  // namespace inceres
