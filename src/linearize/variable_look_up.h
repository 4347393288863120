#pragma once

#include <cstdint>
#include <vector>

#include "linearize/linearization.h"
#include "linearize/point_pair.h"

namespace inceres::internal {

/// Where the values of each variable are, and its tangent map: of a large family all that its
/// factors need for a pass over them, in place of a table with two pointers for each of their
/// slots. Its families refer to it.
class VariableLookUp {
 public:
  /// Of a family whose factors have four residuals at most.
  static constexpr int kMostRows = 4;

  bool is_bound() const { return maps_ != nullptr; }
  /// Finds the values of all variables where the points have them.
  void Bind(const FactorGraph& graph, const PointPair& points);

  /// Takes the tables of a large family away, and its residuals of the candidate, which go where
  /// EvaluateCandidate is told. For who does nothing but passes over chunks of its factors, and has
  /// no pins. Not of families that ask for more than their batch.
  void Serve(Linearization* family) const;

  /// FactorFamily::Evaluate, of a few factors at a time.
  EvaluationFailure Evaluate(const Linearization& family, FactorBatch batch) const;
  const double* Values(VariableId id) const { return values_[id]; }

 private:
  std::vector<const double*> values_;  // per VariableId
  const TangentMap* const* maps_ = nullptr;
};

/// As its family does, wherever its parameters are.
EvaluationFailure EvaluateBatch(const Linearization& family, const FactorBatch& batch);

/// Linearization::LinearizedParameters, or CandidateParameters, wherever they are.
std::vector<const double*> ParametersOf(const Linearization& family, int factor, bool candidate);

/// What a family's linearization takes.
std::int64_t BytesOf(const Linearization& family);

}  // namespace inceres::internal
