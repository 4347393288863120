#include <cstring>

#include "inceres/storage/graph_formats.h"
#include "inceres/storage/graph_stream.h"

namespace inceres {
namespace {

template <typename Unsigned>
Unsigned LittleEndian(const char* bytes) {
  Unsigned value = 0;
  for (std::size_t k = 0; k < sizeof(value); ++k) {
    value |= static_cast<Unsigned>(static_cast<unsigned char>(bytes[k])) << (8 * k);
  }
  return value;
}

double DoubleAt(const char* bytes) {
  const auto bits = LittleEndian<std::uint64_t>(bytes);
  double value;
  std::memcpy(&value, &bits, sizeof(value));
  return value;
}

}  // namespace

void GraphReader::Fail(const std::string& what) {
  if (status_.ok()) {
    status_ = Status::Error(StatusCode::kIo, what);
  }
}

// Null, after a failure, if there are not that many bytes.
const char* GraphReader::Take(std::size_t count) {
  if (!status_.ok()) {
    return nullptr;
  }
  if (count > remaining()) {
    Fail("it ends before all of it is read");
    return nullptr;
  }
  const char* taken = data_ + next_;
  next_ += count;
  return taken;
}

std::uint8_t GraphReader::ReadByte() {
  const char* bytes = Take(1);
  return bytes == nullptr ? std::uint8_t{0} : static_cast<std::uint8_t>(*bytes);
}

std::int32_t GraphReader::ReadInt() {
  const char* bytes = Take(4);
  return bytes == nullptr ? 0 : static_cast<std::int32_t>(LittleEndian<std::uint32_t>(bytes));
}

std::int64_t GraphReader::ReadLong() {
  const char* bytes = Take(8);
  return bytes == nullptr ? 0 : static_cast<std::int64_t>(LittleEndian<std::uint64_t>(bytes));
}

double GraphReader::ReadDouble() {
  const char* bytes = Take(8);
  return bytes == nullptr ? 0.0 : DoubleAt(bytes);
}

bool GraphReader::ReadDoubles(double* values, std::size_t count) {
  // Not count * 8, which may overflow.
  const char* bytes = count <= remaining() / 8 ? Take(8 * count) : Take(remaining() + 1);
  for (std::size_t k = 0; bytes != nullptr && k < count; ++k) {
    values[k] = DoubleAt(bytes + 8 * k);
  }
  return bytes != nullptr;
}

std::vector<double> GraphReader::ReadVector(std::size_t count) {
  std::vector<double> values(count <= remaining() / 8 && ok() ? count : 0);
  if (!ReadDoubles(values.data(), count)) {
    values.clear();
  }
  return values;
}

std::string GraphReader::ReadString() {
  const std::size_t size = ReadCount(1);
  const char* bytes = Take(size);
  return bytes == nullptr ? std::string() : std::string(bytes, size);
}

std::size_t GraphReader::ReadCount(std::size_t bytes_each) {
  const std::int64_t count = ReadLong();
  if (ok() && (count < 0 || static_cast<std::uint64_t>(count) > remaining() / bytes_each)) {
    Fail("a count of " + std::to_string(count) + " items, for which there is no room");
  }
  return ok() ? static_cast<std::size_t>(count) : 0;
}

std::int32_t GraphReader::ReadIntIn(std::int32_t lowest, std::int32_t highest, const char* what) {
  const std::int32_t value = ReadInt();
  if (ok() && (value < lowest || value > highest)) {
    Fail(std::string(what) + " is " + std::to_string(value) + ", which it cannot be");
  }
  return ok() ? value : lowest;
}

std::shared_ptr<const Manifold> GraphReader::ReadManifold() {
  return ReadByte() != 0 ? formats_.ReadManifold("a manifold", this) : nullptr;
}

std::shared_ptr<const Loss> GraphReader::ReadLoss() {
  return ReadByte() != 0 ? formats_.ReadLoss("a loss", this) : nullptr;
}

}  // namespace inceres
