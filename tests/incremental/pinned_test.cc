// First-estimate Jacobians: pinned variables are linearized where they are pinned, residuals stay
// where the variables are.
#include <cmath>

#include <gtest/gtest.h>

#include "inceres/autodiff/autodiff_family.h"
#include "inceres/problem/graph_edit.h"
#include "inceres/problem/losses.h"
#include "inceres/problem/manifolds.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/marginalization.h"
#include "inceres/solver/solver.h"
#include "incremental/incremental_system.h"
#include "incremental/whole_graph.h"
#include "support/core_pipeline.h"
#include "support/dense_oracle.h"
#include "support/random_graph.h"

namespace inceres::test {
namespace {

// Two curved frames, a Euclidean one and a landmark; factors with and without losses join them.
struct World {
  World() : random(7) {
    frames = {random.AddFrame(std::make_shared<PoseManifold>()),
              random.AddFrame(std::make_shared<SE3Manifold>()), random.AddFrame(3)};
    landmark = random.AddLandmark(2);
    random.Connect(7, {frames[0], frames[1]});
    random.Connect(6, {frames[1], frames[2]}, std::make_shared<HuberLoss>(0.1));
    random.Connect(3, {frames[0], landmark}, std::make_shared<CauchyLoss>(0.3));
    random.Connect(3, {frames[2], landmark});
    random.Connect(3, {frames[2]});
    pins = {1, 2, landmark};
    for (const VariableId id : pins) {
      const double* x = graph().Values(id);
      std::vector<double> pin(x, x + graph().AmbientSize(id));
      const std::vector<double> step =
          random.random().Vector(static_cast<std::size_t>(graph().TangentSize(id)));
      if (graph().manifold(id) != nullptr) {
        EXPECT_TRUE(graph().manifold(id)->Plus(x, step.data(), pin.data()));
      } else {
        std::transform(x, x + pin.size(), step.begin(), pin.begin(), std::plus<>());
      }
      pin_values.push_back(pin);
    }
  }
  FactorGraph& graph() { return random.graph(); }

  // What the linearization must be: J of each factor at the pinned point, f at the values,
  // corrected for the loss at f. Through a factor that is shifted so that it has at the pins the
  // residual it has at the values, which the oracle linearizes.
  Eigen::MatrixXd ExpectedHessian(Eigen::VectorXd* gradient) {
    const std::vector<VariableId> ids = {0, 1, 2, landmark};
    FactorGraph plain = graph();
    for (std::size_t k = 0; k < pins.size(); ++k) {
      plain.PinLinearization(pins[k], nullptr);
    }
    FactorGraph moved = plain;
    for (std::size_t k = 0; k < pins.size(); ++k) {
      moved.SetValues(pins[k], pin_values[k].data());
    }
    for (FamilyId family = 0; family < plain.num_families(); ++family) {
      for (int i = 0; i < plain.NumFactors(family); ++i) {
        plain.SetLoss(family, i, nullptr);
        moved.SetLoss(family, i, nullptr);
      }
    }
    const DenseOracle at_values(plain, ids);
    const DenseOracle at_pins(moved, ids);
    Eigen::MatrixXd J = at_pins.J;
    Eigen::VectorXd f = at_values.f;
    int row = 0;
    for (FamilyId family = 0; family < graph().num_families(); ++family) {
      const int size = graph().family(family).residual_size();
      for (int i = 0; i < graph().NumFactors(family); ++i, row += size) {
        if (const Loss* loss = graph().loss(family, i)) {
          double rho[3];
          loss->Evaluate(f.segment(row, size).squaredNorm(), rho);
          J.middleRows(row, size) *= std::sqrt(rho[1]);  // ρ'' ≤ 0 of these losses
          f.segment(row, size) *= std::sqrt(rho[1]);
        }
      }
    }
    *gradient = J.transpose() * f;
    return J.transpose() * J;
  }

