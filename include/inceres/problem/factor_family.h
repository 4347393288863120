#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "inceres/export.h"

namespace inceres {

/// How a variable must move for a family whose Evaluate writes tangent Jacobians by formulas of its
/// own: to first order as this manifold's ⊞ (problem/manifolds.h), whatever its class is.
enum class SlotSpace : unsigned char {
  kAny,         ///< as it likes: the family projects, or has no Jacobian that depends on it
  kEuclidean,   ///< x + δ: no manifold is needed
  kPose,        ///< PoseManifold
  kLeftPose,    ///< LeftPoseManifold
  kSimilarity,  ///< SimilarityManifold
};

/// How an ambient Jacobian of one variable becomes a tangent one at the current linearization
/// point: J_tangent = J_ambient · M with M = ∂(x ⊞ δ)/∂δ (ambient_size × tangent_size). The graph
/// classifies M once per variable and linearization, so that the common cases cost a copy instead
/// of a product.
struct TangentMap {
  /// What M is.
  enum class Kind : unsigned char {
    kConstant,   ///< the variable is held constant: its Jacobian must not be written
    kIdentity,   ///< M = I: copy
    kSelection,  ///< every column of M is a unit vector: column j is ambient column selection[j]
    kDense,      ///< anything else: multiply by plus_jacobian
    kUnwanted,   ///< not constant, but its Jacobian is of no use this time: it must not be written
  };
  Kind kind = Kind::kIdentity;            ///< what to do with a Jacobian
  int ambient_size = 0;                   ///< rows of M
  int tangent_size = 0;                   ///< columns of M
  const double* plus_jacobian = nullptr;  ///< M, row-major; kSelection and kDense only
  const int* selection = nullptr;         ///< tangent_size indices; kSelection only
  /// kSelection and kDense only: the first columns of M that are unit vectors of the same index, in
  /// rows without another entry (a pose of translation and quaternion has three, one of VINS all
  /// six): there the product is a copy.
  int num_identity_columns = 0;

