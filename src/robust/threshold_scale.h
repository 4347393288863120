#pragma once

#include <vector>

#include "inceres/solver/gnc.h"

namespace inceres::internal {

/// What a chi-square threshold is to be multiplied by for measurements that came out better than
/// their information says: kTightTails times the largest ratio of a quantile of their squared
/// errors, of `degrees` residuals each, to that of the distribution, at 50, 75, 90 and 95 %. Not
/// above 1, and 1 where there are fewer than twenty. Errors of real measurements have longer tails
/// than their middle tells, which is why the quantiles go up to 95 %; a few wrong ones among them
/// do not reach any, and more of them, up to half, not the median, of whose ratio it is at most ten
/// times. Sorts the errors. Source: matching of quantiles (Huber & Ronchetti, "Robust Statistics",
/// 2009, section 5.1, has the median alone).
inline constexpr double kTightTails = 2.0;
double ThresholdScale(int degrees, std::vector<double>* squared_errors);

}  // namespace inceres::internal
