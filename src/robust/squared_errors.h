#pragma once

#include <functional>
#include <string>
#include <vector>

#include "inceres/problem/factor_graph.h"
#include "inceres/solver/gnc.h"
#include "inceres/status.h"

namespace inceres::internal {

using GncValues = std::function<const double*(VariableId)>;

/// ‖f‖² of these factors, which must be there, before any loss, at the given values: errors[k] is
/// of factors[k]. A factor that cannot be evaluated is a failure that names it. Cost: a residual
/// each.
Status SquaredErrors(const FactorGraph& graph, const std::vector<FactorId>& factors,
                     const GncValues& values, std::vector<double>* errors);

/// c² of a factor of this family: the error that an inlier stays below with the probability asked
/// for, by the chi-square distribution of as many degrees of freedom as the residual has rows,
/// times the scale of the options.
double ThresholdOf(const GncOptions& options, const FactorFamily& family);

/// By the error and not by the weight, which after the last round may still be on its way.
void AddVerdict(FactorId factor, double squared_error, double threshold, double weight,
                GncSummary* summary);

/// That the factors are there and each is named once.
Status CheckSuspects(const FactorGraph& graph, const std::vector<FactorId>& factors);

/// "relative pose 17": what messages call a factor.
std::string NameOfSuspect(const FactorGraph& graph, FactorId factor);

}  // namespace inceres::internal
