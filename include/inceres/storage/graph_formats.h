#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <typeindex>
#include <utility>

#include "inceres/export.h"
#include "inceres/problem/factor_family.h"
#include "inceres/storage/graph_stream.h"

namespace inceres {

namespace internal {

/// How objects of the types that derive from Base are written, by their types, and read, by names.
/// Of a type with several names all are read, and the one that came last is written.
template <typename Base>
class FormatTable {
 public:
  struct Format {
    std::string name;
    std::function<void(const Base& object, GraphWriter* writer)> write;
    std::function<std::shared_ptr<Base>(GraphReader* reader)> read;
  };

  void Add(std::type_index type, Format format) {
    const std::string name = format.name;
    names_.insert_or_assign(type, name);
    formats_.insert_or_assign(name, Entry{type, std::move(format)});
  }
  /// Null if there is none.
  const Format* Of(const Base& object) const {
    const std::type_index type(typeid(object));
    const auto name = names_.find(type);
    const auto found = name == names_.end() ? formats_.end() : formats_.find(name->second);
    // The name may be another type's by now, whose format would take the object for one of its own.
    return found == formats_.end() || found->second.type != type ? nullptr : &found->second.format;
  }
  const Format* Named(const std::string& name) const {
    const auto found = formats_.find(name);
    return found == formats_.end() ? nullptr : &found->second.format;
  }

 private:
  struct Entry {
    std::type_index type;
    Format format;
  };

  std::map<std::string, Entry> formats_;          // by name
  std::map<std::type_index, std::string> names_;  // to be written under, by type
};

}  // namespace internal

/// The formats by which SaveGraph and LoadGraph write and read families, manifolds and losses:
/// those of all built-in types, and yours once you have added them. A file names the format of each
/// object; what has none of that name is not read, and nothing is ever loaded but data.
///
///     formats.AddFamily<MyFamily>(
///         "my_project.my_family",
///         [](const MyFamily& family, GraphWriter* writer) { … every measurement, in order … },
///         [](GraphReader* reader) { return std::make_shared<MyFamily>(…); });
///
/// A `read` may return null after GraphReader::Fail; that it has read all that was written is
/// checked. A name added again replaces the format. A type may be added under several names, a
/// built-in one too: it is written under the last, and files that have an earlier one are read as
/// before. Threads: as a plain value.
class INCERES_EXPORT GraphFormats {
 public:
  /// Knows the built-in types.
  GraphFormats();

  /// Families of this type are written and read so, under this name.
  template <typename Family, typename Write, typename Read>
  void AddFamily(const std::string& name, Write write, Read read) {
    Add<Family>(&families_, name, std::move(write), std::move(read));
  }
  /// The same for a type of manifold.
  template <typename M, typename Write, typename Read>
  void AddManifold(const std::string& name, Write write, Read read) {
    Add<M>(&manifolds_, name, std::move(write), std::move(read));
  }
  /// The same for a type of loss.
  template <typename L, typename Write, typename Read>
  void AddLoss(const std::string& name, Write write, Read read) {
    Add<L>(&losses_, name, std::move(write), std::move(read));
  }

  /// What SaveGraph and LoadGraph use: an object with the name of its format. A failure is the
  /// writer's or reader's, and names the object by `what`.
  void Write(const FactorFamily& family, const std::string& what, GraphWriter* writer) const;
  /// The same for the others.
  void Write(const Manifold& manifold, const std::string& what, GraphWriter* writer) const;
  /// The same for the others.
  void Write(const Loss& loss, const std::string& what, GraphWriter* writer) const;
  /// Reads a family; null after a failure.
  std::shared_ptr<FactorFamily> ReadFamily(const std::string& what, GraphReader* reader) const;
  /// Reads a manifold; null after a failure.
  std::shared_ptr<Manifold> ReadManifold(const std::string& what, GraphReader* reader) const;
  /// Reads a loss; null after a failure.
  std::shared_ptr<Loss> ReadLoss(const std::string& what, GraphReader* reader) const;

 private:
  template <typename T, typename Base, typename Write, typename Read>
  static void Add(internal::FormatTable<Base>* table, const std::string& name, Write write,
                  Read read) {
    table->Add(typeid(T), {name,
                           [write = std::move(write)](const Base& object, GraphWriter* writer) {
                             write(static_cast<const T&>(object), writer);
                           },
                           [read = std::move(read)](GraphReader* reader) {
                             return std::shared_ptr<Base>(read(reader));
                           }});
  }
  template <typename Base>
  static void WriteBy(const internal::FormatTable<Base>& table, const Base& object,
                      const std::string& what, GraphWriter* writer);
  template <typename Base>
  static std::shared_ptr<Base> ReadBy(const internal::FormatTable<Base>& table,
                                      const std::string& what, GraphReader* reader);

  internal::FormatTable<FactorFamily> families_;
  internal::FormatTable<Manifold> manifolds_;
  internal::FormatTable<Loss> losses_;
};

}  // namespace inceres
