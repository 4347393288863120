#pragma once

#include <vector>

#include <Eigen/Core>

#include "inceres/problem/factor_graph.h"
#include "linear/front_qr.h"
#include "linearize/evaluator.h"

namespace inceres::internal {

/// Landmarks eliminated from the Jacobian itself, each by orthogonal transformations of its own
/// rows:
///
///     Qᵀ [J_l J_c] = [R T]
///                    [0 J*]
///
/// where R is a triangle but for the order of its columns, so P = RᵀR, W P⁻¹ = Tᵀ R⁻ᵀ, and the J*
/// of all landmarks, with the rows of other factors, are a root of S, of the condition number of J,
/// not its square. Source: Triggs et al., "Bundle
/// adjustment: a modern synthesis", 1999, section B.3; Demmel et al., "Square root bundle
/// adjustment for large-scale reconstruction", CVPR 2021.
class OrthogonalElimination {
 public:
  struct Landmark {
    // R, its columns as they were taken: an upper triangle of the landmark's tangent size; rows of
    // zeros for want of rows.
    Eigen::MatrixXd triangle;
    Eigen::VectorXi columns;  // whose they are: triangle.col(k) is R.col(columns[k])
    Eigen::MatrixXd T;        // as many rows; the columns of the frames, one after the other
    Eigen::VectorXd squares;  // of the norms of J_l's columns
    RowsOfBlocks rest;        // J*, and the frames, ascending

    /// The largest variance for known frames, in units of what it is with all else known; infinite
    /// if R is singular.
    double Inflation() const;
    Eigen::MatrixXd InverseOfR() const;
  };

  /// Of the Jacobians that the evaluator holds; it stays as long as this is used.
  OrthogonalElimination(const FactorGraph& graph, const Layout& layout, const Evaluator& evaluator);

  Landmark Eliminate(int landmark) const;
  /// Of factors without a landmark, factor by factor.
  std::vector<RowsOfBlocks> OtherRows() const;

 private:
  struct Ref {
    int family;
    int factor;
  };
  RowsOfBlocks Frames(const std::vector<Ref>& factors) const;
  void Fill(const std::vector<Ref>& factors, int landmark, RowsOfBlocks* rows,
            Eigen::MatrixXd* J_l) const;

  const FactorGraph& graph_;
  const Layout& layout_;
  const Evaluator& evaluator_;
  std::vector<std::vector<Ref>> factors_of_;  // per landmark
  std::vector<Ref> others_;
};

}  // namespace inceres::internal
