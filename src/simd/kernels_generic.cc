#define INCERES_KERNEL_NAMESPACE kernels_generic
#define INCERES_KERNEL_NAME "generic"
#define INCERES_VECTOR_WIDTH 2
#define INCERES_MAX_COLUMNS 4
#define INCERES_MAX_QUADS 1
#include "simd/kernels_body.inc"
