#include "distributed/petsc_objects.h"

#include <petscsys.h>

#include <cstdlib>
#include <limits>

namespace inceres::internal {

// The C interface of PETSc as the rest of the code uses it. PETSc returns codes and, unless told
// otherwise, prints a trace for each of them; here a code becomes an exception with the call and
// PETSc's own words, and nothing is printed.

namespace {

// The general text belongs to the code, the specific one to the call that failed last.
std::string Describe(PetscErrorCode code, const char* call) {
  const char* general = nullptr;
  char* specific = nullptr;
  static_cast<void>(PetscErrorMessage(code, &general, &specific));
  std::string text = std::string("PETSc, ") + call + ": error " + std::to_string(code);
  if (general != nullptr) {
    text += std::string(", ") + general;
  }
  if (specific != nullptr && specific[0] != '\0') {
    text += std::string(": ") + specific;
  }
  return text;
}

bool ends_petsc = false;

// At exit, of what EnsurePetsc has started. PetscFinalize ends MPI too if PetscInitialize began it.
// Whoever began MPI himself may have ended it, and then nothing of PETSc can be called.
void EndPetsc() {
  PetscBool ended = PETSC_TRUE;
  int mpi_ended = 1;
  if (ends_petsc && PetscFinalized(&ended) == 0 && ended == PETSC_FALSE &&
      MPI_Finalized(&mpi_ended) == MPI_SUCCESS && mpi_ended == 0) {
    static_cast<void>(PetscFinalize());
  }
}

}  // namespace

PetscFailure::PetscFailure(PetscErrorCode code, const char* call)
    : std::runtime_error(Describe(code, call)) {
}

PetscInt ToPetscInt(long long count) {
  if (count > static_cast<long long>(std::numeric_limits<PetscInt>::max())) {
    throw PetscFailure(PETSC_ERR_ARG_OUTOFRANGE,
                       "integers of this build of PETSc are too short for this problem");
  }
  return static_cast<PetscInt>(count);
}

// Whoever has started PETSc or MPI keeps it: a PETSc that runs is taken as it is, and
// PetscInitialize takes over an MPI that runs.
void EnsurePetsc() {
  PetscBool initialized = PETSC_FALSE;
  Check(PetscInitialized(&initialized), "PetscInitialized");
  if (initialized == PETSC_FALSE) {
    Check(PetscInitializeNoArguments(), "PetscInitialize");
    // Before the first solver is complete, so after the last one in static storage is destroyed.
    ends_petsc = std::atexit(&EndPetsc) == 0;
  }
  // Handlers are a stack of the process: pushed once, however many solvers are made.
  static const bool kReturnsErrors = PetscPushErrorHandler(PetscReturnErrorHandler, nullptr) == 0;
  static_cast<void>(kReturnsErrors);
}

void ForgetPetsc() {
  ends_petsc = false;
}

// Stages are known by name in the whole process, and registered when the name first comes. Logging
// never fails a solve: codes are ignored.
LogStage::LogStage(const char* name) {
  PetscLogStage stage = -1;
  if (PetscLogStageGetId(name, &stage) == 0 && stage < 0) {
    static_cast<void>(PetscLogStageRegister(name, &stage));
  }
  static_cast<void>(PetscLogStagePush(stage));
}

LogStage::~LogStage() {
  static_cast<void>(PetscLogStagePop());
}

}  // namespace inceres::internal
