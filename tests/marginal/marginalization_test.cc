// What can be chosen when marginalizing, and what can go wrong.
#include "inceres/solver/marginalization.h"

#include <algorithm>
#include <functional>

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "inceres/problem/manifolds.h"
#include "inceres/solver/solver.h"
#include "marginal/linear_world.h"
#include "problem/graph_dump.h"
#include "support/dense_oracle.h"
#include "support/random_graph.h"

namespace inceres::test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

MarginalizationRequest Request(std::vector<VariableId> ids) {
  MarginalizationRequest request;
  request.marginalized = std::move(ids);
  return request;
}

// A chain x_0 … x_3 of 2-vectors with a prior on x_0, and a point seen from x_0 and x_1.
struct Chain : LinearWorld {
  Chain() {
    for (int i = 0; i < 4; ++i) {
      AddVariable(RandomMatrix(&random, 2, 1));
    }
    landmark = AddVariable(RandomMatrix(&random, 2, 1), Role::kLandmark);
    prior = AddFactor({0}, RandomMatrix(&random, 2, 2), RandomMatrix(&random, 2, 1));
    for (int i = 0; i < 3; ++i) {
      links.push_back(
          AddFactor({i, i + 1}, RandomMatrix(&random, 2, 4), RandomMatrix(&random, 2, 1)));
    }
    for (int i = 0; i < 2; ++i) {
      views.push_back(
          AddFactor({i, landmark}, RandomMatrix(&random, 2, 4), RandomMatrix(&random, 2, 1)));
    }
  }
  Random random{11};
  VariableId landmark;
  FactorId prior;
  std::vector<FactorId> links;
  std::vector<FactorId> views;
};

// A failure leaves everything as it was.
void ExpectRefused(FactorGraph* graph, const MarginalizationRequest& request,
                   const MarginalizationOptions& options, StatusCode code,
                   const std::string& message, const std::vector<VariableId>& offenders) {
  const std::string before = Dump(*graph);
  const MarginalizationSummary summary = Marginalize(request, options, graph);
  EXPECT_EQ(summary.status.code, code);
  EXPECT_EQ(summary.status.message.rfind(message, 0), 0U) << summary.status.message;
  EXPECT_EQ(summary.offenders, offenders);
  EXPECT_EQ(summary.prior.family, -1);
  EXPECT_EQ(Dump(*graph), before);
}

TEST(MarginalizationFailure, BadIdsAndOptions) {
  Chain chain;
  const MarginalizationOptions options;
  const auto invalid = StatusCode::kInvalidArgument;
  ExpectRefused(&chain.graph, Request({0, 9}), options, invalid,
                "variable 9 is to be marginalized or dropped but does not exist", {9});
  MarginalizationRequest request = Request({0, 1});
  request.dropped = {1};
  ExpectRefused(&chain.graph, request, options, invalid,
                "variable 1 is to be marginalized or dropped twice", {1});
  request = Request({0});
  request.order = {1, 0};
  ExpectRefused(&chain.graph, request, options, invalid,
                "variable 0 is named in the order of the prior but goes", {0});
  request.order = {1, 7};
  ExpectRefused(&chain.graph, request, options, invalid,
                "variable 7 is named in the order of the prior but does not exist", {7});
  request.order = {1, 2, 1};
  ExpectRefused(&chain.graph, request, options, invalid,
                "variable 1 is named twice in the order of the prior", {1});
  request = Request({0});
  request.dropped_factors = {chain.prior, chain.prior};
  EXPECT_EQ(Marginalize(request, options, &chain.graph).status.code, invalid);
  request.dropped_factors = {{7, 0}};
  ExpectRefused(&chain.graph, request, options, invalid, "RemoveFactor: there is no family 7", {});
  MarginalizationOptions bad;
  bad.epsilon = -1.0;
  ExpectRefused(&chain.graph, Request({0}), bad, invalid,
                "MarginalizationOptions::epsilon = -1 but must be finite and >= 0", {});
  bad = MarginalizationOptions();
  bad.rank_tolerance = 1.0;
  ExpectRefused(&chain.graph, Request({0}), bad, invalid,
                "MarginalizationOptions::rank_tolerance = 1 but must be in [0, 1)", {});
}

