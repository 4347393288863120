#pragma once

namespace inceres::tools {

/// Keeps stock Ceres's sparse factorizations on one thread where one is asked for. As Debian
/// packages it, CHOLMOD starts four OpenMP threads whatever num_threads says, which on two cores
/// makes it several times slower: no comparison of one thread with one thread. Whoever sets
/// OMP_MAX_ACTIVE_LEVELS has decided; with more threads nothing is changed. Of this process, before
/// the first solve.
void KeepStockOnItsThreads(int num_threads);

}  // namespace inceres::tools
