// Both marginalizations against the Schur complement of the dense normal equations.

#include "vins/marginalization.h"

#include <Eigen/Cholesky>
#include <ceres/ceres.h>
#include <gtest/gtest.h>

#include "okvis/manifolds.h"
#include "okvis/marginalization_error.h"
#include "okvis/reprojection_error.h"
#include "sliding_window/numeric_jacobian.h"
#include "sliding_window/random_state.h"
#include "vins/projection_factor.h"

namespace sliding_window {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// H and b of residuals with tangent Jacobians, added up by hand.
struct Dense {
  explicit Dense(int size) : H(MatrixXd::Zero(size, size)), b(VectorXd::Zero(size)) {}
  void Add(const LinearizedFactor& factor, const std::vector<MatrixXd>& tangent,
           const std::vector<int>& offsets) {
    MatrixXd J = MatrixXd::Zero(factor.r.size(), b.size());
    for (std::size_t i = 0; i < offsets.size(); ++i) {
      J.middleCols(offsets[i], tangent[i].cols()) += factor.J[i] * tangent[i];
    }
    H += J.transpose() * J;
    b += J.transpose() * factor.r;
  }
  // What is left of it without the first m.
  void Reduce(int m) {
    const Eigen::Index n = b.size() - m;
    const Eigen::LDLT<MatrixXd> H_mm(H.topLeftCorner(m, m));
    const MatrixXd H_rm = H.bottomLeftCorner(n, m);
    b = (b.tail(n) - H_rm * H_mm.solve(b.head(m))).eval();
    H = (H.bottomRightCorner(n, n) - H_rm * H_mm.solve(H_rm.transpose())).eval();
  }
  MatrixXd H;
  VectorXd b;
};

void ExpectSame(const MatrixXd& J, const VectorXd& r, const Dense& dense, double tolerance = 1e-9) {
  EXPECT_LT((J.transpose() * J - dense.H).norm(), tolerance * dense.H.norm());
  EXPECT_LT((J.transpose() * r - dense.b).norm(), tolerance * dense.b.norm());
}

// A pull of a pose toward another, with a full Jacobian, so that everything is well determined.
class Pull : public ceres::CostFunction {
 public:
  Pull(int size, RandomState* random) : A_(size, size), b_(size) {
    set_num_residuals(size);
    mutable_parameter_block_sizes()->push_back(size);
    for (int i = 0; i < A_.size(); ++i) {
      A_.data()[i] = random->Uniform(-3.0, 3.0);
    }
    for (int i = 0; i < size; ++i) {
      b_[i] = random->Uniform(-1.0, 1.0);
    }
  }
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    Eigen::Map<VectorXd>(residuals, b_.size()) =
        A_ * Eigen::Map<const VectorXd>(parameters[0], b_.size()) + b_;
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      Eigen::Map<RowMajorMatrix>(jacobians[0], b_.size(), b_.size()) = A_;
    }
    return true;
  }

 private:
  MatrixXd A_;
  VectorXd b_;
};

struct Scene {
  RandomState random{1};
  std::vector<std::vector<double>> poses{ToVector({}),
                                         ToVector({{0.3, 0.1, 0.0}, Exp({0.0, 0.1, 0.0})}),
                                         ToVector({{0.6, -0.1, 0.1}, Exp({0.1, 0.1, 0.0})})};
  std::vector<double> extrinsic = ToVector({{0.1, 0.0, 0.0}, Exp({0.0, 0.0, 0.1})});
  ceres::CauchyLoss loss{1.0};
};

