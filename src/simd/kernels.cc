#include "simd/kernels.h"

#include <initializer_list>

#include "simd/small_kernels.h"

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
extern const SmallKernels kSmallKernels;
}  // namespace kernels_generic
#ifdef INCERES_ARM64_KERNELS
namespace kernels_neon {
extern const Kernels kKernels;
extern const SmallKernels kSmallKernels;
}  // namespace kernels_neon
#endif
#ifdef INCERES_X86_KERNELS
namespace kernels_avx2 {
extern const Kernels kKernels;
extern const SmallKernels kSmallKernels;
}  // namespace kernels_avx2
namespace kernels_avx512 {
extern const Kernels kKernels;
extern const SmallKernels kSmallKernels;
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

const SmallKernels* SmallKernelsFor(InstructionSet set) {
  if (KernelsFor(set) == nullptr) {
    return nullptr;
  }
  switch (set) {
#ifdef INCERES_X86_KERNELS
    case InstructionSet::kAvx2:
      return &kernels_avx2::kSmallKernels;
    case InstructionSet::kAvx512:
      return &kernels_avx512::kSmallKernels;
#endif
#ifdef INCERES_ARM64_KERNELS
    case InstructionSet::kNeon:
      return &kernels_neon::kSmallKernels;
#endif
    default:
      return &kernels_generic::kSmallKernels;
  }
}

namespace {

// The one with the largest tiles first: 32 registers of four doubles, 16 of them, 32 of two.
InstructionSet BestSet() {
  for (const InstructionSet set :
       {InstructionSet::kAvx512, InstructionSet::kAvx2, InstructionSet::kNeon}) {
    if (KernelsFor(set) != nullptr) {
      return set;
    }
  }
  return InstructionSet::kGeneric;
}

}  // namespace

const Kernels& BestKernels() {
  static const Kernels& best = *KernelsFor(BestSet());
  return best;
}

const SmallKernels& BestSmallKernels() {
  static const SmallKernels& best = *SmallKernelsFor(BestSet());
  return best;
}

}  // namespace inceres::internal
