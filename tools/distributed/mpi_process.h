#pragma once

#include <mpi.h>

#include <optional>

#include "tools/command_line/help.h"

namespace inceres::tools {

/// The number of this process.
int RankOf(MPI_Comm comm);

/// Whether this is rank 0, which prints and writes.
inline bool IsRoot(MPI_Comm comm) {
  return RankOf(comm) == 0;
}

/// A tool as one process of an mpiexec: MPI and PETSc from begin to end. Words of the command line
/// with one dash, and the values behind them, go to PETSc and are taken out; what has two dashes is
/// left for the tool. Ranks but the first print nothing on standard output.
class MpiProcess {
 public:
  MpiProcess(int* argc, char*** argv);
  ~MpiProcess();
  MpiProcess(const MpiProcess&) = delete;
  MpiProcess& operator=(const MpiProcess&) = delete;

  /// False: PETSc could not be started, and has said why.
  bool started() const { return started_; }
  /// ParseCommandLine, of which only rank 0 is heard.
  std::optional<int> ParseFlags(const ToolHelp& help, int* argc, char*** argv);
  /// Ends PETSc and MPI. What main returns: the exit code, the same on all ranks.
  int End(int exit_code);

 private:
  bool started_ = false;
};

}  // namespace inceres::tools
