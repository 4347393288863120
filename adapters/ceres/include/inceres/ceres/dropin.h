#pragma once

/* What a program may ask the drop-in, in C, so that it can look for these with dlsym:
 * `libinceres_dropin.so` exports them beside the functions of Ceres that it stands in for. Threads:
 * any. */

#ifdef __cplusplus
extern "C" {
#endif

/** 1 if solves go to inceres, with INCERES_MODE `fallback` to be looked at only; 0 if every call is
 * passed through, because it is `stock` or the Ceres found is not the release compiled for. */
__attribute__((visibility("default"))) int inceres_dropin_is_active(void);

/** How many solves inceres has done so far, those handed to stock Ceres not counted. */
__attribute__((visibility("default"))) long long inceres_dropin_num_solves(void);

/** How many ceres::Problems the drop-in has seen constructed and not destroyed. */
__attribute__((visibility("default"))) int inceres_dropin_num_problems(void);

#ifdef __cplusplus
}
#endif
