#pragma once

#include <cstdlib>  // which says whose library it is

#if defined(__GLIBC__)
#include <malloc.h>
#endif

namespace inceres::internal {

/// Gives what was freed back to the system where the allocator keeps it, as glibc's does between
/// blocks that are still in use. Takes milliseconds: for once a large solve.
inline void ReturnFreedMemory() {
#if defined(__GLIBC__)
  malloc_trim(0);
#endif
}

}  // namespace inceres::internal
