#pragma once

#include <cstdint>
#include <vector>

#include "distributed/communicator.h"
#include "inceres/distributed/distributed_solver.h"
#include "inceres/problem/factor_graph.h"
#include "linearize/layout.h"

namespace inceres::internal {

/// A frame of this rank in the system of all.
struct FramePlace {
  static constexpr int kTangent = 0;  ///< vectors: a frame has its tangent size
  static constexpr int kSquare = 1;   ///< diagonal blocks: its square
  static constexpr int kAmbient = 2;  ///< values

  std::int64_t id = -1;
  VariableId variable = -1;
  int sizes[3] = {0, 0, 0};
  int owner = -1;                     ///< −1: it moves nowhere
  std::int64_t begin[3] = {0, 0, 0};  ///< in what all ranks own, rank by rank
  int num_others = 0;                 ///< other ranks with factors of it
  int number = -1;                    ///< among all frames that move, by ascending id
};

/// A rank that has factors of a frame.
struct FrameSharer {
  int frame;
  int rank;
  std::int64_t num_factors;
};

/// Which of the ranks that share a frame sums its rows: the owner. In a product a rank sends its
/// part of each frame that it shares to the owner, or, of those it owns, the sum to all others: of
/// a frame that h ranks share 2 (h − 1) times its entries are sent, whoever owns it. Owners are
/// such that what a rank sends, over the entries of the frames it shares, is about the same for
/// all, and of the rest that all own as much. `sizes`: entries of each frame. `sharers`: by
/// ascending frame, at least one of each.
std::vector<int> ChooseFrameOwners(const std::vector<int>& sizes,
                                   const std::vector<FrameSharer>& sharers, int num_ranks);

/// Which frames the ranks have in common, and who owns each: sums its rows, and counts it. That is
/// one of those with factors of it, such that all have about as much to send. Owned frames are
/// numbered rank by rank, by ascending id.
///
/// Cost: a record of 48 bytes of each frame of each rank goes to all.
class SharedFrames {
 public:
  /// Collective. An error, the same on all ranks, names the frame and the ranks.
  Status Agree(const Communicator& ranks, const GraphPart& part, const Layout& layout);

  /// Of the frames of the layout, in its order.
  const std::vector<FramePlace>& moving() const { return moving_; }
  /// Frames that others move, and no factor here touches.
  const std::vector<FramePlace>& idle() const { return idle_; }
  /// Positions in `moving` of those that are owned here, by ascending id: as they are numbered.
  const std::vector<int>& owned() const { return owned_; }
  /// The rows of these, in their order: where each begins, one more; and which is that of a frame
  /// by its number, −1 if others own it.
  const std::vector<int>& owned_offsets() const { return owned_offsets_; }
  int OwnedRow(int number) const { return row_of_number_[static_cast<std::size_t>(number)]; }
  /// Entries of vectors in which each of them begins on a quad.
  std::size_t padded_owned_size() const { return padded_owned_size_; }
  /// Entries owned here, the first of them among those of all, and how many these are, of each of
  /// the three kinds.
  std::int64_t owned_size(int kind) const { return owned_size_[kind]; }
  std::int64_t owned_begin(int kind) const { return owned_begin_[kind]; }
  std::int64_t total_size(int kind) const { return total_size_[kind]; }
  std::int64_t num_frames() const { return static_cast<std::int64_t>(sizes_.size()); }
  /// Tangent sizes of all frames that move, by ascending id.
  const std::vector<int>& sizes() const { return sizes_; }

 private:
  struct Record;
  struct Group;
  Status Collect(const GraphPart& part, const Layout& layout, std::vector<Record>* own) const;
  static const char* FindDifference(const Record& first, const Record& record);
  static Status FindGroups(const std::vector<Record>& all, int rank, std::vector<Group>* groups);
  static void ChooseOwners(const std::vector<Record>& all, int num_ranks,
                           std::vector<Group>* groups);
  static std::int64_t SizeOf(const Record& record, int kind);
  Status Number(const Communicator& ranks, const std::vector<Record>& all);
  void Keep(const GraphPart& part, const Layout& layout, int rank);

  std::vector<FramePlace> numbered_;  // of this rank, in the order of its part
  std::vector<FramePlace> moving_;
  std::vector<FramePlace> idle_;
  std::vector<int> owned_;
  std::vector<int> owned_offsets_{0};
  std::vector<int> row_of_number_;
  std::size_t padded_owned_size_ = 0;
  std::int64_t owned_size_[3] = {0, 0, 0};
  std::int64_t owned_begin_[3] = {0, 0, 0};
  std::int64_t total_size_[3] = {0, 0, 0};
  std::vector<int> sizes_;
};

}  // namespace inceres::internal
