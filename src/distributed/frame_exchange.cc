#include "distributed/frame_exchange.h"

#include <algorithm>

#include "base/stopwatch.h"

namespace inceres::internal {

// Values of frames between the ranks that have them and their owners, by one plan of PETSc for both
// directions. The vector of all ranks holds what is owned, rank by rank; an index set names, for
// each entry here, its place in it. Forward, entries are copied from owners to all that list them
// (Spread); reversed with ADD_VALUES, those of all are summed at the owner (Collect). Both touch
// ranks that share a frame, and no others.
//
// The two vectors of PETSc have no memory of their own: the arrays of the caller are lent to them
// for the time of a call.

FrameExchange::FrameExchange(const Communicator& ranks, const SharedFrames& frames,
                             const std::vector<FramePlace>& places, int kind)
    : owned_size_(frames.owned_size(kind)) {
  std::vector<PetscInt> indices;
  for (const FramePlace& place : places) {
    // Tangent vectors, diagonal blocks or values: the same frames with other sizes.
    const int size = place.sizes[kind];
    here_size_ += size;
    // An owner sends to all others; each of them sends to the owner.
    const int num_sent = place.owner == ranks.rank() ? place.num_others : 1;
    bytes_per_round_ += std::int64_t{num_sent} * size * static_cast<std::int64_t>(sizeof(double));
    for (int k = 0; k < size; ++k) {
      indices.push_back(ToPetscInt(place.begin[kind] + k));
    }
  }
  // Without arrays, which Scatter places.
  Check(VecCreateMPIWithArray(ranks.comm(), 1, ToPetscInt(owned_size_),
                              ToPetscInt(frames.total_size(kind)), nullptr, owned_.Receive()),
        "VecCreateMPIWithArray");
  Check(VecCreateSeqWithArray(PETSC_COMM_SELF, 1, ToPetscInt(here_size_), nullptr, here_.Receive()),
        "VecCreateSeqWithArray");
  // The index set is of the plan alone; the plan copies what it needs. The target has no index set:
  // it takes entries in their order.
  PetscOwned<IS, ISDestroy> from;
  Check(ISCreateGeneral(ranks.comm(), ToPetscInt(here_size_), indices.data(), PETSC_COPY_VALUES,
                        from.Receive()),
        "ISCreateGeneral");
  Check(VecScatterCreate(owned_.get(), from.get(), here_.get(), nullptr, scatter_.Receive()),
        "VecScatterCreate");
}

// Collective, and a rank without entries calls it too: PETSc asks for an array that is not null
// even then.
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

// The reverse scatter adds to what is there, hence the zeros. An owner is among those that list its
// frames, so its own share is added the same way.
void FrameExchange::Collect(const double* here, double* owned) {
  std::fill_n(owned, owned_size_, 0.0);
  Scatter(here, owned, /*collect=*/true);
}

}  // namespace inceres::internal
