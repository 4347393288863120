#include "linearize/memory_prediction.h"

#include <algorithm>

#include "linearize/jacobian_places.h"
#include "linearize/linearization.h"
#include "simd/kernels.h"

namespace inceres::internal {

// What an evaluator will take, counted before anything is allocated, so that a solve too large for
// memory is declined at once. Numbers follow the members of Linearization, PointPair and
// LandmarkIncidences; an estimate to be held against a limit, not an exact count: not below what is
// taken, and little above it. Who gives something back tells the budget then. Indices have 32 bits,
// and targets and places of blocks give one bit to a flag: more than that cannot be numbered,
// whatever memory there is.

namespace {

constexpr std::int64_t kInts = std::int64_t{1} << 31;
constexpr std::int64_t kFlaggedInts = std::int64_t{1} << 30;  // one bit is a flag

constexpr std::int64_t kDouble = sizeof(double);
// Per factor: its share of the sums of costs, and of the chunks that are evaluated.
constexpr std::int64_t kSums = 1;
// Per connection: two pointers and a tangent offset.
constexpr std::int64_t kConnection = 2 * sizeof(void*) + sizeof(std::int32_t);
// Per factor of a landmark: its place in the lists, and one incidence, its frame, landmark and
// place by frame; per connection of such a factor a target in Y.
constexpr std::int64_t kIncidence = sizeof(Incidence) + 4 * sizeof(std::int32_t);
constexpr std::int64_t kTarget = sizeof(std::int32_t);
// Per landmark: its factors, where these and its incidences begin, its size.
constexpr std::int64_t kLandmark = sizeof(LandmarkFactors) + 3 * sizeof(std::int32_t);
// Per variable: the tangent map, and where it is in the layout.
constexpr std::int64_t kVariable = 64;
// Of a factor and of each of its connections, where records have an order of their own.
constexpr std::int64_t kRecord = sizeof(std::int32_t);
constexpr std::int64_t kPoints = 2;  // current and candidate
constexpr std::int64_t kLossValue = 4 * kDouble;

// Whether any of its factors does: then all of them are counted as if they did, mostly rightly. The
// first factor answers for most families; it may be a free place, or touch a point that is a frame.
bool TouchesLandmarks(const FactorGraph& graph, FamilyId id) {
  const std::int64_t num_entries =
      std::int64_t{graph.NumFactors(id)} * graph.family(id).num_slots();
  const VariableId* ids = num_entries > 0 ? graph.Variables(id, 0) : nullptr;
  return std::any_of(ids, ids + num_entries, [&](VariableId variable) {
    return variable >= 0 && graph.role(variable) == Role::kLandmark;
  });
}

bool HasLargeFamilies(const FactorGraph& graph) {
  bool found = false;
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    found = found || Linearization::MayKeepSingles(graph.family(id), graph.NumFactors(id));
  }
  return found;
}

bool IsByFactor(JacobianStorage storage) {
  return storage == JacobianStorage::kByFactor || storage == JacobianStorage::kByFactorInSingle ||
         storage == JacobianStorage::kWithoutPadding || storage == JacobianStorage::kInChunks;
}

// As they are kept, with what it takes to know where; and of a strip of them as they are written.
// Those of chunks count themselves (JacobianChunks::Cut).
std::int64_t BytesOfJacobians(const FactorGraph& graph, FamilyId id, JacobianStorage storage) {
  if (storage == JacobianStorage::kInChunks) {
    return 0;
  }
  const FactorFamily& family = graph.family(id);
  const std::int64_t num_places = graph.NumFactors(id);
  std::int64_t entries = 0;  // of a factor
  for (int s = 0; s < family.num_slots(); ++s) {
    const int columns = family.slot(s).tangent_size;
    entries += family.residual_size() * (IsByFactor(storage) ? columns : PadToQuad(columns));
  }
  const std::int64_t in_double = kDouble * PadToQuad(static_cast<int>(entries));
  const bool in_single = storage == JacobianStorage::kByFactorInSingle &&
                         Linearization::MayKeepSingles(family, graph.NumFactors(id));
  const bool has_records = IsByFactor(storage) && storage != JacobianStorage::kWithoutPadding &&
                           HasRecordsByLandmark(graph, id);
  std::int64_t bytes = num_places * in_double / (in_single ? 2 : 1);
  if (in_single || has_records) {
    bytes += Linearization::kStripSize * in_double;
  }
  if (has_records) {
    bytes += Linearization::kStripSize * kDouble * family.residual_size() +
             num_places * kRecord * (1 + family.num_slots());
  }
  return bytes;
}

// The largest block of a slot, padded or not, or all of a factor's blocks together.
std::int64_t QuadsOfBlock(const FactorFamily& family, JacobianStorage storage) {
  std::int64_t largest = 0, all = 0;
  for (int s = 0; s < family.num_slots(); ++s) {
    const std::int64_t quads =
        std::int64_t{family.residual_size()} * (PadToQuad(family.slot(s).tangent_size) / kQuad);
    largest = std::max(largest, quads);
    all += quads;
  }
  return IsByFactor(storage) ? all : largest;
}

}  // namespace

// Counts that are too large throw before anything is taken.
void CheckCounts(std::int64_t num_factors, int num_slots, int residual_size,
                 std::int64_t block_quads) {
  MemoryBudget::CheckCount(num_factors * num_slots, kFlaggedInts,
                           "connections of the factors of one family");
  MemoryBudget::CheckCount(num_factors * residual_size, kInts, "residuals of one family");
  MemoryBudget::CheckCount(num_factors * block_quads, kFlaggedInts,
                           "quads of Jacobians of one family and slot");
}

void TakeForGraph(const FactorGraph& graph, bool eliminates_landmarks, JacobianStorage storage,
                  MemoryBudget* budget) {
  const bool has_strips = storage == JacobianStorage::kByFactorInSingle && HasLargeFamilies(graph);
  // Borrowed values are counted, too.
  std::int64_t values = 0, padded = 0, num_landmarks = 0;
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    values += graph.HasVariable(id) ? graph.AmbientSize(id) : 0;
    padded += has_strips && graph.HasVariable(id) ? PadToQuad(graph.TangentSize(id)) : 0;
    num_landmarks += graph.role(id) == Role::kLandmark ? 1 : 0;
  }
  budget->Take(kPoints * kDouble * values + kVariable * graph.num_variables() + kDouble * padded,
               "the variables");
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    const FactorFamily& family = graph.family(id);
    const std::int64_t num_factors = graph.NumFactors(id);
    CheckCounts(num_factors, family.num_slots(), family.residual_size(),
                QuadsOfBlock(family, storage));
    // Jacobians at one point, residuals at both.
    budget->Take(BytesOfJacobians(graph, id, storage), "the Jacobians");
    budget->Take(static_cast<std::int64_t>(sizeof(Linearization)) +
                     num_factors * (kDouble * kPoints * family.residual_size() + kSums +
                                    kConnection * family.num_slots() +
                                    (graph.HasLosses(id) ? kLossValue : 0)),
                 "the residuals");
    if (eliminates_landmarks && num_landmarks > 0 && TouchesLandmarks(graph, id)) {
      budget->Take(num_factors * (kIncidence + kTarget * family.num_slots()),
                   "the incidences of landmarks");
    }
  }
  if (eliminates_landmarks) {
    budget->Take(num_landmarks * kLandmark, "the landmarks");
  }
}

}  // namespace inceres::internal
