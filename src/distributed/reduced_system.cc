#include "distributed/reduced_system.h"

#include <algorithm>
#include <cstddef>
#include <functional>

#include "base/stopwatch.h"
#include "distributed/ranked_two_level.h"

namespace inceres::internal {

// (S + Λ_c) v over ranks, S not formed. Each rank applies C − Y Yᵀ of its own factors and landmarks
// to the v of the frames it has; the parts are summed by the owners, who add Λ_c v once:
//
//     Spread v;   y_here = S_here v;   Collect y_here;   y += Λ_c v.
//
// Vectors between calls have the entries owned here, without padding, so dot products over all
// ranks count each frame once. The kernels read vectors whose frames begin on quads, in the order
// of the layout; packed ↔ padded copies stand at either end.
//
// The block preconditioners need blocks of the whole sum: diagonal blocks of C or S go to the
// owners by an exchange of their own, and are inverted there with Λ added. What is kept: the plans,
// and the inverses until the next Prepare.

ReducedSystem::ReducedSystem(const RankedParts& parts, FrameExchange* exchange)
    : parts_(parts),
      exchange_(*exchange),
      block_exchange_(parts.ranks, parts.frames, parts.frames.moving(), FramePlace::kSquare) {
  packed_.resize(static_cast<std::size_t>(exchange_.here_size()));
  const Layout& layout = parts.evaluator.layout();
  // Padding is zero here, and nothing writes it later.
  padded_.assign(static_cast<std::size_t>(layout.quad_offset[layout.num_frames]) * kQuad, 0.0);
  padded_product_.resize(padded_.size());
  // 1 without Jacobi scaling.
  owned_scale_.assign(static_cast<std::size_t>(parts.frames.owned_offsets().back()), 1.0);
  padded_owned_.assign(parts.frames.padded_owned_size(), 0.0);
  padded_result_.resize(padded_owned_.size());
}

ReducedSystem::~ReducedSystem() = default;

// What is owned of values of the frames here.
// Values of a shared frame are the same on all ranks that have it, so those here will do: no
// exchange.
void ReducedSystem::ChooseOwned(const double* here, std::vector<double>* owned) const {
  owned->clear();
  const std::vector<int>& offsets = parts_.plans.pattern.offsets;
  for (const int position : parts_.frames.owned()) {
    const auto i = static_cast<std::size_t>(position);
    owned->insert(owned->end(), here + offsets[i], here + offsets[i + 1]);
  }
}

void ReducedSystem::SetDamping(const double* frame_damping) {
  ChooseOwned(frame_damping, &owned_damping_);
}

void ReducedSystem::SetScale(const double* frame_scale) {
  ChooseOwned(frame_scale, &owned_scale_);
}

// Collective, two exchanges. Cost: a pass over the Jacobians.
void ReducedSystem::Multiply(const double* v, double* y) {
  const StageTimer timer(&product_seconds_);
  ++num_products_;
  exchange_.Spread(v, packed_.data());
  const Layout& layout = parts_.evaluator.layout();
  layout.Pad(packed_.data(), 0, layout.num_frames, padded_.data());
  std::fill(padded_product_.begin(), padded_product_.end(), 0.0);
  // The sign is turned on the way to the packed vector. Without damping, which must not be added by
  // every rank.
  parts_.elimination.SubtractReduced(padded_.data(), padded_product_.data());
  for (int i = 0; i < layout.num_frames; ++i) {
    const double* const minus =
        padded_product_.data() + static_cast<std::ptrdiff_t>(layout.quad_offset[i]) * kQuad;
    std::transform(minus, minus + layout.TangentSize(i), packed_.data() + layout.packed_offset[i],
                   std::negate<>());
  }
  exchange_.Collect(packed_.data(), y);
  for (std::size_t k = 0; k < owned_damping_.size(); ++k) {
    y[k] += owned_damping_[k] * v[k];
  }
}

// Once for a structure. Other preconditioners do without, and two_level_ stays null.
Status ReducedSystem::MakeTwoLevel(const RankedAggregates& aggregates) {
  Status status;
  two_level_ = std::make_unique<RankedTwoLevel>(parts_, aggregates, &status);
  return status;
}

void ReducedSystem::Refresh() {
  if (two_level_ != nullptr) {
    two_level_->Refresh();
  }
}

// After SetDamping of the same elimination.
Status ReducedSystem::Prepare(PreconditionerKind kind) {
  kind_ = kind;
  switch (kind) {
    case PreconditionerKind::kIdentity:
      return Status::Ok();
    case PreconditionerKind::kTwoLevel:
      return two_level_->Prepare(owned_damping_);
    // Jacobi by blocks, as Ceres's JACOBI (blocks of C) or SCHUR_JACOBI (blocks of S).
    default:
      return InvertBlocks(kind == PreconditionerKind::kSchurJacobi);
  }
}

// Collective. A sum of blocks is positive definite where each of its terms need not be: only the
// owner's sum is inverted.
Status ReducedSystem::InvertBlocks(bool of_S) {
  const BlockPattern& pattern = parts_.plans.pattern;
  std::vector<double> here;
  for (std::size_t k = 0; k < parts_.plans.block_row.size(); ++k) {
    if (pattern.columns[k] == parts_.plans.block_row[k]) {
      const double* const block = of_S ? parts_.elimination.S() + pattern.value_begin[k]
                                       : parts_.hessian.FrameBlock(static_cast<int>(k));
      const int size = pattern.block_size(parts_.plans.block_row[k]);
      // Whole squares, in the order of the layout, as FramePlace::kSquare counts them.
      here.insert(here.end(), block, block + static_cast<std::ptrdiff_t>(size) * size);
    }
  }
  std::vector<double> owned(static_cast<std::size_t>(block_exchange_.owned_size()));
  block_exchange_.Collect(here.data(), owned.data());
  std::vector<const double*> diagonal_blocks;
  const double* next = owned.data();
  const std::vector<int>& offsets = parts_.frames.owned_offsets();
  for (std::size_t k = 0; k + 1 < offsets.size(); ++k) {
    const std::ptrdiff_t size = offsets[k + 1] - offsets[k];
    diagonal_blocks.push_back(next);
    next += size * size;
  }
  const int singular = inverses_.Invert(offsets, diagonal_blocks, owned_damping_.data(),
                                        parts_.evaluator.executor());
  // A block without an inverse on one rank is an invalid step on all.
  Status own;
  if (singular >= 0) {
    const int position = parts_.frames.owned()[static_cast<std::size_t>(singular)];
    own = Status::Error(
        StatusCode::kSingular,
        "the preconditioner is not positive definite at frame " +
            std::to_string(parts_.frames.moving()[static_cast<std::size_t>(position)].id));
  }
  return parts_.ranks.Agree(own);
}

// Local but for the two levels, which exchange coarse vectors.
void ReducedSystem::Precondition(const double* r, double* z) {
  if (kind_ == PreconditionerKind::kIdentity) {  // Ceres's is that of the scaled system
    // With the scaled matrix s S s and no preconditioner, x = s x̃ moves along s (s r): M⁻¹ =
    // diag(s²).
    for (std::size_t k = 0; k < owned_scale_.size(); ++k) {
      z[k] = owned_scale_[k] * owned_scale_[k] * r[k];
    }
    return;
  }
  // visit(first packed entry, size, first padded entry).
  const auto for_each_frame = [this](const auto& visit) {
    const std::vector<int>& offsets = parts_.frames.owned_offsets();
    std::size_t padded = 0;
    for (std::size_t k = 0; k + 1 < offsets.size(); ++k) {
      const int size = offsets[k + 1] - offsets[k];
      visit(offsets[k], size, padded);
      padded += static_cast<std::size_t>(PadToQuad(size));
    }
  };
  for_each_frame([&](int at, int size, std::size_t padded) {
    std::copy_n(r + at, size, padded_owned_.data() + padded);
  });
  if (kind_ == PreconditionerKind::kTwoLevel) {
    two_level_->Apply(padded_owned_.data(), padded_result_.data());
  } else {
    inverses_.Apply(parts_.evaluator.executor(), padded_owned_.data(), padded_result_.data());
  }
  for_each_frame([&](int at, int size, std::size_t padded) {
    std::copy_n(padded_result_.data() + padded, size, z + at);
  });
}

std::int64_t ReducedSystem::Bytes() const {
  const std::size_t doubles = packed_.size() + padded_.size() + padded_product_.size() +
                              owned_damping_.size() + owned_scale_.size() + padded_owned_.size() +
                              padded_result_.size();
  return static_cast<std::int64_t>(doubles * sizeof(double)) + inverses_.Bytes() +
         (two_level_ != nullptr ? two_level_->Bytes() : 0);
}

}  // namespace inceres::internal