TEST(MarginalizationFailure, TwoLandmarksInOnePrior) {
  Chain chain;
  const VariableId second = chain.AddVariable(VectorXd::Zero(2), Role::kLandmark);
  chain.AddFactor({0, second}, RandomMatrix(&chain.random, 2, 4), VectorXd::Zero(2));
  ExpectRefused(&chain.graph, Request({0}), MarginalizationOptions(), StatusCode::kInvalidArgument,
                "the prior would join 2 landmarks (variables 4, 5); a factor touches at most one: "
                "marginalize them too, or drop "
                "their factors",
                {chain.landmark, second});
}

TEST(MarginalizationFailure, RankLossNamesEveryLandmark) {
  Chain chain;
  std::vector<VariableId> seen_once;
  for (int l = 0; l < 2; ++l) {
    seen_once.push_back(chain.AddVariable(VectorXd::Zero(3), Role::kLandmark));
    chain.AddFactor({0, seen_once.back()}, RandomMatrix(&chain.random, 2, 5), VectorXd::Zero(2));
  }
  const MarginalizationRequest request = Request({0, chain.landmark, seen_once[0], seen_once[1]});
  ExpectRefused(&chain.graph, request, MarginalizationOptions(), StatusCode::kSingular,
                "the factors do not determine the marginalized landmarks 5, 6: drop them, or allow "
                "rank loss, or keep what they "
                "are measured against",
                seen_once);

  // Allowed, they say nothing: as if they had been dropped.
  Chain other;
  MarginalizationOptions allowed;
  allowed.allow_rank_loss = true;
  const MarginalizationSummary summary = Marginalize(request, allowed, &chain.graph);
  ASSERT_TRUE(summary.status.ok()) << summary.status.message;
  const MarginalizationSummary expected =
      Marginalize(Request({0, other.landmark}), MarginalizationOptions(), &other.graph);
  ASSERT_TRUE(expected.status.ok());
  EXPECT_LT(RelativeError(InformationOf(*FindLinearPrior(chain.graph, summary.prior)),
                          InformationOf(*FindLinearPrior(other.graph, expected.prior))),
            1e-13);
}

TEST(MarginalizationFailure, RankLossOfFrames) {
  Chain chain;
  MarginalizationRequest request = Request({0, chain.landmark});
  request.dropped_factors = {chain.prior, chain.links[0], chain.views[0]};
  ExpectRefused(&chain.graph, request, MarginalizationOptions(), StatusCode::kSingular,
                "the factors do not determine the marginalized variables 0: drop them, or allow "
                "rank loss, or keep what they are "
                "measured against",
                {0});
}

TEST(MarginalizationFailure, AFactorThatCannotBeEvaluated) {
  Chain chain;
  const auto family =
      chain.graph.AddFamily(JetFamily<1, 2>([](const auto* /*x*/, auto* /*f*/) { return false; }));
  chain.graph.AddFactor(family, 0, {0});
  ExpectRefused(
      &chain.graph, Request({0, chain.landmark}), MarginalizationOptions(),
      StatusCode::kEvaluationFailed,
      "factor 0 of function (variables 0): the cost function returned false; at variable 0 = (",
      {});
}

TEST(MarginalizationFailure, ALossWithoutAWeightIsNamed) {
  for (const double slope : {-1.0, static_cast<double>(NAN), HUGE_VAL}) {
    Chain chain;
    GraphEdit edit(chain.graph);
    edit.SetLoss(chain.prior, LossOfSlope(slope));
    ASSERT_TRUE(chain.graph.Apply(edit).ok());
    ExpectRefused(&chain.graph, Request({0, chain.landmark}), MarginalizationOptions(),
                  StatusCode::kEvaluationFailed, "factor 0 of linear (variables 0): its loss has",
                  {});
  }
}

