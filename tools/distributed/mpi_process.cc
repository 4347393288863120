#include "tools/distributed/mpi_process.h"

#include <fcntl.h>
#include <petscsys.h>
#include <unistd.h>

#include <cctype>
#include <cstdio>
#include <vector>

#include "tools/command_line/command_line.h"

namespace inceres::tools {
namespace {

bool IsForPetsc(const char* word) {
  return word[0] == '-' && std::isalpha(static_cast<unsigned char>(word[1])) != 0;
}

// A value may be a negative number.
bool IsValue(const char* word) {
  return word[0] != '-' || (word[1] >= '0' && word[1] <= '9');
}

// Moves PETSc's words, with the program's name before them, out of the command line.
std::vector<char*> TakePetscWords(int* argc, char** argv) {
  std::vector<char*> taken{argv[0]};
  int kept = 1;
  for (int i = 1; i < *argc; ++i) {
    if (!IsForPetsc(argv[i])) {
      argv[kept++] = argv[i];
      continue;
    }
    taken.push_back(argv[i]);
    if (i + 1 < *argc && IsValue(argv[i + 1])) {
      taken.push_back(argv[++i]);
    }
  }
  *argc = kept;
  argv[kept] = nullptr;
  return taken;
}

// Sends a stream nowhere. A copy of where it went.
int Silence(int stream) {
  const int copy = dup(stream);
  const int nowhere = open("/dev/null", O_WRONLY | O_CLOEXEC);
  dup2(nowhere, stream);
  close(nowhere);
  return copy;
}

}  // namespace

int RankOf(MPI_Comm comm) {
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  return rank;
}

MpiProcess::MpiProcess(int* argc, char*** argv) {
  std::vector<char*> words = TakePetscWords(argc, *argv);
  auto count = static_cast<int>(words.size());
  words.push_back(nullptr);
  char** petsc_argv = words.data();
  started_ = PetscInitialize(&count, &petsc_argv, nullptr, nullptr) == 0;
  if (started_ && !IsRoot(MPI_COMM_WORLD)) {
    close(Silence(STDOUT_FILENO));
  }
}

MpiProcess::~MpiProcess() {
  if (started_) {
    static_cast<void>(End(0));
  }
}

std::optional<int> MpiProcess::ParseFlags(const ToolHelp& help, int* argc, char*** argv) {
  if (IsRoot(MPI_COMM_WORLD)) {
    return ParseCommandLine(help, argc, argv);
  }
  const int errors = Silence(STDERR_FILENO);
  const std::optional<int> exit_code = ParseCommandLine(help, argc, argv);
  dup2(errors, STDERR_FILENO);
  close(errors);
  return exit_code;
}

int MpiProcess::End(int exit_code) {
  if (!started_) {
    return exit_code;
  }
  started_ = false;
  MPI_Allreduce(MPI_IN_PLACE, &exit_code, 1, MPI_INT, MPI_MAX, MPI_COMM_WORLD);
  return PetscFinalize() == 0 ? exit_code : kExitFailure;
}

}  // namespace inceres::tools
