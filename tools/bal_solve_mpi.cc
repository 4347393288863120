// Solves a BAL problem on all ranks of an mpiexec.

#include <mpi.h>
#include <petscsys.h>

#include <cstdio>
#include <cstdlib>
#include <exception>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <gflags/gflags.h>

#include "inceres/distributed/distributed_solver.h"
#include "tools/command_line/command_line.h"
#include "tools/command_line/json_report.h"
#include "tools/command_line/output.h"
#include "tools/command_line/read_flags.h"
#include "tools/distributed/agree.h"
#include "tools/distributed/mpi_flags.h"
#include "tools/distributed/mpi_part.h"
#include "tools/distributed/mpi_process.h"
#include "tools/distributed/mpi_report.h"
#include "tools/distributed/partition.h"
#include "tools/distributed/tracks.h"
#include "tools/generate/make_scene.h"
#include "tools/generate/scene_flags.h"

DEFINE_string(input, "",
              "The BAL file to solve: text, .gz or .bz2. Text is read by all ranks, each its share "
              "of the bytes.");
DEFINE_string(
    generate, "",
    "Solve the problem that bal_generate --preset makes of this name, instead of a file: path-N, "
    "city-N, collection-N, .... The flags of bal_generate that describe the scene, as "
    "--true_start, are those of this tool too.");
DEFINE_string(output, "", "Write the solved problem to this BAL file (.gz and .bz2 compress).");

