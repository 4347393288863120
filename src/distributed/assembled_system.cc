#include "distributed/assembled_system.h"

#include <algorithm>
#include <climits>
#include <numeric>
#include <tuple>
#include <utility>

namespace inceres::internal {

// S + Λ_c formed as a matrix of PETSc, for solvers that take entries. A rank has its own factors
// and landmarks only, so the block (i, j) of its S = C − Y Yᵀ is one term of a sum over all ranks;
// rows belong to the owners of their frames.
//
// Who sends which block to whom is found once, for the structure stays in a solve. Kept between
// calls: the plan, the buffers and the matrix with its pattern. Assemble packs, exchanges values
// only, sums them in the order of the ranks from zero on, and inserts whole blocks: the same ranks
// give the same bits, and no value passes PETSc's stash of entries of others, whose sums would come
// in the order of messages.
//
// The pattern that FramePlans have is lower triangular in the order of this rank's layout; the
// matrix has the order of all ranks, by owner and then by id. So a block may lie the other way
// around there.

namespace {

// As MPI counts values: no rank sends more than 16 GiB of a matrix, nor 2 GiB of places.
// MPI takes counts as int. Throws on this rank alone: an agreement, or the end of the program,
// tells the others.
int ToCount(std::int64_t count) {
  if (count > INT_MAX) {
    throw PetscFailure(PETSC_ERR_ARG_OUTOFRANGE, "a rank's share of S is too large to be sent");
  }
  return static_cast<int>(count);
}

// Exclusive prefix sums. The total is checked too, since it is the length of the buffer.
std::vector<int> BeginsOf(const std::vector<int>& counts) {
  std::vector<int> begins(counts.size(), 0);
  std::int64_t total = 0;
  for (std::size_t r = 0; r < counts.size(); ++r) {
    begins[r] = ToCount(total);
    total += counts[r];
  }
  ToCount(total);
  return begins;
}

}  // namespace

// The order matters: shares are numbered by rank before the exchange of places, and only what is
// received says how many entries each owned row has. What this rank does by itself is agreed on
// before the first exchange; what throws later ends the program, for the others are in the midst of
// one.
AssembledSystem::AssembledSystem(Form form, const ReducedSystem& system)
    : form_(form), system_(system) {
  std::vector<std::vector<Place>> places;
  const Status collected = system.ranks().Try([&] {
    NumberShares(CollectShares(), &places);
    return Status::Ok();
  });
  if (!collected.ok()) {
    throw AgreedFailure(collected);
  }
  PlanExchange(std::move(places));
  Preallocate();
}

// Each block of the local pattern becomes a share for the owner of its row. The upper form has one
// share for each block, turned such that its row is not behind its column; the whole form has two,
// of which one is the transpose, and one on the diagonal.
std::vector<std::vector<AssembledSystem::Share>> AssembledSystem::CollectShares() const {
  std::vector<std::vector<Share>> of_rank(static_cast<std::size_t>(system_.ranks().size()));
  const FramePlans& plans = system_.plans();
  const std::vector<FramePlace>& frames = system_.frames().moving();
  const auto add = [&](const FramePlace& row, const FramePlace& column, int block,
                       bool transposed) {
    const Place place{row.begin[0], column.begin[0], row.sizes[0], column.sizes[0]};
    of_rank[static_cast<std::size_t>(row.owner)].push_back({place, block, transposed});
  };
  for (std::size_t k = 0; k < plans.block_row.size(); ++k) {
    const FramePlace& i = frames[static_cast<std::size_t>(plans.block_row[k])];
    const FramePlace& j = frames[static_cast<std::size_t>(plans.pattern.columns[k])];
    const auto block = static_cast<int>(k);
    // Index 0 is FramePlace::kTangent: begin is the first scalar row in the matrix.
    const bool upper = i.begin[0] <= j.begin[0];
    if (form_ == Form::kWhole && &i != &j) {
      add(i, j, block, false);
      add(j, i, block, true);
    } else {
      add(upper ? i : j, upper ? j : i, block, !upper);
    }
  }
  return of_rank;
}

// Shares are concatenated by rank of destination, and `shares_` keeps that order for PackShares.
// Also whether MPI can count them: the values, and the bytes of the places.
void AssembledSystem::NumberShares(const std::vector<std::vector<Share>>& of_rank,
                                   std::vector<std::vector<Place>>* places) {
  const auto num_ranks = of_rank.size();
  places->resize(num_ranks);
  to_ranks_.counts.assign(num_ranks, 0);
  from_ranks_.counts.assign(num_ranks, 0);
  for (std::size_t r = 0; r < num_ranks; ++r) {
    std::int64_t num_values = 0;
    for (const Share& share : of_rank[r]) {
      shares_.push_back(share);
      (*places)[r].push_back(share.place);
      num_values += std::int64_t{share.place.rows} * share.place.columns;
    }
    to_ranks_.counts[r] = ToCount(num_values);
  }
  to_ranks_.begins = BeginsOf(to_ranks_.counts);
  ToCount(static_cast<std::int64_t>(shares_.size() * sizeof(Place)));
}

// Places travel once; afterwards position k in the stream of values means place k. A rank sends to
// itself like to others, so that one loop sums all.
void AssembledSystem::PlanExchange(std::vector<std::vector<Place>> places) {
  const Communicator& ranks = system_.ranks();
  // Receivers learn the counts of values first.
  MPI_Alltoall(to_ranks_.counts.data(), 1, MPI_INT, from_ranks_.counts.data(), 1, MPI_INT,
               ranks.comm());
  from_ranks_.begins = BeginsOf(from_ranks_.counts);
  const std::vector<Place> received = ranks.SendToEach(std::move(places));
  // The last begin and the last count give the total.
  const auto total = [](const Communicator::Parts& parts) {
    return static_cast<std::size_t>(parts.begins.back()) +
           static_cast<std::size_t>(parts.counts.back());
  };
  sent_.resize(total(to_ranks_));
  received_.resize(total(from_ranks_));
  PlanSums(received);
}

// Finds where each received block is summed. Equal places are made neighbors by sorting; the key
// ends with k, so the order is total, and `received` itself stays in the order of the ranks, which
// is the order of the sums in Assemble.
void AssembledSystem::PlanSums(const std::vector<Place>& received) {
  std::vector<std::size_t> order(received.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto key = [&](std::size_t k) {
    return std::make_tuple(received[k].row, received[k].column, k);
  };
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return key(a) < key(b); });
  targets_.resize(received.size());
  std::int64_t size = 0;
  for (const std::size_t k : order) {
    const Place& place = received[k];
    const bool known = !owned_.empty() && owned_.back().place.row == place.row &&
                       owned_.back().place.column == place.column;
    if (!known) {
      owned_.push_back({place, size});
      size += std::int64_t{place.rows} * place.columns;
    }
    // A sum is addressed by the first of its values, rows without padding.
    targets_[k] = owned_.back().begin;
  }
  for (const Place& place : received) {
    target_sizes_.push_back(std::int64_t{place.rows} * place.columns);
  }
  sums_.resize(static_cast<std::size_t>(size));
}

