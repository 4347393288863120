#pragma once

#include <string>

namespace inceres::tools {

/// The text as character data of an XML document; control characters become spaces.
std::string EscapeXml(const std::string& text);

}  // namespace inceres::tools
