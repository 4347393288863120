// Lesson 7, a sliding window: ten cameras stay, older ones leave. Marginalized, they leave behind
// what they knew; dropped, they take it with them. Both windows are held against all cameras.
//
//     07_sliding_window
#include <array>
#include <cmath>
#include <cstdio>
#include <deque>
#include <iostream>
#include <iterator>
#include <map>
#include <memory>

#include "examples/wall.h"
#include "inceres/factors/pose_prior.h"
#include "inceres/problem/graph_edit.h"
#include "inceres/solver/marginalization.h"
#include "inceres/solver/solver.h"

namespace {

enum class Leaving { kNever, kMarginalized, kDropped };

class Window {
 public:
  explicit Window(Leaving leaving) : leaving_(leaving) {
    camera_on_body_ = graph_.AddBorrowedConstant(on_body_, 7);
  }

  bool AddCamera(int i) {
    inceres::GraphEdit edit(graph_);
    const auto pose = wall::Pose(i, i < 2 ? 0.0 : 0.03);
    cameras_.push_back(edit.AddVariable(pose.data(), 7, inceres::Role::kFrame, manifold_));
    if (i < 2) {  // where it begins is known to a millimeter
      inceres::PosePriorFamily::Measurement prior;
      for (int k = 0; k < 7; ++k) {
        prior.pose[k] = pose[static_cast<std::size_t>(k)];
        prior.sqrt_information[7 * (k % 6)] = 1000.0;
      }
      edit.AddFactor(priors_, prior, {cameras_.back()});
    }
    for (int k = wall::FirstSeen(i); k < wall::EndSeen(i); ++k) {
      if (points_.count(k) == 0) {
        const auto start = wall::PointStart(k);
        points_[k] = edit.AddVariable(start.data(), 3, inceres::Role::kLandmark);
      }
      edit.AddFactor(sights_, wall::Sight(i, k), {cameras_.back(), camera_on_body_, points_[k]});
    }
    return graph_.Apply(edit).ok() && inceres::Solve({}, &graph_).IsSolutionUsable() && Slide();
  }

  int num_factors() const { return graph_.num_factors(); }
  const double* newest() const { return graph_.Values(cameras_.back()); }

 private:
  // [quoted in docs/lessons/07_sliding_window.md]
  // The oldest camera leaves, with the points it sees.
  bool Slide() {
    if (leaving_ == Leaving::kNever || cameras_.size() <= 10) {
      return true;
    }
    inceres::MarginalizationRequest request = inceres::OldestFrameRule(graph_, {cameras_.front()});
    cameras_.pop_front();
    if (leaving_ == Leaving::kDropped) {  // the same variables, but nothing is kept of them
      request.dropped.insert(request.dropped.end(), request.marginalized.begin(),
                             request.marginalized.end());
      request.marginalized.clear();
    }
    const inceres::MarginalizationSummary summary =
        inceres::Marginalize(request, inceres::MarginalizationOptions(), &graph_);
    for (auto it = points_.begin(); it != points_.end();) {
      it = graph_.HasVariable(it->second) ? std::next(it) : points_.erase(it);
    }
    return summary.status.ok();
  }
  // [end of quote]

  const double on_body_[7] = {0, 0, 0, 0, 0, 0, 1};
  Leaving leaving_;
  inceres::FactorGraph graph_;
  inceres::FamilyHandle<inceres::PointReprojectionFamily> sights_ =
      graph_.AddFamily(std::make_shared<inceres::PointReprojectionFamily>(wall::Camera()));
  inceres::FamilyHandle<inceres::PosePriorFamily> priors_ =
      graph_.AddFamily(std::make_shared<inceres::PosePriorFamily>());
  std::shared_ptr<const inceres::Manifold> manifold_ = std::make_shared<inceres::PoseManifold>();
  inceres::VariableId camera_on_body_ = -1;
  std::deque<inceres::VariableId> cameras_;
  std::map<int, inceres::VariableId> points_;
};

double Distance(const double* p, const double* q) {
  return std::hypot(p[0] - q[0], p[1] - q[1], p[2] - q[2]);
}

}  // namespace

int main() {
  Window all(Leaving::kNever), marginalized(Leaving::kMarginalized), dropped(Leaving::kDropped);
  std::printf("        factors                 newest camera, meters from where all put it\n");
  std::printf("camera  all    window           marginalized  dropped\n");
  for (int i = 0; i < 60; ++i) {
    for (Window* window : {&all, &marginalized, &dropped}) {
      if (!window->AddCamera(i)) {
        std::cerr << "camera " << i << " was not solved\n";
        return 1;
      }
    }
    if ((i + 1) % 10 == 0) {
      std::printf("%6d  %-6d %-15d  %-12.4f  %-8.4f\n", i, all.num_factors(),
                  marginalized.num_factors(), Distance(marginalized.newest(), all.newest()),
                  Distance(dropped.newest(), all.newest()));
    }
  }
  return 0;
}
