#include "distributed/reduced_system.h"

#include <algorithm>
#include <cstddef>

#include "base/stopwatch.h"

namespace inceres::internal {

ReducedSystem::ReducedSystem(const Communicator& ranks, const SharedFrames& frames,
                             const Evaluator& evaluator, const FramePlans& plans,
                             const Hessian& hessian, const Elimination& elimination,
                             FrameExchange* exchange)
    : ranks_(ranks),
      frames_(frames),
      evaluator_(evaluator),
      plans_(plans),
      hessian_(hessian),
      elimination_(elimination),
      exchange_(*exchange),
      block_exchange_(ranks, frames, frames.moving(), FramePlace::kSquare),
      product_(plans.pattern) {
  for (std::size_t k = 0; k < plans.block_row.size(); ++k) {
    blocks_.push_back(hessian.FrameBlock(static_cast<int>(k)));
  }
  no_damping_.assign(static_cast<std::size_t>(exchange_.here_size()), 0.0);
  packed_.resize(no_damping_.size());
  padded_.assign(static_cast<std::size_t>(product_.padded_offsets().back()), 0.0);
  padded_product_.resize(padded_.size());
  owned_offsets_.push_back(0);
  std::size_t padded_size = 0;
  for (const int position : frames.owned()) {
    const int size = frames.moving()[static_cast<std::size_t>(position)].sizes[0];
    owned_offsets_.push_back(owned_offsets_.back() + size);
    padded_size += static_cast<std::size_t>(PadToQuad(size));
  }
  owned_scale_.assign(static_cast<std::size_t>(owned_offsets_.back()), 1.0);
  padded_owned_.assign(padded_size, 0.0);
  padded_result_.resize(padded_size);
}

// What is owned of values of the frames here.
void ReducedSystem::ChooseOwned(const double* here, std::vector<double>* owned) const {
  owned->clear();
  const std::vector<int>& offsets = plans_.pattern.offsets;
  for (const int position : frames_.owned()) {
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

void ReducedSystem::Multiply(const double* v, double* y) {
  const StageTimer timer(&product_seconds_);
  ++num_products_;
  exchange_.Spread(v, packed_.data());
  const std::vector<int>& packed = product_.packed_offsets();
  const std::vector<int>& padded = product_.padded_offsets();
  for (int i = 0; i < product_.num_rows(); ++i) {
    std::copy_n(packed_.data() + packed[i], product_.block_size(i), padded_.data() + padded[i]);
  }
  std::fill(padded_product_.begin(), padded_product_.end(), 0.0);
  product_.Subtract(blocks_, no_damping_.data(), evaluator_.executor(), padded_.data(),
                    padded_product_.data());
  elimination_.AddCoupled(padded_.data(), padded_product_.data());
  for (int i = 0; i < product_.num_rows(); ++i) {
    std::transform(padded_product_.data() + padded[i],
                   padded_product_.data() + padded[i] + product_.block_size(i),
                   packed_.data() + packed[i], [](double minus) { return -minus; });
  }
  exchange_.Collect(packed_.data(), y);
  for (std::size_t k = 0; k < owned_damping_.size(); ++k) {
    y[k] += owned_damping_[k] * v[k];
  }
}

Status ReducedSystem::MakeTwoLevel(const LandmarkIncidences& incidences,
                                   const RankedAggregates& aggregates) {
  Status status;
  two_level_ = RankedTwoLevel::Make(ranks_, frames_, evaluator_, incidences, plans_, hessian_,
                                    elimination_, aggregates, &status);
  return status;
}

void ReducedSystem::Refresh() {
  if (two_level_ != nullptr) {
    two_level_->Refresh();
  }
}

Status ReducedSystem::Prepare(PreconditionerKind kind) {
  kind_ = kind;
  switch (kind) {
    case PreconditionerKind::kIdentity:
      return Status::Ok();
    case PreconditionerKind::kTwoLevel:
      return two_level_->Prepare(owned_damping_);
    default:
      return InvertBlocks(kind == PreconditionerKind::kSchurJacobi);
  }
}

Status ReducedSystem::InvertBlocks(bool of_S) {
  const BlockPattern& pattern = plans_.pattern;
  std::vector<double> here;
  for (std::size_t k = 0; k < plans_.block_row.size(); ++k) {
    if (pattern.columns[k] == plans_.block_row[k]) {
      const double* const block = of_S ? elimination_.S() + pattern.value_begin[k] : blocks_[k];
      const int size = pattern.block_size(plans_.block_row[k]);
      here.insert(here.end(), block, block + static_cast<std::ptrdiff_t>(size) * size);
    }
  }
  std::vector<double> owned(static_cast<std::size_t>(block_exchange_.owned_size()));
  block_exchange_.Collect(here.data(), owned.data());
  std::vector<const double*> diagonal_blocks;
  const double* next = owned.data();
  for (std::size_t k = 0; k + 1 < owned_offsets_.size(); ++k) {
    const std::ptrdiff_t size = owned_offsets_[k + 1] - owned_offsets_[k];
    diagonal_blocks.push_back(next);
    next += size * size;
  }
  const int singular = inverses_.Invert(owned_offsets_, diagonal_blocks, owned_damping_.data(),
                                        evaluator_.executor());
  Status own;
  if (singular >= 0) {
    const int position = frames_.owned()[static_cast<std::size_t>(singular)];
    own =
        Status::Error(StatusCode::kSingular,
                      "the preconditioner is not positive definite at frame " +
                          std::to_string(frames_.moving()[static_cast<std::size_t>(position)].id));
  }
  return ranks_.Agree(own);
}

void ReducedSystem::Precondition(const double* r, double* z) {
  if (kind_ == PreconditionerKind::kIdentity) {  // Ceres's is that of the scaled system
    for (std::size_t k = 0; k < owned_scale_.size(); ++k) {
      z[k] = owned_scale_[k] * owned_scale_[k] * r[k];
    }
    return;
  }
  const auto for_each_frame = [this](const auto& visit) {
    std::size_t padded = 0;
    for (std::size_t k = 0; k + 1 < owned_offsets_.size(); ++k) {
      const int size = owned_offsets_[k + 1] - owned_offsets_[k];
      visit(owned_offsets_[k], size, padded);
      padded += static_cast<std::size_t>(PadToQuad(size));
    }
  };
  for_each_frame([&](int at, int size, std::size_t padded) {
    std::copy_n(r + at, size, padded_owned_.data() + padded);
  });
  if (kind_ == PreconditionerKind::kTwoLevel) {
    two_level_->Apply(padded_owned_.data(), padded_result_.data());
  } else {
    inverses_.Apply(evaluator_.executor(), padded_owned_.data(), padded_result_.data());
  }
  for_each_frame([&](int at, int size, std::size_t padded) {
    std::copy_n(padded_result_.data() + padded, size, z + at);
  });
}

std::int64_t ReducedSystem::Bytes() const {
  const std::size_t doubles = no_damping_.size() + packed_.size() + padded_.size() +
                              padded_product_.size() + owned_damping_.size() + owned_scale_.size() +
                              padded_owned_.size() + padded_result_.size();
  return static_cast<std::int64_t>(doubles * sizeof(double)) + product_.Bytes() +
         inverses_.Bytes() + (two_level_ != nullptr ? two_level_->Bytes() : 0);
}

}  // namespace inceres::internal
