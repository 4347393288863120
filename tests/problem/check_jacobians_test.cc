// CheckJacobians: right families pass, a planted mistake is found and named, failures have a
// status.
#include "inceres/problem/check_jacobians.h"

#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/problem/ambient_family.h"
#include "problem/ridders.h"

namespace inceres {
namespace {

// f = (x₀ exp(x₁), sin(x₀) + x₁² / scale), with an error of choice in one entry.
class CurvedFamily final : public AmbientFamily<CurvedFamily> {
 public:
  using Measurement = double;  // what is added to ∂f₁/∂x₀
  explicit CurvedFamily(double scale = 1.0) : AmbientFamily(2, {{2, 2}}), scale_(scale) {}
  void Add(double mistake) { mistakes_.push_back(mistake); }
  int size() const override { return static_cast<int>(mistakes_.size()); }
  const char* Name() const override { return "curved"; }
  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    const double* x = parameters[0];
    if (x[0] < 0.0) {
      return false;
    }
    residuals[0] = x[0] * std::exp(x[1]);
    residuals[1] = std::sin(x[0]) + x[1] * x[1] / scale_;
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      jacobians[0][0] = std::exp(x[1]);
      jacobians[0][1] = x[0] * std::exp(x[1]);
      jacobians[0][2] = std::cos(x[0]) + mistakes_[static_cast<std::size_t>(i)];
      jacobians[0][3] = 2.0 * x[1] / scale_;
    }
    return true;
  }

 private:
  double scale_;
  std::vector<double> mistakes_;
};

// The rotated direction R(q) e_x; its ambient Jacobian is that of unit quaternions, so it is right
// along the manifold only.
class DirectionFamily final : public AmbientFamily<DirectionFamily> {
 public:
  DirectionFamily() : AmbientFamily(3, {{4, 3}}) {}
  int size() const override { return 1; }
  const char* Name() const override { return "direction"; }
  bool EvaluateOne(int, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    const double x = parameters[0][0], y = parameters[0][1], z = parameters[0][2],
                 w = parameters[0][3];
    residuals[0] = 1.0 - 2.0 * (y * y + z * z);
    residuals[1] = 2.0 * (x * y + w * z);
    residuals[2] = 2.0 * (x * z - w * y);
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      const double J[12] = {0.0,     -4.0 * y, -4.0 * z, 0.0,      2.0 * y, 2.0 * x,
                            2.0 * w, 2.0 * z,  2.0 * z,  -2.0 * w, 2.0 * x, -2.0 * y};
      std::copy_n(J, 12, jacobians[0]);
    }
    return true;
  }
};

// Does not depend on its variable, and tells which kind of map it was given.
class KindFamily final : public FactorFamily {
 public:
  explicit KindFamily(int tangent_size) : FactorFamily(1, {{3, tangent_size}}) {}
  int size() const override { return 1; }
  const char* Name() const override { return "kind"; }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override {
    batch.residuals[0] = 1.0;
    if (batch.tangent_maps != nullptr) {
      map_ = *batch.tangent_maps[0];
    }
    return {};
  }
  const TangentMap& map() const { return map_; }

 private:
  mutable TangentMap map_;
};

class CheckJacobiansOfAGraph : public testing::Test {
 protected:
  // Factors at (1, 0.5), (2, 0.5), …; the third of them has the mistake.
  void Build(double mistake, double first = 1.0) {
    family_ = graph_.AddFamily(std::make_shared<CurvedFamily>());
    for (int i = 0; i < 5; ++i) {
      const double start[] = {first + i, 0.5};
      const VariableId x = graph_.AddVariable(start, 2, Role::kFrame);
      family_->Add(i == 2 ? mistake : 0.0);
      graph_.Connect(family_, &x);
    }
  }

  FactorGraph graph_;
  FamilyHandle<CurvedFamily> family_;
};

