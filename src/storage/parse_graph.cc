#include "storage/parse_graph.h"

#include <cstdint>
#include <string>
#include <utility>

#include "inceres/storage/graph_formats.h"
#include "storage/print_graph.h"

// Reads the parts of a graph in the order in which print_graph.cc writes them. A parser takes care
// of one thing only: that nothing in the bytes makes it ask for too much memory or look where there
// is nothing. Whether ids, sizes and factors fit together is for GraphRestorer to judge, which sees
// all parts.
//
// Each ReadCount is told the least that one item takes in the file; the number of items is then at
// most the file's size through that.

namespace inceres::internal {
namespace {

class GraphParser {
 public:
  GraphParser(GraphReader* reader, GraphParts* parts,
              std::vector<std::shared_ptr<FactorFamily>>* families)
      : reader_(*reader), parts_(*parts), families_(*families) {}

  void Parse() {
    // An object takes a name's length and its own length at least: 16 bytes.
    const std::size_t num_manifolds = reader_.ReadCount(16);
    // Failures name an object by its number in the file, which those that refer to it use too.
    for (std::size_t k = 0; k < num_manifolds && reader_.ok(); ++k) {
      manifolds_.push_back(
          reader_.formats().ReadManifold("manifold " + std::to_string(k), &reader_));
    }
    const std::size_t num_losses = reader_.ReadCount(16);
    for (std::size_t k = 0; k < num_losses && reader_.ok(); ++k) {
      losses_.push_back(reader_.formats().ReadLoss("loss " + std::to_string(k), &reader_));
    }
    // Shared objects come before variables and factors, which name them by number; variables before
    // what belongs to some of them.
    ParseVariables();
    ParseBounds();
    ParsePins();
    // In the order in which edits will take them, the last one first.
    parts_.free_variables = ParseIds(reader_.ReadCount(4));
    // A family is an object too: 16 bytes at least.
    const std::size_t num_families = reader_.ReadCount(16);
    for (std::size_t k = 0; k < num_families && reader_.ok(); ++k) {
      ParseFamily();
    }
    if (reader_.ok() && reader_.remaining() > 0) {
      ParseGroups();
    }
    if (reader_.ok() && reader_.remaining() > 0) {
      reader_.Fail(std::to_string(reader_.remaining()) + " bytes are left over");
    }
  }

 private:
  void ParseVariables();
  void ParseBounds();
  void ParsePins();
  void ParseFamily();
  void ParseGroups();
  std::vector<std::int32_t> ParseIds(std::size_t count);
  // The ambient size of a variable whose id is read; 0 after a failure.
  std::size_t ParseSizeOf(VariableId* id);
  // The object of a number that is read; null for −1.
  template <typename T>
  std::shared_ptr<const T> ParseShared(const std::vector<std::shared_ptr<const T>>& objects,
                                       const char* what);

