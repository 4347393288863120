#include "simd/kernels.h"

#include <initializer_list>

namespace inceres::internal {

namespace kernels_generic {
extern const Kernels kKernels;
}
#ifdef INCERES_ARM64_KERNELS
namespace kernels_neon {
extern const Kernels kKernels;
}
#endif
#ifdef INCERES_X86_KERNELS
namespace kernels_avx2 {
extern const Kernels kKernels;
}
namespace kernels_avx512 {
extern const Kernels kKernels;
}
#endif

const Kernels* KernelsFor(InstructionSet set) {
  switch (set) {
    case InstructionSet::kGeneric:
      return &kernels_generic::kKernels;
#ifdef INCERES_X86_KERNELS
    case InstructionSet::kAvx2:
      return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")
                 ? &kernels_avx2::kKernels
                 : nullptr;
    case InstructionSet::kAvx512:
      return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
                     __builtin_cpu_supports("avx512dq")
                 ? &kernels_avx512::kKernels
                 : nullptr;
#endif
#ifdef INCERES_ARM64_KERNELS
    case InstructionSet::kNeon:
      return &kernels_neon::kKernels;
#endif
    default:
      return nullptr;
  }
}

const Kernels& BestKernels() {
  for (const InstructionSet set :
       {InstructionSet::kAvx512, InstructionSet::kAvx2, InstructionSet::kNeon}) {
    if (const Kernels* kernels = KernelsFor(set)) {
      return *kernels;
    }
  }
  return *KernelsFor(InstructionSet::kGeneric);
}

}  // namespace inceres::internal