  RandomGraph random;
  std::vector<VariableId> frames;
  VariableId landmark = -1;
  std::vector<VariableId> pins;
  std::vector<std::vector<double>> pin_values;
};

TEST(PinnedLinearization, OfTheBatchEvaluator) {
  World world;
  for (std::size_t k = 0; k < world.pins.size(); ++k) {
    world.graph().PinLinearization(world.pins[k], world.pin_values[k].data());
  }
  Eigen::VectorXd gradient;
  const Eigen::MatrixXd H = world.ExpectedHessian(&gradient);
  const CorePipeline pipeline(world.graph(), /*eliminate_landmarks=*/false);
  ASSERT_TRUE(pipeline.status.ok()) << pipeline.status.message;
  EXPECT_LT(RelativeError(ToDense(pipeline.plans.pattern, pipeline.hessian.C().data()), H), 1e-14);
  const Eigen::Map<const Eigen::VectorXd> g(pipeline.hessian.gradient().data(), gradient.size());
  EXPECT_LT(RelativeError(g, gradient), 1e-13);
  EXPECT_NEAR(pipeline.cost, CostAt(world.graph(), world.graph().state()), 1e-12);
}

// Pinned by an edit after everything has been linearized where it is, and let go again.
TEST(PinnedLinearization, OfTheIncrementalSystem) {
  World world;
  FactorGraph& graph = world.graph();
  internal::IncrementalSystem system(graph, 1);
  internal::AddWholeGraph(&system);
  internal::RelinearizeWork work;
  const auto diagonals = [&] {
    std::vector<double> entries;
    EXPECT_TRUE(system.Relinearize(0.0, RebuildPolicy::kNever, &work).ok());
    for (int frame = 0; frame < 3; ++frame) {
      entries.insert(entries.end(), system.schur().FrameDiagonal(frame),
                     system.schur().FrameDiagonal(frame) +
                         system.schur().frames()[static_cast<std::size_t>(frame)].size);
    }
    return entries;
  };
  const std::vector<double> before = diagonals();
  GraphEdit edit(graph);
  for (std::size_t k = 0; k < world.pins.size(); ++k) {
    edit.PinLinearization(world.pins[k], world.pin_values[k].data());
  }
  ASSERT_TRUE(system.Apply(edit).ok());
  const std::vector<double> pinned = diagonals();
  EXPECT_EQ(work.num_factors, 5);
  Eigen::VectorXd gradient;
  const Eigen::MatrixXd H = world.ExpectedHessian(&gradient);
  for (std::size_t k = 0; k < pinned.size(); ++k) {
    EXPECT_NEAR(pinned[k], H(static_cast<Eigen::Index>(k), static_cast<Eigen::Index>(k)),
                1e-12 * pinned[k])
        << k;
  }
  EXPECT_NE(pinned, before);
  edit.Restart();
  for (const VariableId id : world.pins) {
    edit.PinLinearization(id, nullptr);
  }
  ASSERT_TRUE(system.Apply(edit).ok());
  const std::vector<double> after = diagonals();
  for (std::size_t k = 0; k < after.size(); ++k) {
    EXPECT_NEAR(after[k], before[k], 1e-12 * before[k]) << k;
  }
}

TEST(PinnedLinearization, ABadPinIsRefused) {
  World world;
  GraphEdit edit(world.graph());
  edit.PinLinearization(9, world.pin_values[0].data());
  EXPECT_EQ(world.graph().Apply(edit).message,
            "PinLinearization: variable 9 does not exist: the graph has 4 variables");
  edit.Restart();
  world.pin_values[0][2] = std::nan("");
  edit.PinLinearization(world.pins[0], world.pin_values[0].data());
  EXPECT_EQ(world.graph().Apply(edit).message, "PinLinearization: value 2 of variable 1 is nan");
  EXPECT_FALSE(world.graph().HasPins());
}

// log x, which is defined where x is positive.
struct Logarithm {
  template <typename T>
  bool operator()(const T* x, T* residual) const {
    using std::log;
    if (x[0] <= 0.0) {
      return false;
    }
    residual[0] = log(x[0]);
    return true;
  }
};
using Logarithms = AutoDiffFamily<Logarithm, 1, 1>;

// A factor of the value x that is linearized at `pin`, one of the two where it has no value.
void ExpectFailureAt(double x, double pin, const std::string& expected) {
  const std::string message =
      "factor 0 of log (variables 0): the cost function returned false; at variable 0 = " +
      expected;
  FactorGraph graph;
  const VariableId id = graph.AddVariable(&x, 1, Role::kFrame);
  graph.AddFactor(graph.AddFamily(std::make_shared<Logarithms>("log")), {}, {id});
  graph.PinLinearization(id, &pin);
  EXPECT_EQ(Solve(SolverOptions(), &graph).detail, message);
  MarginalizationRequest request;
  request.marginalized = {id};
  EXPECT_EQ(Marginalize(request, MarginalizationOptions(), &graph).status.message, message);
  IncrementalOptions options;
  options.batch_share = 1.0;
  IncrementalSolver solver(options);
  const auto family = solver.AddFamily(std::make_shared<Logarithms>("log"));
  GraphEdit edit(solver.graph());
  const VariableId living = edit.AddVariable(&x, 1, Role::kFrame);
  edit.AddFactor(family, {}, {living});
  edit.PinLinearization(living, &pin);
  ASSERT_TRUE(solver.Apply(edit).ok());
  EXPECT_EQ(solver.Update().message, message);
}

TEST(PinnedLinearization, AFailureIsToldWithTheValuesWhereItIs) {
  ExpectFailureAt(/*x=*/2.0, /*pin=*/-1.0, "(-1)");
  ExpectFailureAt(/*x=*/-3.0, /*pin=*/1.0, "(-3)");
}

}  // namespace
}  // namespace inceres::test
