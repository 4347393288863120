#include <cstdint>
#include <string>
#include <utility>

#include "inceres/storage/graph_formats.h"
#include "storage/graph_layout.h"

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
    ParseBoundsAndPins();
    // In the order in which edits will take them, the last one first.
    parts_.free_variables = ParseIds(reader_.ReadCount(4));
    // A family is an object too: 16 bytes at least.
    const std::size_t num_families = reader_.ReadCount(16);
    for (std::size_t k = 0; k < num_families && reader_.ok(); ++k) {
      ParseFamily();
    }
    if (reader_.ok() && reader_.remaining() > 0) {
      // A graph without groups ends before.
      ParseThoseThatHave(
          4, [this](VariableId id, std::size_t) { parts_.groups[id] = reader_.ReadInt(); });
    }
    if (reader_.ok() && reader_.remaining() > 0) {
      reader_.Fail(std::to_string(reader_.remaining()) + " bytes are left over");
    }
  }

 private:
  void ParseVariables();
  // Variables that have something: their number, and of each its id and what read(id, its ambient
  // size) takes, at least so many bytes. The size is 0 after a failure.
  template <typename Read>
  void ParseThoseThatHave(std::size_t bytes, const Read& read);
  void ParseBoundsAndPins();
  void ParseFamily();
  std::vector<std::int32_t> ParseIds(std::size_t count);
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
    VariableRecord variable;
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

template <typename Read>
void GraphParser::ParseThoseThatHave(std::size_t bytes, const Read& read) {
  const std::size_t count = reader_.ReadCount(4 + bytes);
  const auto num_variables = static_cast<std::int32_t>(parts_.variables.size());
  for (std::size_t k = 0; k < count && reader_.ok(); ++k) {
    const VariableId id = reader_.ReadIntIn(0, num_variables - 1, "a variable");
    read(id, reader_.ok() ? IndexOf(parts_.variables[IndexOf(id)].ambient_size) : 0);
  }
}

void GraphParser::ParseBoundsAndPins() {
  // At least one value each of two bounds.
  ParseThoseThatHave(16, [this](VariableId id, std::size_t size) {
    VariableBounds& bounds = parts_.bounds[id];
    bounds.lower = reader_.ReadVector(size);
    bounds.upper = reader_.ReadVector(size);
  });
  ParseThoseThatHave(
      8, [this](VariableId id, std::size_t size) { parts_.pins[id] = reader_.ReadVector(size); });
}

void GraphParser::ParseFamily() {
  const std::string name = "family " + std::to_string(families_.size());
  // Kept twice: the graph takes families as const, LoadedFamilies hands out what can be added to.
  families_.push_back(reader_.formats().ReadFamily(name, &reader_));
  if (!reader_.ok()) {
    return;
  }
  FamilyRecord family;
  family.family = families_.back();
  const auto num_slots = static_cast<std::size_t>(family.family->num_slots());
  const std::size_t num_factors = reader_.ReadCount(4 * num_slots);
  // Of factors without variables there is nothing to count but the measurements.
  if (num_factors > static_cast<std::size_t>(family.family->size())) {
    reader_.Fail(name + " has " + std::to_string(num_factors) + " factors but " +
                 std::to_string(family.family->size()) + " measurements");
    return;
  }
  family.num_factors = static_cast<int>(num_factors);
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

}  // namespace

void ParseGraph(GraphReader* reader, GraphParts* parts,
                std::vector<std::shared_ptr<FactorFamily>>* families) {
  GraphParser(reader, parts, families).Parse();
}

}  // namespace inceres::internal