// A copy has the same families: priors that are made in it are not written over those of the graph.
TEST(Marginalization, ACopyHasPriorsOfItsOwn) {
  Chain chain;
  ASSERT_TRUE(
      Marginalize(Request({chain.landmark}), MarginalizationOptions(), &chain.graph).status.ok());
  FactorGraph copy = chain.graph;
  const std::string before = Dump(chain.graph);
  const DenseOracle oracle(chain.graph, {0, 1, 2, 3});
  for (const VariableId id : {0, 1, 2}) {
    ASSERT_TRUE(Marginalize(Request({id}), MarginalizationOptions(), &copy).status.ok());
  }
  EXPECT_EQ(Dump(chain.graph), before);
  EXPECT_EQ(DenseOracle(chain.graph, {0, 1, 2, 3}).H, oracle.H);
}

TEST(Marginalization, TheCallersOrder) {
  Chain chain;
  Chain by_id;
  MarginalizationRequest request = Request({chain.landmark, 1});
  request.order = {3, 2, 0};  // 3 is no neighbor
  const MarginalizationSummary summary =
      Marginalize(request, MarginalizationOptions(), &chain.graph);
  ASSERT_TRUE(summary.status.ok()) << summary.status.message;
  EXPECT_EQ(summary.kept, (std::vector<VariableId>{2, 0}));
  request.order.clear();
  const MarginalizationSummary sorted =
      Marginalize(request, MarginalizationOptions(), &by_id.graph);
  EXPECT_EQ(sorted.kept, (std::vector<VariableId>{0, 2}));
  const MatrixXd H = InformationOf(*FindLinearPrior(chain.graph, summary.prior));
  const MatrixXd H_by_id = InformationOf(*FindLinearPrior(by_id.graph, sorted.prior));
  EXPECT_LT(RelativeError(H.topLeftCorner(2, 2), H_by_id.bottomRightCorner(2, 2)), 1e-13);
  EXPECT_LT(RelativeError(H.topRightCorner(2, 2), H_by_id.bottomLeftCorner(2, 2)), 1e-13);
}

TEST(Marginalization, DroppedVariablesAndFactorsSayNothing) {
  Chain chain;
  Chain without;
  MarginalizationRequest request = Request({0});
  request.dropped = {chain.landmark};
  request.dropped_factors = {chain.links[2]};
  const MarginalizationSummary summary =
      Marginalize(request, MarginalizationOptions(), &chain.graph);
  ASSERT_TRUE(summary.status.ok()) << summary.status.message;
  EXPECT_EQ(summary.num_factors, 2);
  GraphEdit edit(without.graph);
  edit.RemoveVariable(without.landmark);
  edit.RemoveFactor(without.links[2]);
  ASSERT_TRUE(without.graph.Apply(edit).ok());
  const MarginalizationSummary expected =
      Marginalize(Request({0}), MarginalizationOptions(), &without.graph);
  EXPECT_EQ(FindLinearPrior(chain.graph, summary.prior)->J,
            FindLinearPrior(without.graph, expected.prior)->J);
  EXPECT_FALSE(chain.graph.HasVariable(chain.landmark));
  EXPECT_FALSE(chain.graph.HasFactor(chain.links[2].family, chain.links[2].index));
}

TEST(Marginalization, WithNobodyToTellThereIsNoPrior) {
  Chain chain;
  const MarginalizationSummary summary =
      Marginalize(Request({0, 1, 2, 3, 4}), MarginalizationOptions(), &chain.graph);
  ASSERT_TRUE(summary.status.ok()) << summary.status.message;
  EXPECT_EQ(summary.prior.family, -1);
  EXPECT_EQ(chain.graph.num_factors(), 0);
  EXPECT_EQ(chain.graph.num_live_variables(), 0);
}

