#include "trust_region/schur_model.h"

#include <algorithm>
#include <utility>

#include "linear/elimination_order.h"
#include "linear/not_positive_definite.h"
#include "linear/select_solver.h"
#include "linear/sparse_cholesky.h"
#include "linearize/jacobian_chunks.h"

namespace inceres::internal {

// H, and S from it, behind one interface (docs/algorithms.md, "Schur complement"). PlainModel
// solves (C + Λ) δ = −g and is the whole model where nothing is eliminated; SchurModel eliminates
// first. Plans and symbolic factorization are made in the constructors, once a structure; a
// refresh sums H, and each damping eliminates, factors and substitutes anew.

Status CheckBlockOffsets(const Evaluator& evaluator, const LandmarkIncidences& incidences) {
  // 2³⁰ quads are the 32 GiB of the message; of 31 bits a target gives one to its flag.
  constexpr std::int64_t kMaxQuads = std::int64_t{1} << 30;
  std::int64_t largest = incidences.y_quads;
  for (const Linearization& cache : evaluator.families()) {
    for (const SlotJacobians& slot : cache.slots) {
      largest = std::max<std::int64_t>(largest, cache.num_factors * (slot.factor_stride / kQuad));
    }
  }
  return largest < kMaxQuads
             ? Status::Ok()
             : Status::Error(StatusCode::kInvalidArgument,
                             "the problem is too large: the Jacobians of one family, or the blocks "
                             "of one landmark, exceed 32 GiB");
}

void DescribeHessian(const Evaluator& evaluator, const Hessian& hessian, const FramePlans& plans,
                     WorkCounts* work) {
  work->bytes += static_cast<std::int64_t>(
      sizeof(double) * hessian.C().size() +
      sizeof(ProductTerm) * (plans.hessian.terms.size() + plans.schur.terms.size()));
  for (const Linearization& cache : evaluator.families()) {
    // Kernels are sized at compile time up to residuals of 4; longer ones take the loop of run-time
    // length.
    if (cache.residual_size > 4) {
      work->num_dynamic_size_factors += cache.num_factors;
    }
  }
}

// Incidences, plan, H, solver, in the order of the members: each is built on the one before.
PlainModel::PlainModel(const SolverOptions& options, const Evaluator& evaluator,
                       std::unique_ptr<LandmarkIncidences> incidences, Status* status)
    : LinearModel(evaluator),
      incidences_(incidences != nullptr ? std::move(*incidences) : LandmarkIncidences(evaluator)),
      plans_(evaluator, incidences_),
      hessian_(evaluator, incidences_, plans_) {
  // Before a solver is made for it.
  *status = CheckBlockOffsets(evaluator, incidences_);
  // Without a variable that moves, or with landmarks alone, there is nothing to reduce to.
  if (status->ok() && plans_.pattern.size() > 0) {
    reduced_solver_ = MakeReducedSolver(options.reduced_solver, options.reduced_solver_factory,
                                        plans_.pattern, evaluator.executor(), status);
    if (reduced_solver_ && !options.reduced_solver_factory) {  // its memory is not touched yet
      evaluator.Take(static_cast<std::int64_t>(reduced_solver_->Bytes()),
                     "the factor of the reduced system");
    }
  }
}

// Steps' products are of the Jacobians before, so they go.
void PlainModel::Refresh() {
  multiplied_.clear();
  hessian_.Accumulate();
  clock_->Charge(&seconds_->hessian);
}

// With the step itself, entry by entry: whoever asks for the products of a vector need not know
// where it comes from.
void PlainModel::KeepProducts(const double* step, const RowProducts& products) {
  multiplied_.assign(step, step + Gradient().size());
  products_ = products;
}

// An evaluation of all factors is spared who asks for the step that was just solved for.
RowProducts PlainModel::MultiplyJacobian(const double* v) {
  const bool is_known =
      !multiplied_.empty() && std::equal(multiplied_.begin(), multiplied_.end(), v);
  return is_known ? products_ : LinearModel::MultiplyJacobian(v);
}

// S is C where nothing is eliminated, else the Schur complement.
Status PlainModel::SolveReduced(const double* S, const double* b, const double* damping,
                                double* step) {
  if (!reduced_solver_) {
    return Status::Ok();
  }
  // All rows count as changed.
  Status solved = NameVariable(
      *reduced_solver_, reduced_solver_->Factorize(ReducedMatrix(plans_.pattern, S, damping), {}),
      [this](std::size_t frame) { return evaluator_.layout().variables[frame]; });
  if (solved.ok()) {
    solved = reduced_solver_->Solve(b, {}, {}, step);
  }
  clock_->Charge(&seconds_->factorization);
  return solved;
}

Status PlainModel::Solve(const double* damping, double* step) {
  // η = −g.
  b_.resize(Gradient().size());
  std::transform(Gradient().begin(), Gradient().end(), b_.begin(), [](double g) { return -g; });
  return SolveReduced(hessian_.C().data(), b_.data(), damping, step);
}

std::vector<int> PlainModel::EliminationOrder() const {
  return reduced_solver_ ? EliminationOrderOf(*reduced_solver_) : std::vector<int>();
}

// Sizes of the reduced system, and bytes of what grows with the problem.
void PlainModel::Describe(WorkCounts* work) const {
  work->num_frames = plans_.pattern.num_blocks();
  work->reduced_size = plans_.pattern.size();
  DescribeHessian(evaluator_, hessian_, plans_, work);
}

// A sparse factor reads each block of S once, and before it writes there. Where it writes is the
// columns of its fronts, so S is gone after a factorization and must be formed anew for the next
// one: elimination does that in any case, as the damping of landmarks is in it.
double* PlainModel::PlaceS() {
  auto* const sparse = dynamic_cast<SparseCholesky*>(reduced_solver_.get());
  if (sparse == nullptr) {
    return nullptr;
  }
  const auto before = static_cast<std::int64_t>(sparse->Bytes());
  double* const S = sparse->PlaceValues(&plans_.pattern);
  evaluator_.Take(static_cast<std::int64_t>(sparse->Bytes()) - before,  // not touched yet
                  "the values of the reduced system");
  return S;
}

// The base class has made the solver for S already: its pattern has the blocks that elimination
// fills. S is formed anew for each damping.
SchurModel::SchurModel(const SolverOptions& options, const Evaluator& evaluator,
                       std::unique_ptr<LandmarkIncidences> incidences, Status* status)
    : PlainModel(options, evaluator, std::move(incidences), status),
      elimination_(evaluator, incidences_, plans_, hessian_,
                   {PlaceS(), /*may_forget_landmarks=*/true}) {
  const std::int64_t before = incidences_.Bytes();
  incidences_.ForgetPlaces();
  evaluator.GiveBack(before - incidences_.Bytes());
}

// The packed vectors have frames first, then landmarks; damping and step are cut there.
Status SchurModel::Solve(const double* damping, double* step) {
  const int frame_size = plans_.pattern.size();
  // A landmark without a positive pivot is kSingular here, before S is factored: an invalid step.
  const Status eliminated = elimination_.Eliminate(damping + frame_size);
  clock_->Charge(&seconds_->elimination);
  if (!eliminated.ok()) {
    return eliminated;
  }
  const Status solved = SolveReduced(elimination_.S(), elimination_.b(), damping, step);
  if (!solved.ok()) {
    return solved;
  }
  // Needs δ_c complete: δ_l = U_invᵀ (z − Yᵀ δ_c).
  Status substituted = Status::Ok();
  if (evaluator_.jacobian_chunks() != nullptr) {
    substituted = SubstituteByChunks(step);
  } else {
    elimination_.BackSubstitute(step, step + frame_size);
  }
  clock_->Charge(&seconds_->back_substitution);
  return substituted;
}

// With Jδ in the same pass: what is not kept is evaluated once for both. Chunks of landmarks in the
// order of the elimination, and then those of factors without one, which have no landmark to
// substitute and count in Jδ alone.
Status SchurModel::SubstituteByChunks(double* step) {
  JacobianChunks& chunks = *evaluator_.jacobian_chunks();
  RowProducts products;
  for (int chunk = 0; chunk < chunks.num_chunks(); ++chunk) {
    Status brought = chunks.Bring(chunk);
    if (!brought.ok()) {
      return brought;
    }
    if (chunk < incidences_.num_chunks()) {
      elimination_.BackSubstitute(incidences_.chunk_begin[chunk],
                                  incidences_.chunk_begin[chunk + 1], step,
                                  step + plans_.pattern.size());
    }
    jacobian().AddChunk(chunk, incidences_, step, &products);
  }
  KeepProducts(step, products);
  return Status::Ok();
}

void SchurModel::Describe(WorkCounts* work) const {
  PlainModel::Describe(work);
  work->num_landmarks = incidences_.num_landmarks();
  work->num_schur_products = plans_.num_schur_products();
  work->bytes += elimination_.Bytes();
}

// Dynamic sparsity: a PlainModel that is made anew when the pattern of J has changed. Whether it
// has is seen by the tangent offsets of all entries, which are -1 where a block is all zeros: a
// comparison costs far less than a plan. What a new pattern needs of memory is asked for as it is
// made.
DynamicModel::DynamicModel(const SolverOptions& options, const Evaluator& evaluator)
    : LinearModel(evaluator), options_(options), tangent_offsets_(evaluator.families().size()) {
}

void DynamicModel::Refresh() {
  if (model_ == nullptr || !ZerosAreAsBefore()) {
    Rebuild();
  }
  // Clocks are those of the solve, which the new model does not know yet.
  model_->TimeInto(seconds_, clock_);
  model_->Refresh();
}

// The evaluator takes offsets of zero blocks away (LeaveOutZeroBlocks).
bool DynamicModel::ZerosAreAsBefore() const {
  const std::vector<Linearization>& families = evaluator_.families();
  return std::equal(families.begin(), families.end(), tangent_offsets_.begin(),
                    [](const Linearization& cache, const auto& offsets) {
                      return cache.tangent_offsets == offsets;
                    });
}

void DynamicModel::Rebuild() {
  model_.reset();  // its memory serves the new one
  model_ = std::make_unique<PlainModel>(options_, evaluator_, nullptr, &status_);
  for (const Linearization& cache : evaluator_.families()) {
    tangent_offsets_[cache.id] = cache.tangent_offsets;
  }
}

// A system that cannot be set up is an error of its solves.
Status DynamicModel::Solve(const double* damping, double* step) {
  return status_.ok() ? model_->Solve(damping, step) : status_;
}

// Asked before the first linearization, too, when there is nothing to tell but the sizes.
void DynamicModel::Describe(WorkCounts* work) const {
  if (model_ != nullptr) {
    model_->Describe(work);
    return;
  }
  work->num_frames = evaluator_.layout().num_frames;
  work->reduced_size = evaluator_.layout().size();
  for (const Linearization& cache : evaluator_.families()) {
    work->bytes += static_cast<std::int64_t>(sizeof(std::int32_t) * cache.tangent_offsets.size());
  }
}

}  // namespace inceres::internal
