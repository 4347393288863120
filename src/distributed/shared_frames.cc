#include "distributed/shared_frames.h"

#include <algorithm>
#include <numeric>
#include <string>

#include "distributed/checkpoint.h"
#include "simd/kernels.h"

namespace inceres::internal {

// Which frames the ranks have in common. A frame is known by an id; each rank lists those it has.
// All lists go to all ranks, as records of 48 bytes, are sorted by id and rank, and every rank
// draws the same conclusions from them: whether the lists fit together, which frames move, who owns
// each, and where each lies in the vectors of all ranks.
//
// In those vectors the frames of a rank follow one another by ascending id, rank after rank, so a
// rank owns a contiguous range, as PETSc wants it. There are three such vectors: of tangent sizes,
// of their squares and of ambient sizes.
//
// Checks matter more here than elsewhere: ranks that start a frame from different values, or of
// which only some hold it, would each minimize something else without noticing.

namespace {

std::string NameOf(std::int64_t id) {
  return "frame " + std::to_string(id);
}

// How many times factors touch each variable.
std::vector<std::int64_t> CountFactorsOfVariables(const FactorGraph& graph) {
  std::vector<std::int64_t> num_factors(static_cast<std::size_t>(graph.num_variables()), 0);
  for (FamilyId f = 0; f < graph.num_families(); ++f) {
    // Variables of all factors of a family lie one after the other, so one pointer serves. A free
    // place of an edited graph has −1.
    const auto num_entries =
        static_cast<std::ptrdiff_t>(graph.NumFactors(f)) * graph.family(f).num_slots();
    const VariableId* ids = num_entries > 0 ? graph.Variables(f, 0) : nullptr;
    for (std::ptrdiff_t k = 0; k < num_entries; ++k) {
      if (ids[k] >= 0) {
        ++num_factors[static_cast<std::size_t>(ids[k])];
      }
    }
  }
  return num_factors;
}

// Whether what is listed may be a frame of this rank.
Status CheckFrame(const GlobalVariable& frame, const FactorGraph& graph, const Layout& layout) {
  if (frame.id < 0 || !graph.HasVariable(frame.variable)) {
    return Status::Error(StatusCode::kInvalidArgument,
                         NameOf(frame.id) + ", variable " + std::to_string(frame.variable) +
                             ": ids are not negative, and the variable must be in the graph");
  }
  // Landmarks come behind the frames in the layout. What does not move has −1, and may be listed.
  return layout.Position(frame.variable) < layout.num_frames
             ? Status::Ok()
             : Status::Error(StatusCode::kInvalidArgument,
                             "variable " + std::to_string(frame.variable) +
                                 " is listed as a frame, and is a landmark of this rank");
}

}  // namespace

// As it travels: without padding.
struct SharedFrames::Record {
  std::int64_t id;
  std::uint64_t values;
  std::int64_t num_factors;  // 0: no factor here touches it
  std::int32_t rank;
  std::int32_t place;  // in the part of its rank
  std::int32_t ambient_size;
  std::int32_t tangent_size;
  std::int64_t constant;
};

// The records of this rank, in the order of its part, and what can be wrong without the others:
// unknown variables, a landmark among the frames, one variable under two names, a frame that moves
// and has no name.
Status SharedFrames::Collect(const GraphPart& part, const Layout& layout,
                             std::vector<Record>* own) const {
  const FactorGraph& graph = *part.graph;
  const std::vector<std::int64_t> num_factors = CountFactorsOfVariables(graph);
  std::vector<char> listed(num_factors.size(), 0);
  for (const GlobalVariable& frame : part.frames) {
    const Status status = CheckFrame(frame, graph, layout);
    if (!status.ok()) {
      return status;
    }
    char& seen = listed[static_cast<std::size_t>(frame.variable)];
    if (seen != 0) {
      return Status::Error(StatusCode::kInvalidArgument,
                           "variable " + std::to_string(frame.variable) + " is listed twice");
    }
    seen = 1;
    Record record{};
    record.id = frame.id;
    record.ambient_size = graph.AmbientSize(frame.variable);
    record.tangent_size = graph.TangentSize(frame.variable);
    // Compared by a sum over their bits, which is of fixed length. So −0 and 0 differ.
    record.values = ChecksumOf(reinterpret_cast<const char*>(graph.Values(frame.variable)),
                               static_cast<std::size_t>(record.ambient_size) * sizeof(double));
    record.num_factors = num_factors[static_cast<std::size_t>(frame.variable)];
    record.place = static_cast<std::int32_t>(own->size());
    record.constant = graph.IsConstant(frame.variable) ? 1 : 0;
    own->push_back(record);
  }
  for (int i = 0; i < layout.num_frames; ++i) {
    const VariableId id = layout.variables[static_cast<std::size_t>(i)];
    if (listed[static_cast<std::size_t>(id)] == 0) {
      return Status::Error(StatusCode::kInvalidArgument,
                           "variable " + std::to_string(id) +
                               " is a frame that moves, and is not listed in GraphPart::frames");
    }
  }
  return Status::Ok();
}

// Collective: one gathering of all lists. From the sorted list on everything is computed by each
// rank for itself, errors included, with the same result.
Status SharedFrames::Agree(const Communicator& ranks, const GraphPart& part, const Layout& layout) {
  std::vector<Record> own;
  Status status = ranks.Try([&] { return Collect(part, layout, &own); });
  if (!status.ok()) {
    return status;
  }
  for (Record& record : own) {
    record.rank = ranks.rank();
  }
  std::vector<Record> all = ranks.GatherAll(own);
  std::sort(all.begin(), all.end(), [](const Record& a, const Record& b) {
    return a.id != b.id ? a.id < b.id : a.rank < b.rank;
  });
  // One for each entry of the part, in its order; Record::place refers to it.
  numbered_.assign(own.size(), FramePlace());
  status = Number(ranks, all);
  if (status.ok()) {
    Keep(part, layout, ranks.rank());
  }
  return status;
}

// The records of one frame.
// All ranks that list it, a range of the sorted records.
struct SharedFrames::Group {
  std::size_t begin;
  std::size_t end;
  int num_sharers;  // ranks with factors of it
  int owner;
  const Record* own;  // that of this rank; null: it does not list the frame
};

// What of a record is not as the first one has it: words to stand before two ranks; or null.
const char* SharedFrames::FindDifference(const Record& first, const Record& record) {
  if (record.ambient_size != first.ambient_size || record.tangent_size != first.tangent_size) {
    return " has another size on rank ";
  }
  if (record.constant != first.constant) {
    return " is constant on only one of rank ";
  }
  return record.values != first.values ? " starts from other values on rank " : nullptr;
}

Status SharedFrames::FindGroups(const std::vector<Record>& all, int rank,
                                std::vector<Group>* groups) {
  for (std::size_t begin = 0; begin < all.size();) {
    const Record& first = all[begin];
    Group group{begin, begin, 0, -1, nullptr};
    for (; group.end < all.size() && all[group.end].id == first.id; ++group.end) {
      const Record& record = all[group.end];
      // Records of one frame are sorted by rank, so the same rank twice stands next to itself.
      if (group.end > begin && all[group.end - 1].rank == record.rank) {
        return Status::Error(
            StatusCode::kInvalidArgument,
            NameOf(first.id) + " is listed twice by rank " + std::to_string(record.rank));
      }
      if (const char* differs = FindDifference(first, record)) {
        return Status::Error(StatusCode::kInvalidArgument,
                             NameOf(first.id) + differs + std::to_string(record.rank) +
                                 " and rank " + std::to_string(first.rank));
      }
      group.num_sharers += record.num_factors > 0 ? 1 : 0;
      group.own = record.rank == rank ? &record : group.own;
    }
    // Frames that are constant, or that no factor of any rank touches, are checked and then left
    // out: nobody owns them.
    if (group.num_sharers > 0 && first.constant == 0) {
      groups->push_back(group);
    }
    begin = group.end;
  }
  return Status::Ok();
}

// Only ranks with factors of a frame can own it. Groups are by ascending id and records by
// ascending rank, as ChooseFrameOwners expects; balance is by tangent sizes, which a product sends.
void SharedFrames::ChooseOwners(const std::vector<Record>& all, int num_ranks,
                                std::vector<Group>* groups) {
  std::vector<int> sizes;
  std::vector<FrameSharer> sharers;
  for (const Group& group : *groups) {
    for (std::size_t k = group.begin; k < group.end; ++k) {
      if (all[k].num_factors > 0) {
        sharers.push_back({static_cast<int>(sizes.size()), all[k].rank, all[k].num_factors});
      }
    }
    sizes.push_back(all[group.begin].tangent_size);
  }
  const std::vector<int> owners = ChooseFrameOwners(sizes, sharers, num_ranks);
  for (std::size_t i = 0; i < owners.size(); ++i) {
    (*groups)[i].owner = owners[i];
  }
}

// Of a frame in each of the three vectors.
std::int64_t SharedFrames::SizeOf(const Record& record, int kind) {
  const std::int64_t d = record.tangent_size;
  return kind == FramePlace::kTangent  ? d
         : kind == FramePlace::kSquare ? d * d
                                       : record.ambient_size;
}

// All ranks number the same records, so nothing needs to be agreed on.
Status SharedFrames::Number(const Communicator& ranks, const std::vector<Record>& all) {
  std::vector<Group> groups;
  Status status = FindGroups(all, ranks.rank(), &groups);
  if (!status.ok()) {
    return status;
  }
  ChooseOwners(all, ranks.size(), &groups);
  // All frames that move are numbered by ascending id, whoever owns them: what patterns and sums
  // over all frames are by.
  sizes_.clear();
  for (const Group& group : groups) {
    if (group.own != nullptr) {
      FramePlace& place = numbered_[static_cast<std::size_t>(group.own->place)];
      place.number = static_cast<int>(sizes_.size());
      place.owner = group.owner;
      // Ranks with factors, without this one.
      place.num_others = group.num_sharers - (group.own->num_factors > 0 ? 1 : 0);
    }
    sizes_.push_back(all[group.begin].tangent_size);
  }
  // A counting sort by owner: sizes first, one rank further; their sums are where each rank begins;
  // then each frame takes the next place of its owner, by ascending id.
  for (int kind = 0; kind < 3; ++kind) {
    std::vector<std::int64_t> next(static_cast<std::size_t>(ranks.size()) + 1, 0);
    for (const Group& group : groups) {
      next[static_cast<std::size_t>(group.owner) + 1] += SizeOf(all[group.begin], kind);
    }
    std::partial_sum(next.begin(), next.end(), next.begin());  // where each rank begins
    const auto own = static_cast<std::size_t>(ranks.rank());
    owned_size_[kind] = next[own + 1] - next[own];
    owned_begin_[kind] = next[own];
    total_size_[kind] = next.back();
    for (const Group& group : groups) {
      std::int64_t& at = next[static_cast<std::size_t>(group.owner)];
      if (group.own != nullptr) {
        numbered_[static_cast<std::size_t>(group.own->place)].begin[kind] = at;
      }
      at += SizeOf(all[group.begin], kind);
    }
  }
  return status;
}

// Sorts the entries of this rank into those that the layout has, by position, and those that move
// elsewhere only. An entry without an owner moves nowhere, and is neither.
void SharedFrames::Keep(const GraphPart& part, const Layout& layout, int rank) {
  moving_.assign(static_cast<std::size_t>(layout.num_frames), FramePlace());
  for (std::size_t k = 0; k < numbered_.size(); ++k) {
    FramePlace& place = numbered_[k];
    place.id = part.frames[k].id;
    place.variable = part.frames[k].variable;
    const int d = part.graph->TangentSize(place.variable);
    place.sizes[FramePlace::kTangent] = d;
    place.sizes[FramePlace::kSquare] = d * d;
    place.sizes[FramePlace::kAmbient] = part.graph->AmbientSize(place.variable);
    const int position = layout.Position(place.variable);
    if (position >= 0) {
      moving_[static_cast<std::size_t>(position)] = place;
      if (place.owner == rank) {
        owned_.push_back(position);
      }
    } else if (place.owner >= 0) {
      idle_.push_back(place);
    }
  }
  // The vectors of owned entries are in this order.
  std::sort(owned_.begin(), owned_.end(), [this](int a, int b) {
    return moving_[static_cast<std::size_t>(a)].id < moving_[static_cast<std::size_t>(b)].id;
  });
  row_of_number_.assign(sizes_.size(), -1);
  for (const int position : owned_) {
    const FramePlace& place = moving_[static_cast<std::size_t>(position)];
    row_of_number_[static_cast<std::size_t>(place.number)] =
        static_cast<int>(owned_offsets_.size()) - 1;
    const int size = place.sizes[FramePlace::kTangent];
    owned_offsets_.push_back(owned_offsets_.back() + size);
    padded_owned_size_ += static_cast<std::size_t>(PadToQuad(size));
  }
}

}  // namespace inceres::internal
