#include "distributed/petsc_objects.h"

#include <petscsys.h>

#include <algorithm>
#include <limits>

namespace inceres::internal {
namespace {

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

void Copy(const std::vector<double>& from, Vec to) {
  double* values = nullptr;
  Check(VecGetArrayWrite(to, &values), "VecGetArrayWrite");
  std::copy(from.begin(), from.end(), values);
  Check(VecRestoreArrayWrite(to, &values), "VecRestoreArrayWrite");
}

void Copy(Vec from, std::vector<double>* to) {
  const double* values = nullptr;
  Check(VecGetArrayRead(from, &values), "VecGetArrayRead");
  std::copy(values, values + to->size(), to->begin());
  Check(VecRestoreArrayRead(from, &values), "VecRestoreArrayRead");
}

void EnsurePetsc() {
  PetscBool initialized = PETSC_FALSE;
  Check(PetscInitialized(&initialized), "PetscInitialized");
  if (initialized == PETSC_FALSE) {
    Check(PetscInitializeNoArguments(), "PetscInitialize");
    Check(PetscRegisterFinalizeAll(), "PetscRegisterFinalizeAll");
  }
  static const bool kReturnsErrors = PetscPushErrorHandler(PetscReturnErrorHandler, nullptr) == 0;
  static_cast<void>(kReturnsErrors);
}

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
