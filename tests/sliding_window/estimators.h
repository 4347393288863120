#pragma once

#include <functional>
#include <memory>

#include <ceres/ceres.h>

#include "common/run.h"
#include "okvis/okvis_estimator.h"
#include "vins/vins_estimator.h"

namespace sliding_window {

/// What both estimators have in common, for tests that play both.
struct AnyEstimator {
  std::function<void(const Frame&)> add_frame;
  std::function<ImuState()> newest_state;
  std::function<std::vector<double>()> values;
  std::function<void(const std::vector<double>&)> set_values;
};

template <typename Estimator>
AnyEstimator Wrap(std::shared_ptr<Estimator> estimator) {
  return {[estimator](const Frame& frame) { estimator->AddFrame(frame); },
          [estimator] { return estimator->newest_state(); },
          [estimator] { return estimator->Values(); },
          [estimator](const std::vector<double>& values) { estimator->SetValues(values); }};
}

using MakeAny =
    std::function<AnyEstimator(const EstimatorOptions&, const SolveFunction&, const ImuState& start,
                               const std::vector<Pose>& body_from_cameras)>;

inline AnyEstimator MakeVins(const EstimatorOptions& options, const SolveFunction& solve,
                             const ImuState& start, const std::vector<Pose>& body_from_cameras) {
  return Wrap(
      std::make_shared<VinsEstimator>(options, 400, solve, start, body_from_cameras.front()));
}

inline MakeAny MakeOkvis(bool newest_first) {
  return [newest_first](const EstimatorOptions& options, const SolveFunction& solve,
                        const ImuState& start, const std::vector<Pose>& body_from_cameras) {
    OkvisOptions okvis_options;
    okvis_options.newest_first = newest_first;
    return Wrap(
        std::make_shared<OkvisEstimator>(options, okvis_options, solve, start, body_from_cameras));
  };
}

inline void SolveWithStock(const ceres::Solver::Options& options, ceres::Problem* problem,
                           ceres::Solver::Summary* summary) {
  ceres::Solve(options, problem, summary);
}

}  // namespace sliding_window
