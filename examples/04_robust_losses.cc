// Lesson 4, robust losses: a circle through points of which a fifth is wrong, with and without.
//
//     04_robust_losses [picture.svg]
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <memory>
#include <vector>

#include "examples/noise.h"
#include "examples/picture.h"
#include "inceres/problem/ambient_family.h"
#include "inceres/problem/losses.h"
#include "inceres/solver/solver.h"

namespace {

using Point = std::array<double, 2>;
using Circle = std::array<double, 3>;  // center, radius

// residual = ‖point − center‖ − radius, of a circle (3).
class CircleFamily : public inceres::AmbientFamily<CircleFamily> {
 public:
  using Measurement = Point;
  CircleFamily() : AmbientFamily(1, {{3, 3}}) {}

  void Add(const Point& point) { points_.push_back(point); }
  int size() const override { return static_cast<int>(points_.size()); }
  const char* Name() const override { return "circle"; }

  bool EvaluateOne(int i, const double* const* circle, double* residual, double** J) const {
    const Point& point = points_[static_cast<std::size_t>(i)];
    const double dx = point[0] - circle[0][0], dy = point[1] - circle[0][1];
    const double distance = std::hypot(dx, dy);
    residual[0] = distance - circle[0][2];
    if (J != nullptr && J[0] != nullptr) {
      const double by_circle[3] = {-dx / distance, -dy / distance, -1.0};
      std::copy_n(by_circle, 3, J[0]);
    }
    return distance > 0.0;
  }

 private:
  std::vector<Point> points_;
};

constexpr Circle kTruth = {1.0, 2.0, 5.0};
// 40 points on three quarters of the circle, 2 cm beside it, and ten far to the right of it.
std::vector<Point> Measure() {
  Noise noise(4);
  std::vector<Point> points;
  for (int i = 0; i < 40; ++i) {
    const double angle = 1.5 * M_PI * i / 40.0, radius = kTruth[2] + 0.04 * (noise.Uniform() - 0.5);
    points.push_back({kTruth[0] + radius * std::cos(angle), kTruth[1] + radius * std::sin(angle)});
  }
  for (int i = 0; i < 10; ++i) {
    points.push_back({9.0 + 3.0 * noise.Uniform(), -2.0 + 6.0 * noise.Uniform()});
  }
  return points;
}

// [quoted in docs/lessons/04_robust_losses.md]
Circle Fit(const std::vector<Point>& points, const std::shared_ptr<const inceres::Loss>& loss,
           const Circle& start) {
  inceres::FactorGraph graph;
  const auto family = graph.AddFamily(std::make_shared<CircleFamily>());
  const inceres::VariableId circle = graph.AddVariable(start.data(), 3, inceres::Role::kFrame);
  for (const Point& point : points) {
    graph.AddFactor(family, point, {circle}, loss);  // null: least squares
  }
  inceres::Solve(inceres::SolverOptions(), &graph);
  return {graph.Values(circle)[0], graph.Values(circle)[1], graph.Values(circle)[2]};
}
// [end of quote]

struct Contender {
  const char *name, *color;
  Circle circle;
};

bool Draw(const std::vector<Point>& points, const std::vector<Contender>& fits, const char* path) {
  Picture picture(path, -6.0, -6.0, 22.0, 15.0);
  double y = 8.0;
  for (const Contender& fit : fits) {
    picture.Circle(fit.circle[0], fit.circle[1], fit.circle[2], fit.color);
    picture.Text(9.5, y -= 1.0, fit.name, fit.color);
  }
  for (const Point& point : points) {
    picture.Dot(point[0], point[1], "#333");
  }
  return picture.Close();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 2 || (argc == 2 && argv[1][0] == '-')) {
    std::fprintf(stderr, "usage: 04_robust_losses [PICTURE.svg]\n");
    return 2;
  }
  const std::vector<Point> points = Measure();
  const Circle start = {3.0, 2.0, 4.0};
  // [quoted in docs/lessons/04_robust_losses.md]
  const Circle squares = Fit(points, nullptr, start);
  const Circle huber = Fit(points, std::make_shared<inceres::HuberLoss>(0.05), start);
  const Circle cauchy = Fit(points, std::make_shared<inceres::CauchyLoss>(0.05), start);
  const Circle tukey = Fit(points, std::make_shared<inceres::TukeyLoss>(0.15), cauchy);
  // [end of quote]
  const std::vector<Contender> fits = {{"least squares", "#c0392b", squares},
                                       {"Huber", "#e67e22", huber},
                                       {"Cauchy", "#2980b9", cauchy},
                                       {"Tukey, from Cauchy", "#27ae60", tukey}};
  std::printf("%zu points, 10 of them wrong; the truth is (1, 2), radius 5\n", points.size());
  std::printf("%-20s %8s %8s %8s %10s\n", "loss", "x", "y", "radius", "off by");
  for (const Contender& fit : fits) {
    const Circle& c = fit.circle;
    const double off = std::hypot(c[0] - kTruth[0], c[1] - kTruth[1], c[2] - kTruth[2]);
    std::printf("%-20s %8.3f %8.3f %8.3f %8.3f m\n", fit.name, c[0], c[1], c[2], off);
  }
  return argc < 2 || Draw(points, fits, argv[1]) ? 0 : 1;
}
