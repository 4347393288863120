#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include "base/zeroed_array.h"
#include "linearize/linearization.h"

namespace inceres::internal {

class Evaluator;
struct LandmarkIncidences;

/// Jacobians of a chunk of factors at a time, of families that keep none (JacobianStorage::
/// kInChunks): a pass over J goes from chunk to chunk and has each evaluated anew, at the current
/// point, corrected for losses as before. Chunk k has the factors of the landmarks of chunk k of
/// the elimination; behind these come chunks of what touches no landmark. Of each family a chunk
/// has the records from Begin to End.
///
/// Cost: an evaluation of all factors a pass. Memory: the largest chunk; 4 bytes a factor, and 4
/// of each of its slots, where factors come in another order than landmarks. Threads: those of the
/// evaluator; the same bits for any number.
class JacobianChunks {
 public:
  /// What of the graph does not allow it, in words; null: nothing does.
  static const char* Obstacle(const FactorGraph& graph);

  explicit JacobianChunks(Evaluator* evaluator) : evaluator_(*evaluator) {}

  /// Cuts as the elimination does, once, before any pass.
  void Cut(const LandmarkIncidences& incidences);
  int num_chunks() const { return num_chunks_; }
  int Begin(int chunk, FamilyId family) const { return ends_[Entry(chunk, family)]; }
  int End(int chunk, FamilyId family) const { return ends_[Entry(chunk + 1, family)]; }
  /// Whose record it is.
  int FactorAt(FamilyId family, int record) const {
    return factors_[family].empty() ? record : factors_[family][record];
  }

  /// Asks `reader` to read each chunk of Linearize; not to be called twice.
  void ReadBy(std::function<void(int chunk)> reader) { reader_ = std::move(reader); }

  /// Evaluator::EvaluateJacobians: all chunks, each for the reader as well.
  Status Linearize(bool known_point, double* cost);

  /// Puts the Jacobians of a chunk where they are read, unless they are there. kEvaluationFailed
  /// where a factor fails that did not before.
  Status Bring(int chunk);

  std::int64_t Bytes() const;

 private:
  // Records of a family that are evaluated by one task.
  struct Piece {
    FamilyId family;
    int begin;
    int end;
  };
  // Of a task: where a factor is written whose record has another number.
  struct Moved {
    std::vector<SlotJacobians> slots;
    std::vector<JacobianView> views;
  };
  std::size_t Entry(int chunk, FamilyId family) const {
    return static_cast<std::size_t>(chunk) * factors_.size() + static_cast<std::size_t>(family);
  }
  void FindFactors();
  void CutByLandmarks(const LandmarkIncidences& incidences);
  void CutTheRest();
  void CutIntoPieces();
  std::int64_t QuadsOf(FamilyId family) const;
  int EndOfRun(const Piece& piece, int record) const;
  Status Evaluate(int chunk, bool known_point, double* cost);
  EvaluationFailure EvaluatePiece(const Piece& piece, bool known_point, Moved* moved, double* cost);
  EvaluationFailure EvaluateRun(FamilyId family, int begin, int end, bool known_point,
                                const LinearizationPlaces& places, double* cost);

  Evaluator& evaluator_;
  int num_chunks_ = 0;
  int in_memory_ = -1;  // which chunk is
  std::function<void(int)> reader_;
  std::vector<int> ends_;                           // per chunk, and one before; per family
  std::vector<std::vector<std::int32_t>> factors_;  // per family: by record; empty: the same
  std::vector<Piece> pieces_;                       // by chunk
  std::vector<int> pieces_begin_;                   // per chunk, one more
  std::vector<double> costs_;                       // of the pieces of a chunk
  std::vector<EvaluationFailure> failures_;
  std::vector<Moved> moved_;  // per piece of a chunk; empty: all records are their factors
  ZeroedArray values_;
};

/// Bring of an evaluator that keeps no Jacobians.
Status BringJacobians(const Evaluator& evaluator, int chunk);

}  // namespace inceres::internal
