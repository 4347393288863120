// 128-bit NEON, which every arm64 processor has. Its 32 registers hold a tile of 3 columns by 3
// quads with the row that feeds it (4 columns would spill); the generic kernels keep to tiles for
// processors of 16.
#define INCERES_KERNEL_NAMESPACE kernels_neon
#define INCERES_KERNEL_NAME "neon"
#define INCERES_VECTOR_WIDTH 2
#define INCERES_LONG_VECTOR_WIDTH 2
#define INCERES_MAX_COLUMNS 3
#define INCERES_MAX_QUADS 3
#include "simd/kernels_body.inc"
