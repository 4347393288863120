#include "distributed/shared_frames.h"

#include <algorithm>
#include <cstring>
#include <string>
#include <type_traits>

namespace inceres::internal {
namespace {

// FNV-1a over the bits of the values.
std::uint64_t HashOf(const double* values, int count) {
  std::uint64_t hash = 0xcbf29ce484222325U;
  for (int k = 0; k < count; ++k) {
    std::uint64_t bits = 0;
    std::memcpy(&bits, values + k, sizeof bits);
    for (int byte = 0; byte < 8; ++byte, bits >>= 8) {
      hash = (hash ^ (bits & 0xff)) * 0x100000001b3U;
    }
  }
  return hash;
}

std::string NameOf(std::int64_t id) {
  return "frame " + std::to_string(id);
}

}  // namespace

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

Status SharedFrames::Collect(const GraphPart& part, const Layout& layout,
                             std::vector<Record>* own) const {
  const FactorGraph& graph = *part.graph;
  std::vector<std::int64_t> num_factors(static_cast<std::size_t>(graph.num_variables()), 0);
  for (FamilyId f = 0; f < graph.num_families(); ++f) {
    const auto num_entries =
        static_cast<std::ptrdiff_t>(graph.NumFactors(f)) * graph.family(f).num_slots();
    const VariableId* ids = num_entries > 0 ? graph.Variables(f, 0) : nullptr;
    for (std::ptrdiff_t k = 0; k < num_entries; ++k) {
      if (ids[k] >= 0) {
        ++num_factors[static_cast<std::size_t>(ids[k])];
      }
    }
  }
  std::vector<char> listed(num_factors.size(), 0);
  for (const GlobalVariable& frame : part.frames) {
    if (frame.id < 0 || !graph.HasVariable(frame.variable)) {
      return Status::Error(StatusCode::kInvalidArgument,
                           NameOf(frame.id) + ", variable " + std::to_string(frame.variable) +
                               ": ids are not negative, and the variable must be in the graph");
    }
    if (layout.Position(frame.variable) >= layout.num_frames) {
      return Status::Error(StatusCode::kInvalidArgument,
                           "variable " + std::to_string(frame.variable) +
                               " is listed as a frame, and is a landmark of this rank");
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
    record.values = HashOf(graph.Values(frame.variable), record.ambient_size);
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

Status SharedFrames::Agree(const Communicator& ranks, const GraphPart& part, const Layout& layout) {
  std::vector<Record> own;
  Status status = ranks.Try([&] { return Collect(part, layout, &own); });
  if (!status.ok()) {
    return status;
  }
  static_assert(std::is_trivially_copyable_v<Record>);
  std::vector<char> bytes(own.size() * sizeof(Record));
  for (Record& record : own) {
    record.rank = ranks.rank();
  }
  if (!own.empty()) {
    std::memcpy(bytes.data(), own.data(), bytes.size());
  }
  const std::vector<char> gathered = ranks.GatherBytes(bytes);
  std::vector<Record> all(gathered.size() / sizeof(Record));
  if (!all.empty()) {
    std::memcpy(all.data(), gathered.data(), gathered.size());
  }
  std::sort(all.begin(), all.end(), [](const Record& a, const Record& b) {
    return a.id != b.id ? a.id < b.id : a.rank < b.rank;
  });
  numbered_.assign(own.size(), FramePlace());
  status = Number(ranks, all);
  if (status.ok()) {
    Keep(part, layout, ranks.rank());
  }
  return status;
}

// All ranks number the same records, so nothing needs to be agreed on.
Status SharedFrames::Number(const Communicator& ranks, const std::vector<Record>& all) {
  struct Group {
    std::size_t begin;
    std::size_t end;
    int owner;
    int num_sharers;
  };
  std::vector<Group> groups;
  std::vector<std::int64_t> next(3 * static_cast<std::size_t>(ranks.size()) + 3, 0);
  const auto sizes_of = [](const Record& record, int kind) -> std::int64_t {
    const std::int64_t d = record.tangent_size;
    return kind == FramePlace::kTangent  ? d
           : kind == FramePlace::kSquare ? d * d
                                         : record.ambient_size;
  };
  for (std::size_t begin = 0; begin < all.size();) {
    const Record& first = all[begin];
    Group group{begin, begin, -1, 0};
    std::int64_t most = 0;
    for (; group.end < all.size() && all[group.end].id == first.id; ++group.end) {
      const Record& record = all[group.end];
      const char* differs =
          record.ambient_size != first.ambient_size || record.tangent_size != first.tangent_size
              ? " has another size on rank "
          : record.constant != first.constant ? " is constant on only one of rank "
          : record.values != first.values     ? " starts from other values on rank "
                                              : nullptr;
      if (differs == nullptr && group.end > begin && record.rank == all[group.end - 1].rank) {
        differs = " is listed twice, by rank ";
      }
      if (differs != nullptr) {
        return Status::Error(StatusCode::kInvalidArgument,
                             NameOf(first.id) + differs + std::to_string(record.rank) +
                                 " and rank " + std::to_string(first.rank));
      }
      group.num_sharers += record.num_factors > 0 ? 1 : 0;
      if (record.num_factors > most) {
        most = record.num_factors;
        group.owner = record.rank;
      }
    }
    if (group.owner >= 0 && first.constant == 0) {
      for (int kind = 0; kind < 3; ++kind) {
        next[static_cast<std::size_t>(3 * (group.owner + 1) + kind)] += sizes_of(first, kind);
      }
      groups.push_back(group);
    }
    begin = group.end;
  }
  for (std::size_t k = 3; k < next.size(); ++k) {
    next[k] += next[k - 3];  // where each rank begins
  }
  num_frames_ = static_cast<std::int64_t>(groups.size());
  for (int kind = 0; kind < 3; ++kind) {
    const auto k = static_cast<std::size_t>(3 * ranks.rank() + kind);
    owned_size_[kind] = next[k + 3] - next[k];
    total_size_[kind] = next[next.size() - 3 + static_cast<std::size_t>(kind)];
  }
  for (const Group& group : groups) {
    std::int64_t* const at = next.data() + static_cast<std::ptrdiff_t>(3) * group.owner;
    for (std::size_t k = group.begin; k < group.end; ++k) {
      if (all[k].rank == ranks.rank()) {
        FramePlace& place = numbered_[static_cast<std::size_t>(all[k].place)];
        place.owner = group.owner;
        std::copy(at, at + 3, place.begin);
        place.num_others = group.num_sharers - (all[k].num_factors > 0 ? 1 : 0);
      }
    }
    for (int kind = 0; kind < 3; ++kind) {
      at[kind] += sizes_of(all[group.begin], kind);
    }
  }
  return Status::Ok();
}

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
  std::sort(owned_.begin(), owned_.end(), [this](int a, int b) {
    return moving_[static_cast<std::size_t>(a)].id < moving_[static_cast<std::size_t>(b)].id;
  });
}

}  // namespace inceres::internal