// Gives PETSc the number of entries of each row, inside the square of columns owned here and
// outside, so that insertion never allocates.
void AssembledSystem::Preallocate() {
  const SharedFrames& frames = system_.frames();
  const PetscInt rows = ToPetscInt(frames.owned_size(FramePlace::kTangent));
  const PetscInt all = ToPetscInt(frames.total_size(FramePlace::kTangent));
  PetscInt first = 0;
  MPI_Exscan(&rows, &first, 1, MPIU_INT, MPI_SUM, system_.ranks().comm());
  // MPI_Exscan leaves the result of rank 0 undefined.
  first = system_.ranks().rank() == 0 ? 0 : first;
  std::vector<PetscInt> inside(static_cast<std::size_t>(rows), 0);
  std::vector<PetscInt> outside(inside.size(), 0);
  for (const OwnedBlock& block : owned_) {
    const bool own_column = block.place.column >= first && block.place.column < first + rows;
    for (int r = 0; r < block.place.rows; ++r) {
      const auto row = static_cast<std::size_t>(block.place.row - first + r);
      // Of a diagonal block the upper form keeps columns r and behind.
      const bool half = form_ == Form::kUpper && block.place.row == block.place.column;
      (own_column ? inside : outside)[row] += block.place.columns - (half ? r : 0);
    }
  }
  Check(MatCreate(system_.ranks().comm(), matrix_.Receive()), "MatCreate");
  Mat S = matrix_.get();
  Check(MatSetSizes(S, rows, rows, all, all), "MatSetSizes");
  if (form_ == Form::kUpper) {
    // Blocks of size 1, for frames differ in size. Of the two calls that follow the one of the
    // other type has no effect: on one rank the matrix is sequential.
    Check(MatSetType(S, MATSBAIJ), "MatSetType");
    Check(MatSeqSBAIJSetPreallocation(S, 1, 0, inside.data()), "MatSeqSBAIJSetPreallocation");
    Check(MatMPISBAIJSetPreallocation(S, 1, 0, inside.data(), 0, outside.data()),
          "MatMPISBAIJSetPreallocation");
    // Diagonal blocks are inserted as whole squares.
    Check(MatSetOption(S, MAT_IGNORE_LOWER_TRIANGULAR, PETSC_TRUE), "MatSetOption");
  } else {
    Check(MatSetType(S, MATAIJ), "MatSetType");
    Check(MatSeqAIJSetPreallocation(S, 0, inside.data()), "MatSeqAIJSetPreallocation");
    Check(MatMPIAIJSetPreallocation(S, 0, inside.data(), 0, outside.data()),
          "MatMPIAIJSetPreallocation");
  }
  Check(MatSetOption(S, MAT_SPD, PETSC_TRUE), "MatSetOption");
  // Assembly needs no messages: owners insert their own rows only.
  Check(MatSetOption(S, MAT_NO_OFF_PROC_ENTRIES, PETSC_TRUE), "MatSetOption");
}

