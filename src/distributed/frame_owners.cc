#include "distributed/frame_owners.h"

#include <algorithm>
#include <cstddef>

namespace inceres::internal {
namespace {

struct Load {
  double shared = 0.0;  // entries of frames that others have too
  double more = 0.0;    // sent for frames owned here that somebody else could own
  double owned = 0.0;

  // With a frame of h ranks more: what is to be equal for all. Owning it costs h − 2 of its entries
  // more than not to; of two ranks both send the same.
  double With(double entries, int num_sharers) const {
    return num_sharers > 2 ? (more + entries * (num_sharers - 2)) / shared : owned;
  }
};

struct Group {
  int frame;
  const FrameSharer* begin;
  const FrameSharer* end;

  int size() const { return static_cast<int>(end - begin); }
};

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
    for (const FrameSharer* sharer = group.begin; group.size() > 1 && sharer != group.end;
         ++sharer) {
      loads[static_cast<std::size_t>(sharer->rank)].shared +=
          sizes[static_cast<std::size_t>(group.frame)];
    }
  }
  std::stable_sort(groups.begin(), groups.end(),
                   [](const Group& a, const Group& b) { return a.size() > b.size(); });
  std::vector<int> owners(sizes.size(), -1);
  for (const Group& group : groups) {
    const auto frame = static_cast<std::size_t>(group.frame);
    const double entries = sizes[frame];
    owners[frame] = FindOwner(group, entries, loads);
    Load& load = loads[static_cast<std::size_t>(owners[frame])];
    load.more += entries * std::max(0, group.size() - 2);
    load.owned += entries;
  }
  return owners;
}

}  // namespace inceres::internal
