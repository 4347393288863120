#pragma once

#include <string>

namespace inceres::tools {

/// Appends text formatted as by printf, at most 511 bytes.
[[gnu::format(printf, 2, 3)]] void AppendFormat(std::string* svg, const char* format, ...);

/// The text as character data of an XML document; control characters become spaces.
std::string EscapeXml(const std::string& text);

}  // namespace inceres::tools