TEST_F(CheckJacobiansOfAGraph, PassesARightFamily) {
  Build(0.0);
  const JacobianReport report = CheckJacobians(graph_, family_);
  EXPECT_TRUE(report.ok()) << report.ToString();
  EXPECT_EQ(report.num_factors, 5);
  EXPECT_EQ(report.num_entries, 20);
  EXPECT_EQ(report.num_uncertain, 0);
  EXPECT_LT(report.worst.relative_error, 1e-9);
  EXPECT_GE(report.worst.factor, 0);
}

TEST_F(CheckJacobiansOfAGraph, NamesTheWorstEntry) {
  Build(1e-3);
  const JacobianReport report = CheckJacobians(graph_, family_);
  EXPECT_FALSE(report.ok());
  EXPECT_TRUE(report.status.ok());
  EXPECT_EQ(report.num_wrong, 1);
  EXPECT_EQ(report.worst.family, family_.id);
  EXPECT_EQ(report.worst.factor, 2);
  EXPECT_EQ(report.worst.slot, 0);
  EXPECT_EQ(report.worst.row, 1);
  EXPECT_EQ(report.worst.column, 0);
  EXPECT_NEAR(report.worst.numeric, std::cos(3.0), 1e-9);
  EXPECT_NEAR(report.worst.analytic, std::cos(3.0) + 1e-3, 1e-12);
  EXPECT_NE(report.ToString().find("factor 2 of curved (variables 2), slot 0, row 1, column 0"),
            std::string::npos)
      << report.ToString();
}

TEST_F(CheckJacobiansOfAGraph, LooksAtAsManyFactorsAsAsked) {
  Build(1.0);
  JacobianCheckOptions options;
  options.max_factors = 2;  // 0 and 3
  EXPECT_EQ(CheckJacobians(graph_, family_, options).num_factors, 2);
  EXPECT_TRUE(CheckJacobians(graph_, family_, options).ok());
}

// Held constant, a variable is checked all the same: its factor is as wrong as before.
TEST_F(CheckJacobiansOfAGraph, LooksAtConstantsToo) {
  Build(1e-3);
  graph_.SetConstant(2, true);
  EXPECT_EQ(CheckJacobians(graph_, family_).worst.factor, 2);
  EXPECT_EQ(CheckJacobians(graph_).worst.factor, 2);
}

// A constant may have another tangent space than its slot: then there is nothing to compare.
TEST(CheckJacobiansOfConstants, LeavesOutWhatTheSlotHasNoTangentSpaceFor) {
  FactorGraph graph;
  const FamilyHandle<DirectionFamily> family = graph.AddFamily(std::make_shared<DirectionFamily>());
  const double q[] = {0.0, 0.0, 0.0, 1.0};
  const VariableId x = graph.AddVariable(q, 4, Role::kFrame);  // without a manifold
  graph.SetConstant(x, true);
  graph.Connect(family, &x);
  ASSERT_TRUE(graph.Validate().ok());
  const JacobianReport report = CheckJacobians(graph);
  EXPECT_TRUE(report.ok()) << report.ToString();
  EXPECT_EQ(report.num_entries, 0);
}

TEST_F(CheckJacobiansOfAGraph, TakesAllFactorsByTheLargestNumber) {
  Build(0.0);
  JacobianCheckOptions options;
  options.max_factors = std::numeric_limits<int>::max();
  EXPECT_EQ(CheckJacobians(graph_, family_, options).num_factors, 5);
}

TEST_F(CheckJacobiansOfAGraph, SaysWhatCannotBeEvaluated) {
  Build(0.0, -2.0);
  const JacobianReport report = CheckJacobians(graph_, family_);
  EXPECT_EQ(report.status.code, StatusCode::kEvaluationFailed);
  EXPECT_NE(report.status.message.find("factor 0 of curved"), std::string::npos)
      << report.status.message;
  EXPECT_FALSE(report.ok());
}

// At x₀ = 1e-4 the first step would leave the domain of the function.
TEST_F(CheckJacobiansOfAGraph, TakesSmallerStepsBesideTheEdgeOfTheDomain) {
  Build(0.0, 1e-4);
  const JacobianReport report = CheckJacobians(graph_, family_);
  EXPECT_TRUE(report.ok()) << report.ToString();
}

