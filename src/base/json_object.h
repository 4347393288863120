#pragma once

#include <cmath>
#include <cstdint>
#include <locale>
#include <sstream>
#include <string>

namespace inceres::internal {

/// The text as JSON writes it, in quotes; control characters become spaces.
inline std::string JsonString(const std::string& value) {
  std::string text = "\"";
  for (const char c : value) {
    if (c == '"' || c == '\\') {
      text += '\\';
    }
    text += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
  }
  return text + '"';
}

/// A JSON object under construction. Numbers keep 17 digits; what JSON has no number for becomes
/// null.
class JsonObject {
 public:
  JsonObject() {
    text_.imbue(std::locale::classic());  // a decimal point, whatever the program's locale
    text_ << std::boolalpha << '{';
    text_.precision(17);
  }

  JsonObject& Add(const char* name, double value) {
    Name(name);
    if (std::isfinite(value)) {
      text_ << value;
    } else {
      text_ << "null";
    }
    return *this;
  }
  JsonObject& Add(const char* name, std::int64_t value) {
    Name(name) << value;
    return *this;
  }
  JsonObject& Add(const char* name, int value) {
    return Add(name, static_cast<std::int64_t>(value));
  }
  JsonObject& Add(const char* name, bool value) {
    Name(name) << value;
    return *this;
  }
  JsonObject& AddString(const char* name, const std::string& value) {
    Name(name) << JsonString(value);
    return *this;
  }
  JsonObject& AddRaw(const char* name, const std::string& json) {
    Name(name) << json;
    return *this;
  }
  /// An array of what to_json makes of each row.
  template <typename Rows, typename ToJson>
  JsonObject& AddArray(const char* name, const Rows& rows, ToJson&& to_json) {
    Name(name) << '[';
    const char* separator = "";
    for (const auto& row : rows) {
      text_ << separator << to_json(row);
      separator = ", ";
    }
    text_ << ']';
    return *this;
  }
  std::string Close() {
    text_ << '}';
    return text_.str();
  }

 private:
  std::ostream& Name(const char* name) {
    if (!first_) {
      text_ << ", ";
    }
    first_ = false;
    return text_ << '"' << name << "\": ";
  }

  std::ostringstream text_;
  bool first_ = true;
};

}  // namespace inceres::internal
