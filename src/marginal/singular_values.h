#pragma once

#include <Eigen/Core>
#include <Eigen/SVD>

/// Singular values by divide and conquer, compiled once (singular_values.cc): the compiler takes
/// longer for them than for all else in this folder.
extern template class Eigen::BDCSVD<Eigen::MatrixXd>;