// The optimum of the others is where it was, and the cost there has fallen by fixed_cost.
TEST(Marginalization, TheOptimumStaysWhereItWas) {
  Chain chain;
  SolverOptions options;
  options.function_tolerance = 0.0;
  options.gradient_tolerance = 0.0;
  options.parameter_tolerance = 0.0;
  chain.AddFactor({3}, RandomMatrix(&chain.random, 3, 2), RandomMatrix(&chain.random, 3, 1));
  FactorGraph solved = chain.graph;
  ASSERT_TRUE(Solve(options, &solved).IsSolutionUsable());
  // Not at the optimum: the prior of a linear problem does not depend on where it is linearized.
  const MarginalizationSummary summary =
      Marginalize(Request({0, chain.landmark}), MarginalizationOptions(), &chain.graph);
  ASSERT_TRUE(summary.status.ok());
  ASSERT_TRUE(Solve(options, &chain.graph).IsSolutionUsable());
  for (VariableId id = 1; id < 4; ++id) {
    for (int k = 0; k < 2; ++k) {
      EXPECT_NEAR(chain.graph.Values(id)[k], solved.Values(id)[k], 1e-8);
    }
  }
  EXPECT_NEAR(CostAt(chain.graph, chain.graph.state()) + summary.fixed_cost,
              CostAt(solved, solved.state()), 1e-12);
}

TEST(MarginalizationConstants, AreKnownOrKept) {
  const auto run = [](bool constant, bool keep) {
    Chain chain;
    chain.graph.SetConstant(1, constant);
    MarginalizationOptions options;
    options.keep_constants = keep;
    const MarginalizationSummary summary = Marginalize(Request({0, 4}), options, &chain.graph);
    EXPECT_TRUE(summary.status.ok()) << summary.status.message;
    return std::make_pair(summary.kept,
                          summary.prior.family < 0
                              ? MatrixXd()
                              : InformationOf(*FindLinearPrior(chain.graph, summary.prior)));
  };
  EXPECT_TRUE(run(true, false).first.empty());
  const auto kept = run(true, true);
  EXPECT_EQ(kept.first, std::vector<VariableId>{1});
  EXPECT_EQ(kept.second, run(false, false).second);
}

// A constant that goes is fixed where it is.
TEST(MarginalizationConstants, GoAsTheyAre) {
  Chain chain;
  chain.graph.SetConstant(0, true);
  FactorGraph before = chain.graph;
  const MarginalizationSummary summary =
      Marginalize(Request({0, chain.landmark}), MarginalizationOptions(), &chain.graph);
  ASSERT_TRUE(summary.status.ok()) << summary.status.message;
  EXPECT_EQ(summary.kept, std::vector<VariableId>{1});
  // What the link alone says about x_1 with x_0 known, and nothing more: two views fix a point of
  // two coordinates.
  const DenseOracle all(before, {chain.landmark, 1});
  const DenseOracle rest(chain.graph, {1});
  const MatrixXd P = all.H.topLeftCorner(2, 2);
  const MatrixXd W = all.H.bottomLeftCorner(2, 2);
  EXPECT_LT(RelativeError(rest.H, all.H.bottomRightCorner(2, 2) - W * P.inverse() * W.transpose()),
            1e-12);
  EXPECT_LT(RelativeError(rest.g, all.g.tail(2) - W * P.inverse() * all.g.head(2)), 1e-12);
}

// A prior with one strong, one middling and one weak direction about x_1 (3): information 1e4, 1,
// 1e-10 along known axes.
MarginalizationSummary Thresholded(PriorThreshold threshold, double epsilon, MatrixXd* information,
                                   VectorXd* gradient) {
  LinearWorld world;
  Random random(5);
  world.AddVariable(RandomMatrix(&random, 1, 1));
  world.AddVariable(VectorXd::Zero(3));
  const MatrixXd V = RandomMatrix(&random, 3, 3).householderQr().householderQ();
  const double sigmas[3] = {1e2, 1.0, 1e-5};
  for (int k = 0; k < 3; ++k) {
    MatrixXd A = MatrixXd::Zero(1, 4);
    A.rightCols(3) = sigmas[k] * V.col(k).transpose();
    world.AddFactor({0, 1}, A, VectorXd::Constant(1, sigmas[k]));
  }
  world.AddFactor({0}, MatrixXd::Identity(1, 1), VectorXd::Zero(1));
  MarginalizationOptions options;
  options.threshold = threshold;
  options.epsilon = epsilon;
  const MarginalizationSummary summary = Marginalize(Request({0}), options, &world.graph);
  EXPECT_TRUE(summary.status.ok()) << summary.status.message;
  const LinearPrior& prior = *FindLinearPrior(world.graph, summary.prior);
  *information = V.transpose() * InformationOf(prior) * V;
  *gradient = V.transpose() * GradientOf(prior);
  EXPECT_EQ(prior.e0.size(), 3U);
  return summary;
}

