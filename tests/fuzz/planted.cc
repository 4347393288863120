// Which planted defect is in force in this program: the one that INCERES_PLANTED names.
#include <cstdlib>
#include <cstring>

namespace inceres::fuzz {

bool IsPlanted(const char* name);

bool IsPlanted(const char* name) {
  static const char* const planted = std::getenv("INCERES_PLANTED");
  return planted != nullptr && std::strcmp(planted, name) == 0;
}

}  // namespace inceres::fuzz
