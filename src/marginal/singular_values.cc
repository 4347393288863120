#include "marginal/singular_values.h"

template class Eigen::BDCSVD<Eigen::MatrixXd>;
