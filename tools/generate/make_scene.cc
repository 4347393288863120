#include "tools/generate/make_scene.h"

#include <cstdio>
#include <string>
#include <utility>

#include "tools/command_line/heartbeat.h"
#include "tools/command_line/output.h"
#include "tools/command_line/progress_lines.h"
#include "tools/generate/scene_flags.h"

namespace inceres::tools {
namespace {

bool StartsWith(const std::string& text, const std::string& start) {
  return text.compare(0, start.size(), start) == 0;
}

SceneProgress Printer() {
  ProgressLines lines(ProgressOutput());
  return [lines](int points, int of_points) mutable {
    if (points % 1000 == 0) {
      lines([&] {
        char text[64];
        std::snprintf(text, sizeof(text), "simulating: %.0f %% of %d points",
                      100.0 * points / of_points, of_points);
        return std::string(text);
      });
    }
  };
}

Status MakeStreet(const std::string& preset, SimulatedBal* scene) {
  StreetSceneOptions options;
  StreetScene street;
  Status status = ReadStreet(preset, &options);
  if (status.ok()) {
    const Heartbeat heartbeat(ProgressOutput(), "simulating");
    status = GenerateStreetScene(options, &street);
  }
  scene->problem = std::move(street.problem);
  scene->true_cameras = std::move(street.truth.cameras);
  scene->true_points = std::move(street.truth.points);
  scene->outliers = std::move(street.outliers);
  return status;
}

}  // namespace

Status MakeScene(const std::string& preset, SimulatedBal* scene) {
  if (Status status = CheckSceneFlags(); !status.ok()) {
    return status;
  }
  if (StartsWith(preset, "city-")) {
    CityOptions options;
    const Status status = ReadCity(preset, &options);
    return status.ok() ? GenerateCity(options, Printer(), scene) : status;
  }
  if (StartsWith(preset, "collection-")) {
    CollectionOptions options;
    const Status status = ReadCollection(preset, &options);
    return status.ok() ? GenerateCollection(options, Printer(), scene) : status;
  }
  return MakeStreet(preset, scene);
}

}  // namespace inceres::tools
