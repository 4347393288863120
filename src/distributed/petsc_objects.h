#pragma once

#include <petscvec.h>

#include <stdexcept>
#include <vector>

namespace inceres::internal {

/// PETSc could not do what it was asked; most of such failures are those of all ranks.
class PetscFailure : public std::runtime_error {
 public:
  PetscFailure(PetscErrorCode code, const char* call);
};

/// Throws PetscFailure unless the call did well.
inline void Check(PetscErrorCode code, const char* call) {
  if (code != 0) {
    throw PetscFailure(code, call);
  }
}

/// A count as PETSc takes it; throws PetscFailure if its integers are too short.
PetscInt ToPetscInt(long long count);

/// Owns an object of PETSc that DESTROY(&object) frees.
template <typename Object, PetscErrorCode (*kDestroy)(Object*)>
class PetscOwned {
 public:
  PetscOwned() = default;
  ~PetscOwned() { Reset(); }
  PetscOwned(const PetscOwned&) = delete;
  PetscOwned& operator=(const PetscOwned&) = delete;

  Object get() const { return object_; }
  /// For calls that make one.
  Object* Receive() {
    Reset();
    return &object_;
  }
  void Reset() {
    if (object_ != nullptr) {
      static_cast<void>(kDestroy(&object_));
      object_ = nullptr;
    }
  }

 private:
  Object object_ = nullptr;
};

/// Starts PETSc and MPI, if nobody has; from then on PETSc's errors are returned, not printed. What
/// is started here is ended when the program exits, unless ForgetPetsc was called or MPI has ended.
void EnsurePetsc();
/// Before the program ends on this rank alone: the end of PETSc is collective, and nobody comes.
void ForgetPetsc();

/// Begins a stage of PETSc's log (-log_view) by its name, and ends it.
class LogStage {
 public:
  explicit LogStage(const char* name);
  ~LogStage();
  LogStage(const LogStage&) = delete;
  LogStage& operator=(const LogStage&) = delete;
};

}  // namespace inceres::internal