  /// Whether Jacobians are projected by both in the same way.
  bool IsLike(const TangentMap& other) const {
    return kind == other.kind && num_identity_columns == other.num_identity_columns;
  }
  /// Whether a Jacobian is to be written.
  bool wanted() const { return kind != Kind::kConstant && kind != Kind::kUnwanted; }
  /// Whether M = [I; 0]: the tangent Jacobian is the first columns of the ambient one.
  bool copies() const {
    return kind == Kind::kIdentity ||
           (kind == Kind::kSelection && num_identity_columns == tangent_size);
  }
};

/// Where the tangent Jacobians of one slot go: entry (r, c) of factor i is data[i · factor_stride +
/// r · row_stride + c]. row_stride ≥ tangent size; the columns beyond the tangent size are zero and
/// must stay so. What lies between two factors' may be read, by the thread that evaluates them, but
/// is not written.
struct JacobianView {
  double* data = nullptr;            ///< entry (0, 0) of factor 0
  std::ptrdiff_t factor_stride = 0;  ///< from factor to factor
  int row_stride = 0;                ///< from row to row
};

namespace internal {
class KeptEvaluations;
}

/// One call's worth of work: the factors [begin, end) of a family. Index i below always counts from
/// the family's first factor.
struct FactorBatch {
  int begin = 0;  ///< the first factor to evaluate
  int end = 0;    ///< one after the last
  /// parameters[i · num_slots + s]: the ambient values of slot s
  const double* const* parameters = nullptr;
  const TangentMap* const* tangent_maps = nullptr;  ///< same index; null for a cost-only evaluation
  double* residuals = nullptr;  ///< residuals[i · residual_size + r], to be written
  /// one view a slot, to be written; null for a cost-only evaluation
  const JacobianView* jacobians = nullptr;
  /// FactorFamily::Prepare has been told of these factors, at the same parameters.
  bool prepared = false;
  /// A hint of who calls for one factor at a time, in an order of his own: a factor that he calls
  /// for soon, or −1. A family whose factors are objects that lie anywhere in memory may ask for
  /// that one's already. Changes no result.
  int next = -1;
  /// Of a call with Jacobians, where who asks will soon come back to some of these factors at the
  /// same parameters: an AmbientFamily keeps there what it computes, and looks there first. Null:
  /// nobody comes back. A family that is quick leaves it alone.
  internal::KeptEvaluations* kept = nullptr;
  /// Of a call with Jacobians, where blocks that are all zeros are left out
  /// (SolverOptions::dynamic_sparsity): whether one is, by the same index as parameters; false
  /// before the call. A family that says so need not write that block; one that says nothing writes
  /// all of them. Null: nobody asks.
  bool* zero_blocks = nullptr;
};

/// Names the factor that could not be evaluated; `factor` is negative on success. Which number it
/// was, if it was one, is said by the rest: residual `entry`, or entry `entry` (row-major, of the
/// ambient Jacobian) of slot `slot`.
struct EvaluationFailure {
  int factor = -1;          ///< index in its family
  const char* reason = "";  ///< static string
  int slot = -1;            ///< of the Jacobian at fault; −1: a residual, or nothing of the kind
  int entry = -1;           ///< −1: not known
  double value = 0.0;       ///< that stands there
  /// Whether there is a failure.
  bool failed() const { return factor >= 0; }
};

namespace internal {
/// "cost function 0x55…": for Describe.
INCERES_EXPORT std::string DescribeObject(const char* kind, const void* object);
}  // namespace internal

/// Like factors stored together: same residual size, same ambient and tangent size in every slot.
/// This is the seam between the solver and every kind of measurement: one virtual call evaluates a
/// *range* of factors, so built-in families loop over plain arrays and foreign ones (a user's cost
/// functions) pay one indirect call a range.
///
/// A family owns the measurements; the FactorGraph owns the connections (which variables factor i
/// touches) and the losses. Evaluate writes residuals and *tangent* Jacobians, both before any
/// robust loss. A family whose formulas give ambient Jacobians derives from AmbientFamily
/// (problem/ambient_family.h), which projects.
///
/// Threads: Evaluate is called concurrently, on disjoint ranges, when the solver runs with several
/// threads, and only from the solving thread when it runs with one.
class INCERES_EXPORT FactorFamily {
 public:
  /// What a factor takes at one of its places: values, and degrees of freedom.
  struct Slot {
    int ambient_size = 0;  ///< values of the variable
    int tangent_size = 0;  ///< its degrees of freedom
  };

  /// For factors with so many residuals, and a variable for each slot; at least one of either.
  FactorFamily(int residual_size, std::vector<Slot> slots)
      : residual_size_(residual_size), slots_(std::move(slots)) {}
  virtual ~FactorFamily() = default;
  FactorFamily(const FactorFamily&) = delete;
  FactorFamily& operator=(const FactorFamily&) = delete;

  /// Residuals of a factor.
  int residual_size() const { return residual_size_; }
  /// Variables of a factor.
  int num_slots() const { return static_cast<int>(slots_.size()); }
  /// The sizes of slot s. Requires 0 ≤ s < num_slots().
  const Slot& slot(int s) const { return slots_[static_cast<std::size_t>(s)]; }

  /// In which tangent space Evaluate writes the Jacobians of slot s. A graph with a variable in
  /// another one there, on a manifold and not constant, is refused by name.
  virtual SlotSpace Space(int /*s*/) const { return SlotSpace::kAny; }

  /// Number of factors whose measurements the family holds.
  virtual int size() const = 0;

  /// What error messages call a factor of this family, for example "BAL reprojection".
  virtual const char* Name() const = 0;

  /// What the user knows one factor by, for error messages: the address of an object of his, say.
  /// Empty: by its index alone.
  virtual std::string Describe(int /*factor*/) const { return ""; }

  /// Evaluates the factors [batch.begin, batch.end). Must write every residual, and every Jacobian
  /// that is wanted. On failure names the first factor that failed; what was written is then
  /// ignored.
  virtual EvaluationFailure Evaluate(const FactorBatch& batch) const = 0;

