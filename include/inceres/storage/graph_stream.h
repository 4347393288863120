#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "inceres/export.h"
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

}  // namespace inceres