TEST(VinsMarginalization, IsTheDenseSchurComplement) {
  Scene scene;
  std::vector<double> depths{0.2, 0.3, 0.25, 0.4};
  std::vector<std::unique_ptr<Pull>> pulls;
  // Columns: pose 0, the depths; pose 1, pose 2, the extrinsic.
  const std::vector<int> pose_at{0, 10, 16};
  const int extrinsic_at = 22;
  Dense dense(28);
  MarginalizationInfo info;
  const MatrixXd pose_tangent = MatrixXd::Identity(7, 6);
  const MatrixXd depth_tangent = MatrixXd::Identity(1, 1);
  for (std::size_t k = 0; k < 3; ++k) {
    const Pull pull(7, &scene.random);
    info.Add(pull, nullptr, {scene.poses[k].data()},
             k == 0 ? std::vector<int>{0} : std::vector<int>{});
    dense.Add(Linearize(pull, nullptr, {scene.poses[k].data()}), {pose_tangent}, {pose_at[k]});
  }
  for (int d = 0; d < 4; ++d) {
    for (int k = 1; k < 3; ++k) {
      const ProjectionFactor factor(scene.random.Vector(0.4).head<2>(),
                                    scene.random.Vector(0.4).head<2>(), 20.0);
      const std::vector<double*> blocks{scene.poses[0].data(), scene.poses[k].data(),
                                        scene.extrinsic.data(), &depths[d]};
      info.Add(factor, &scene.loss, blocks, {0, 3});
      dense.Add(Linearize(factor, &scene.loss, {blocks.begin(), blocks.end()}),
                {pose_tangent, pose_tangent, pose_tangent, depth_tangent},
                {0, pose_at[k], extrinsic_at, 6 + d});
    }
  }
  info.Marginalize();
  dense.Reduce(10);
  ASSERT_EQ(info.J().cols(), 18);
  ExpectSame(info.J(), info.r(), dense);

  // As a factor: r at the point of linearization, and J dx away from it.
  const std::vector<double*> kept = info.KeptBlocks({});
  ASSERT_EQ(kept, (std::vector<double*>{scene.poses[1].data(), scene.poses[2].data(),
                                        scene.extrinsic.data()}));
  const MarginalizationFactor factor(&info);
  const Values x{scene.poses[1], scene.poses[2], scene.extrinsic};
  EXPECT_EQ(ResidualAt(factor, x), info.r());
  ExpectJacobiansAreDerivatives(factor, x, {ByVinsPose(), ByVinsPose(), ByVinsPose()}, 1e-6);
  std::vector<double> elsewhere(7);
  EXPECT_EQ(info.KeptBlocks({{kept[1], elsewhere.data()}})[1], elsewhere.data());
}

TEST(VinsMarginalization, TellsNothingOfDirectionsThatNothingMeasured) {
  double x[9] = {};
  double y[9] = {};
  struct Difference : ceres::SizedCostFunction<9, 9, 9> {
    bool Evaluate(double const* const* p, double* r, double** J) const override {
      for (int i = 0; i < 9; ++i) {
        r[i] = p[1][i] - p[0][i];
      }
      for (int k = 0; J != nullptr && k < 2; ++k) {
        if (J[k] != nullptr) {
          Eigen::Map<RowMajorMatrix>(J[k], 9, 9) =
              (k == 0 ? -1.0 : 1.0) * RowMajorMatrix::Identity(9, 9);
        }
      }
      return true;
    }
  };
  MarginalizationInfo info;
  info.Add(Difference(), nullptr, {x, y}, {0});
  info.Marginalize();
  EXPECT_LT(info.J().norm(), 1e-12);
  EXPECT_LT(info.r().norm(), 1e-12);
  EXPECT_EQ(info.r().size(), 9);
}

ceres::Problem::Options OwnNothing() {
  ceres::Problem::Options options;
  options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  return options;
}

// Columns of the dense system: landmark, pose 0, pose 1, pose 2. The extrinsic is constant.
struct OkvisScene : Scene {
  OkvisScene() : problem(OwnNothing()) {
    problem.AddParameterBlock(extrinsic.data(), 7, &pose_manifold);
    problem.SetParameterBlockConstant(extrinsic.data());
    problem.AddParameterBlock(landmark.data(), 4, &point_manifold);
    for (int k = 0; k < 3; ++k) {
      problem.AddParameterBlock(poses[k].data(), 7, &pose_manifold);
      costs.push_back(std::make_unique<Pull>(7, &random));
      pulls.push_back(problem.AddResidualBlock(costs.back().get(), nullptr, poses[k].data()));
      costs.push_back(std::make_unique<ReprojectionError>(random.Vector(0.4).head<2>(), 20.0));
      sightings.push_back(problem.AddResidualBlock(costs.back().get(), &loss, poses[k].data(),
                                                   landmark.data(), extrinsic.data()));
    }
  }
  MatrixXd PoseTangent(const std::vector<double>& x) const { return By(pose_manifold).jacobian(x); }
  void AddSighting(int k, const std::vector<double>& pose, Dense* dense) const {
    dense->Add(Linearize(*problem.GetCostFunctionForResidualBlock(sightings[k]), &loss,
                         {pose.data(), landmark.data(), extrinsic.data()}),
               {PoseTangent(pose), MatrixXd::Identity(4, 3)}, {3 + 6 * k, 0});
  }
  void AddPull(int k, const std::vector<double>& pose, Dense* dense) const {
    dense->Add(
        Linearize(*problem.GetCostFunctionForResidualBlock(pulls[k]), nullptr, {pose.data()}),
        {PoseTangent(pose)}, {3 + 6 * k});
  }

