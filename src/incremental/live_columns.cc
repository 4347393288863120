#include "incremental/live_columns.h"

#include <algorithm>
#include <type_traits>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "base/sort_unique.h"

namespace inceres::internal {
namespace {

// V of docs/algorithms.md, "From a live factor": cov(a, b) = V_aᵀ S⁻¹ V_b + [a = b is a landmark]
// (P + λD)⁻¹ with V = E_a of a frame and −Y U_inv of a landmark. V has entries in the rows of few
// frames, so only these are stored, as one dense block with the list of its rows. The
// preconditioner is the same elimination run as a solver: forwards through the landmarks, S by its
// factor, and back. It reads what the system has, changes nothing of it, and may be used while
// others read as well.

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Block = Eigen::Map<const RowMajor, 0, Eigen::OuterStride<>>;

// L⁻¹ of a landmark's P + λD.
Block InverseRootOf(const IncrementalSchur& schur, int landmark) {
  // Rows are kQuad apart whatever the landmark's size; the lower triangle is L⁻¹, and above it is
  // zero.
  const int size = schur.landmarks()[landmark].size;
  return {schur.blocks().UInv(landmark), size, size, Eigen::OuterStride<>(kQuad)};
}

// Yᵀ of one of its frames: rows of the landmark, columns of the frame.
// Y is stored as landmark-size rows of padded frame-size entries, as LandmarkIncidences has it.
Block YTransposed(const BlockRow& row, int landmark_size) {
  return {row.A, landmark_size, row.size, Eigen::OuterStride<>(row.quads * kQuad)};
}

using Small = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kQuad, 1>;
using SmallSquare = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kQuad, kQuad>;

// B = λ L⁻¹ D L⁻ᵀ of L Lᵀ = P + λD: its eigenvalues are the shares of the damping, from 0 to 1.
SmallSquare DampingShares(const IncrementalSchur& schur, std::int32_t l) {
  const Block U_inv = InverseRootOf(schur, l);
  Small D(schur.landmarks()[l].size);
  for (int k = 0; k < schur.landmarks()[l].size; ++k) {
    D[k] = schur.blocks().D(l, k);
  }
  return schur.blocks().lambda(l) * U_inv * D.asDiagonal() * U_inv.transpose();
}

// B (I − B)⁻¹ u, without the directions that only the damping holds.
Small TimesDampingOverRest(const SmallSquare& B, const Small& u) {
  // Of a direction in which P has less than this beside the damping, W is rounding.
  constexpr double kNothing = 1e-10;
  constexpr double kFarFromOne = 0.5;
  if (B.trace() < kFarFromOne) {
    const SmallSquare rest = SmallSquare::Identity(B.rows(), B.rows()) - B;
    return rest.llt().solve(B * u);
  }
  const Eigen::SelfAdjointEigenSolver<SmallSquare> shares(B);
  Small v = shares.eigenvectors().transpose() * u;
  for (Eigen::Index k = 0; k < v.size(); ++k) {
    const double share = std::max(shares.eigenvalues()[k], 0.0);
    v[k] *= 1.0 - share > kNothing ? share / (1.0 - share) : 0.0;
  }
  return shares.eigenvectors() * v;
}

// Free places, constants and undetermined landmarks have no Y in S.
bool CountsInS(const IncrementalSchur& schur, int landmark) {
  return schur.landmarks()[landmark].id >= 0 && schur.IsInS(landmark);
}

}  // namespace

LiveColumns::LiveColumns(const IncrementalSystem& system, const std::vector<VariableId>& ids)
    : system_(system), ids_(ids) {
  const IncrementalSchur& schur = system.schur();
  // Columns in the order of the request, as wide as the variables' tangent spaces.
  for (const VariableId id : ids) {
    const int frame = system.FrameOf(id);
    offsets_.push_back(offsets_.back() + (frame >= 0
                                              ? schur.frames()[frame].size
                                              : schur.landmarks()[system.LandmarkOf(id)].size));
  }
  // First which rows V has, then their places: landmarks share frames, and V is dense in the rows.
  ListRows();
  V_.values.setZero(V_.begin.back(), offsets_.back());
  // SparseColumns has one begin a row; the total was only needed for the size.
  V_.begin.pop_back();
  for (std::size_t k = 0; k < ids.size(); ++k) {
    const int frame = system.FrameOf(ids[k]);
    if (frame < 0) {
      FillLandmark(system.LandmarkOf(ids[k]), offsets_[k]);
      continue;
    }
    // V_.rows ascends: the row's place is found by bisection.
    const auto at = std::lower_bound(V_.rows.begin(), V_.rows.end(), frame) - V_.rows.begin();
    V_.values
        .block(V_.begin[at], offsets_[k], schur.frames()[frame].size, schur.frames()[frame].size)
        .setIdentity();
  }
}

// Rows of the frames themselves, and of the frames that requested landmarks are seen from.
void LiveColumns::ListRows() {
  const IncrementalSchur& schur = system_.schur();
  for (const VariableId id : ids_) {
    if (system_.FrameOf(id) >= 0) {
      AddRow(system_.FrameOf(id));
      continue;
    }
    for (const std::int32_t row : schur.landmarks()[system_.LandmarkOf(id)].frames) {
      AddRow(row);
    }
  }
  SortUnique(&V_.rows);
  // Packed within V: rows of S that V does not have take no room.
  V_.begin.assign(1, 0);
  for (const int row : V_.rows) {
    V_.begin.push_back(V_.begin.back() + schur.frames()[row].size);
  }
}

// A held frame has covariance zero: its row of S is a unit row.
void LiveColumns::AddRow(int row) {
  if (!system_.schur().frames()[row].held) {
    V_.rows.push_back(row);
  }
}

// −Y U_inv, row by row of the landmark's separator.
void LiveColumns::FillLandmark(int landmark, int column) {
  const IncrementalSchur& schur = system_.schur();
  const int size = schur.landmarks()[landmark].size;
  std::vector<BlockRow> rows;
  schur.blocks().Rows(landmark, &rows);
  for (std::size_t r = 0; r < rows.size(); ++r) {
    const int frame = schur.landmarks()[landmark].frames[r];
    if (schur.frames()[frame].held) {
      continue;
    }
    const auto at = std::lower_bound(V_.rows.begin(), V_.rows.end(), frame) - V_.rows.begin();
    // −(Yᵀ)ᵀ U_inv = −W (P + λD)⁻¹.
    V_.values.block(V_.begin[at], column, rows[r].size, size) =
        -YTransposed(rows[r], size).transpose() * InverseRootOf(schur, landmark);
  }
}

// What a landmark has of its own, with all frames known.
void LiveColumns::AddLandmarks(Eigen::MatrixXd* product) const {
  for (std::size_t k = 0; k < ids_.size(); ++k) {
    const int landmark = system_.LandmarkOf(ids_[k]);
    if (landmark >= 0) {
      const Block U_inv = InverseRootOf(system_.schur(), landmark);
      // U_invᵀ U_inv = (L Lᵀ)⁻¹.
      product->block(offsets_[k], offsets_[k], U_inv.rows(), U_inv.rows()) +=
          U_inv.transpose() * U_inv;
    }
  }
}

double LargestDampingShare(const IncrementalSchur& schur, std::int32_t landmark) {
  const Eigen::SelfAdjointEigenSolver<SmallSquare> shares(DampingShares(schur, landmark),
                                                          Eigen::EigenvaluesOnly);
  return std::clamp(shares.eigenvalues()[shares.eigenvalues().size() - 1], 0.0, 1.0);
}

// With u = Yᵀx = L⁻¹Wᵀx it is Y (Lᵀ P⁻¹ L − I) u = Y B (I − B)⁻¹ u, since P = L (I − B) Lᵀ. Held
// frames do not move.
void AddLandmarkDamping(const IncrementalSchur& schur, std::int32_t l, const Eigen::VectorXd& x,
                        std::vector<BlockRow>* rows, Eigen::VectorXd* product) {
  if (!CountsInS(schur, l)) {
    return;
  }
  const IncrementalSchur::Landmark& landmark = schur.landmarks()[l];
  Small u = Small::Zero(landmark.size);
  schur.blocks().Rows(l, rows);
  const auto for_each_row = [&](const auto& visit) {
    for (std::size_t r = 0; r < rows->size(); ++r) {
      const int frame = landmark.frames[r];
      if (!schur.frames()[frame].held) {
        visit(YTransposed((*rows)[r], landmark.size), schur.FrameOffset(frame),
              schur.frames()[frame].size);
      }
    }
  };
  for_each_row([&](const Block& Y_t, int at, int size) { u += Y_t * x.segment(at, size); });
  u = TimesDampingOverRest(DampingShares(schur, l), u);
  for_each_row([&](const Block& Y_t, int at, int size) {
    product->segment(at, size) += Y_t.transpose() * u;
  });
}

namespace {

// Of a vector by quads of the system, constant or mutable.
template <typename Scalar>
auto Segment(Scalar* vector, std::int32_t quad, int size) {
  using Vector =
      std::conditional_t<std::is_const_v<Scalar>, const Eigen::VectorXd, Eigen::VectorXd>;
  return Eigen::Map<Vector>(vector + std::ptrdiff_t{quad} * kQuad, size);
}

// Calls visit(l, its rows of Y, u = U_inv r_l) of each landmark that S has eliminated; u is the
// visitor's to change.
template <typename Visit>
void ForEachEliminated(const IncrementalSchur& schur, const double* r, const Visit& visit) {
  std::vector<BlockRow> rows;
  const int num_landmarks = static_cast<int>(schur.landmarks().size());
  for (int l = 0; l < num_landmarks; ++l) {
    if (CountsInS(schur, l)) {
      const auto& landmark = schur.landmarks()[l];
      Eigen::VectorXd u = InverseRootOf(schur, l) * Segment(r, landmark.quad, landmark.size);
      schur.blocks().Rows(l, &rows);
      visit(l, rows, &u);
    }
  }
}

// Forwards, landmark by landmark: the frames' part of b −= Y U_inv r_l.
void EliminateLandmarks(const IncrementalSchur& schur, const double* r, double* b) {
  ForEachEliminated(schur, r, [&](int l, const std::vector<BlockRow>& rows, Eigen::VectorXd* u) {
    for (const BlockRow& row : rows) {
      Segment(b, row.frame, row.size) -=
          YTransposed(row, schur.landmarks()[l].size).transpose() * *u;
    }
  });
}

// Backwards with the frames' solution in x: every landmark by itself, in any order.
void SolveLandmarks(const IncrementalSchur& schur, const double* r, double* x) {
  ForEachEliminated(schur, r, [&](int l, const std::vector<BlockRow>& rows, Eigen::VectorXd* u) {
    const auto& landmark = schur.landmarks()[l];
    for (const BlockRow& row : rows) {
      *u -= YTransposed(row, landmark.size) *
            Segment(static_cast<const double*>(x), row.frame, row.size);
    }
    // Writes the landmark's part last: rows of frames in x are only read from here on.
    Segment(x, landmark.quad, landmark.size) = InverseRootOf(schur, l).transpose() * *u;
  });
}

}  // namespace

// x_c = (S + μD)⁻¹ (r_c − Y U_inv r_l), x_l = U_invᵀ (U_inv r_l − Yᵀ x_c).
Status SolveDamped(const IncrementalSystem& system, const LiveFactor& factor, const double* r,
                   double* x) {
  const IncrementalSchur& schur = system.schur();
  const std::vector<int>& offsets = schur.offsets();
  // b is formed in a copy of r, padded as r is; only frames' entries of it change.
  std::vector<double> padded(r, r + std::ptrdiff_t{system.variables().num_quads()} * kQuad);
  EliminateLandmarks(schur, r, padded.data());
  // Packed as S is; a row that is free has no scalars there.
  std::vector<double> b(offsets.back(), 0.0), solution(offsets.back(), 0.0);
  // Held frames get b = 0 and a unit row, and their step is left at what the caller zeroed.
  for (std::size_t f = 0; f < schur.frames().size(); ++f) {
    const auto& frame = schur.frames()[f];
    if (frame.id >= 0 && !frame.held) {
      std::copy_n(padded.begin() + std::ptrdiff_t{frame.quad} * kQuad, frame.size,
                  b.begin() + offsets[f]);
    }
  }
  const Status solved =
      offsets.back() > 0 ? factor.Solve(offsets, b.data(), solution.data()) : Status::Ok();
  for (std::size_t f = 0; f < schur.frames().size(); ++f) {
    const auto& frame = schur.frames()[f];
    if (frame.id >= 0) {
      std::copy_n(solution.begin() + offsets[f], frame.held ? 0 : frame.size,
                  x + std::ptrdiff_t{frame.quad} * kQuad);
    }
  }
  SolveLandmarks(schur, r, x);
  return solved;
}

}  // namespace inceres::internal
