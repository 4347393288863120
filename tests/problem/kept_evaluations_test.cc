// Evaluations that are kept: a cost function is called once at a point, and who comes back gets
// what it would write again.
#include "problem/kept_evaluations.h"

#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/problem/ambient_family.h"

namespace inceres {
namespace {

// Two residuals of a pose [p, q] and a point; counts its calls, and writes a bad entry if told to.
class CountingFamily final : public AmbientFamily<CountingFamily> {
 public:
  CountingFamily() : AmbientFamily(2, {{7, 6}, {3, 3}}) {}
  int size() const override { return 2; }
  const char* Name() const override { return "counting"; }
  void Prefetch(int i) const { prefetched = i; }
  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    ++num_calls;
    const double x = parameters[0][0] + std::copysign(1.0, parameters[1][2]);
    residuals[0] = x + i;
    residuals[1] = has_bad_residual ? std::nan("") : 2.0 * x;
    for (int k = 0; jacobians[0] != nullptr && k < 14; ++k) {
      jacobians[0][k] = x + k;
    }
    for (int k = 0; jacobians[1] != nullptr && k < (forgets_an_entry ? 5 : 6); ++k) {
      jacobians[1][k] = x - k;
    }
    return !returns_false;
  }

  mutable int num_calls = 0;
  mutable int prefetched = -1;
  bool has_bad_residual = false;
  bool forgets_an_entry = false;
  bool returns_false = false;
};

class KeptEvaluations : public testing::Test {
 protected:
  enum Wanted { kPose, kPoint, kBoth };

  KeptEvaluations() {
    for (std::size_t k = 0; k < 42; ++k) {
      M_[k] = k < 18 || k % 6 < 3 ? (k / 6 == k % 6 ? 1.0 : 0.0) : std::cos(static_cast<double>(k));
    }
  }

  // Of both factors; the other slot is held constant, or computed for nobody.
  EvaluationFailure Evaluate(Wanted wanted, const TangentMap& other, bool keeps = true) {
    const TangentMap* const pose = wanted == kPoint ? &other : &turning_;
    const TangentMap* const point = wanted == kPose ? &other : &identity_;
    const TangentMap* const maps[4] = {pose, point, pose, point};
    J_pose_.assign(32, -77.0);
    J_point_.assign(16, -77.0);
    const JacobianView views[2] = {{J_pose_.data(), 16, 8}, {J_point_.data(), 8, 4}};
    FactorBatch batch{0, 2, parameters_, maps, residuals_.data(), views};
    batch.kept = keeps ? &kept_ : nullptr;
    batch.next = next_;
    return family_.Evaluate(batch);
  }

  // What is written with what is kept is what is written without.
  void ExpectAsAnew(Wanted wanted, const TangentMap& other, int num_calls) {
    family_.num_calls = 0;
    ASSERT_FALSE(Evaluate(wanted, other).failed());
    EXPECT_EQ(family_.num_calls, num_calls);
    const std::vector<double> residuals = residuals_, J_pose = J_pose_, J_point = J_point_;
    ASSERT_FALSE(Evaluate(wanted, other, /*keeps=*/false).failed());
    EXPECT_EQ(residuals, residuals_);
    EXPECT_EQ(J_pose, J_pose_);
    EXPECT_EQ(J_point, J_point_);
  }

  CountingFamily family_;
  internal::KeptEvaluations kept_{family_, 2};
  int next_ = -1;
  double pose_[7] = {0.3, 0.1, -2.0, 0.5, 0.5, 0.5, 0.5};
  double points_[2][3] = {{1.0, 2.0, 0.0}, {4.0, 5.0, 6.0}};
  const double* parameters_[4] = {pose_, points_[0], pose_, points_[1]};
  double M_[42];
  TangentMap turning_{TangentMap::Kind::kDense, 7, 6, M_, nullptr, 3};
  TangentMap identity_{TangentMap::Kind::kIdentity, 3, 3, nullptr, nullptr};
  TangentMap constant_{TangentMap::Kind::kConstant, 0, 0, nullptr, nullptr};
  TangentMap unwanted_{TangentMap::Kind::kUnwanted, 0, 0, nullptr, nullptr};
  std::vector<double> residuals_ = std::vector<double>(4);
  std::vector<double> J_pose_;
  std::vector<double> J_point_;
};

TEST_F(KeptEvaluations, ServeWhoeverComesBackToTheValues) {
  ExpectAsAnew(kPose, unwanted_, 2);
  ExpectAsAnew(kPoint, unwanted_, 0);
  ExpectAsAnew(kBoth, unwanted_, 0);
  // to the bit: of one factor the point is at another zero
  points_[0][2] = -0.0;
  ExpectAsAnew(kBoth, unwanted_, 1);
  pose_[0] += 1.0;
  ExpectAsAnew(kPoint, constant_, 2);
  kept_.Forget();
  ExpectAsAnew(kPoint, constant_, 2);
}

// The factor named next is another one, or this one again.
TEST_F(KeptEvaluations, AHintOfWhatComesNextChangesNothing) {
  ExpectAsAnew(kPose, unwanted_, 2);
  EXPECT_EQ(family_.prefetched, -1);
  for (next_ = 0; next_ < 2; ++next_) {
    ExpectAsAnew(kBoth, unwanted_, 0);
    EXPECT_EQ(family_.prefetched, next_);
  }
  pose_[0] += 1.0;
  next_ = 1;
  ExpectAsAnew(kPoint, constant_, 2);
}

// A constant is asked for no Jacobian, so there is none for who wants it.
TEST_F(KeptEvaluations, HaveOnlyWhatWasAskedFor) {
  ExpectAsAnew(kPoint, constant_, 2);
  ExpectAsAnew(kPoint, constant_, 0);
  ExpectAsAnew(kBoth, constant_, 2);
  ExpectAsAnew(kPoint, constant_, 0);
}

// As without keeping, when it is written and when it is asked for again.
TEST_F(KeptEvaluations, AreCheckedWhenTheyAreWanted) {
  family_.forgets_an_entry = true;
  EXPECT_FALSE(Evaluate(kPose, unwanted_).failed());
  for (const bool keeps : {true, true, false}) {
    const EvaluationFailure failure = Evaluate(kBoth, unwanted_, keeps);
    EXPECT_EQ(failure.factor, 0);
    EXPECT_EQ(failure.slot, 1);
    EXPECT_EQ(failure.entry, 5);
    EXPECT_NE(std::string(failure.reason).find("Jacobian"), std::string::npos);
  }
  family_.forgets_an_entry = false;
  family_.has_bad_residual = true;
  kept_.Forget();
  for (const bool keeps : {true, true, false}) {
    const EvaluationFailure failure = Evaluate(kBoth, unwanted_, keeps);
    EXPECT_EQ(failure.factor, 0);
    EXPECT_EQ(failure.slot, -1);
    EXPECT_EQ(failure.entry, 1);
    EXPECT_NE(std::string(failure.reason).find("residual"), std::string::npos);
  }
}

TEST_F(KeptEvaluations, DoNotOutliveACallThatFailed) {
  ExpectAsAnew(kBoth, unwanted_, 2);
  const double before = pose_[0];
  pose_[0] = 5.0;
  family_.returns_false = true;
  EXPECT_EQ(Evaluate(kBoth, unwanted_).factor, 0);
  EXPECT_EQ(Evaluate(kBoth, unwanted_).factor, 0);
  family_.returns_false = false;
  pose_[0] = before;
  ExpectAsAnew(kBoth, unwanted_, 1);  // the second factor was not called
}

}  // namespace
}  // namespace inceres
