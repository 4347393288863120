#pragma once

#include <cstdint>
#include <vector>

#include "distributed/communicator.h"
#include "inceres/distributed/graph_part.h"
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
  /// Entries owned here, and by all, of each of the three kinds.
  std::int64_t owned_size(int kind) const { return owned_size_[kind]; }
  std::int64_t total_size(int kind) const { return total_size_[kind]; }
  std::int64_t num_frames() const { return static_cast<std::int64_t>(sizes_.size()); }
  /// Tangent sizes of all frames that move, by ascending id.
  const std::vector<int>& sizes() const { return sizes_; }

 private:
  struct Record;
  struct Group;
  Status Collect(const GraphPart& part, const Layout& layout, std::vector<Record>* own) const;
  static const char* FindDifference(const Record& first, const Record& record);
  static Status FindGroups(const std::vector<Record>& all, std::vector<Group>* groups);
  static void ChooseOwners(const std::vector<Record>& all, int num_ranks,
                           std::vector<Group>* groups);
  static std::int64_t SizeOf(const Record& record, int kind);
  Status Number(const Communicator& ranks, const std::vector<Record>& all);
  void Place(const Group& group, const std::vector<Record>& all, int rank, int kind,
             std::int64_t at);
  void CountFrames(const std::vector<Group>& groups, const std::vector<Record>& all, int rank);
  void Keep(const GraphPart& part, const Layout& layout, int rank);

  std::vector<FramePlace> numbered_;  // of this rank, in the order of its part
  std::vector<FramePlace> moving_;
  std::vector<FramePlace> idle_;
  std::vector<int> owned_;
  std::int64_t owned_size_[3] = {0, 0, 0};
  std::int64_t total_size_[3] = {0, 0, 0};
  std::vector<int> sizes_;
};

}  // namespace inceres::internal
