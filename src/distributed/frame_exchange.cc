#include "distributed/frame_exchange.h"

#include <algorithm>

#include "base/stopwatch.h"

namespace inceres::internal {

FrameExchange::FrameExchange(const Communicator& ranks, const SharedFrames& frames,
                             const std::vector<FramePlace>& places, int kind)
    : owned_size_(frames.owned_size(kind)) {
  std::vector<PetscInt> indices;
  for (const FramePlace& place : places) {
    const int size = place.sizes[kind];
    here_size_ += size;
    // An owner sends to all others; each of them sends to the owner.
    const int num_sent = place.owner == ranks.rank() ? place.num_others : 1;
    bytes_per_round_ += std::int64_t{num_sent} * size * static_cast<std::int64_t>(sizeof(double));
    for (int k = 0; k < size; ++k) {
      indices.push_back(ToPetscInt(place.begin[kind] + k));
    }
  }
  Check(VecCreateMPIWithArray(ranks.comm(), 1, ToPetscInt(owned_size_),
                              ToPetscInt(frames.total_size(kind)), nullptr, owned_.Receive()),
        "VecCreateMPIWithArray");
  Check(VecCreateSeqWithArray(PETSC_COMM_SELF, 1, ToPetscInt(here_size_), nullptr, here_.Receive()),
        "VecCreateSeqWithArray");
  PetscOwned<IS, ISDestroy> from;
  Check(ISCreateGeneral(ranks.comm(), ToPetscInt(here_size_), indices.data(), PETSC_COPY_VALUES,
                        from.Receive()),
        "ISCreateGeneral");
  Check(VecScatterCreate(owned_.get(), from.get(), here_.get(), nullptr, scatter_.Receive()),
        "VecScatterCreate");
}

void FrameExchange::Scatter(const double* from, double* to, bool collect) {
  const StageTimer timer(&seconds_);
  const Vec source = collect ? here_.get() : owned_.get();
  const Vec target = collect ? owned_.get() : here_.get();
  // PETSc reads the one and writes the other
  Check(VecPlaceArray(source, from != nullptr ? const_cast<double*>(from) : &nothing_),
        "VecPlaceArray");
  Check(VecPlaceArray(target, to != nullptr ? to : &nothing_), "VecPlaceArray");
  const InsertMode mode = collect ? ADD_VALUES : INSERT_VALUES;
  const ScatterMode direction = collect ? SCATTER_REVERSE : SCATTER_FORWARD;
  Check(VecScatterBegin(scatter_.get(), source, target, mode, direction), "VecScatterBegin");
  Check(VecScatterEnd(scatter_.get(), source, target, mode, direction), "VecScatterEnd");
  Check(VecResetArray(source), "VecResetArray");
  Check(VecResetArray(target), "VecResetArray");
}

void FrameExchange::Spread(const double* owned, double* here) {
  Scatter(owned, here, /*collect=*/false);
}

void FrameExchange::Collect(const double* here, double* owned) {
  std::fill_n(owned, owned_size_, 0.0);
  Scatter(here, owned, /*collect=*/true);
}

}  // namespace inceres::internal
