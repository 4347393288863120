#include "tools/sim/option_range.h"

namespace inceres::internal {

std::string ShortNumber(double value) {
  std::string text = std::to_string(value);
  const std::size_t last = text.find_last_not_of('0');
  return text.find('.') == std::string::npos ? text
                                             : text.substr(0, text[last] == '.' ? last : last + 1);
}

}  // namespace inceres::internal
