#pragma once

#include <cstdint>
#include <string>

#include "inceres/status.h"
#include "tools/sim/city_scene.h"
#include "tools/sim/collection_scene.h"
#include "tools/sim/street_scene.h"

namespace inceres::tools {

// The flags that describe the scene of bal_generate, and of what else simulates one. Sizes come
// from the preset of this name (none: "", a street), then from what was given on the command line;
// derived ones follow. kInvalidArgument names a flag that is not for this kind of scene, or the
// field that is out of range.

Status ReadStreet(const std::string& name, StreetSceneOptions* options);
Status ReadCity(const std::string& name, CityOptions* options);
Status ReadCollection(const std::string& name, CollectionOptions* options);

/// Two flags that say the same are kInvalidArgument.
Status CheckSceneFlags();

std::uint64_t SceneSeed();  ///< --seed
/// One of these flags that is not at its default; empty: none.
std::string FirstSceneFlagSet();

}  // namespace inceres::tools