  /// Whether solvers are to call Prepare.
  virtual bool Prepares() const { return false; }

  /// For a family whose calls are dear, as those into an interpreter: is told of all factors that
  /// an evaluation is about to ask for, `count` of them, ascending, within [batch.begin,
  /// batch.end), and may compute them in one go; the Evaluates that follow, on ranges of these
  /// factors and marked as prepared, then hand over what it has kept. Writes none of the batch's
  /// arrays. `batch.jacobians` tells as for Evaluate whether Jacobians are wanted, but the views
  /// are not to be used. On failure names a factor, and no Evaluate follows.
  ///
  /// Called on the solving thread, never while Evaluate runs. What is evaluated in small pieces
  /// (single landmarks, marginalization, pinned variables) is not announced: Evaluate must work
  /// without.
  virtual EvaluationFailure Prepare(const FactorBatch& /*batch*/, const std::int32_t* /*factors*/,
                                    int /*count*/) const {
    return {};
  }

  /// How many factors are worth a task of their own where several threads evaluate, at least 1: few
  /// where one may take long, as a user's function may. Changes no result.
  virtual int TaskSize() const { return 256; }

  /// Whether Recenter may ever do anything: solvers ask before they call it.
  virtual bool Recenters() const { return false; }

  /// For factors whose formula is an expansion about a point of their own, as a preintegrated IMU
  /// measurement is about the biases it was integrated at: moves that point of one factor to the
  /// values its variables have now (num_slots() pointers), if they have gone too far from it.
  /// Returns whether it did; Evaluate then computes another function than before.
  ///
  /// Solvers call it between two iterations only: at the start of a solve and at each accepted
  /// point, for the factors whose variables have moved, on the solving thread and never while
  /// Evaluate runs. They linearize a factor that has changed anew, and compare no cost from before
  /// with one from after. It is const because the measurement stays what it is; but two graphs that
  /// are solved at the same time must not share a family whose expansion points move.
  virtual bool Recenter(int /*factor*/, const double* const* /*parameters*/) const { return false; }

  /// True if the tangent Jacobians that Evaluate writes do not depend on the values: the
  /// incremental solver then forms JᵀJ once.
  virtual bool HasConstantJacobian() const { return false; }

 protected:
  /// What Place(index, measurement) does in a family that keeps a vector of measurements:
  /// overwrites, or appends at the end. Beyond the end nothing is written, and FactorGraph::Check
  /// finds the family too small.
  template <typename Measurement>
  static void PlaceIn(std::vector<Measurement>* measurements, int index,
                      const Measurement& measurement) {
    const auto i = static_cast<std::size_t>(index);
    if (i < measurements->size()) {
      (*measurements)[i] = measurement;
    } else if (i == measurements->size()) {
      measurements->push_back(measurement);
    }
  }

 private:
  int residual_size_;
  std::vector<Slot> slots_;
};

/// A family that keeps one M a factor, with what FactorGraph::AddFactor and edits need of it. Base
/// is FactorFamily, or AmbientFamily of the class that derives from this one.
template <typename M, typename Base = FactorFamily>
class MeasuredFamily : public Base {
 public:
  /// What Add and Place take.
  using Measurement = M;
  /// As Base.
  using Base::Base;

  /// Appends a measurement.
  void Add(Measurement measurement) { measurements_.push_back(std::move(measurement)); }
  /// Overwrites the measurement at `index`, or appends it if index == size().
  void Place(int index, const Measurement& measurement) {
    this->PlaceIn(&measurements_, index, measurement);
  }
  /// Memory for so many factors.
  void Reserve(std::size_t num_factors) { measurements_.reserve(num_factors); }
  /// The measurement at an index.
  const Measurement& measurement(int i) const { return measurements_[static_cast<std::size_t>(i)]; }

  /// Number of measurements.
  int size() const override { return static_cast<int>(measurements_.size()); }

 protected:
  /// All of them, in the order of the factors.
  const std::vector<Measurement>& measurements() const { return measurements_; }

 private:
  std::vector<Measurement> measurements_;
};

}  // namespace inceres
