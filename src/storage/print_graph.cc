#include <algorithm>
#include <cstddef>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "inceres/storage/graph_formats.h"
#include "storage/graph_layout.h"

// Writes the parts of a graph (graph_layout.h has their order; parse_graph.cc reads them). What
// variables and factors share is written once and named by number, so that it is shared again when
// it is loaded. Ids and places that are free are written in the order in which they will be given
// out: edits of the loaded graph then get the ids that edits of the saved one would, which keeps
// the order of sums, and thereby every bit.

namespace inceres::internal {
namespace {

// Objects that others share, each once and by its number.
template <typename T>
class Shared {
 public:
  /// −1 of null.
  // Numbers follow the order of first use, not of addresses, which change from run to run: the same
  // graph gives the same bytes.
  std::int32_t Add(const T* object) {
    if (object == nullptr) {
      return -1;
    }
    const auto added = numbers_.emplace(object, static_cast<std::int32_t>(objects_.size()));
    if (added.second) {
      objects_.push_back(object);
    }
    return added.first->second;
  }
  void Print(const std::string& kind, GraphWriter* writer) const {
    writer->WriteLong(static_cast<std::int64_t>(objects_.size()));
    for (std::size_t k = 0; k < objects_.size(); ++k) {
      writer->formats().Write(*objects_[k], kind + " " + std::to_string(k), writer);
    }
  }

 private:
  // By identity: two equal losses are two objects.
  std::map<const T*, std::int32_t> numbers_;
  std::vector<const T*> objects_;
};

// Reads the graph by its public calls alone, so what is written does not depend on how it is kept
// in memory.
class GraphPrinter {
 public:
  GraphPrinter(const FactorGraph& graph, GraphWriter* writer) : graph_(graph), writer_(*writer) {}

  // Collects first, since the objects stand in the file before those that name them. Printing then
  // calls Add again, which by now only looks a number up.
  void Print() {
    Collect();
    manifolds_.Print("manifold", &writer_);
    losses_.Print("loss", &writer_);
    PrintVariables();
    PrintBoundsAndPins();
    PrintFreeVariables();
    writer_.WriteLong(graph_.num_families());
    for (FamilyId id = 0; id < graph_.num_families(); ++id) {
      PrintFamily(id);
    }
    // Nothing at all where there are none: such a file is as it was before groups.
    if (graph_.HasEliminationGroups()) {
      PrintThoseThatHave(
          true, [this](VariableId id) { return graph_.elimination_group(id) != 0; },
          [this](VariableId id) { writer_.WriteInt(graph_.elimination_group(id)); });
    }
  }

 private:
  void Collect();
  void PrintVariables();
  // Of the few variables that have something their number, and each with what write(id) adds to its
  // id. Without `any` there are none: most graphs need no walk.
  template <typename Has, typename Write>
  void PrintThoseThatHave(bool any, const Has& has, const Write& write);
  void PrintBoundsAndPins();
  void PrintFreeVariables();
  void PrintFamily(FamilyId id);
  std::size_t SizeOf(VariableId id) const {
    return static_cast<std::size_t>(graph_.AmbientSize(id));
  }

