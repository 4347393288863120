#pragma once

#include <petscmat.h>

#include <cstdint>
#include <vector>

#include "distributed/petsc_objects.h"
#include "distributed/reduced_system.h"

namespace inceres::internal {

/// S + Λ_c as a matrix of PETSc. Each rank forms its share of each block; blocks go to the owner of
/// their row by one exchange that is planned once, are summed there in the order of the ranks, and
/// set where they belong: nothing passes PETSc's stash of entries that others own.
class AssembledSystem {
 public:
  enum class Form {
    kUpper,  ///< the upper triangle, as MPISBAIJ: for Cholesky
    kWhole,  ///< both, as MPIAIJ: for preconditioners of all kinds
  };

  /// Collective, as all calls. Throws AgreedFailure, on all ranks, if one cannot plan its shares.
  AssembledSystem(Form form, const ReducedSystem& system);

  /// Sets the entries, after an elimination and SetDamping.
  void Assemble();

  Mat matrix() const { return matrix_.get(); }
  std::int64_t Bytes() const;

 private:
  // A block of S by the numbers of its rows and columns, of which the first one is given.
  struct Place {
    std::int64_t row;
    std::int64_t column;
    std::int32_t rows;
    std::int32_t columns;
  };
  // One that is formed here, and goes to a rank.
  struct Share {
    Place place;
    int block;  // of the pattern
    bool transposed;
  };
  // One that is owned here.
  struct OwnedBlock {
    Place place;
    std::int64_t begin;  // of its values
  };

  std::vector<std::vector<Share>> CollectShares() const;
  void NumberShares(const std::vector<std::vector<Share>>& of_rank,
                    std::vector<std::vector<Place>>* places);
  void PlanExchange(std::vector<std::vector<Place>> places);
  void PlanSums(const std::vector<Place>& received);
  void Preallocate();
  void PackShares();
  void AddDamping();

  const Form form_;
  const ReducedSystem& system_;
  std::vector<Share> shares_;                  // by rank
  Communicator::Parts to_ranks_, from_ranks_;  // values
  std::vector<std::int64_t> targets_;          // per block received: where its values are summed
  std::vector<std::int64_t> target_sizes_;
  std::vector<OwnedBlock> owned_;
  std::vector<double> sent_, received_, sums_;
  PetscOwned<Mat, MatDestroy> matrix_;
};

}  // namespace inceres::internal
