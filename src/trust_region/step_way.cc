#include "trust_region/step_way.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "linear/reduced_prediction.h"
#include "schur/scene_shape.h"

namespace inceres::internal {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// All in flops of the dense Cholesky that take as long, in processor time of one thread, from steps
// in cities of 300 and 1,000 cameras with streets of 16 and 64 m, a path of 400, and 300 photos
// (benchmarks/step_ways.cc).

// A number of the Jacobians, or of S, that a product reads; a flop of what forms S.
constexpr double kPerNumberRead = 9.0;
constexpr double kPerEntryOfS = 55.0;
constexpr double kPerFormingFlop = 2.5;
constexpr double kPerNumberWritten = 170.0;  // read before, of the blocks that a chunk adds to
// Iterations of a step, on the way to convergence and near it. Blocks: few where all frames are
// neighbors of neighbors, set-up among them, and so many for each step that the scene is longer.
// Two levels: about as many wherever it was tried, and each takes so much longer.
constexpr double kFewestIterations = 15.0;
constexpr double kShortLength = 2.0;
constexpr double kIterationsPerLength = 25.0;
// Their steps are the less exact ones: to convergence it takes so many times as many.
constexpr double kMoreSteps = 1.2;
constexpr double kTwoLevelIterations = 12.0;
constexpr double kTwoLevelPenalty = 1.6;
// To make two levels: modes for each number of the Jacobians; the fine and the coarse part for each
// of them, and for each flop of what would form S; or for each entry of S.
constexpr double kModesPerNumber = 300.0;
constexpr double kLevelsPerNumber = 270.0;
constexpr double kLevelsPerFormingFlop = 5.0;
constexpr double kLevelsPerEntryOfS = 400.0;
constexpr double kBytesPerProduct = 8.0;
// A factor may take so many times as long: its steps are exact, and fewer.
constexpr double kFactorPremium = 1.3;

// S is stored twice, without damping and factored in place or beside it.
double BytesOfS(double entries, const SceneShape& scene) {
  return 2.0 * sizeof(double) * entries + kBytesPerProduct * scene.num_products();
}

// Everything here is predicted from connections: how many numbers the Jacobians have, how many
// products make S, which share of its blocks is there, and how long the scene is. No value is
// looked at, and no clock: but for what fits into memory the choice is the same on every machine,
// for any number of threads.
class Prediction {
 public:
  Prediction(const Evaluator& evaluator, const LandmarkIncidences& incidences)
      : evaluator_(evaluator), scene_(evaluator, incidences), extent_(scene_.FindExtent()) {}

  // Ways that need S share what forming it takes: the flops of its products, and what chunks of
  // landmarks read and write of it. They are left out where there is no room for S. The other two
  // read the Jacobians in each iteration instead. Entries of S are those of its lower triangle.
  StepCosts Run() {
    const SceneShape::Sample sample = scene_.TakeSample();
    const double frame_size = scene_.size() / std::max(1.0, scene_.num_frames());
    fill_ = sample.fill;
    const double entries = 0.5 * fill_ * scene_.size() * (scene_.size() + 1.0);
    const double blocks =
        kFewestIterations + kIterationsPerLength * std::max(0.0, extent_.length - kShortLength);
    const double numbers = scene_.numbers_read();
    const double modes = kModesPerNumber * numbers;
    const double two_levels = kTwoLevelPenalty * kTwoLevelIterations;
    forming_ = kPerFormingFlop * scene_.product_flops() +
               kPerNumberWritten * sample.writes_per_product * scene_.num_products() * frame_size *
                   frame_size;
    StepCosts costs;
    costs.of.fill(kInfinity);
    costs[StepWay::kBlocks] = kMoreSteps * blocks * kPerNumberRead * numbers;
    costs[StepWay::kTwoLevel] = modes + kLevelsPerNumber * numbers +
                                kLevelsPerFormingFlop * scene_.product_flops() +
                                two_levels * kPerNumberRead * numbers;
    if (HasRoomFor(BytesOfS(entries, scene_))) {
      costs[StepWay::kBlocksOnS] = kMoreSteps * (forming_ + blocks * kPerEntryOfS * entries);
      costs[StepWay::kTwoLevelOnS] =
          forming_ + modes + (kLevelsPerEntryOfS + two_levels * kPerEntryOfS) * entries;
      AddFactor(&costs);
    }
    return costs;
  }

