// Priors against a Schur complement in 128-bit floating point, and against each other over orders
// of elimination.
#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "inceres/problem/manifolds.h"
#include "inceres/solver/marginalization.h"
#include "marginal/linear_world.h"
#include "support/dense_oracle.h"
#include "support/random_graph.h"

namespace inceres::test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

__extension__ typedef __float128 Quad;

// H_rr − H_rm H_mm⁻¹ H_mr and the same of the gradient, by Gauss–Jordan steps on the leading
// columns of [H g] in 128 bits.
void QuadSchurComplement(const MatrixXd& J, const VectorXd& f, int num_marginalized, MatrixXd* H,
                         VectorXd* g) {
  const auto n = static_cast<std::size_t>(J.cols());
  std::vector<std::vector<Quad>> M(n, std::vector<Quad>(n + 1, 0));
  for (std::size_t i = 0; i < n; ++i) {
    for (Eigen::Index r = 0; r < J.rows(); ++r) {
      const Quad left = J(r, static_cast<Eigen::Index>(i));
      for (std::size_t k = 0; k < n; ++k) {
        M[i][k] += left * static_cast<Quad>(J(r, static_cast<Eigen::Index>(k)));
      }
      M[i][n] += left * static_cast<Quad>(f[r]);
    }
  }
  for (std::size_t p = 0; p < static_cast<std::size_t>(num_marginalized); ++p) {
    for (std::size_t i = p + 1; i < n; ++i) {
      const Quad factor = M[i][p] / M[p][p];
      for (std::size_t k = p; k <= n; ++k) {
        M[i][k] -= factor * M[p][k];
      }
    }
  }
  const auto m = static_cast<std::size_t>(num_marginalized);
  H->resize(static_cast<Eigen::Index>(n - m), static_cast<Eigen::Index>(n - m));
  g->resize(static_cast<Eigen::Index>(n - m));
  for (std::size_t i = m; i < n; ++i) {
    for (std::size_t k = m; k < n; ++k) {
      (*H)(static_cast<Eigen::Index>(i - m), static_cast<Eigen::Index>(k - m)) =
          static_cast<double>(M[i][k]);
    }
    (*g)[static_cast<Eigen::Index>(i - m)] = static_cast<double>(M[i][n]);
  }
}

// max |A − B|_ij / √(B_ii B_jj): big entries hide nothing.
double ScaledError(const MatrixXd& A, const MatrixXd& B) {
  const VectorXd scale = B.diagonal().cwiseSqrt().cwiseInverse();
  return (scale.asDiagonal() * (A - B) * scale.asDiagonal()).cwiseAbs().maxCoeff();
}
double ScaledError(const VectorXd& a, const VectorXd& b, const MatrixXd& H) {
  const VectorXd scale = H.diagonal().cwiseSqrt().cwiseInverse();
  return (scale.asDiagonal() * (a - b)).cwiseAbs().maxCoeff() /
         (scale.asDiagonal() * b).cwiseAbs().maxCoeff();
}

void ExpectSamePrior(const LinearPrior& prior, const MatrixXd& H, const VectorXd& g,
                     double tolerance) {
  EXPECT_LT(ScaledError(InformationOf(prior), H), tolerance);
  EXPECT_LT(ScaledError(GradientOf(prior), g, H), tolerance);
}

// Frames in a chain, points seen from several of them, priors; factor weights from 1e-2 to 1e14,
// the extremes included.
struct StiffWorld {
  explicit StiffWorld(unsigned seed) : random(seed) {
    for (int i = 0; i < 6; ++i) {
      frames.push_back(world.AddVariable(RandomMatrix(&random, i % 2 == 0 ? 6 : 3, 1)));
    }
    for (int l = 0; l < 8; ++l) {
      landmarks.push_back(world.AddVariable(RandomMatrix(&random, 1 + l % 3, 1), Role::kLandmark));
    }
    for (int i = 0; i < 6; ++i) {
      Add({frames[Index(i)]}, 6);
      for (int j = i + 1; j < std::min(6, i + 3); ++j) {
        Add({frames[Index(i)], frames[Index(j)]}, 6);
      }
    }
    for (int l = 0; l < 8; ++l) {
      for (int v = 0; v < 4; ++v) {
        Add({frames[Index((l + v) % 6)], landmarks[Index(l)]}, 2);
      }
    }
  }
  static std::size_t Index(int i) { return static_cast<std::size_t>(i); }

