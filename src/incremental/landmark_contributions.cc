// The contributions of landmarks to S and b.

#include <algorithm>
#include <cstddef>

#include "incremental/schur_sums.h"

namespace inceres::internal {

// −Y Yᵀ and −Y z of the landmarks in S and b (docs/algorithms.md, "Schur complement"; Y = W
// U_invᵀ, z = U_inv l). The Y that is in S is the one that blocks_ has, and it is taken out with
// just those numbers before blocks_ gets others. A new Y changes all blocks between the frames of
// a separator, so replacing takes one pass over S where taking out and adding would take two.

void SchurSums::AddLandmark(std::int32_t landmark, double sign) {
  // Rows in the order of the separator, which is sorted by row, as the targets are.
  const Contribution contribution = blocks_.Rows(landmark, &landmark_rows_);
  AddProducts(contribution, sign, blocks_.Targets(landmark).data());
  AddToB(contribution, blocks_.z(landmark), nullptr, sign);
  Touch(FramesOf(landmark));
}

// A landmark eliminated anew takes the place of what it was in one pass over its blocks of S:
//
//     S := S + Y_out Y_outᵀ − Y Yᵀ,   b := b + Y_out z_out − Y z.
//
// Y and z are written over by the elimination, so what is in S is copied before.
void SchurSums::EliminateAnew(std::int32_t landmark, const double* eta) {
  const std::ptrdiff_t size = blocks_.SizeOfY(landmark);
  if (size > static_cast<std::ptrdiff_t>(Y_out_.size())) {
    Y_out_.resize(static_cast<std::size_t>(2 * size));
  }
  // A copy: Eliminate writes the new Y over the old one.
  std::copy_n(blocks_.Y(landmark), size, Y_out_.data());
  double z_out[kQuad];
  std::copy_n(blocks_.z(landmark), kQuad, z_out);
  blocks_.Eliminate(landmark, eta);

  Contribution contribution = blocks_.Rows(landmark, &landmark_rows_);
  const double* Y = blocks_.Y(landmark);
  for (int r = 0; r < contribution.count; ++r) {
    // The same layout, so the same distance from the beginning.
    landmark_rows_[r].out = Y_out_.data() + (landmark_rows_[r].A - Y);
  }
  contribution.replaces = true;
  AddProducts(contribution, -1.0, blocks_.Targets(landmark).data());
  AddToB(contribution, blocks_.z(landmark), z_out, -1.0);
  Touch(FramesOf(landmark));
}

// For the blocks and entries for which part(row)(column) and part(row)(row) hold.
template <typename Part>
void SchurSums::AddPart(std::int32_t landmark, double sign, const Part& part) {
  const Contribution contribution = blocks_.Rows(landmark, &landmark_rows_);
  const std::vector<std::int32_t>& frames = FramesOf(landmark);
  landmark_targets_ = blocks_.Targets(landmark);
  std::size_t at = 0;
  for (int r = 0; r < contribution.count; ++r) {
    // Whether a block belongs to the part is a question about both its rows; the outer one is
    // answered once a row.
    const auto is_in = part(frames[r]);
    for (int c = 0; c <= r; ++c, ++at) {
      landmark_targets_[at] = is_in(frames[c]) ? landmark_targets_[at] : -1;
    }
    if (is_in(frames[r])) {
      AddToB({contribution.rows + r, 1, contribution.depth}, blocks_.z(landmark), nullptr, sign);
      changes_.Touch(frames[r]);
    }
  }
  AddProducts(contribution, sign, landmark_targets_.data());
}

// Both rows inside: of a new frame's own system, whatever else the landmark sees is held.
void SchurSums::AddLandmarkWithin(std::int32_t landmark, double sign, const IndexSet& rows) {
  AddPart(landmark, sign, [&rows](std::int32_t r) {
    return [&rows, in = rows.Has(r)](std::int32_t c) { return in && rows.Has(c); };
  });
}

// Either row: the whole row and its column. Of b only that row's entries, but all rows have
// another block.
void SchurSums::AddLandmarkAcross(std::int32_t landmark, double sign, std::int32_t row) {
  AddPart(landmark, sign, [row](std::int32_t r) {
    return [row, in = r == row](std::int32_t c) { return in || c == row; };
  });
  Touch(FramesOf(landmark));
}

}  // namespace inceres::internal