 private:
  bool HasRoomFor(double bytes) const {
    return evaluator_.HasRoomFor(static_cast<std::int64_t>(bytes));
  }

  // Columns of a factor are at least as long as those of S: where that is dearer than the best of
  // the others, nobody needs to know how much. Nor where the envelope is cheap already, as of most
  // paths: the solver looks for something better. From the bound that costs nothing to the symbolic
  // analysis: with f the fill and n the size, columns of S have fn/2 entries on average, and a
  // factor takes n (fn/2)² flops at least, even without any fill of its own. Then the dense
  // solver's own prediction, if it would take the system; the envelope in the order of the walk;
  // and at last the analysis of the pattern. One that fails, or has no room, is no way.
  void AddFactor(StepCosts* costs) const {
    const double best = *std::min_element(costs->of.begin(), costs->of.end());
    const double size = scene_.size();
    double& cost = (*costs)[StepWay::kFactor];
    cost = forming_ + 0.25 * fill_ * fill_ * size * size * size;
    costs->factor_is_bound = cost > kFactorPremium * best;
    if (costs->factor_is_bound) {
      return;
    }
    ReducedPrediction prediction = PredictFullSystem(size);
    if (!IsSolvedDensely(size, fill_)) {
      prediction = scene_.PredictEnvelope(extent_);
      costs->factor_is_bound = Fits(prediction) && forming_ + prediction.cost <= best;
      if (!costs->factor_is_bound && !PredictReducedSolver(scene_.Pattern(), &prediction).ok()) {
        cost = kInfinity;
        return;
      }
    }
    cost = Fits(prediction) ? forming_ + prediction.cost : kInfinity;
  }

  bool Fits(const ReducedPrediction& prediction) const {
    return HasRoomFor(prediction.bytes + kBytesPerProduct * scene_.num_products());
  }

  const Evaluator& evaluator_;
  const SceneShape scene_;
  const SceneShape::Extent extent_;
  double fill_ = 0.0;
  double forming_ = 0.0;  // S
};

// Whether even a full S is factored in the time of a few products, of Jacobians with padding. Asked
// first, as it needs no incidences.
bool IsSmall(const Evaluator& evaluator) {
  double numbers = 0.0;
  for (const Linearization& cache : evaluator.families()) {
    for (const SlotJacobians& slot : cache.slots) {
      numbers += static_cast<double>(cache.num_factors) *
                 static_cast<double>(cache.residual_size * PadToQuad(slot.columns));
    }
  }
  return PredictFullSystem(evaluator.layout().frame_size()).cost <=
         kFewestIterations * kPerNumberRead * numbers;
}

}  // namespace

// The premium is for what costs do not show: steps of a factor are exact, so fewer of them are
// needed.
StepWay StepCosts::Cheapest() const {
  const auto best = std::min_element(of.begin(), of.end());
  return (*this)[StepWay::kFactor] <= kFactorPremium * *best
             ? StepWay::kFactor
             : static_cast<StepWay>(best - of.begin());
}

// Incidences that were found are handed on, for whichever model is chosen needs them.
StepCosts PredictSteps(const Evaluator& evaluator,
                       std::unique_ptr<LandmarkIncidences>* incidences) {
  StepCosts costs;
  if (IsSmall(evaluator)) {
    costs.of.fill(kInfinity);
    costs[StepWay::kFactor] = PredictFullSystem(evaluator.layout().frame_size()).cost;
    return costs;
  }
  auto found = std::make_unique<LandmarkIncidences>(evaluator);
  costs = Prediction(evaluator, *found).Run();
  if (incidences != nullptr) {
    *incidences = std::move(found);
  }
  return costs;
}

// Tolerances and limits stay those of the caller.
ConjugateGradientsOptions OptionsOf(StepWay way, const ConjugateGradientsOptions& options) {
  ConjugateGradientsOptions result = options;
  const bool two_level = way == StepWay::kTwoLevel || way == StepWay::kTwoLevelOnS;
  result.preconditioner =
      two_level ? PreconditionerKind::kTwoLevel : PreconditionerKind::kSchurJacobi;
  result.explicit_schur_complement = way == StepWay::kBlocksOnS || way == StepWay::kTwoLevelOnS;
  return result;
}

}  // namespace inceres::internal
