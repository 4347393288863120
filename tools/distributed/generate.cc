#include "tools/distributed/generate.h"

#include "tools/distributed/agree.h"
#include "tools/sim/street_scene.h"

namespace inceres::tools {

Status GenerateTracks(MPI_Comm comm, const std::string& preset, Tracks* tracks) {
  StreetSceneOptions options;
  StreetScene scene;
  Status status = GetStreetScenePreset(preset, &options);
  status = status.ok() ? GenerateStreetScene(options, &scene) : status;
  status = Agree(comm, status);
  if (status.ok()) {
    TakeTracks(comm, scene.problem, tracks);
  }
  return status;
}

}  // namespace inceres::tools
