#include "adapters/incremental_window.h"

#include <algorithm>
#include <cmath>

namespace inceres::testing {
namespace {

constexpr double kStride = 0.4;

// Deterministic noise in [−1, 1] for measurement k.
double Noise(int k) {
  return std::sin(12.9898 * k + 0.5) * std::cos(78.233 * k);
}

std::vector<double> TrueFrame(int k) {
  return {kStride * k, 0.3 * std::sin(0.2 * k), 0.1 * std::cos(0.3 * k)};
}

std::vector<double> TrueLandmark(int l) {
  return {1.0 + 0.35 * l, 2.0 * std::sin(2.3 * l)};
}

template <typename T>
void ToFrame(const T* frame, const T* landmark, T* c) {
  const T x = landmark[0] - frame[0];
  const T y = landmark[1] - frame[1];
  c[0] = cos(frame[2]) * x + sin(frame[2]) * y;
  c[1] = -sin(frame[2]) * x + cos(frame[2]) * y;
}

struct SightingCost {
  template <typename T>
  bool operator()(const T* frame, const T* landmark, T* residual) const {
    T c[2];
    ToFrame(frame, landmark, c);
    residual[0] = c[0] / (3.0 + c[0]) - u;
    residual[1] = c[1] / (3.0 + c[0]) - v;
    return true;
  }
  double u, v;
};

struct OdometryCost {
  template <typename T>
  bool operator()(const T* a, const T* b, T* residual) const {
    T c[2];
    ToFrame(a, b, c);
    residual[0] = 10.0 * (c[0] - x);
    residual[1] = 10.0 * (c[1] - y);
    residual[2] = 20.0 * (b[2] - a[2] - turn);
    return true;
  }
  double x, y, turn;
};

struct PriorCost {
  template <typename T>
  bool operator()(const T* frame, T* residual) const {
    for (int i = 0; i < 3; ++i) {
      residual[i] = 3.0 * (frame[i] - mean[i]);
    }
    return true;
  }
  double mean[3];
};

ceres::Problem::Options ProblemOptions() {
  ceres::Problem::Options options;
  options.enable_fast_removal = true;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  return options;
}

}  // namespace

IncrementalWindow::IncrementalWindow()
    : memory_(3 * kMaxFrames + 2 * kNumLandmarks), problem_(ProblemOptions()) {
  for (int k = kMaxFrames - 1; k >= 0; --k) {
    frame_room_.push_back(memory_.data() + 3 * k);
  }
  for (int l = kNumLandmarks - 1; l >= 0; --l) {
    landmark_room_.push_back(memory_.data() + 3 * kMaxFrames + 2 * l);
  }
}

double* IncrementalWindow::TakeRoom(std::vector<double*>* pool) {
  double* room = pool->back();
  pool->pop_back();
  return room;
}

void IncrementalWindow::Step() {
  if (static_cast<int>(frames_.size()) == kMaxFrames) {
    RemoveOldestFrame();
  }
  AddFrame();
}

void IncrementalWindow::AddFrame() {
  const int k = next_frame_++;
  const std::vector<double> truth = TrueFrame(k);
  double* frame = TakeRoom(&frame_room_);
  for (int i = 0; i < 3; ++i) {
    frame[i] = truth[static_cast<std::size_t>(i)] + 0.02 * Noise(7 * k + i);
  }
  problem_.AddParameterBlock(frame, 3);
  if (!frames_.empty()) {
    const std::vector<double> before = TrueFrame(k - 1);
    double c[2];
    ToFrame(before.data(), truth.data(), c);
    problem_.AddResidualBlock(
        new ceres::AutoDiffCostFunction<OdometryCost, 3, 3, 3>(
            new OdometryCost{c[0] + 0.01 * Noise(1000 + k), c[1] + 0.01 * Noise(2000 + k),
                             truth[2] - before[2] + 0.01 * Noise(3000 + k)}),
        nullptr, frames_.rbegin()->second, frame);
  } else {
    frames_[k] = frame;
    AddPrior(k);
  }
  frames_[k] = frame;
  for (int l = 0; l < kNumLandmarks; ++l) {
    const std::vector<double> landmark = TrueLandmark(l);
    double c[2];
    ToFrame(truth.data(), landmark.data(), c);
    if (c[0] > 0.0 && c[0] < 3.0) {
      const int n = 100 * k + l;
      const double outlier = n % 41 == 0 ? 0.3 : 0.0;
      See(k, l, c[0] / (3.0 + c[0]) + 0.005 * Noise(5000 + n) + outlier,
          c[1] / (3.0 + c[0]) + 0.005 * Noise(9000 + n));
    }
  }
}

void IncrementalWindow::AddPrior(int k) {
  const std::vector<double> truth = TrueFrame(k);
  problem_.AddResidualBlock(new ceres::AutoDiffCostFunction<PriorCost, 3, 3>(new PriorCost{
                                {truth[0] + 0.01, truth[1] - 0.01, truth[2] + 0.002}}),
                            nullptr, frames_[k]);
}

// A landmark enters the problem with its second sighting.
void IncrementalWindow::See(int frame, int landmark, double u, double v) {
  std::vector<Sighting>& sightings = sightings_[landmark];
  sightings.push_back({frame, u, v});
  double*& room = landmarks_[landmark];
  const auto add = [&](const Sighting& sighting) {
    problem_.AddResidualBlock(new ceres::AutoDiffCostFunction<SightingCost, 2, 3, 2>(
                                  new SightingCost{sighting.u, sighting.v}),
                              &loss_, frames_[sighting.frame], room);
  };
  if (sightings.size() < 2) {
    landmarks_.erase(landmark);
  } else if (room == nullptr) {
    room = TakeRoom(&landmark_room_);
    const std::vector<double> truth = TrueLandmark(landmark);
    room[0] = truth[0] + 0.05 * Noise(11 * landmark);
    room[1] = truth[1] + 0.05 * Noise(11 * landmark + 1);
    for (const Sighting& sighting : sightings) {
      add(sighting);
    }
  } else {
    add(sightings.back());
  }
}

void IncrementalWindow::RemoveOldestFrame() {
  const auto [k, frame] = *frames_.begin();
  frames_.erase(frames_.begin());
  problem_.RemoveParameterBlock(frame);
  frame_room_.push_back(frame);
  for (auto it = sightings_.begin(); it != sightings_.end();) {
    std::vector<Sighting>& sightings = it->second;
    sightings.erase(
        std::remove_if(sightings.begin(), sightings.end(),
                       [oldest = k](const Sighting& sighting) { return sighting.frame == oldest; }),
        sightings.end());
    const auto landmark = landmarks_.find(it->first);
    if (sightings.empty() && landmark != landmarks_.end()) {
      problem_.RemoveParameterBlock(landmark->second);
      landmark_room_.push_back(landmark->second);
      landmarks_.erase(landmark);
    }
    it = sightings.empty() ? sightings_.erase(it) : std::next(it);
  }
  AddPrior(frames_.begin()->first);
}

void IncrementalWindow::SetFrozen(bool frozen) {
  const auto set = [&](double* block, bool constant) {
    constant ? problem_.SetParameterBlockConstant(block)
             : problem_.SetParameterBlockVariable(block);
  };
  for (const auto& [l, landmark] : landmarks_) {
    set(landmark, frozen);
  }
  for (const auto& [k, frame] : frames_) {
    set(frame, (frozen && k != next_frame_ - 1) || k == 0);
  }
}

void IncrementalWindow::Nudge(double by) {
  frames_.rbegin()->second[1] += by;
  landmarks_.begin()->second[0] -= by;
}

ceres::ParameterBlockOrdering* IncrementalWindow::LandmarksFirst() const {
  auto* ordering = new ceres::ParameterBlockOrdering;
  for (const auto& [l, landmark] : landmarks_) {
    ordering->AddElementToGroup(landmark, 0);
  }
  for (const auto& [k, frame] : frames_) {
    ordering->AddElementToGroup(frame, 1);
  }
  return ordering;
}

double IncrementalWindow::Cost() {
  double cost = -1.0;
  problem_.Evaluate(ceres::Problem::EvaluateOptions(), &cost, nullptr, nullptr, nullptr);
  return cost;
}

std::vector<double> IncrementalWindow::Values() const {
  std::vector<double> values;
  for (const auto& [k, frame] : frames_) {
    values.insert(values.end(), frame, frame + 3);
  }
  for (const auto& [l, landmark] : landmarks_) {
    values.insert(values.end(), landmark, landmark + 2);
  }
  return values;
}

void IncrementalWindow::SetValues(const std::vector<double>& values) {
  auto next = values.begin();
  for (const auto& [k, frame] : frames_) {
    std::copy_n(next, 3, frame);
    next += 3;
  }
  for (const auto& [l, landmark] : landmarks_) {
    std::copy_n(next, 2, landmark);
    next += 2;
  }
}

}  // namespace inceres::testing
