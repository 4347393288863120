#pragma once

#include <string>
#include <vector>

#include "inceres/status.h"

namespace inceres::internal {

/// The names of presets, which have a `name` each, in their order.
template <typename Presets>
std::vector<std::string> PresetNames(const Presets& presets) {
  std::vector<std::string> names;
  for (const auto& preset : presets) {
    names.emplace_back(preset.name);
  }
  return names;
}

/// Points *found at the preset of that name; kInvalidArgument names those that there are, and
/// `others`, which begins with a comma if there is any.
template <typename Presets, typename Preset>
Status FindPreset(const Presets& presets, const std::string& name, const Preset** found,
                  const char* others = "") {
  std::string known;
  for (const Preset& preset : presets) {
    if (name == preset.name) {
      *found = &preset;
      return Status::Ok();
    }
    known += std::string(known.empty() ? "" : ", ") + preset.name;
  }
  return Status::Error(StatusCode::kInvalidArgument,
                       "no preset '" + name + "'; known are " + known + others);
}

}  // namespace inceres::internal
