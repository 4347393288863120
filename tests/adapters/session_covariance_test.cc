// Covariances of a session's living problem.
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include <ceres/autodiff_cost_function.h>
#include <ceres/covariance.h>

#include "adapters/session_support.h"

namespace inceres::testing {
namespace {

// A planar point from another, a little curved.
struct Offset {
  template <typename T>
  bool operator()(const T* a, const T* b, T* residual) const {
    residual[0] = T(2.0) * (b[0] - a[0] - T(1.0)) + T(0.1) * a[1] * b[1];
    residual[1] = T(3.0) * (b[1] - a[1]) + T(0.2) * a[0] * b[0] / T(20.0);
    return true;
  }
};

struct Difference {
  template <typename T>
  bool operator()(const T* a, const T* b, T* residual) const {
    residual[0] = b[0] - a[0] - T(1.0);
    return true;
  }
};

// Points along a line, the first of which is held or not; each seen from the one before and from
// the one before that.
struct Line {
  explicit Line(int size) {
    for (int i = 0; i < size; ++i) {
      points.push_back({0.9 * i, 0.1});
    }
    for (std::size_t i = 1; i < points.size(); ++i) {
      Add(i - 1, i);
      if (i > 1) {
        Add(i - 2, i);
      }
    }
    problem.SetParameterBlockConstant(points[0].data());
  }
  void Add(std::size_t a, std::size_t b) {
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Offset, 2, 2, 2>(new Offset), nullptr,
                             points[a].data(), points[b].data());
  }
  std::vector<std::array<double, 2>> points;
  ceres::Problem problem;
};

TEST(SessionCovariance, IsThatOfCeres) {
  Line line(12);
  Session session;
  session.Solve(&line.problem);
  ASSERT_EQ(session.summary.termination_type, ceres::CONVERGENCE);
  const double* a = line.points[4].data();
  const double* b = line.points[11].data();
  ceres::Covariance stock{ceres::Covariance::Options()};
  ASSERT_TRUE(stock.Compute({{a, a}, {a, b}, {b, b}}, &line.problem));
  double expected[16];
  ASSERT_TRUE(stock.GetCovarianceMatrix({a, b}, expected));
  for (const CovarianceAccuracy accuracy :
       {CovarianceAccuracy::kUndamped, CovarianceAccuracy::kExact}) {
    LiveCovarianceOptions options;
    options.accuracy = accuracy;
    LiveCovariance covariance;
    const Status status = session.session.Covariance({a, b}, options, &covariance);
    ASSERT_TRUE(status.ok()) << status.message;
    ASSERT_EQ(covariance.size(), 4);
    // Jacobians of the solve may be a little older than those of now.
    const double tolerance = accuracy == CovarianceAccuracy::kExact ? 1e-9 : 1e-4;
    for (int i = 0; i < 4; ++i) {
      for (int j = 0; j < 4; ++j) {
        EXPECT_NEAR(covariance(i, j), expected[4 * i + j],
                    tolerance * std::sqrt(expected[5 * i] * expected[5 * j]));
      }
    }
  }
  LiveCovariance covariance;
  ASSERT_TRUE(session.session.Covariance({line.points[0].data(), b}, {}, &covariance).ok());
  EXPECT_EQ(covariance(0, 0), 0.0);
  EXPECT_GT(covariance(2, 2), 0.0);
}

TEST(SessionCovariance, FollowsTheProblem) {
  Tug tug;
  LiveCovariance covariance;
  ASSERT_TRUE(tug.session.session.Covariance({&tug.x}, {}, &covariance).ok());
  EXPECT_NEAR(covariance(0, 0), 0.2, 1e-12);
  tug.problem.RemoveResidualBlock(tug.first);
  tug.Solve();
  ASSERT_TRUE(tug.session.session.Covariance({&tug.x}, {}, &covariance).ok());
  EXPECT_NEAR(covariance(0, 0), 0.25, 1e-12);
}

// Where others have solved since, or nobody, values may be where the session has left them, and the
// problem is another one.
TEST(SessionCovariance, IsOfTheLastSolveOrNone) {
  Tug tug;
  LiveCovariance covariance;
  const auto expect_none = [&](const char* why) {
    const Status status = tug.session.session.Covariance({&tug.x}, {}, &covariance);
    EXPECT_EQ(status.code, StatusCode::kInvalidArgument) << why;
    EXPECT_NE(status.message.find(why), std::string::npos) << status.message;
  };
  Pull c(3.0, 10.0);
  tug.problem.AddResidualBlock(&c, nullptr, &tug.x);
  ceres::Solver::Options options;
  options.minimizer_type = ceres::LINE_SEARCH;
  options.max_num_iterations = 0;
  options.logging_type = ceres::SILENT;
  const double before = tug.x;
  tug.session.session.Solve(options, &tug.problem, &tug.session.summary, {}, &tug.session.report);
  ASSERT_TRUE(tug.session.report.used_stock);
  ASSERT_EQ(tug.x, before);
  expect_none("stock Ceres");
  tug.session.Solve(&tug.problem, options);
  ASSERT_EQ(tug.session.summary.termination_type, ceres::FAILURE);
  expect_none("refused");
  tug.Solve();
  ASSERT_TRUE(tug.session.session.Covariance({&tug.x}, {}, &covariance).ok());
  EXPECT_NEAR(covariance(0, 0), 1.0 / 105.0, 1e-12);
  tug.problem.SetParameterBlockConstant(&tug.x);
  tug.Solve();
  expect_none("nothing to solve for");
}

TEST(SessionCovariance, NamesWhatIsWrong) {
  Session fresh;
  LiveCovariance covariance;
  const double other = 0.0;
  EXPECT_EQ(fresh.session.Covariance({&other}, {}, &covariance).code, StatusCode::kInvalidArgument);
  Tug tug;
  EXPECT_NE(tug.session.session.Covariance({&other}, {}, &covariance).message.find("last solve"),
            std::string::npos);
  EXPECT_EQ(tug.session.session.Covariance({&tug.x, &tug.x}, {}, &covariance).code,
            StatusCode::kInvalidArgument);
  tug.x += 1.0;
  EXPECT_NE(tug.session.session.Covariance({&tug.x}, {}, &covariance).message.find("moved"),
            std::string::npos);
  EXPECT_EQ(covariance.size(), 0);
  tug.Solve();
  EXPECT_TRUE(tug.session.session.Covariance({&tug.x}, {}, &covariance).ok());
  tug.session.session.Reset();
  EXPECT_EQ(tug.session.session.Covariance({&tug.x}, {}, &covariance).code,
            StatusCode::kInvalidArgument);
}

TEST(SessionCovariance, AFreeGaugeIsAStatus) {
  Session session;
  ceres::Problem plain;
  std::array<std::array<double, 1>, 3> x = {};
  for (std::size_t i = 0; i < 2; ++i) {
    plain.AddResidualBlock(new ceres::AutoDiffCostFunction<Difference, 1, 1, 1>(new Difference),
                           nullptr, x[i].data(), x[i + 1].data());
  }
  session.Solve(&plain);
  LiveCovariance covariance;
  EXPECT_EQ(session.session.Covariance({x[1].data()}, {}, &covariance).code, StatusCode::kSingular);
}

}  // namespace
}  // namespace inceres::testing
