#include "simd/kernels.h"

#include <initializer_list>

namespace inceres::internal {

// The choice of an instruction set at run time. One table of kernels a set, each made of the same
// source (kernels_body.inc) by a file of its own, compiled with the options of that set. This file
// and all others of the library are compiled for any processor, so that nothing but a table's own
// functions may be called before the processor was asked.
//
// A table that was compiled may still be of no use: KernelsFor asks the processor. (Of the AVX-512
// table it does not ask for fused multiply-adds: whatever has AVX-512 has them.) The choice depends
// on the processor alone and is the same in every call; results of two sets are equal up to
// rounding only (docs/determinism.md).

namespace kernels_generic {
extern const Kernels kKernels;
}  // namespace kernels_generic
#ifdef INCERES_ARM64_KERNELS
namespace kernels_neon {
extern const Kernels kKernels;
}  // namespace kernels_neon
#endif
#ifdef INCERES_X86_KERNELS
namespace kernels_avx2 {
extern const Kernels kKernels;
}  // namespace kernels_avx2
namespace kernels_avx512 {
extern const Kernels kKernels;
}  // namespace kernels_avx512
#endif

const Kernels* KernelsFor(InstructionSet set) {
  switch (set) {
    // Baseline instructions of the target: always there.
    case InstructionSet::kGeneric:
      return &kernels_generic::kKernels;
#ifdef INCERES_X86_KERNELS
    case InstructionSet::kAvx2:
      // Two flags: fused multiply-adds are an extension apart from AVX2.
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
    // Every arm64 processor has it, so there is nothing to ask.
    case InstructionSet::kNeon:
      return &kernels_neon::kKernels;
#endif
    default:
      return nullptr;
  }
}

// The one with the largest tiles first: 32 registers of four doubles, 16 of them, 32 of two.
const Kernels& BestKernels() {
  static const Kernels& best = []() -> const Kernels& {
    for (const InstructionSet set :
         {InstructionSet::kAvx512, InstructionSet::kAvx2, InstructionSet::kNeon}) {
      if (const Kernels* kernels = KernelsFor(set)) {
        return *kernels;
      }
    }
    return kernels_generic::kKernels;
  }();
  return best;
}

}  // namespace inceres::internal