TEST(MarginalizationThreshold, CutsOffWhatIsBelowIt) {
  MatrixXd information;
  VectorXd gradient;
  const auto expect = [&](const MarginalizationSummary& summary, int truncated,
                          const Eigen::Vector3d& expected) {
    EXPECT_EQ(summary.num_truncated, truncated);
    EXPECT_EQ(summary.rank, 3 - truncated);
    for (int k = 0; k < 3; ++k) {
      EXPECT_NEAR(information(k, k), expected[k], 1e-10 * expected[k] + 1e-12) << k;
      EXPECT_NEAR(gradient[k], -expected[k], 1e-10 * expected[k] + 1e-12) << k;  // e = σ (vᵀx − 1)
    }
  };
  expect(Thresholded(PriorThreshold::kNone, 1e-8, &information, &gradient), 0, {1e4, 1.0, 1e-10});
  expect(Thresholded(PriorThreshold::kAbsolute, 1e-8, &information, &gradient), 1, {1e4, 1.0, 0.0});
  expect(Thresholded(PriorThreshold::kAbsolute, 1e-11, &information, &gradient), 0,
         {1e4, 1.0, 1e-10});
  expect(Thresholded(PriorThreshold::kAbsolute, 10.0, &information, &gradient), 2, {1e4, 0.0, 0.0});
  // Against the largest of the scaled matrix, which lies between 1 and 3.
  const MarginalizationSummary relative =
      Thresholded(PriorThreshold::kRelative, 1e-12, &information, &gradient);
  EXPECT_EQ(relative.num_truncated, 1);
  EXPECT_NEAR(information(0, 0), 1e4, 1e-4);
  EXPECT_EQ(Thresholded(PriorThreshold::kRelative, 1e-16, &information, &gradient).num_truncated,
            0);
}

// The relative threshold looks at directions in units of the variables: a weak unit is not a weak
// direction.
TEST(MarginalizationThreshold, RelativeDoesNotMindUnits) {
  LinearWorld world;
  world.AddVariable(VectorXd::Zero(1));
  world.AddVariable(VectorXd::Zero(2));
  MatrixXd A(2, 3);
  A << 1.0, 1e7, 0.0, 1.0, 0.0, 1e-7;
  world.AddFactor({0, 1}, A, VectorXd::Zero(2));
  world.AddFactor({0}, MatrixXd::Constant(1, 1, 10.0), VectorXd::Zero(1));
  MarginalizationOptions options;
  options.threshold = PriorThreshold::kRelative;
  options.epsilon = 1e-12;
  EXPECT_EQ(Marginalize(Request({0}), options, &world.graph).num_truncated, 0);
}