  PoseManifold pose_manifold;
  HomogeneousPointManifold point_manifold;
  std::vector<double> landmark{0.5, -0.2, 4.0, 1.0};
  std::vector<std::unique_ptr<ceres::CostFunction>> costs;
  std::vector<ceres::ResidualBlockId> pulls, sightings;
  ceres::Problem problem;
};

TEST(OkvisMarginalization, IsTheDenseSchurComplementInOneOrSeveralSteps) {
  OkvisScene scene;
  Dense dense(21);
  for (int k = 0; k < 3; ++k) {
    scene.AddSighting(k, scene.poses[k], &dense);
    scene.AddPull(k, scene.poses[k], &dense);
  }
  dense.Reduce(9);
  for (const bool in_steps : {false, true}) {
    MarginalizationError error;
    for (int k = 0; k < 3; ++k) {
      error.Add(scene.problem, scene.pulls[k]);
    }
    for (int k = 0; k < 3; ++k) {
      error.Add(scene.problem, scene.sightings[k]);
    }
    if (in_steps) {
      error.MarginalizeOut({scene.landmark.data()});
      error.MarginalizeOut({scene.poses[0].data()});
    } else {
      error.MarginalizeOut({scene.landmark.data(), scene.poses[0].data()});
    }
    error.Update();
    ASSERT_EQ(error.Blocks(), (std::vector<double*>{scene.poses[1].data(), scene.poses[2].data()}));
    EXPECT_EQ(error.parameter_block_sizes(), (std::vector<int>{7, 7}));
    ExpectSame(error.prior().J, error.prior().r, dense);
    const Values x{scene.poses[1], scene.poses[2]};
    EXPECT_EQ(ResidualAt(error, x), error.prior().r);
    ExpectJacobiansAreDerivatives(error, x, {By(scene.pose_manifold), By(scene.pose_manifold)},
                                  1e-6);
  }
}

// The same object grows and shrinks, and what it has linearized once stays where it was.
TEST(OkvisMarginalization, LinearizesAConnectedBlockWhereItWasFirst) {
  OkvisScene scene;
  MarginalizationError error;
  error.Add(scene.problem, scene.pulls[1]);
  error.Update();
  EXPECT_EQ(error.num_residuals(), 6);
  const std::vector<double> first = scene.poses[1];
  scene.pose_manifold.Plus(first.data(), VectorXd::Constant(6, 0.01).eval().data(),
                           scene.poses[1].data());
  error.Add(scene.problem, scene.sightings[1]);
  error.Add(scene.problem, scene.sightings[2]);
  error.Add(scene.problem, scene.pulls[2]);
  error.Update();
  EXPECT_EQ(error.num_residuals(), 15);
  error.MarginalizeOut({scene.landmark.data()});
  error.Update();
  EXPECT_EQ(error.num_residuals(), 12);

  Dense dense(21);
  scene.AddPull(1, first, &dense);
  scene.AddSighting(1, first, &dense);
  scene.AddSighting(2, scene.poses[2], &dense);
  scene.AddPull(2, scene.poses[2], &dense);
  dense.Reduce(3);
  Dense poses_only(12);
  poses_only.H = dense.H.bottomRightCorner(12, 12);
  poses_only.b = dense.b.tail(12);
  ExpectSame(error.prior().J, error.prior().r, poses_only, 1e-8);
}

}  // namespace
}  // namespace sliding_window
