// Registers of two doubles, which every target has (SSE2 on x86-64, and on others whatever the
// compiler makes of it). A quad is two registers, so a tile of one quad by 4 columns takes eight.
#define INCERES_KERNEL_NAMESPACE kernels_generic
#define INCERES_KERNEL_NAME "generic"
#define INCERES_VECTOR_WIDTH 2
#define INCERES_LONG_VECTOR_WIDTH 2
#define INCERES_MAX_COLUMNS 4
#define INCERES_MAX_QUADS 1
#include "simd/kernels_body.inc"
