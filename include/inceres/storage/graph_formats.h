#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <typeindex>
#include <utility>
#include <vector>

#include "inceres/export.h"
#include "inceres/problem/factor_family.h"
#include "inceres/problem/losses.h"
#include "inceres/problem/manifolds.h"
#include "inceres/status.h"

namespace inceres {

class GraphFormats;

/// What a format of a type of yours (GraphFormats) writes an object with: numbers one after the
/// other, little-endian on every machine, without names. Nothing here fails at once: the first
/// thing that cannot be written is status().
class INCERES_EXPORT GraphWriter {
 public:
  /// `formats` must outlive the writer.
  explicit GraphWriter(const GraphFormats& formats) : formats_(formats) {}

  /// One byte.
  void WriteByte(std::uint8_t value) { bytes_.push_back(static_cast<char>(value)); }
  /// Four bytes.
  void WriteInt(std::int32_t value);
  /// Eight bytes.
  void WriteLong(std::int64_t value);
  /// The eight bytes of an IEEE 754 double, whatever its value.
  void WriteDouble(double value);
  /// So many doubles one after the other.
  void WriteDoubles(const double* values, std::size_t count);
  /// A length, then the bytes.
  void WriteString(const std::string& text);
  /// By the formats of their types; null is fine.
  void WriteManifold(const Manifold* manifold);
  /// The same for a loss.
  void WriteLoss(const Loss* loss);

  /// The formats that types are looked up in.
  const GraphFormats& formats() const { return formats_; }
  /// What has been written so far.
  const std::string& bytes() const { return bytes_; }
  /// The first failure, or Ok.
  const Status& status() const { return status_; }
  /// Ends the whole save or load with this message, unless something failed before.
  void Fail(const std::string& what);

 private:
  friend class GraphFormats;
  GraphWriter(const GraphFormats& formats, int depth) : formats_(formats), depth_(depth) {}

  const GraphFormats& formats_;
  int depth_ = 0;  // of objects within objects
  std::string bytes_;
  Status status_;
};

/// What a format reads its object with: in the order it was written in. Trusts nothing: beyond the
/// end of the object every read gives 0 and fails the whole load, as Fail does; so a format may
/// read on and look at ok() once, but must not take a count for true: ask ReadCount for it.
class INCERES_EXPORT GraphReader {
 public:
  /// Of `size` bytes, which must outlive the reader, as `formats` must.
  GraphReader(const char* data, std::size_t size, const GraphFormats& formats)
      : GraphReader(data, size, formats, 0) {}

  /// One byte.
  std::uint8_t ReadByte();
  /// Four bytes.
  std::int32_t ReadInt();
  /// Eight bytes.
  std::int64_t ReadLong();
  /// A double, whatever its value.
  double ReadDouble();
  /// `count` doubles; false, and nothing is written, if there are not that many.
  bool ReadDoubles(double* values, std::size_t count);
  /// `count` doubles in memory that is asked for once it is known that they are there; empty after
  /// a failure.
  std::vector<double> ReadVector(std::size_t count);
  /// A length, then the bytes; empty after a failure.
  std::string ReadString();
  /// How many items follow, of at least bytes_each ≥ 1 bytes: a number that the rest of the object
  /// has room for, so that memory for as many may be asked for. 0 after a failure.
  std::size_t ReadCount(std::size_t bytes_each);
  /// An integer between these, or a failure that calls it `what`, and the lowest of them.
  std::int32_t ReadIntIn(std::int32_t lowest, std::int32_t highest, const char* what);
  /// An enumerator between 0 and this one.
  template <typename Enum>
  Enum ReadEnum(Enum last, const char* what) {
    return static_cast<Enum>(ReadIntIn(0, static_cast<std::int32_t>(last), what));
  }
  /// Null if null was written, or after a failure.
  std::shared_ptr<const Manifold> ReadManifold();
  /// A loss; null if null was written, or after a failure.
  std::shared_ptr<const Loss> ReadLoss();

  /// Whether nothing has failed.
  bool ok() const { return status_.ok(); }
  /// The first failure, or Ok.
  const Status& status() const { return status_; }
  /// Bytes of the object that are not read yet.
  std::size_t remaining() const { return size_ - next_; }
  /// The formats that types are looked up in.
  const GraphFormats& formats() const { return formats_; }
  /// Ends the whole save or load with this message, unless something failed before.
  void Fail(const std::string& what);

 private:
  friend class GraphFormats;
  GraphReader(const char* data, std::size_t size, const GraphFormats& formats, int depth)
      : data_(data), size_(size), formats_(formats), depth_(depth) {}
  const char* Take(std::size_t count);

  const char* data_;
  std::size_t size_;
  std::size_t next_ = 0;
  const GraphFormats& formats_;
  int depth_;  // of objects within objects
  Status status_;
};

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
