#include "trust_region/solver_way.h"

#include "inceres/problem/losses.h"
#include "support/street_graph.h"
#include "trust_region/curve.h"

namespace inceres::test {
namespace {

constexpr TrustRegionStrategyKind kStrategies[] = {
    TrustRegionStrategyKind::kLevenbergMarquardt, TrustRegionStrategyKind::kMarquardt,
    TrustRegionStrategyKind::kDogleg, TrustRegionStrategyKind::kSubspaceDogleg};
constexpr const char* kPreconditionerNames[] = {"Identity", "Jacobi",        "SchurJacobi",
                                                "TwoLevel", "ClusterJacobi", "ClusterTridiagonal"};

const char* NameOf(PreconditionerKind kind) {
  return kPreconditionerNames[static_cast<int>(kind)];
}

auto Bundle(const BundleOptions& options) {
  return [options](bool other_numbers) {
    BundleOptions bundle = options;
    if (other_numbers) {
      bundle.noise *= 0.6;
      bundle.perturbation *= 0.8;
    }
    const std::shared_ptr<RandomGraph> random = MakeBundle(bundle);
    return std::shared_ptr<FactorGraph>(random, &random->graph());
  };
}

// With landmarks of this size.
auto HostedBundle(int landmark_size) {
  BundleOptions bundle;
  bundle.num_frames = 10;
  bundle.num_landmarks = 40;
  bundle.num_views = 5;
  bundle.landmark_sizes = {landmark_size};
  bundle.residual_sizes = {2, 3};
  bundle.losses = bundle.constants = bundle.hosted = true;
  bundle.perturbation = 0.1;
  return Bundle(bundle);
}

// Jacobians of several strips.
auto BundleOfStrips() {
  BundleOptions bundle;
  bundle.num_frames = 20;
  bundle.num_landmarks = 3000;
  bundle.num_views = 5;
  bundle.losses = bundle.constants = true;
  bundle.perturbation = 0.1;
  return Bundle(bundle);
}

auto Street(bool split, bool shared_focal, bool inverse_depth, bool held_and_priors) {
  StreetGraphOptions options;
  options.num_cameras = 100;
  options.split = split;
  options.shared_focal = shared_focal;
  options.inverse_depth = inverse_depth;
  options.first_constant = options.priors = held_and_priors;
  return [options](bool other_numbers) mutable {
    options.drift = other_numbers ? 0.001 : 0.002;
    const std::shared_ptr<StreetGraph> street = MakeStreetGraph(options);
    return std::shared_ptr<FactorGraph>(street, &street->graph);
  };
}

auto Curve() {
  return [](bool other_numbers) {
    return std::make_shared<FactorGraph>(
        MakeCurve(other_numbers ? 7 : 6, std::make_shared<HuberLoss>(0.5)));
  };
}

SolverOptions Iterations(int count) {
  SolverOptions options;
  options.max_num_iterations = count;
  options.function_tolerance = options.gradient_tolerance = options.parameter_tolerance = 0.0;
  return options;
}

void AddFactorizations(std::vector<SolverWay>* ways) {
  BundleOptions large = MixedBundle(900);
  large.num_frames = 40;
  const BundleOptions small = MixedBundle(80);
  SolverOptions options = Iterations(6);
  for (const TrustRegionStrategyKind strategy : kStrategies) {
    options.strategy = strategy;
    const std::string name = std::string("_") + ToString(strategy);
    options.reduced_solver = ReducedSolverKind::kDense;
    ways->push_back({"Dense" + name, options, Bundle(large)});
    options.reduced_solver = ReducedSolverKind::kSparse;
    ways->push_back({"Sparse" + name, options, Bundle(large)});
    options.reduced_solver = ReducedSolverKind::kPcg;
    ways->push_back({"Pcg" + name, options, Bundle(large), /*remembers=*/true});
    SolverOptions recomputing = options;
    recomputing.max_num_iterations = 4;
    recomputing.recompute_jacobians = true;
    recomputing.reduced_solver = ReducedSolverKind::kDense;
    ways->push_back({"Recomputing" + name, recomputing, Bundle(LongBundle(/*by_frame=*/true))});
  }
  options = Iterations(4);
  options.recompute_jacobians = true;
  options.reduced_solver = ReducedSolverKind::kSparse;
  ways->push_back({"RecomputingSparse", options, Bundle(LongBundle(/*by_frame=*/true))});
  options = Iterations(10);
  options.linear_model = LinearModelKind::kDenseQr;
  ways->push_back({"Qr", options, Bundle(small)});
  options.linear_model = LinearModelKind::kPlain;
  options.reduced_solver = ReducedSolverKind::kDense;
  ways->push_back({"Plain", options, Bundle(small)});
  options = Iterations(15);
  options.dynamic_sparsity = true;
  ways->push_back({"Dynamic", options, Curve()});
}

void AddConjugateGradients(std::vector<SolverWay>* ways) {
  SolverOptions options = Iterations(5);
  options.linear_model = LinearModelKind::kIterativeSchur;
  ConjugateGradientsOptions& cg = options.conjugate_gradients;
  cg.eta = 1e-4;
  cg.single_precision_jacobians = true;
  for (const auto kind : {PreconditionerKind::kIdentity, PreconditionerKind::kJacobi,
                          PreconditionerKind::kSchurJacobi, PreconditionerKind::kTwoLevel,
                          PreconditionerKind::kClusterTridiagonal}) {
    cg.preconditioner = kind;
    ways->push_back({std::string("Single") + NameOf(kind), options, BundleOfStrips()});
  }
  cg.single_precision_jacobians = false;
  for (const auto kind : {PreconditionerKind::kSchurJacobi, PreconditionerKind::kTwoLevel,
                          PreconditionerKind::kClusterTridiagonal}) {
    cg.preconditioner = kind;
    for (const bool formed : {false, true}) {
      if (formed && kind == PreconditionerKind::kClusterTridiagonal) {
        continue;  // there is no such way
      }
      cg.explicit_schur_complement = formed;
      const std::string name = NameOf(kind) + std::string(formed ? "Formed" : "");
      cg.eta = 0.1;
      cg.max_iterations = 2000;
      for (const int size : {1, 2, 3, 4}) {
        ways->push_back({name + std::to_string(size), options, HostedBundle(size)});
      }
      if (kind == PreconditionerKind::kTwoLevel) {
        SolverOptions on_street = options;
        on_street.max_num_iterations = 8;
        on_street.initial_trust_region_radius = 1e8;
        on_street.conjugate_gradients.eta = 1e-3;
        on_street.conjugate_gradients.max_iterations = 20000;
        const auto add = [&](const char* street, auto make) {
          ways->push_back({name + street, on_street, make});
        };
        add("OnAStreet", Street(false, false, false, false));
        add("OnASplitStreet", Street(true, false, false, true));
        add("OnAStreetOfOneFocal", Street(true, true, false, true));
        add("OnAFreeStreetOfOneFocal", Street(true, true, false, false));
        add("OnAStreetOfInverseDepths", Street(false, false, true, true));
      }
    }
  }
}

bool Allocates(const SolverWay& way) {
  const SolverOptions& options = way.options;
  const PreconditionerKind preconditioner = options.conjugate_gradients.preconditioner;
  return way.remembers || options.dynamic_sparsity ||
         options.linear_model == LinearModelKind::kDenseQr ||
         options.strategy == TrustRegionStrategyKind::kSubspaceDogleg ||
         (options.linear_model == LinearModelKind::kIterativeSchur &&
          preconditioner != PreconditionerKind::kIdentity &&
          preconditioner != PreconditionerKind::kClusterTridiagonal);
}

}  // namespace

std::vector<SolverWay> SolverWays() {
  std::vector<SolverWay> ways;
  AddFactorizations(&ways);
  AddConjugateGradients(&ways);
  for (SolverWay& way : ways) {
    way.allocates = Allocates(way);
  }
  return ways;
}

}  // namespace inceres::test
