// The next Ceres of a program linked with --wrap: the linker calls it __real_….
#include "adapters/ceres/dropin/src/ceres_symbols.h"

namespace inceres::internal {
namespace real {
#define INCERES_DECLARE_REAL(name, symbol, ...) \
  std::remove_pointer_t<decltype(NextCeres::name)> name __asm__("__real_" symbol);
INCERES_CERES_SYMBOLS(INCERES_DECLARE_REAL)
#undef INCERES_DECLARE_REAL
}  // namespace real

namespace {

NextCeres RealCeres() {
  NextCeres next;
#define INCERES_TAKE_REAL(name, symbol, ...) next.name = real::name;
  INCERES_CERES_SYMBOLS(INCERES_TAKE_REAL)
#undef INCERES_TAKE_REAL
  next.is_ours = true;  // headers and library met at link time, as in any static link
  return next;
}

}  // namespace

const NextCeres& Next() {
  static const NextCeres kNext = RealCeres();
  return kNext;
}

}  // namespace inceres::internal
