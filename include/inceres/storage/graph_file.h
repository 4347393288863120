#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "inceres/export.h"
#include "inceres/io/read_options.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/status.h"
#include "inceres/storage/graph_formats.h"

namespace inceres {

/// The families of a graph that was loaded, by FamilyId, to be added to.
struct LoadedFamilies {
  /// By FamilyId; null for a family that the graph was saved without.
  std::vector<std::shared_ptr<FactorFamily>> families;

  /// The handle of a family whose type is known; of id −1 if there is none or it is of another
  /// type.
  template <typename Family>
  FamilyHandle<Family> Handle(FamilyId id) const {
    const bool known = id >= 0 && id < static_cast<FamilyId>(families.size());
    auto family =
        known ? std::dynamic_pointer_cast<Family>(families[static_cast<std::size_t>(id)]) : nullptr;
    return family == nullptr ? FamilyHandle<Family>() : FamilyHandle<Family>{id, std::move(family)};
  }
};

/// Writes a graph with everything it owns to a file, compressed if the name ends in .gz or .bz2:
/// variables with their values, manifolds, roles, constants, bounds and pins; families with their
/// measurements; factors with their losses; and which ids and places are free, in the order in
/// which edits will take them again. A graph that was loaded goes on as the saved one would have:
/// the same ids, the same bits.
///
/// Not kept: the values of a borrowed constant are, as a constant that the graph owns (its values
/// in the state come with it); names of variables (SetVariableNames); ids of factors that a
/// GraphEdit began with. Manifolds and losses that were shared stay shared.
///
/// Errors: what Validate says of the graph; kInvalidArgument for a type without a format, named;
/// kIo as WriteBal has them: nothing of a file that fails is left under its name.
///
/// The format: "INCEREGR", a version (1), size and CRC-32 of the rest; numbers little-endian. A
/// program reads files of its own version and earlier ones. Cost: the file in memory, and one pass.
INCERES_EXPORT Status SaveGraph(const std::string& path, const FactorGraph& graph,
                                const GraphFormats& formats = GraphFormats());

/// Reads what SaveGraph wrote. Files may come from anyone: every count is held against what is left
/// of the file before memory is asked for it, and what was read passes FactorGraph::Validate, or is
/// refused; no code is loaded. Memory is within a small multiple of the file's size, unpacked.
///
/// kIo, with the file, for one that is missing, no saved graph, of a later version, truncated, or
/// damaged (the checksum does not match), and for anything inside that cannot be, by what it is;
/// kUnavailable, with its name, for a format that is not known. On an error `graph` and `families`
/// are unchanged; both are replaced otherwise. `families` may be null.
INCERES_EXPORT Status LoadGraph(const std::string& path, FactorGraph* graph,
                                LoadedFamilies* families = nullptr,
                                const GraphFormats& formats = GraphFormats(),
                                const ReadOptions& options = ReadOptions());

/// The same to and from memory, not compressed.
INCERES_EXPORT Status SaveGraphToBytes(const FactorGraph& graph, const GraphFormats& formats,
                                       std::string* bytes);
/// Reads what SaveGraphToBytes has written; as LoadGraph otherwise.
INCERES_EXPORT Status LoadGraphFromBytes(const std::string& bytes, const GraphFormats& formats,
                                         FactorGraph* graph, LoadedFamilies* families = nullptr);

}  // namespace inceres
