#include "tools/distributed/generate.h"

#include <utility>

#include "tools/distributed/agree.h"
#include "tools/distributed/mpi_process.h"
#include "tools/generate/make_scene.h"

namespace inceres::tools {

Status GenerateTracks(MPI_Comm comm, const std::string& preset, Tracks* tracks) {
  SimulatedBal scene;
  const Status status = Agree(comm, IsRoot(comm) ? MakeScene(preset, &scene) : Status::Ok());
  if (status.ok()) {
    TakeTracks(comm, std::move(scene.problem), tracks);
  }
  return status;
}

}  // namespace inceres::tools