  GraphReader& reader_;
  GraphParts& parts_;
  std::vector<std::shared_ptr<FactorFamily>>& families_;
  std::vector<std::shared_ptr<const Manifold>> manifolds_;
  std::vector<std::shared_ptr<const Loss>> losses_;
};

template <typename T>
std::shared_ptr<const T> GraphParser::ParseShared(
    const std::vector<std::shared_ptr<const T>>& objects, const char* what) {
  // Without any objects in the file, only −1 passes.
  const std::int32_t number =
      reader_.ReadIntIn(-1, static_cast<std::int32_t>(objects.size()) - 1, what);
  return number < 0 ? nullptr : objects[static_cast<std::size_t>(number)];
}

// As many as ReadCount has found room for.
std::vector<std::int32_t> GraphParser::ParseIds(std::size_t count) {
  std::vector<std::int32_t> ids(count);
  for (std::int32_t& id : ids) {
    id = reader_.ReadInt();
  }
  return ids;
}

// A byte of flags, a size and the number of a manifold each; then the values of all.
void GraphParser::ParseVariables() {
  const std::size_t count = reader_.ReadCount(9);
  if (count > static_cast<std::size_t>(INT32_MAX)) {
    reader_.Fail("more variables than a graph can have");
    return;
  }
  std::size_t num_values = 0;
  for (std::size_t k = 0; k < count && reader_.ok(); ++k) {
    GraphParts::Variable variable;
    // Unknown bits are ignored: version 1 has three.
    const std::uint8_t flags = reader_.ReadByte();
    variable.role = (flags & kIsLandmark) != 0 ? Role::kLandmark : Role::kFrame;
    variable.constant = (flags & kIsConstant) != 0;
    variable.removed = (flags & kIsRemoved) != 0;
    // The sum of sizes cannot overflow 64 bits: at most 2^31 variables of 2^30 values.
    variable.ambient_size = reader_.ReadIntIn(1, 1 << 30, "the size of a variable");
    variable.manifold = ParseShared(manifolds_, "the number of a manifold");
    num_values += static_cast<std::size_t>(variable.ambient_size);
    parts_.variables.push_back(std::move(variable));
  }
  // Fails if the sizes add up to more values than there are.
  parts_.state = reader_.ReadVector(num_values);
}

std::size_t GraphParser::ParseSizeOf(VariableId* id) {
  const auto num_variables = static_cast<std::int32_t>(parts_.variables.size());
  *id = reader_.ReadIntIn(0, num_variables - 1, "a variable");
  return reader_.ok() ? static_cast<std::size_t>(
                            parts_.variables[static_cast<std::size_t>(*id)].ambient_size)
                      : 0;
}

// An id and at least one value each of two bounds: 20 bytes.
void GraphParser::ParseBounds() {
  const std::size_t count = reader_.ReadCount(20);
  for (std::size_t k = 0; k < count && reader_.ok(); ++k) {
    VariableId id = -1;
    const std::size_t size = ParseSizeOf(&id);
    VariableBounds bounds;
    bounds.lower = reader_.ReadVector(size);
    bounds.upper = reader_.ReadVector(size);
    parts_.bounds[id] = std::move(bounds);
  }
}

// An id and at least one value: 12 bytes.
void GraphParser::ParsePins() {
  const std::size_t count = reader_.ReadCount(12);
  for (std::size_t k = 0; k < count && reader_.ok(); ++k) {
    VariableId id = -1;
    const std::size_t size = ParseSizeOf(&id);
    parts_.pins[id] = reader_.ReadVector(size);
  }
}

void GraphParser::ParseFamily() {
  const std::string name = "family " + std::to_string(families_.size());
  // Kept twice: the graph takes families as const, LoadedFamilies hands out what can be added to.
  families_.push_back(reader_.formats().ReadFamily(name, &reader_));
  if (!reader_.ok()) {
    return;
  }
  GraphParts::Family family;
  family.family = families_.back();
  const auto num_slots = static_cast<std::size_t>(family.family->num_slots());
  const std::size_t num_factors = reader_.ReadCount(4 * num_slots);
  // Of factors without variables there is nothing to count but the measurements.
  if (num_factors > static_cast<std::size_t>(family.family->size())) {
    reader_.Fail(name + " has " + std::to_string(num_factors) + " factors but " +
                 std::to_string(family.family->size()) + " measurements");
    return;
  }
  family.num_factors = static_cast<std::int64_t>(num_factors);
  // Bounded by ReadCount, for it has multiplied by the slots.
  family.variables = ParseIds(num_factors * num_slots);
  // A family whose factors have no losses says so in one byte.
  if (reader_.ReadByte() != 0) {
    for (std::size_t k = 0; k < num_factors && reader_.ok(); ++k) {
      // One per place; −1 is no loss, at free places too.
      family.losses.push_back(ParseShared(losses_, "the number of a loss"));
    }
  }
  family.free_places = ParseIds(reader_.ReadCount(4));
  parts_.families.push_back(std::move(family));
}

// An id and a group: 8 bytes. A graph without groups ends before.
void GraphParser::ParseGroups() {
  const std::size_t count = reader_.ReadCount(8);
  for (std::size_t k = 0; k < count && reader_.ok(); ++k) {
    VariableId id = -1;
    ParseSizeOf(&id);
    parts_.groups[id] = reader_.ReadInt();
  }
}

}  // namespace

void ParseGraph(GraphReader* reader, GraphParts* parts,
                std::vector<std::shared_ptr<FactorFamily>>* families) {
  GraphParser(reader, parts, families).Parse();
}

}  // namespace inceres::internal
