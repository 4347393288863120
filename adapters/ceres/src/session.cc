#include "inceres/ceres/session.h"

#include <memory>
#include <string>

#include <glog/logging.h>

#include "adapters/ceres/src/decline.h"
#include "adapters/ceres/src/gate.h"
#include "adapters/ceres/src/incremental_solve.h"
#include "adapters/ceres/src/option_mapping.h"

namespace inceres {

class CeresSession::Impl {
 public:
  explicit Impl(const SessionOptions& session_options) : options(session_options) {}

  void Look(const ceres::Problem& problem) {
    if (has_view) {
      internal::IntrospectValues(problem, &view);
    } else {
      internal::Introspect(problem, &view);
    }
    has_view = true;
  }

  const SessionOptions options;
  std::unique_ptr<internal::LivingProblem> living;
  int num_threads = 0;  // of the living problem, which cannot change it
  internal::ProblemView view;
  bool has_view = false;  // of the problem's structure as it is
};

CeresSession::CeresSession(const SessionOptions& options) : impl_(std::make_unique<Impl>(options)) {
}

CeresSession::~CeresSession() = default;

void CeresSession::Solve(const ceres::Solver::Options& options, ceres::Problem* problem, ceres::Solver::Summary* summary,
                         SolveReport* report) {
  const internal::WallClock clock;
  CHECK(problem != nullptr);  // as ceres::Solve
  CHECK(summary != nullptr);
  *summary = ceres::Solver::Summary();
  internal::ClearResults(report);
  impl_->has_view = impl_->has_view && report != nullptr && report->problem_unedited;
  std::string obstacle = internal::IncrementalOptionsObstacle(options, report != nullptr ? report->evaluation_callback : nullptr);
  internal::OrderingView ordering;
  if (obstacle.empty()) {
    impl_->Look(*problem);
    ordering = internal::ReadOrdering(options, impl_->view);
    obstacle = internal::IncrementalProblemObstacle(options, impl_->view, ordering);
  }
  if (!obstacle.empty()) {
    internal::Decline(options, problem, summary, obstacle, report);
    return;
  }
  // Out of the session while it works: a failure, or an exception out of user code, ends it.
  std::unique_ptr<internal::LivingProblem> living = std::move(impl_->living);
  const IncrementalOptions core = internal::MapIncrementalOptions(options, impl_->options.core);
  if (living == nullptr || core.num_threads != impl_->num_threads) {
    const auto trust = impl_->options.verify_cached_factors ? internal::Trust::kVerified : internal::Trust::kAddresses;
    living = std::make_unique<internal::LivingProblem>(core, trust);
    impl_->num_threads = core.num_threads;
  }
  if (internal::SolveIncrementally({options, impl_->view, ordering, clock, nullptr}, core, living.get(), summary, report)) {
    impl_->living = std::move(living);
  }
}

void CeresSession::Forget(const ceres::CostFunction* cost_function) {
  if (impl_->living != nullptr) {
    impl_->living->Forget(cost_function);
  }
}

void CeresSession::Forget(const ceres::LossFunction* loss_function) {
  if (impl_->living != nullptr) {
    impl_->living->Forget(loss_function);
  }
}

void CeresSession::Reset() {
  impl_->living.reset();
}

}  // namespace inceres
