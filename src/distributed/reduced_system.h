#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "base/aligned_vector.h"
#include "distributed/communicator.h"
#include "distributed/frame_exchange.h"
#include "distributed/shared_frames.h"
#include "inceres/solver/options.h"
#include "linear/block_inverses.h"
#include "linearize/hessian.h"
#include "schur/elimination.h"

namespace inceres::internal {

struct RankedAggregates;
class RankedTwoLevel;

/// What a solve over ranks works with. All of it, and this, outlives who is given it.
struct RankedParts {
  const Communicator& ranks;
  const SharedFrames& frames;
  const Evaluator& evaluator;
  const LandmarkIncidences& incidences;
  const FramePlans& plans;
  const Hessian& hessian;
  const Elimination& elimination;
};

/// S + Λ_c of all ranks, implicit: this rank's share of S is C − Y Yᵀ of its own factors and
/// landmarks. Vectors have the entries owned here, in the order of their numbers.
class ReducedSystem {
 public:
  /// `exchange`: of the tangent vectors of the frames here.
  ReducedSystem(const RankedParts& parts, FrameExchange* exchange);
  ~ReducedSystem();

  /// Makes what PreconditionerKind::kTwoLevel takes, before the first Prepare of it. Collective. An
  /// error is that of all ranks.
  Status MakeTwoLevel(const RankedAggregates& aggregates);
  /// C and the Jacobians are new.
  void Refresh();
  /// After each elimination. `frame_damping`: of the frames here, packed; copied.
  void SetDamping(const double* frame_damping);
  /// The scale of the columns, for preconditioner kIdentity; of the frames here.
  void SetScale(const double* frame_scale);

  /// y = (S + Λ) v. Collective.
  void Multiply(const double* v, double* y);
  /// Makes the preconditioner. kSingular names a frame; the same on all ranks.
  Status Prepare(PreconditionerKind kind);
  /// z = M⁻¹ r.
  void Precondition(const double* r, double* z);

  const RankedParts& parts() const { return parts_; }
  /// Λ of the frames owned here.
  const std::vector<double>& owned_damping() const { return owned_damping_; }
  double product_seconds() const { return product_seconds_; }
  std::int64_t num_products() const { return num_products_; }
  std::int64_t Bytes() const;

 private:
  void ChooseOwned(const double* here, std::vector<double>* owned) const;
  Status InvertBlocks(bool of_S);

  const RankedParts& parts_;
  FrameExchange& exchange_;
  FrameExchange block_exchange_;  // of diagonal blocks
  BlockInverses inverses_;
  std::unique_ptr<RankedTwoLevel> two_level_;
  PreconditionerKind kind_ = PreconditionerKind::kIdentity;
  std::vector<double> owned_damping_;
  std::vector<double> owned_scale_;
  std::vector<double> packed_;  // of the frames here
  AlignedVector<double> padded_;
  AlignedVector<double> padded_product_;
  AlignedVector<double> padded_owned_;
  AlignedVector<double> padded_result_;
  double product_seconds_ = 0.0;
  std::int64_t num_products_ = 0;
};

/// Solves (S + Λ) x = b on all ranks.
class DistributedReducedSolver {
 public:
  virtual ~DistributedReducedSolver() = default;
  virtual const char* Name() const = 0;
  /// b and x of the frames owned here. The Status is the same on all ranks.
  virtual Status Solve(const std::vector<double>& b, std::vector<double>* x) = 0;
  /// Of the last Solve.
  virtual int num_iterations() const { return 1; }
  virtual std::int64_t Bytes() const { return 0; }
};

/// The three solvers there are. `system` outlives them. Collective; AgreedFailure is thrown on all
/// ranks, and the Status is the same on all.
std::unique_ptr<DistributedReducedSolver> MakeMergedGradients(
    const ConjugateGradientsOptions& options, ReducedSystem* system);
std::unique_ptr<DistributedReducedSolver> MakeKspSolver(const ConjugateGradientsOptions& options,
                                                        ReducedSystem* system, Status* status);
std::unique_ptr<DistributedReducedSolver> MakeCholeskySolver(ReducedSystem* system);

/// Why a factorization by MUMPS failed.
enum class MumpsFailure {
  kSpaceTooSmall,  ///< it has predicted too little, and is to be given more: ICNTL(14)
  kOutOfMemory,
  kOther,  ///< taken for one of the matrix
};
/// By its INFOG(1).
MumpsFailure MumpsFailureOf(int infog1);

}  // namespace inceres::internal