  void Add(const std::vector<VariableId>& ids, int rows) {
    int columns = 0;
    for (const VariableId id : ids) {
      columns += world.graph.AmbientSize(id);
    }
    const int kind = count++ % 5;
    const double exponent = kind == 0 ? 14.0 : kind == 1 ? -2.0 : random.Between(-2.0, 14.0);
    const double sqrt_weight = std::pow(10.0, 0.5 * exponent);
    world.AddFactor(ids, sqrt_weight * RandomMatrix(&random, rows, columns),
                    sqrt_weight * RandomMatrix(&random, rows, 1));
  }

  Random random;
  LinearWorld world;
  std::vector<VariableId> frames;
  std::vector<VariableId> landmarks;
  int count = 0;
};

// The frames kept of what factors of the gone ones say, in 128 bits.
void Expected(const FactorGraph& graph, const std::vector<VariableId>& gone,
              const std::vector<VariableId>& kept, MatrixXd* H, VectorXd* g) {
  // Only the factors that touch one of the gone.
  FactorGraph part = graph;
  std::vector<FactorId> others;
  part.TrackFactors();
  GraphEdit edit(part);
  for (FamilyId family = 0; family < part.num_families(); ++family) {
    for (int i = 0; i < part.NumFactors(family); ++i) {
      const VariableId* ids = part.HasFactor(family, i) ? part.Variables(family, i) : nullptr;
      if (ids != nullptr &&
          std::none_of(ids, ids + part.family(family).num_slots(), [&](VariableId id) {
            return std::find(gone.begin(), gone.end(), id) != gone.end();
          })) {
        edit.RemoveFactor({family, i});
      }
    }
  }
  ASSERT_TRUE(part.Apply(edit).ok());
  std::vector<VariableId> order = gone;
  order.insert(order.end(), kept.begin(), kept.end());
  const DenseOracle oracle(part, order);
  int num_gone = 0;
  for (const VariableId id : gone) {
    num_gone += graph.TangentSize(id);
  }
  QuadSchurComplement(oracle.J, oracle.f, num_gone, H, g);
}

TEST(Marginalization, OfStiffFactorsIsTheSchurComplementInQuadPrecision) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    StiffWorld stiff(seed);
    std::vector<VariableId> gone = stiff.landmarks;
    gone.insert(gone.end(), {stiff.frames[0], stiff.frames[1], stiff.frames[3]});
    const std::vector<VariableId> kept = {stiff.frames[5], stiff.frames[2], stiff.frames[4]};
    MatrixXd H;
    VectorXd g;
    Expected(stiff.world.graph, gone, kept, &H, &g);
    MarginalizationRequest request;
    request.marginalized = gone;
    request.order = kept;
    const MarginalizationSummary summary =
        Marginalize(request, MarginalizationOptions(), &stiff.world.graph);
    ASSERT_TRUE(summary.status.ok()) << summary.status.message;
    EXPECT_EQ(summary.kept, kept);
    SCOPED_TRACE(seed);
    ExpectSamePrior(*FindLinearPrior(stiff.world.graph, summary.prior), H, g, 1e-9);
  }
}