// Writes the blocks of S in the order of the plan. Values lie row-major without padding, as in a
// batch solve; a transposed share reads a block of columns × rows.
void AssembledSystem::PackShares() {
  const BlockPattern& pattern = system_.plans().pattern;
  const double* const S = system_.elimination().S();
  double* out = sent_.data();
  for (const Share& share : shares_) {
    const double* const block = S + pattern.value_begin[static_cast<std::size_t>(share.block)];
    const int rows = share.place.rows;
    const int columns = share.place.columns;
    for (int r = 0; r < rows; ++r) {
      for (int c = 0; c < columns; ++c) {
        *out++ = share.transposed ? block[c * rows + r] : block[r * columns + c];
      }
    }
  }
}

// Λ_c goes in after the sums, once a frame, and not once a rank.
void AssembledSystem::AddDamping() {
  const std::vector<double>& damping = system_.owned_damping();
  std::size_t next = 0;  // diagonal blocks come in the order of the owned frames
  for (const OwnedBlock& block : owned_) {
    if (block.place.row != block.place.column) {
      continue;
    }
    // The diagonal of a row-major square is columns + 1 apart.
    for (int r = 0; r < block.place.rows; ++r) {
      sums_[static_cast<std::size_t>(block.begin + r * (block.place.columns + 1))] +=
          damping[next++];
    }
  }
}

// Collective. Reads the S of the last elimination and the damping of the last SetDamping.
void AssembledSystem::Assemble() {
  const LogStage stage("inceres assemble S");
  PackShares();
  system_.ranks().SendParts(sent_.data(), to_ranks_, received_.data(), from_ranks_);
  // Sums begin at zero on every call, and blocks arrive by ascending rank.
  std::fill(sums_.begin(), sums_.end(), 0.0);
  const double* from = received_.data();
  for (std::size_t k = 0; k < targets_.size(); ++k) {
    double* const to = sums_.data() + targets_[k];
    for (std::int64_t v = 0; v < target_sizes_[k]; ++v) {
      to[v] += *from++;
    }
  }
  AddDamping();
  // INSERT_VALUES replaces what the last assembly has left; every block of the pattern is written,
  // so nothing old remains.
  std::vector<PetscInt> rows;
  std::vector<PetscInt> columns;
  for (const OwnedBlock& block : owned_) {
    rows.resize(static_cast<std::size_t>(block.place.rows));
    columns.resize(static_cast<std::size_t>(block.place.columns));
    std::iota(rows.begin(), rows.end(), static_cast<PetscInt>(block.place.row));
    std::iota(columns.begin(), columns.end(), static_cast<PetscInt>(block.place.column));
    Check(MatSetValues(matrix_.get(), block.place.rows, rows.data(), block.place.columns,
                       columns.data(), sums_.data() + block.begin, INSERT_VALUES),
          "MatSetValues");
  }
  Check(MatAssemblyBegin(matrix_.get(), MAT_FINAL_ASSEMBLY), "MatAssemblyBegin");
  Check(MatAssemblyEnd(matrix_.get(), MAT_FINAL_ASSEMBLY), "MatAssemblyEnd");
}

std::int64_t AssembledSystem::Bytes() const {
  // of a value in the matrix, its column too
  return static_cast<std::int64_t>(
      (sent_.size() + received_.size() + sums_.size()) * sizeof(double) +
      sums_.size() * (sizeof(double) + sizeof(PetscInt)) + shares_.size() * sizeof(Share) +
      owned_.size() * sizeof(OwnedBlock));
}

}  // namespace inceres::internal
