#include "trust_region/large_block_schur_model.h"

#include <algorithm>
#include <string>

#include "trust_region/schur_model.h"

namespace inceres::internal {

// ITERATIVE_SCHUR with variables of any size eliminated. The layout here eliminates nothing, so
// that H is the whole of the normal equations, in the pattern of frames; this file sorts its
// variables into eliminated ones e and kept ones f, and its blocks into H_ee, H_ef and H_ff. H_ee
// is block-diagonal because no factor touches two of the eliminated, which is checked.
//
// Inverses of H_ee are kept, as in Ceres, where elsewhere there are factors. Sums go over e in
// ascending order, so that they have one order.
//
// Only the lower triangle of H is there: of an off-diagonal block (i, j), i > j, both products are
// taken, with the block and with its transpose.

namespace {

double InnerProduct(const double* a, const double* b, int size) {
  double sum = 0.0;
  for (int k = 0; k < size; ++k) {
    sum += a[k] * b[k];
  }
  return sum;
}

void AddScaled(double scale, const double* a, int size, double* y) {
  for (int k = 0; k < size; ++k) {
    y[k] += scale * a[k];
  }
}

// y += M v, M symmetric.
void AddProduct(const Eigen::MatrixXd& M, const double* v, double* y) {
  // By columns, for M is column-major: the inner loop runs along memory and needs no sum across a
  // register.
  const auto size = static_cast<int>(M.rows());
  for (int k = 0; k < size; ++k) {
    AddScaled(v[k], M.col(k).data(), size, y);
  }
}

// False of one that is not positive definite.
bool Invert(const Eigen::MatrixXd& M, Eigen::MatrixXd* inverse) {
  const Eigen::LLT<Eigen::MatrixXd> factor(M);
  // Solved for whether the factor is one or not: who gets false does not look at it.
  *inverse = factor.solve(Eigen::MatrixXd::Identity(M.rows(), M.cols()));
  return factor.info() == Eigen::Success;
}

}  // namespace

using Eigen::MatrixXd;
using Eigen::VectorXd;

LargeBlockSchurModel::LargeBlockSchurModel(const SolverOptions& options, const Evaluator& evaluator,
                                           const std::vector<VariableId>& eliminated,
                                           Status* status)
    : ConjugateGradientsModel(options.conjugate_gradients, evaluator),
      // The layout has no landmarks: there are no incidences, and the pattern is that of H.
      incidences_(evaluator),
      plans_(evaluator, incidences_),
      hessian_(evaluator, incidences_, plans_),
      // Where a variable stands among its own kind indexes everything that is kept by kind.
      place_(static_cast<std::size_t>(plans_.pattern.num_blocks()), 0),
      is_eliminated_(static_cast<std::size_t>(plans_.pattern.num_blocks()), 0) {
  *status = CheckBlockOffsets(evaluator, incidences_);
  for (const VariableId id : eliminated) {
    if (evaluator.layout().FrameOf(id) >= 0) {  // else it does not move
      is_eliminated_[evaluator.layout().FrameOf(id)] = 1;
    }
  }
  int entries = 0;
  for (int v = 0; v < plans_.pattern.num_blocks(); ++v) {
    std::vector<int>& kind = is_eliminated_[v] != 0 ? eliminated_ : kept_;
    place_[v] = static_cast<int>(kind.size());
    kind.push_back(v);
    // Only the kept ones are in the vectors of the iteration, each on a quad.
    if (is_eliminated_[v] == 0) {
      padded_.push_back(entries);
      entries += PadToQuad(Size(v));
    }
  }
  padded_.push_back(entries);
  iteration_.Resize(static_cast<std::size_t>(entries));
  if (status->ok()) {
    SortBlocks(status);
  }
  if (status->ok()) {
    preconditioner_ =
        std::make_unique<KeptBlocks>(options_, FindKeptStructure(), evaluator.executor(), status);
  }
}

// Each off-diagonal block belongs to H_ff or to the H_ef of one e; one between two of the
// eliminated belongs nowhere: H_ee would not be block-diagonal, and no elimination of one at a time
// could follow.
void LargeBlockSchurModel::SortBlocks(Status* status) {
  of_.resize(eliminated_.size());
  const BlockPattern& pattern = plans_.pattern;
  for (int i = 0; i < pattern.num_blocks(); ++i) {
    for (int k = pattern.row_begin[i]; k < pattern.row_begin[i + 1]; ++k) {
      const int j = pattern.columns[k];
      // H_ee and the diagonal of H_ff are read where they are needed, with the damping.
      if (i == j) {
        continue;
      }
      const Entry entry{k, i, j};
      if (is_eliminated_[i] != 0 && is_eliminated_[j] != 0) {
        *status = Status::Error(StatusCode::kInvalidArgument,
                                "two variables to be eliminated share a factor: " +
                                    std::to_string(evaluator_.layout().variables[j]) + " and " +
                                    std::to_string(evaluator_.layout().variables[i]));
        return;
      }
      if (is_eliminated_[i] == 0 && is_eliminated_[j] == 0) {
        between_kept_.push_back(entry);
      } else {
        // Whichever of the two is the eliminated one: rows of H are in the order of the layout, not
        // of the kinds.
        of_[place_[is_eliminated_[i] != 0 ? i : j]].push_back(entry);
      }
    }
  }
}

void LargeBlockSchurModel::Refresh() {
  hessian_.Accumulate();
  clock_->Charge(&seconds_->hessian);
}

// H_vv + Λ_v.
MatrixXd LargeBlockSchurModel::Diagonal(int variable) const {
  // The block on the diagonal is the last one of its row.
  const int block = plans_.pattern.row_begin[variable + 1] - 1;
  const int size = Size(variable);
  const BlockMap lower(hessian_.FrameBlock(block), size, size,
                       Eigen::OuterStride<>(plans_.pattern.row_stride(variable)));
  MatrixXd H = lower.selfadjointView<Eigen::Lower>();
  H.diagonal() += Eigen::Map<const VectorXd>(damping_ + Offset(variable), size);
  return H;
}

// The block with the rows of `row`, one of its two.
MatrixXd LargeBlockSchurModel::Off(const Entry& entry, int row) const {
  const double* values = hessian_.FrameBlock(entry.block);
  // A block of the pattern that no factor reaches.
  if (values == nullptr) {
    return MatrixXd::Zero(Size(row), Size(row == entry.i ? entry.j : entry.i));
  }
  // Row-major, and padded where the pattern is: rows are a stride apart.
  const BlockMap H(values, Size(entry.i), Size(entry.j),
                   Eigen::OuterStride<>(plans_.pattern.row_stride(entry.j)));
  return row == entry.i ? MatrixXd(H) : MatrixXd(H.transpose());
}

// y_row += sign H v, of the other one's entries. Blocks have some 6 to 15 rows and columns: plain
// loops, for a call of a general product costs more than the product itself.
void LargeBlockSchurModel::Multiply(const Entry& entry, int row, const double* v, double sign,
                                    double* y) const {
  const double* H = hessian_.FrameBlock(entry.block);
  if (H == nullptr) {
    return;
  }
  const int stride = plans_.pattern.row_stride(entry.j);
  const int num_rows = Size(entry.i), num_columns = Size(entry.j);
  // As it is stored, a row of the block times v; the other way its transpose, a row of it for each
  // entry of v.
  if (row == entry.i) {
    for (int r = 0; r < num_rows; ++r, H += stride) {
      y[r] += sign * InnerProduct(H, v, num_columns);
    }
  } else {
    for (int r = 0; r < num_rows; ++r, H += stride) {
      AddScaled(sign * v[r], H, num_columns, y);
    }
  }
}

// Anew for each damping. The first in the order of the layout that has no factor is the one that is
// named.
Status LargeBlockSchurModel::FactorEliminated() {
  eliminated_inverse_.resize(eliminated_.size());
  for (std::size_t e = 0; e < eliminated_.size(); ++e) {
    if (!Invert(Diagonal(eliminated_[e]), &eliminated_inverse_[e])) {
      return Status::Error(StatusCode::kSingular,
                           "variable " +
                               std::to_string(evaluator_.layout().variables[eliminated_[e]]) +
                               ", to be eliminated, has a block that is not positive definite");
    }
  }
  return Status::Ok();
}

// Rows of H come in the order of the layout, so the kept ones of an eliminated one ascend.
KeptStructure LargeBlockSchurModel::FindKeptStructure() const {
  KeptStructure structure{/*offsets=*/{0}, /*seen_begin=*/{0}, {}, {}};
  for (const int variable : kept_) {
    structure.offsets.push_back(structure.offsets.back() + Size(variable));
  }
  for (std::size_t e = 0; e < eliminated_.size(); ++e) {
    for (const Entry& entry : of_[e]) {
      structure.seen.push_back(place_[entry.OtherThan(eliminated_[e])]);
    }
    structure.seen_begin.push_back(static_cast<int>(structure.seen.size()));
  }
  for (const Entry& entry : between_kept_) {
    structure.between.emplace_back(place_[entry.i], place_[entry.j]);
  }
  return structure;
}

// Of H_ff, damped, and less what S has less.
Status LargeBlockSchurModel::FactorPreconditioner() {
  if (preconditioner_->IsEmpty()) {
    return Status::Ok();
  }
  preconditioner_->SetZero();
  for (std::size_t f = 0; f < kept_.size(); ++f) {
    preconditioner_->Add(static_cast<int>(f), static_cast<int>(f), Diagonal(kept_[f]));
  }
  for (const Entry& entry : between_kept_) {
    if (preconditioner_->Keeps(place_[entry.i], place_[entry.j])) {
      preconditioner_->Add(place_[entry.i], place_[entry.j], Off(entry, entry.i));
    }
  }
  for (std::size_t e = 0; preconditioner_->AreOfS() && e < eliminated_.size(); ++e) {
    SubtractCoupledBlocks(e);
  }
  return preconditioner_->Factorize();
}

// H_fe H_ee⁻¹ H_ef, where it is kept. Cost: as many products as there are blocks of that.
void LargeBlockSchurModel::SubtractCoupledBlocks(std::size_t e) {
  const std::vector<Entry>& entries = of_[e];
  for (auto row = entries.begin(); row != entries.end(); ++row) {
    const int i = row->OtherThan(eliminated_[e]);
    const MatrixXd minus_product = -Off(*row, i) * eliminated_inverse_[e];
    // Block Jacobi has none beside the diagonal.
    for (auto column = preconditioner_->IsByClusters() ? entries.begin() : row; column <= row;
         ++column) {
      const int j = column->OtherThan(eliminated_[e]);
      if (preconditioner_->Keeps(place_[i], place_[j])) {
        preconditioner_->Add(place_[i], place_[j], minus_product * Off(*column, eliminated_[e]));
      }
    }
  }
}

// As IterativeModel::Solve. A failure at any stage leaves no step.
Status LargeBlockSchurModel::Solve(const double* damping, double* step) {
  BeginStep(damping);
  Status status = FactorEliminated();
  clock_->Charge(&seconds_->elimination);
  if (status.ok() && !kept_.empty()) {
    status = FactorPreconditioner();
    status = status.ok() ? SolveKept(step) : status;
    clock_->Charge(&seconds_->factorization);
  }
  if (status.ok()) {
    // Not of an iteration that broke down, which leaves no step at all.
    leaves_landmarks_ = options_.explicit_schur_complement && !converged_;
    BackSubstitute(step);
    clock_->Charge(&seconds_->back_substitution);
  }
  return status;
}

// b = η_f − H_fe H_ee⁻¹ η_e with η = −g, so that the second term is added with H_ee⁻¹ g_e. Then the
// iteration.
Status LargeBlockSchurModel::SolveKept(double* step) {
  std::fill_n(iteration_.b(), padded_.back(), 0.0);
  for (std::size_t f = 0; f < kept_.size(); ++f) {
    for (int k = 0; k < Size(kept_[f]); ++k) {
      iteration_.b()[padded_[f] + k] = -Gradient()[Offset(kept_[f]) + k];
    }
  }
  for (std::size_t e = 0; e < eliminated_.size(); ++e) {
    // H_ee⁻¹ g_e, once for all blocks of e.
    const VectorXd x = eliminated_inverse_[e] *
                       Eigen::Map<const VectorXd>(Gradient().data() + Offset(eliminated_[e]),
                                                  Size(eliminated_[e]));
    for (const Entry& entry : of_[e]) {
      const int variable = entry.OtherThan(eliminated_[e]);
      Multiply(entry, variable, x.data(), 1.0, iteration_.b() + padded_[place_[variable]]);
    }
  }
  const Status iterated = Iterate();
  for (std::size_t f = 0; iterated.ok() && f < kept_.size(); ++f) {
    std::copy_n(iteration_.x() + padded_[f], Size(kept_[f]), step + Offset(kept_[f]));
  }
  return iterated;
}

// y += H_fe H_ee⁻¹ H_ef v.
void LargeBlockSchurModel::AddCoupled(const double* v, double* y) const {
  for (std::size_t e = 0; e < eliminated_.size(); ++e) {
    const int eliminated = eliminated_[e];
    // Two vectors of the size of e one behind the other: H_ef v, and H_ee⁻¹ of it.
    coupled_.assign(2 * static_cast<std::size_t>(Size(eliminated)), 0.0);
    double* H_ef_v = coupled_.data();
    double* x = H_ef_v + Size(eliminated);
    for (const Entry& entry : of_[e]) {
      const int variable = entry.OtherThan(eliminated);
      Multiply(entry, eliminated, v + padded_[place_[variable]], 1.0, H_ef_v);
    }
    AddProduct(eliminated_inverse_[e], H_ef_v, x);
    for (const Entry& entry : of_[e]) {
      const int variable = entry.OtherThan(eliminated);
      Multiply(entry, variable, x, 1.0, y + padded_[place_[variable]]);
    }
  }
}

// y −= H_vv v of a kept one, damped. Of the block the lower triangle is there.
void LargeBlockSchurModel::SubtractDiagonal(int variable, const double* v, double* y) const {
  const int size = Size(variable);
  const double* H = hessian_.FrameBlock(plans_.pattern.row_begin[variable + 1] - 1);
  const int stride = plans_.pattern.row_stride(variable);
  const double* damping = damping_ + Offset(variable);
  for (int r = 0; r < size; ++r, H += stride) {
    // Row r up to and with the diagonal, and the same row as a column for the entries above.
    y[r] -= InnerProduct(H, v, r + 1) + damping[r] * v[r];
    AddScaled(-v[r], H, r, y);
  }
}

// y −= S v.
void LargeBlockSchurModel::SubtractProduct(const double* v, double* y) const {
  for (std::size_t f = 0; f < kept_.size(); ++f) {
    SubtractDiagonal(kept_[f], v + padded_[f], y + padded_[f]);
  }
  // Each block twice, for it is stored once: H_ij v_j to row i, and its transpose times v_i to row
  // j.
  for (const Entry& entry : between_kept_) {
    Multiply(entry, entry.i, v + padded_[place_[entry.j]], -1.0, y + padded_[place_[entry.i]]);
    Multiply(entry, entry.j, v + padded_[place_[entry.i]], -1.0, y + padded_[place_[entry.j]]);
  }
  // S has less than H_ff by this, so that it is added to −S v.
  AddCoupled(v, y);
}

// M⁻¹ r by blocks; the inverses are there, so nothing can fail.
bool LargeBlockSchurModel::Precondition(const double* r, double* z) {
  if (!preconditioner_->IsEmpty()) {
    preconditioner_->Apply(r, z);
    return true;
  }
  std::fill_n(z, padded_.back(), 0.0);
  for (std::size_t f = 0; f < kept_.size(); ++f) {
    const int size = Size(kept_[f]);
    // Ceres's identity is that of the scaled system.
    // M⁻¹ = diag(s²) of the unscaled variables.
    Eigen::Map<VectorXd>(z + padded_[f], size) =
        Eigen::Map<const VectorXd>(scale_ + Offset(kept_[f]), size)
            .cwiseAbs2()
            .cwiseProduct(Eigen::Map<const VectorXd>(r + padded_[f], size));
  }
  return true;
}

// δ_e; with a Schur complement that Ceres would form nothing where it did not converge, as there.
void LargeBlockSchurModel::BackSubstitute(double* step) const {
  for (std::size_t e = 0; e < eliminated_.size(); ++e) {
    const int variable = eliminated_[e];
    // η_e − H_ef δ_f, with the step of the kept ones, which is packed here.
    VectorXd x = -Eigen::Map<const VectorXd>(Gradient().data() + Offset(variable), Size(variable));
    for (const Entry& entry : of_[e]) {
      const int other = entry.OtherThan(variable);
      Multiply(entry, variable, step + Offset(other), -1.0, x.data());
    }
    Eigen::Map<VectorXd> to(step + Offset(variable), Size(variable));
    to = eliminated_inverse_[e] * x;
    if (leaves_landmarks_) {
      to.setZero();
    }
  }
}

// What is eliminated is called a landmark here as well: the counts are of roles in the solve.
void LargeBlockSchurModel::Describe(WorkCounts* work) const {
  work->num_frames = static_cast<int>(kept_.size());
  work->num_landmarks = static_cast<int>(eliminated_.size());
  for (const int variable : kept_) {
    work->reduced_size += Size(variable);
  }
  work->bytes += static_cast<std::int64_t>(iteration_.Bytes()) + preconditioner_->Bytes();
  DescribeHessian(evaluator_, hessian_, plans_, work);
}

}  // namespace inceres::internal