// One at a time, in every order that never puts two landmarks into one prior, and all at once.
TEST(Marginalization, OrderOfEliminationDoesNotMatter) {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    const std::vector<std::vector<int>> orders = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {2, 1, 0}};
    MatrixXd H;
    VectorXd g;
    for (std::size_t trial = 0; trial <= orders.size() + 1; ++trial) {
      StiffWorld stiff(seed);
      FactorGraph& graph = stiff.world.graph;
      const std::vector<VariableId> kept = {stiff.frames[2], stiff.frames[4], stiff.frames[5]};
      const VariableId frames[3] = {stiff.frames[0], stiff.frames[1], stiff.frames[3]};
      std::vector<std::vector<VariableId>> steps;
      if (trial == 0) {  // all at once
        steps = {stiff.landmarks};
        steps[0].insert(steps[0].end(), frames, frames + 3);
      } else if (trial <=
                 orders.size()) {  // landmark by landmark from the last, then frame by frame
        for (auto id = stiff.landmarks.rbegin(); id != stiff.landmarks.rend(); ++id) {
          steps.push_back({*id});
        }
        for (const int k : orders[trial - 1]) {
          steps.push_back({frames[k]});
        }
      } else {  // the frames with all landmarks but one, then that one: a landmark in a prior
        steps = {std::vector<VariableId>(stiff.landmarks.begin(), stiff.landmarks.end() - 1),
                 {stiff.landmarks.back()}};
        steps[0].insert(steps[0].end(), frames, frames + 3);
      }
      MarginalizationSummary summary;
      for (const std::vector<VariableId>& step : steps) {
        MarginalizationRequest request;
        request.marginalized = step;
        request.order = kept;
        summary = Marginalize(request, MarginalizationOptions(), &graph);
        ASSERT_TRUE(summary.status.ok()) << summary.status.message;
      }
      // Rows that never were part of a step are still in their own factors: the whole information
      // is what must be the same.
      const DenseOracle oracle(graph, kept);
      if (trial == 0) {
        H = oracle.H;
        g = oracle.g;
      }
      SCOPED_TRACE(testing::Message() << "seed " << seed << ", trial " << trial);
      EXPECT_LT(ScaledError(oracle.H, H), 1e-10);
      EXPECT_LT(ScaledError(oracle.g, g, H), 1e-10);
      EXPECT_EQ(graph.num_live_variables(), 3);
    }
  }
}

// Curved frames and landmarks, losses, constants: the prior is the Schur complement of the
// linearized problem.
TEST(Marginalization, OfARandomBundleIsTheSchurComplement) {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    BundleOptions options;
    options.seed = seed;
    options.frame_sizes = {6, 3};
    options.landmark_sizes = {3, 2, 1};
    options.num_views = 4;
    options.manifolds = true;
    options.losses = true;
    options.constants = true;
    options.hosted = seed % 2 == 0;
    const std::unique_ptr<RandomGraph> bundle = MakeBundle(options);
    FactorGraph& graph = bundle->graph();
    // The first frame that moves, with the landmarks it sees.
    VariableId frame = 0;
    while (graph.role(frame) != Role::kFrame || graph.IsConstant(frame)) {
      ++frame;
    }
    graph.TrackFactors();
    std::vector<VariableId> gone;
    std::vector<VariableId> constants;
    graph.ForEachFactorOf(frame, [&](FactorId factor) {
      const VariableId* ids = graph.Variables(factor.family, factor.index);
      for (int s = 0; s < graph.family(factor.family).num_slots(); ++s) {
        if (graph.role(ids[s]) == Role::kLandmark &&
            std::find(gone.begin(), gone.end(), ids[s]) == gone.end() &&
            std::find(constants.begin(), constants.end(), ids[s]) == constants.end()) {
          (graph.IsConstant(ids[s]) ? constants : gone).push_back(ids[s]);
        }
      }
    });
    gone.push_back(frame);
    FactorGraph before = graph;
    MarginalizationRequest request;
    request.marginalized = gone;
    const MarginalizationSummary summary = Marginalize(request, MarginalizationOptions(), &graph);
    ASSERT_TRUE(summary.status.ok()) << summary.status.message;
    const LinearPrior& prior = *FindLinearPrior(graph, summary.prior);
    MatrixXd H;
    VectorXd g;
    Expected(before, gone, summary.kept, &H, &g);
    SCOPED_TRACE(seed);
    ExpectSamePrior(prior, H, g, 1e-11);
    for (const VariableId id : summary.kept) {
      EXPECT_FALSE(graph.IsConstant(id));
    }
  }
}

}  // namespace
}  // namespace inceres::test
