// AVX-512VL on 256-bit registers: there are 32 of them, so a 12 x 9 block of S fits whole. Dense
// factorizations have rows enough for those of 512.
#define INCERES_KERNEL_NAMESPACE kernels_avx512
#define INCERES_KERNEL_NAME "avx512"
#define INCERES_VECTOR_WIDTH 4
#define INCERES_LONG_VECTOR_WIDTH 8
#define INCERES_MAX_COLUMNS 9
#define INCERES_MAX_QUADS 3
#include "simd/kernels_body.inc"
