#pragma once

#include <langinfo.h>

#include <charconv>
#include <cstdio>
#include <cstring>

namespace inceres::internal {

/// A number as printf("%e") writes it, in a fifth of the time: a message may be a tenth of what a
/// small problem takes.
class Scientific {
 public:
  explicit Scientific(double value) {
    if (std::strcmp(nl_langinfo(RADIXCHAR), ".") != 0) {
      std::snprintf(text_, sizeof(text_), "%e",
                    value);  // in the words of the user's locale, as Ceres's
    } else {
      *std::to_chars(text_, text_ + sizeof(text_) - 1, value, std::chars_format::scientific, 6)
           .ptr = '\0';
    }
  }
  const char* text() const { return text_; }

 private:
  char text_[32];
};

}  // namespace inceres::internal
