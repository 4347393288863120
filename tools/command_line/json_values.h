#pragma once

#include <optional>

#include <nlohmann/json.hpp>

namespace inceres::tools {

/// The object with a member for each pair of a name and a value.
template <typename Pairs>
nlohmann::json JsonObject(const Pairs& pairs) {
  nlohmann::json object = nlohmann::json::object();
  for (const auto& [name, value] : pairs) {
    object[name] = value;
  }
  return object;
}

/// The number, or null where there is none.
inline nlohmann::json OrNull(const std::optional<double>& value) {
  return value.has_value() ? nlohmann::json(*value) : nlohmann::json();
}

}  // namespace inceres::tools
