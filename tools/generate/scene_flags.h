#pragma once

#include <cstdint>
#include <string>

#include "inceres/status.h"
#include "tools/sim/city_scene.h"
#include "tools/sim/collection_scene.h"
#include "tools/sim/street_scene.h"

namespace inceres::tools {

// The flags of bal_generate that describe the scene. Sizes come from the preset, then from what was
// given on the command line; derived ones follow. kInvalidArgument names a flag that is not for
// this kind of scene, or the field that is out of range.

Status ReadStreet(StreetSceneOptions* options);
Status ReadCity(CityOptions* options);
Status ReadCollection(CollectionOptions* options);

/// Two flags that say the same are kInvalidArgument.
Status CheckSceneFlags();

const std::string& ScenePreset();  ///< --preset
std::uint64_t SceneSeed();         ///< --seed

}  // namespace inceres::tools
