#pragma once

#include <string>

#include "linearize/evaluator.h"

namespace inceres::internal {

/// "factor 7 of …": the first factor that throws when it is evaluated by itself, at the candidate,
/// then at the current point. For the message after something was thrown: factors are evaluated
/// in batches, and an exception does not say of which factor.
std::string DescribeThrower(Evaluator* evaluator);

}  // namespace inceres::internal
