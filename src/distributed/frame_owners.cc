#include <algorithm>
#include <cstddef>

#include "distributed/shared_frames.h"

namespace inceres::internal {

// Who owns which frame: a greedy balance. What is sent for a frame in a product does not depend on
// its owner, 2 (h − 1) times its entries for h ranks; who sends it does. The owner sends the sum to
// h − 1 ranks, each other one its part to the owner, so ownership costs h − 2 times the entries
// more. For h > 2 the balance is of these extra entries, relative to what a rank shares: one that
// shares little has little to send anyway. Frames of one rank, or of two, cost no more whoever owns
// them, and even out how much each rank owns.
//
// Pure arithmetic on records that all ranks have: each computes the same owners for itself. Ties go
// to the rank with more factors of the frame, then to the lower rank, so the result depends on
// nothing else.

namespace {

struct Load {
  double shared = 0.0;  // entries of frames that others have too
  double more = 0.0;    // sent for frames owned here that somebody else could own
  double owned = 0.0;

  // With a frame of h ranks more: what is to be equal for all. Owning it costs h − 2 of its entries
  // more than not to; of two ranks both send the same.
  // `shared` is positive for whoever shares a frame with two others.
  double With(double entries, int num_sharers) const {
    return num_sharers > 2 ? (more + entries * (num_sharers - 2)) / shared : owned;
  }
};

// The sharers of one frame, which are consecutive.
struct Group {
  int frame;
  const FrameSharer* begin;
  const FrameSharer* end;

  int size() const { return static_cast<int>(end - begin); }
};

// One pass; sharers come by ascending frame.
std::vector<Group> GroupByFrame(const std::vector<FrameSharer>& sharers) {
  std::vector<Group> groups;
  const FrameSharer* const end = sharers.data() + sharers.size();
  for (const FrameSharer* next = sharers.data(); next != end;) {
    Group group{next->frame, next, next};
    while (group.end != end && group.end->frame == group.frame) {
      ++group.end;
    }
    next = group.end;
    groups.push_back(group);
  }
  return groups;
}

// The one with least, of equals the one with more of its factors.
// min_element keeps the first of equals, and sharers of a frame come by ascending rank.
int FindOwner(const Group& group, double entries, const std::vector<Load>& loads) {
  const auto load_of = [&](const FrameSharer& sharer) {
    return loads[static_cast<std::size_t>(sharer.rank)].With(entries, group.size());
  };
  return std::min_element(group.begin, group.end,
                          [&](const FrameSharer& a, const FrameSharer& b) {
                            return load_of(a) != load_of(b) ? load_of(a) < load_of(b)
                                                            : a.num_factors > b.num_factors;
                          })
      ->rank;
}

}  // namespace

// Frames of many ranks first: those of few even out what is left.
std::vector<int> ChooseFrameOwners(const std::vector<int>& sizes,
                                   const std::vector<FrameSharer>& sharers, int num_ranks) {
  std::vector<Group> groups = GroupByFrame(sharers);
  std::vector<Load> loads(static_cast<std::size_t>(num_ranks));
  for (const Group& group : groups) {
    // First what each rank shares in all: the denominators do not change while owners are chosen.
    for (const FrameSharer* sharer = group.begin; group.size() > 1 && sharer != group.end;
         ++sharer) {
      loads[static_cast<std::size_t>(sharer->rank)].shared +=
          sizes[static_cast<std::size_t>(group.frame)];
    }
  }
  // Stable: of as many sharers by ascending frame, on all ranks.
  std::stable_sort(groups.begin(), groups.end(),
                   [](const Group& a, const Group& b) { return a.size() > b.size(); });
  std::vector<int> owners(sizes.size(), -1);
  for (const Group& group : groups) {
    const auto frame = static_cast<std::size_t>(group.frame);
    const double entries = sizes[frame];
    owners[frame] = FindOwner(group, entries, loads);
    Load& load = loads[static_cast<std::size_t>(owners[frame])];
    // Nothing for frames of one or two ranks.
    load.more += entries * std::max(0, group.size() - 2);
    load.owned += entries;
  }
  return owners;
}

}  // namespace inceres::internal
