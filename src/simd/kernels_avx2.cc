// Sixteen registers of four doubles: a tile of 4 columns by 3 quads leaves room for what feeds it.
#define INCERES_KERNEL_NAMESPACE kernels_avx2
#define INCERES_KERNEL_NAME "avx2"
#define INCERES_VECTOR_WIDTH 4
#define INCERES_LONG_VECTOR_WIDTH 4
#define INCERES_MAX_COLUMNS 4
#define INCERES_MAX_QUADS 3
#include "simd/kernels_body.inc"
