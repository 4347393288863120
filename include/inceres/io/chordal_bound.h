#pragma once

#include "inceres/export.h"
#include "inceres/io/g2o.h"
#include "inceres/status.h"

namespace inceres {

/// How near a pose graph's solution is to the global minimum of one particular cost: the chordal
/// one with isotropic noise.
struct ChordalBound {
  double cost = 0.0;                 ///< f at the minimum that was found
  double lower_bound = 0.0;          ///< what no choice of poses is below; at least 0
  double gap = 0.0;                  ///< (cost − lower_bound) / cost, 0 where the cost is
  double smallest_eigenvalue = 0.0;  ///< of the certificate matrix S; −ε says: a global minimum
  double largest_angle = 0.0;  ///< radians between a rotation as given and at the minimum found
};

/// Whether this build can compute it: it needs Spectra, an optional dependency.
INCERES_EXPORT bool HasChordalBound();

/// Minimizes, from the poses of the graph, and bounds from below
///
///     f(R, p) = Σ κ ‖R_j − R_i R_ij‖²_F + τ ‖p_j − p_i − R_i p_ij‖²
///
/// with κ and τ from the traces of each edge's covariance: κ = 3/(2 tr Σ_R), or half the inverse
/// variance of a planar angle; τ = d/tr Σ_p. The bound is that of Lagrangian duality: with the
/// multipliers Λ of RᵀR = I at the minimum found and Q the cost of rotations whose positions are
/// eliminated, S = Q − Λ, and f ≥ tr Λ − n d max(0, −λ_min(S)) whatever the poses, where tr Λ is
/// f_found as far as the gradient there is zero. λ_min is found by Lanczos on (S + σI)⁻¹, and the
/// bound is that of a shift for which S + σI was factored as positive definite: neither what the
/// solve nor what the eigenvalue's iteration has left makes it wrong. The rounding of sums and of
/// the factorization is not counted: some 1e-16 of κ for each entry.
///
/// It is a statement about f, and not a certificate of the cost that a solver of this library
/// minimizes, which has the geodesic error and the whole information matrix of each edge. Where
/// both minima are next to each other it tells that no other one is far below.
///
/// kUnavailable if this build has no Spectra; kInvalidArgument, naming it, if an edge's information
/// is not positive definite, or the graph does not fit together (AddPoseGraph) or does not hang
/// together; kSingular if the solve or the factorization fails. `bound` is then unchanged. Cost: a
/// solve, and some factorizations of n(d + 1) unknowns. Threads: no shared state. Source: Rosen,
/// Carlone, Bandeira & Leonard, "SE-Sync: a certifiably correct algorithm for synchronization over
/// the special Euclidean group", IJRR 2019.
INCERES_EXPORT Status BoundChordalCost(const PoseGraph& graph, ChordalBound* bound);

}  // namespace inceres