TEST_F(CheckJacobiansOfAGraph, RefusesWhatIsNotThere) {
  Build(0.0);
  EXPECT_EQ(CheckJacobians(graph_, 7).status.code, StatusCode::kInvalidArgument);
  JacobianCheckOptions options;
  options.tolerance = 0.0;
  const Status status = CheckJacobians(graph_, options).status;
  EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
  EXPECT_NE(status.message.find("JacobianCheckOptions::tolerance"), std::string::npos);
  options = {};
  options.max_factors = 0;
  EXPECT_FALSE(options.Validate().ok());
  options = {};
  options.relative_step = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(options.Validate().ok());
}

TEST(CheckJacobiansOfAFactor, WorksOnTheTangentSpace) {
  const DirectionFamily family;
  const double q[] = {0.5, -0.1, 0.3, std::sqrt(1.0 - 0.25 - 0.01 - 0.09)};
  for (const Manifold* manifold :
       std::vector<const Manifold*>{new EigenQuaternionManifold, new RotationQuaternionManifold}) {
    const JacobianReport report = CheckJacobians(family, 0, {q}, {manifold});
    EXPECT_TRUE(report.ok()) << report.ToString();
    EXPECT_EQ(report.num_entries, 9);
    delete manifold;
  }
}

// Families go by the kind, and so solvers' kind it has to be.
TEST(CheckJacobiansOfAFactor, TellsWhichKindOfMapItIs) {
  const auto kind_on = [](const Manifold& manifold) {
    const KindFamily family(manifold.TangentSize());
    const double x[] = {0.5, -0.1, 0.3};
    EXPECT_TRUE(CheckJacobians(family, 0, {x}, {&manifold}).ok());
    return family.map().kind;
  };
  EXPECT_EQ(kind_on(EuclideanManifold(3)), TangentMap::Kind::kIdentity);
  EXPECT_EQ(kind_on(SubsetManifold(3, {1})), TangentMap::Kind::kSelection);
  EXPECT_EQ(kind_on(SphereManifold(3)), TangentMap::Kind::kDense);
}

TEST(CheckJacobiansOfAFactor, RefusesWrongSizes) {
  const DirectionFamily family;
  const double q[] = {0.0, 0.0, 0.0, 1.0};
  EXPECT_EQ(CheckJacobians(family, 1, {q}).status.code, StatusCode::kInvalidArgument);
  EXPECT_EQ(CheckJacobians(family, 0, {}).status.code, StatusCode::kInvalidArgument);
  EXPECT_EQ(CheckJacobians(family, 0, {nullptr}).status.code, StatusCode::kInvalidArgument);
  // Euclidean, it would have four columns.
  EXPECT_EQ(CheckJacobians(family, 0, {q}).status.code, StatusCode::kInvalidArgument);
}

// Where rounding leaves the derivative uncertain nothing is called wrong.
TEST(CheckJacobiansOfAFactor, IsNotFooledByRounding) {
  CurvedFamily family(1e-14);  // the second row has values of 1e14 beside sines
  family.Add(0.0);
  const double x[] = {1.0, 1.0};
  const JacobianReport report = CheckJacobians(family, 0, {x});
  EXPECT_TRUE(report.ok()) << report.ToString();
}

TEST(Ridders, ErrorsAreEstimated) {
  internal::NumericDerivative derivative;
  const auto evaluate = [](double t, double* f) {
    f[0] = std::exp(3.0 * t);
    f[1] = 7.0;
    f[2] = std::fabs(t);
    return true;
  };
  ASSERT_TRUE(internal::DifferentiateByRidders(0.1, 3, evaluate, &derivative));
  EXPECT_NEAR(derivative.value[0], 3.0, 1e-11);
  EXPECT_LE(std::fabs(derivative.value[0] - 3.0), derivative.error[0] + 1e-13);
  EXPECT_EQ(derivative.value[1], 0.0);
  const auto never = [](double, double*) { return false; };
  EXPECT_FALSE(internal::DifferentiateByRidders(0.1, 1, never, &derivative));
}

}  // namespace
}  // namespace inceres