  const FactorGraph& graph_;
  GraphWriter& writer_;
  Shared<Manifold> manifolds_;
  Shared<Loss> losses_;
};

void GraphPrinter::Collect() {
  for (VariableId id = 0; id < graph_.num_variables(); ++id) {
    // Variables first, then factors, by their ids: the order of first use is that of the graph.
    manifolds_.Add(graph_.manifold(id));
  }
  for (FamilyId id = 0; id < graph_.num_families(); ++id) {
    for (int factor = 0; graph_.HasLosses(id) && factor < graph_.NumFactors(id); ++factor) {
      losses_.Add(graph_.loss(id, factor));
    }
  }
}

void GraphPrinter::PrintVariables() {
  writer_.WriteLong(graph_.num_variables());
  for (VariableId id = 0; id < graph_.num_variables(); ++id) {
    // Removed variables keep their ids and their room in the state.
    const bool exists = graph_.HasVariable(id);
    // IsConstant is true of a tangent space of size 0 too, which may be the manifold's.
    writer_.WriteByte(static_cast<std::uint8_t>(
        (graph_.role(id) == Role::kLandmark ? kIsLandmark : 0) |
        (graph_.IsConstant(id) ? kIsConstant : 0) | (exists ? 0 : kIsRemoved)));
    writer_.WriteInt(graph_.AmbientSize(id));
    writer_.WriteInt(manifolds_.Add(graph_.manifold(id)));
  }
  for (VariableId id = 0; id < graph_.num_variables(); ++id) {
    // Values, not the state: those of a borrowed constant are elsewhere.
    if (graph_.HasVariable(id)) {
      writer_.WriteDoubles(graph_.Values(id), SizeOf(id));
    } else {
      // As the state has it: the room of a removed variable holds zeros.
      writer_.WriteDoubles(std::vector<double>(SizeOf(id), 0.0).data(), SizeOf(id));
    }
  }
}

template <typename Has, typename Write>
void GraphPrinter::PrintThoseThatHave(bool any, const Has& has, const Write& write) {
  // Listed first, since their number stands before them.
  std::vector<VariableId> ids;
  for (VariableId id = 0; any && id < graph_.num_variables(); ++id) {
    if (has(id)) {
      ids.push_back(id);
    }
  }
  writer_.WriteLong(static_cast<std::int64_t>(ids.size()));
  for (const VariableId id : ids) {
    writer_.WriteInt(id);
    write(id);
  }
}

void GraphPrinter::PrintBoundsAndPins() {
  PrintThoseThatHave(
      graph_.HasBounds(), [this](VariableId id) { return graph_.bounds(id) != nullptr; },
      [this](VariableId id) {
        writer_.WriteDoubles(graph_.bounds(id)->lower.data(), SizeOf(id));
        writer_.WriteDoubles(graph_.bounds(id)->upper.data(), SizeOf(id));
      });
  // The values that a pinned variable is linearized at.
  PrintThoseThatHave(
      graph_.HasPins(), [this](VariableId id) { return graph_.PinnedValues(id) != nullptr; },
      [this](VariableId id) { writer_.WriteDoubles(graph_.PinnedValues(id), SizeOf(id)); });
}

// Of each size those that were borrowed first: what is loaded owns all, and takes the last first.
void GraphPrinter::PrintFreeVariables() {
  // Ids are free for variables of their own size only; by size, ascending, for the same bytes each
  // time.
  std::set<int> sizes;
  for (VariableId id = 0; id < graph_.num_variables(); ++id) {
    if (!graph_.HasVariable(id)) {
      sizes.insert(graph_.AmbientSize(id));
    }
  }
  std::vector<VariableId> last_first;
  for (const int size : sizes) {
    for (const bool borrowed : {false, true}) {
      VariableId id = 0;
      // The graph tells the next one to be given out first; GraphParts keeps that one last: hence
      // written backwards.
      for (int k = 0; (id = graph_.FreeVariable(size, borrowed, k)) >= 0; ++k) {
        last_first.push_back(id);
      }
    }
  }
  writer_.WriteLong(static_cast<std::int64_t>(last_first.size()));
  std::for_each(last_first.rbegin(), last_first.rend(),
                [this](VariableId id) { writer_.WriteInt(id); });
}

void GraphPrinter::PrintFamily(FamilyId id) {
  const FactorFamily& family = graph_.family(id);
  writer_.formats().Write(family, "family " + std::to_string(id) + " (" + family.Name() + ")",
                          &writer_);
  // Places, free ones included, whose variables are −1.
  const int num_factors = graph_.NumFactors(id);
  writer_.WriteLong(num_factors);
  for (int factor = 0; factor < num_factors; ++factor) {
    const VariableId* variables = graph_.Variables(id, factor);
    std::for_each(variables, variables + family.num_slots(),
                  [this](VariableId variable) { writer_.WriteInt(variable); });
  }
  // A loss is a number per factor: a family without any says so in one byte.
  writer_.WriteByte(graph_.HasLosses(id) ? 1 : 0);
  for (int factor = 0; graph_.HasLosses(id) && factor < num_factors; ++factor) {
    writer_.WriteInt(losses_.Add(graph_.loss(id, factor)));
  }
  const int num_free = graph_.NumFreePlaces(id);
  writer_.WriteLong(num_free);
  // Backwards for the same reason.
  for (int k = num_free - 1; k >= 0; --k) {
    writer_.WriteInt(graph_.FreePlace(id, k));
  }
}

}  // namespace

void PrintGraph(const FactorGraph& graph, GraphWriter* writer) {
  GraphPrinter(graph, writer).Print();
}

}  // namespace inceres::internal
