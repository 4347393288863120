#include "linearize/memory_prediction.h"

#include <algorithm>

#include "simd/kernels.h"

namespace inceres::internal {

// What an evaluator will take, counted before anything is allocated, so that a solve too large for
// memory is declined at once. Numbers follow the members of Linearization, PointPair and
// LandmarkIncidences; an estimate to be held against a limit, not an exact count. Indices have 32
// bits, and targets and places of blocks give one bit to a flag: more than that cannot be
// numbered, whatever memory there is.

namespace {

constexpr std::int64_t kInts = std::int64_t{1} << 31;
constexpr std::int64_t kFlaggedInts = std::int64_t{1} << 30;  // one bit is a flag

constexpr std::int64_t kDouble = sizeof(double);
// Per connection: two pointers and a tangent offset.
constexpr std::int64_t kConnection = 2 * sizeof(void*) + sizeof(std::int32_t);
// Per factor of a landmark: its place in the lists, and one incidence, its frame, landmark and
// places by frame and in b; per connection of such a factor a target in Y.
constexpr std::int64_t kIncidence = 36;
constexpr std::int64_t kTarget = sizeof(std::int32_t);
// Per variable: the tangent map, and where it is in the layout.
constexpr std::int64_t kVariable = 64;
constexpr std::int64_t kPoints = 2;  // current and candidate
constexpr std::int64_t kLossValue = 4 * kDouble;

// The first factor speaks for its family: its slots have landmarks in all of them, mostly.
bool TouchesLandmarks(const FactorGraph& graph, FamilyId id) {
  const VariableId* ids = graph.NumFactors(id) > 0 ? graph.Variables(id, 0) : nullptr;
  const int num_slots = graph.NumFactors(id) > 0 ? graph.family(id).num_slots() : 0;
  return std::any_of(ids, ids + num_slots, [&](VariableId variable) {
    return variable >= 0 && graph.role(variable) == Role::kLandmark;
  });
}

}  // namespace

// Counts that are too large throw before anything is taken.
void CheckCounts(const FamilyCounts& counts) {
  const std::int64_t n = counts.num_factors;
  MemoryBudget::CheckCount(n * counts.num_slots, kFlaggedInts,
                           "connections of the factors of one family");
  MemoryBudget::CheckCount(n * counts.residual_size, kInts, "residuals of one family");
  MemoryBudget::CheckCount(n * counts.largest_block_quads, kFlaggedInts,
                           "quads of Jacobians of one family and slot");
}

void TakeForGraph(const FactorGraph& graph, bool eliminates_landmarks, MemoryBudget* budget) {
  // Borrowed values are counted, too.
  std::int64_t values = 0;
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    values += graph.HasVariable(id) ? graph.AmbientSize(id) : 0;
  }
  budget->Take(kPoints * kDouble * values + kVariable * graph.num_variables(), "the variables");
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    const FactorFamily& family = graph.family(id);
    FamilyCounts counts;
    counts.num_factors = graph.NumFactors(id);
    counts.num_slots = family.num_slots();
    counts.residual_size = family.residual_size();
    std::int64_t quads = 0;
    for (int s = 0; s < counts.num_slots; ++s) {
      const std::int64_t block_quads =
          std::int64_t{counts.residual_size} * (PadToQuad(family.slot(s).tangent_size) / kQuad);
      counts.largest_block_quads = std::max(counts.largest_block_quads, block_quads);
      quads += block_quads;
    }
    CheckCounts(counts);
    // Residuals at both points, Jacobians at one.
    budget->Take(counts.num_factors *
                     (kDouble * (kQuad * quads + kPoints * counts.residual_size) +
                      kConnection * counts.num_slots + (graph.HasLosses(id) ? kLossValue : 0)),
                 "the Jacobians");
    if (eliminates_landmarks && TouchesLandmarks(graph, id)) {
      budget->Take(counts.num_factors * (kIncidence + kTarget * counts.num_slots),
                   "the incidences of landmarks");
    }
  }
}

}  // namespace inceres::internal
