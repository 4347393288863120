#include "linearize/tangent.h"

#include <algorithm>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/problem/factor_graph.h"
#include "inceres/problem/manifolds.h"
#include "problem/tangent_kind.h"

namespace inceres::internal {
namespace {

struct Classified {
  Classified(int ambient_size, int tangent_size, std::vector<double> M)
      : plus_jacobian(std::move(M)), selection(tangent_size, -1) {
    map.ambient_size = ambient_size;
    map.tangent_size = tangent_size;
    map.plus_jacobian = plus_jacobian.data();
    ClassifyTangentMap(&map, selection.data());
  }
  std::vector<double> plus_jacobian;
  std::vector<int> selection;
  TangentMap map;
};

TEST(TangentClasses, IdentityAndSelection) {
  EXPECT_EQ(Classified(2, 2, {1, 0, 0, 1}).map.kind, TangentMap::Kind::kIdentity);
  const Classified permuted(3, 2, {0, 1, 0, 0, 1, 0});
  EXPECT_EQ(permuted.map.kind, TangentMap::Kind::kSelection);
  EXPECT_EQ(permuted.selection, (std::vector<int>{2, 0}));
  EXPECT_EQ(Classified(2, 2, {1, 0, 0, 0}).map.kind,
            TangentMap::Kind::kDense);  // a zero column selects nothing
}

TEST(TangentClasses, LeadingIdentityColumnsOfADenseMap) {
  // A pose: the translation as it is, the rest anything.
  EXPECT_EQ(Classified(5, 4, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, .5, .1, 0, 0, .2, .3, 0, 0, .4, .7})
                .map.num_identity_columns,
            2);
  // An entry beside the one in its row, or below it in its column: not a copy any more.
  EXPECT_EQ(Classified(3, 2, {1, 0.1, 0, 1, 0, 2}).map.num_identity_columns, 0);
  EXPECT_EQ(Classified(3, 2, {1, 0, 0, 2, 0.1, 1}).map.num_identity_columns, 0);
  // The identity further down does not count.
  EXPECT_EQ(Classified(3, 2, {2, 0, 0, 1, 0, 0}).map.num_identity_columns, 0);
}

// What a variable was classified as at one point must not linger at the next.
TEST(TangentClasses, AreFoundAnew) {
  Classified classified(3, 2, {1, 0, 0, 2, 0, 1});
  EXPECT_EQ(classified.map.num_identity_columns, 1);
  classified.plus_jacobian = {3, 0, 0, 2, 0, 1};
  classified.map.plus_jacobian = classified.plus_jacobian.data();
  ClassifyTangentMap(&classified.map, classified.selection.data());
  EXPECT_EQ(classified.map.num_identity_columns, 0);
}

// x ⊞ δ = x + x² δ: a map that is another one at every point.
class Stretched final : public Manifold {
 public:
  int AmbientSize() const override { return 1; }
  int TangentSize() const override { return 1; }
  bool Plus(const double* x, const double* delta, double* moved) const override {
    moved[0] = x[0] + x[0] * x[0] * delta[0];
    return true;
  }
  bool PlusJacobian(const double* x, double* M) const override {
    M[0] = x[0] * x[0];
    return true;
  }
};

class TangentOfCandidates : public testing::Test {
 protected:
  TangentOfCandidates() {
    const double x = 2.0;
    id_ = graph_.AddVariable(&x, 1, Role::kFrame, std::make_shared<Stretched>());
    tangent_.Set(graph_, id_, /*wanted=*/true);
    EXPECT_EQ(tangent_.Compute(graph_, id_, &x), nullptr);
  }
  double M() const { return tangent_.map().plus_jacobian[0]; }
  void AskAt(double x) { EXPECT_EQ(tangent_.ComputeCandidate(graph_, id_, &x), nullptr); }
  void RefreshAt(double x) { EXPECT_EQ(tangent_.Refresh(graph_, id_, &x), nullptr); }

  FactorGraph graph_;
  VariableId id_;
  Tangent tangent_;
};

TEST_F(TangentOfCandidates, AnAcceptedCandidateBringsItsMap) {
  AskAt(3.0);
  EXPECT_EQ(M(), 4.0) << "a candidate only";
  tangent_.AcceptCandidate();
  EXPECT_EQ(M(), 9.0);
  RefreshAt(3.0);
  EXPECT_EQ(M(), 9.0);
}

// The map of a candidate of long ago is not that of one for which nobody asked.
TEST_F(TangentOfCandidates, AMapThatNobodyAskedForIsComputedWhenItIsNeeded) {
  AskAt(3.0);
  tangent_.AcceptCandidate();
  tangent_.AcceptCandidate();  // at 5, say
  RefreshAt(5.0);
  EXPECT_EQ(M(), 25.0);
}

TEST_F(TangentOfCandidates, AMapOfARefusedCandidateIsNotThatOfTheNext) {
  AskAt(3.0);
  tangent_.DropCandidate();
  tangent_.AcceptCandidate();  // at 5
  RefreshAt(5.0);
  EXPECT_EQ(M(), 25.0);
}

// The matrix of the candidate and the selection lie behind the matrix of the point, each with room
// of its own, also after a smaller manifold before.
TEST_F(TangentOfCandidates, ALargerManifoldHasRoomForItsMatrices) {
  const std::vector<double> x = {0.1, 0.2, 0.3, 0.0, 0.0, 0.6, 0.8};
  const VariableId pose =
      graph_.AddVariable(x.data(), 7, Role::kFrame, std::make_shared<PoseManifold>());
  tangent_.Set(graph_, pose, /*wanted=*/true);
  ASSERT_EQ(tangent_.Compute(graph_, pose, x.data()), nullptr);
  const std::vector<double> at_x(tangent_.map().plus_jacobian, tangent_.map().plus_jacobian + 42);
  const std::vector<double> y = {0.1, 0.2, 0.3, 0.6, 0.0, 0.0, 0.8};
  ASSERT_EQ(tangent_.ComputeCandidate(graph_, pose, y.data()), nullptr);
  EXPECT_TRUE(std::equal(at_x.begin(), at_x.end(), tangent_.map().plus_jacobian));
  EXPECT_EQ(tangent_.map().num_identity_columns, 3);
  tangent_.AcceptCandidate();
  std::vector<double> at_y(42);
  ASSERT_TRUE(graph_.manifold(pose)->PlusJacobian(y.data(), at_y.data()));
  EXPECT_TRUE(std::equal(at_y.begin(), at_y.end(), tangent_.map().plus_jacobian));
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(tangent_.map().plus_jacobian) % 16, 0U);
}

TEST_F(TangentOfCandidates, AMapOfAnotherManifoldIsGone) {
  AskAt(3.0);
  tangent_.Set(graph_, id_, /*wanted=*/true);
  tangent_.AcceptCandidate();
  RefreshAt(5.0);
  EXPECT_EQ(M(), 25.0);
}

}  // namespace
}  // namespace inceres::internal