namespace inceres::tools {
namespace {

const ToolHelp kHelp = {
    "Solve a bundle-adjustment problem in BAL format on several processes, over MPI.",
    "Started by mpiexec; alone it is one process. Flags with two dashes are this tool's, those "
    "with "
    "one are PETSc's, with their values: -inceres_ksp_type pipecg, -log_view. Rank 0 prints. "
    "Exit codes are those of all ranks.",
    {{"one process", "bal_solve_mpi --input problem-49-7776-pre.txt"},
     {"two processes, and the solved file",
      "mpiexec -n 2 bal_solve_mpi --input problem.txt --output solved.txt"},
     {"three hundred cameras in a city, by conjugate gradients",
      "bal_solve_mpi --generate city-300 --preconditioner two_level"},
     {"a solver and a preconditioner of PETSc",
      "bal_solve_mpi --input problem.txt --linear_solver ksp --form_schur_complement "
      "-inceres_ksp_type fcg -inceres_pc_type bjacobi"}}};

// What a pair of cameras of a point costs, in the cost of one observation: as much where S is
// formed; with a two-level preconditioner a tenth, counted in multiplications: a pair of a camera
// and an aggregate takes 9 x 3 x 8 in A V, an observation some 2,000 an iteration.
double WorkPerSquare(const DistributedOptions& options) {
  if (options.linear_solver == DistributedLinearSolver::kCholesky ||
      options.solver.conjugate_gradients.explicit_schur_complement) {
    return 1.0;
  }
  return options.solver.conjugate_gradients.preconditioner == PreconditionerKind::kTwoLevel ? 0.1
                                                                                            : 0.0;
}

// The problem of a preset of bal_generate, with what the flags say of it (scene_flags.h). Rank 0
// makes it, and deals it out. Collective.
Status GenerateTracks(MPI_Comm comm, const std::string& preset, Tracks* tracks) {
  SimulatedBal scene;
  const Status status = Agree(comm, IsRoot(comm) ? MakeScene(preset, &scene) : Status::Ok());
  if (status.ok()) {
    TakeTracks(comm, std::move(scene.problem), tracks);
  }
  return status;
}

// Loads the problem and deals it out.
Status Load(MPI_Comm comm, const MpiSettings& settings, Tracks* tracks, MpiReport* report) {
  if (FLAGS_input.empty() == FLAGS_generate.empty()) {
    return Invalid("one of --input FILE and --generate PRESET is required; see --help");
  }
  if (const std::string flag = FirstSceneFlagSet(); !FLAGS_input.empty() && !flag.empty()) {
    return Invalid("--" + flag + " describes what --generate makes; --input has its own");
  }
  double start = MPI_Wtime();
  const bool generates = FLAGS_input.empty();
  Status status = generates ? GenerateTracks(comm, FLAGS_generate, tracks)
                            : ReadTracks(comm, FLAGS_input, ReadOptionsFromFlags(), tracks);
  report->problem = generates ? FLAGS_generate : FLAGS_input;
  report->read_seconds = MPI_Wtime() - start;
  if (!status.ok()) {
    return status;
  }
  start = MPI_Wtime();
  status = PartitionTracks(comm, *tracks, settings.partition, WorkPerSquare(settings.options),
                           &report->partition);
  if (status.ok()) {
    MoveTracks(comm, report->partition.target, tracks);
    report->partition_seconds = MPI_Wtime() - start;
  }
  return status;
}

Status WriteOutput(MPI_Comm comm, const Tracks& tracks) {
  const BalProblem solved = GatherProblem(comm, tracks);
  return Agree(comm, IsRoot(comm) ? WriteBal(FLAGS_output, solved) : Status::Ok());
}

Status Run(MPI_Comm comm, ExitCode* code) {
  MpiSettings settings;
  Status status = ReadMpiFlags(&settings);
  if (status.ok()) {
    status = Agree(comm, IsRoot(comm) ? CheckFoldersToWrite() : Status::Ok());
  }
  if (!status.ok()) {
    return status;
  }
  MpiReport report;
  report.robust = settings.robust;
  report.num_threads = settings.options.solver.num_threads;
  Tracks tracks;
  status = Load(comm, settings, &tracks, &report);
  if (!status.ok()) {
    return status;
  }
  report.num_cameras = tracks.num_cameras();
  report.num_points = tracks.num_points;
  report.num_observations = tracks.num_observations;
  MpiPart part(tracks, settings.loss);
  if (FLAGS_output.empty()) {
    std::vector<Seen>().swap(tracks.seen);  // the graph has them
  }
  if (IsRoot(comm)) {
    settings.options.solver.progress = PrintLine;
  }
  report.summary = DistributedSolver(comm, settings.options).Solve(part.part);
  const Summary& solve = report.summary.solve;
  if (!solve.IsSolutionUsable()) {
    *code = kExitFailure;
    return Status::Error(
        StatusCode::kEvaluationFailed,
        "not solved: " + solve.message + (solve.detail.empty() ? "" : " " + solve.detail));
  }
  part.TakeSolution(comm, &tracks);
  if (!FLAGS_output.empty()) {
    status = WriteOutput(comm, tracks);
  }
  if (status.ok() && IsRoot(comm)) {
    PrintTable(report);
    status = WriteJsonReport(ToJson(report));
  }
  return Agree(comm, status);
}

int Main() {
  const MPI_Comm comm = MPI_COMM_WORLD;
  ExitCode code = kExitFailure;
  Status status;
  try {
    status = Run(comm, &code);
  } catch (const std::exception& exception) {
    // The others wait for this rank, and do not know.
    std::fprintf(stderr, "bal_solve_mpi: rank %d: %s\n", RankOf(comm), exception.what());
    MPI_Abort(comm, kExitFailure);
  }
  if (status.ok()) {
    return kExitSuccess;
  }
  if (status.code == StatusCode::kInvalidArgument) {
    code = kExitUsage;
  }
  return IsRoot(comm) ? Fail(code, status.message) : static_cast<int>(code);
}

}  // namespace
}  // namespace inceres::tools

int main(int argc, char** argv) {
  inceres::tools::MpiProcess process(&argc, &argv);
  std::optional<int> exit_code = process.started()
                                     ? process.ParseFlags(inceres::tools::kHelp, &argc, &argv)
                                     : std::optional<int>(inceres::tools::kExitFailure);
  if (!exit_code) {
    exit_code = inceres::tools::Main();
  }
  return process.End(*exit_code);
}