// Priors on manifolds: at x₀ ⊞ δ the residual is e₀ + J δ, exactly, and the Jacobian stays J.
TEST(LinearPriorOnManifolds, IsLinearInTheDifference) {
  const std::vector<std::shared_ptr<const Manifold>> manifolds = {
      std::make_shared<SE3Manifold>(),
      std::make_shared<PoseManifold>(),
      std::make_shared<QuaternionManifold>(),
      std::make_shared<EigenQuaternionManifold>(),
      std::make_shared<SubsetManifold>(4, std::vector<int>{1}),
      nullptr};
  for (const auto& manifold : manifolds) {
    RandomGraph random(17);
    FactorGraph& graph = random.graph();
    const VariableId gone = random.AddFrame(3);
    const VariableId kept = manifold != nullptr ? random.AddFrame(manifold) : random.AddFrame(4);
    const int d = graph.TangentSize(kept);
    if (graph.AmbientSize(kept) == 7) {  // a pose has a unit quaternion
      VectorXd pose = Eigen::Map<const VectorXd>(graph.Values(kept), 7);
      pose.tail(4).normalize();
      graph.SetValues(kept, pose.data());
    }
    random.Connect(9, {gone, kept});
    random.Connect(4, {gone});
    const DenseOracle before(graph, {gone, kept});
    const MarginalizationSummary summary =
        Marginalize(Request({gone}), MarginalizationOptions(), &graph);
    ASSERT_TRUE(summary.status.ok()) << summary.status.message;
    const LinearPrior prior = *FindLinearPrior(graph, summary.prior);
    const MatrixXd H_mm_inverse = before.H.topLeftCorner(3, 3).inverse();
    const MatrixXd W = before.H.bottomLeftCorner(d, 3);
    EXPECT_LT(RelativeError(InformationOf(prior),
                            before.H.bottomRightCorner(d, d) - W * H_mm_inverse * W.transpose()),
              1e-12);

    std::vector<double> delta = random.random().Vector(static_cast<std::size_t>(d));
    for (double& entry : delta) {
      entry *= 0.8;  // less than half a turn, of which the left quaternions make two of ‖δ‖
    }
    std::vector<double> moved(static_cast<std::size_t>(graph.AmbientSize(kept)));
    if (manifold != nullptr) {
      ASSERT_TRUE(manifold->Plus(graph.Values(kept), delta.data(), moved.data()));
    } else {
      std::transform(delta.begin(), delta.end(), graph.Values(kept), moved.begin(), std::plus<>());
    }
    graph.SetValues(kept, moved.data());
    const DenseOracle after(graph, {kept});
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    const Eigen::Map<const RowMajor> J(prior.J.data(), d, d);
    const VectorXd expected = Eigen::Map<const VectorXd>(prior.e0.data(), d) +
                              J * Eigen::Map<const VectorXd>(delta.data(), d);
    EXPECT_LT(RelativeError(after.f.tail(d), expected), 1e-13);
  }
}

TEST(LinearPriorOnManifolds, TheJacobianStaysWhatItWasAfterALargeTurn) {
  RandomGraph random(23);
  FactorGraph& graph = random.graph();
  const VariableId gone = random.AddFrame(2);
  const VariableId kept = random.AddFrame(std::make_shared<PoseManifold>());
  random.Connect(9, {gone, kept});
  const MarginalizationSummary summary =
      Marginalize(Request({gone}), MarginalizationOptions(), &graph);
  ASSERT_TRUE(summary.status.ok());
  const LinearPrior* prior = FindLinearPrior(graph, summary.prior);
  random.Perturb(1.0);
  std::vector<double> J(36, 1e30);
  std::vector<double> f(6);
  const double* parameters[1] = {graph.Values(kept)};
  TangentMap map;
  map.ambient_size = 7;
  map.tangent_size = 6;
  const TangentMap* maps[1] = {&map};
  const JacobianView view{J.data(), 36, 6};
  FactorBatch batch;
  batch.end = 1;
  batch.parameters = parameters;
  batch.tangent_maps = maps;
  batch.residuals = f.data();
  batch.jacobians = &view;
  LinearPriorFamily holder(*prior);
  holder.Add(*prior);
  EXPECT_FALSE(holder.Evaluate(batch).failed());
  EXPECT_EQ(J, prior->J);
  EXPECT_TRUE(holder.HasConstantJacobian());
}

// First-estimate Jacobians: what is kept is pinned where it is, and not moved by the next
// marginalization.
TEST(FirstEstimateJacobians, PinOnceAndStay) {
  Chain chain;
  MarginalizationOptions options;
  options.first_estimate_jacobians = true;
  const std::vector<double> x1(chain.graph.Values(1), chain.graph.Values(1) + 2);
  ASSERT_TRUE(Marginalize(Request({0, chain.landmark}), options, &chain.graph).status.ok());
  ASSERT_NE(chain.graph.PinnedValues(1), nullptr);
  EXPECT_EQ(chain.graph.PinnedValues(2), nullptr);
  const double elsewhere[2] = {7.0, 8.0};
  chain.graph.SetValues(1, elsewhere);
  EXPECT_EQ(std::vector<double>(chain.graph.PinnedValues(1), chain.graph.PinnedValues(1) + 2), x1);
  ASSERT_TRUE(Marginalize(Request({1}), options, &chain.graph).status.ok());
  EXPECT_NE(chain.graph.PinnedValues(2), nullptr);
  EXPECT_FALSE(chain.graph.HasVariable(1));
}

// Jacobians of the prior are those at the pins: marginalizing a nonlinear chain after it has moved.
TEST(FirstEstimateJacobians, OfThePriorAreThoseAtThePins) {
  RandomGraph random(31);
  FactorGraph& graph = random.graph();
  const VariableId gone = random.AddFrame(3);
  const VariableId kept = random.AddFrame(3);
  random.Connect(8, {gone, kept});
  const DenseOracle at_pins(graph, {gone, kept});
  graph.PinLinearization(gone,
                         std::vector<double>(graph.Values(gone), graph.Values(gone) + 3).data());
  graph.PinLinearization(kept,
                         std::vector<double>(graph.Values(kept), graph.Values(kept) + 3).data());
  random.Perturb(0.5);
  const DenseOracle here(graph, {gone, kept});
  const MarginalizationSummary summary =
      Marginalize(Request({gone}), MarginalizationOptions(), &graph);
  ASSERT_TRUE(summary.status.ok());
  const LinearPrior& prior = *FindLinearPrior(graph, summary.prior);
  const MatrixXd H_mm_inverse = at_pins.H.topLeftCorner(3, 3).inverse();
  const MatrixXd W = at_pins.H.bottomLeftCorner(3, 3);
  const VectorXd g = at_pins.J.transpose() * here.f;
  EXPECT_LT(RelativeError(InformationOf(prior),
                          at_pins.H.bottomRightCorner(3, 3) - W * H_mm_inverse * W.transpose()),
            1e-12);
  EXPECT_LT(RelativeError(GradientOf(prior), g.tail(3) - W * H_mm_inverse * g.head(3)), 1e-12);
}

// A point seen from many frames is one small QR; the frames share the information.
TEST(Marginalization, OfALandmarkWithManyObservations) {
  RandomGraph random(41);
  FactorGraph& graph = random.graph();
  const VariableId landmark = random.AddLandmark(3);
  std::vector<VariableId> frames;
  for (int i = 0; i < 120; ++i) {
    frames.push_back(random.AddFrame(i % 3 == 0 ? 6 : 2));
    random.Connect(2, {frames.back(), landmark},
                   i % 2 == 0 ? std::make_shared<HuberLoss>(0.2) : nullptr);
  }
  std::vector<VariableId> order = {landmark};
  order.insert(order.end(), frames.begin(), frames.end());
  const DenseOracle before(graph, order);
  const MarginalizationSummary summary =
      Marginalize(Request({landmark}), MarginalizationOptions(), &graph);
  ASSERT_TRUE(summary.status.ok()) << summary.status.message;
  const auto n = before.H.rows() - 3;
  const MatrixXd W = before.H.bottomLeftCorner(n, 3);
  const MatrixXd expected =
      before.H.bottomRightCorner(n, n) - W * before.H.topLeftCorner(3, 3).inverse() * W.transpose();
  EXPECT_LT(RelativeError(InformationOf(*FindLinearPrior(graph, summary.prior)), expected), 1e-12);
  EXPECT_EQ(summary.rank, 120 * 2 - 3);
}

}  // namespace
}  // namespace inceres::test
