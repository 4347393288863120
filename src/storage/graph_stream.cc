#include <cstring>

#include "inceres/storage/graph_formats.h"

// Writing appends numbers to a string of bytes, without names, types or padding: whoever reads them
// has to know the order, which is the format. A failure is kept and nothing stops; SaveGraph asks
// for it at the end.
//
// Reading is from bytes that may be anything. The one place where bytes are taken is Take, which
// gives nothing beyond the end and nothing after a failure; so a format reads field after field
// without a check in between, gets zeros once something is wrong, and looks at ok() at the end.
// Memory is asked for only after ReadCount has held a count against the bytes that are left: a
// damaged count cannot ask for more than a multiple of the file's size.
//
// Bytes are taken apart and put together by shifts, so the file is little-endian on any machine,
// and need not be aligned.

namespace inceres {
namespace {

// Unsigned, for shifting a negative number to the right is the compiler's business before C++20.
template <typename Unsigned>
void AppendLittleEndian(Unsigned value, std::string* bytes) {
  for (std::size_t k = 0; k < sizeof(value); ++k) {
    bytes->push_back(static_cast<char>(static_cast<unsigned char>(value >> (8 * k))));
  }
}

// The detour by unsigned char keeps the sign of a char out.
template <typename Unsigned>
Unsigned LittleEndian(const char* bytes) {
  Unsigned value = 0;
  for (std::size_t k = 0; k < sizeof(value); ++k) {
    value |= static_cast<Unsigned>(static_cast<unsigned char>(bytes[k])) << (8 * k);
  }
  return value;
}

// Any bits are a double; whether NaN is meant is for the format to say.
double DoubleAt(const char* bytes) {
  const auto bits = LittleEndian<std::uint64_t>(bytes);
  double value;
  std::memcpy(&value, &bits, sizeof(value));
  return value;
}

}  // namespace

// kInvalidArgument, where a reader has kIo: the graph that is to be saved is at fault, not a file.
void GraphWriter::Fail(const std::string& what) {
  if (status_.ok()) {
    status_ = Status::Error(StatusCode::kInvalidArgument, what);
  }
}

// Signed numbers as two's complement, which is what the cast makes of them.
void GraphWriter::WriteInt(std::int32_t value) {
  AppendLittleEndian(static_cast<std::uint32_t>(value), &bytes_);
}

void GraphWriter::WriteLong(std::int64_t value) {
  AppendLittleEndian(static_cast<std::uint64_t>(value), &bytes_);
}

// All bits, those of a NaN and the sign of a zero too.
void GraphWriter::WriteDouble(double value) {
  std::uint64_t bits;
  std::memcpy(&bits, &value, sizeof(bits));
  AppendLittleEndian(bits, &bytes_);
}

void GraphWriter::WriteDoubles(const double* values, std::size_t count) {
  for (std::size_t k = 0; k < count; ++k) {
    WriteDouble(values[k]);
  }
}

// With its length, for it may hold any bytes: WriteBy puts whole objects into one.
void GraphWriter::WriteString(const std::string& text) {
  WriteLong(static_cast<std::int64_t>(text.size()));
  bytes_ += text;
}

// Not shared: an object that two others refer to is written twice here. Those of variables and
// factors, which many share, are written by number (print_graph.cc).
void GraphWriter::WriteManifold(const Manifold* manifold) {
  WriteByte(manifold != nullptr ? 1 : 0);
  if (manifold != nullptr) {
    formats_.Write(*manifold, "a manifold", this);
  }
}

void GraphWriter::WriteLoss(const Loss* loss) {
  WriteByte(loss != nullptr ? 1 : 0);
  if (loss != nullptr) {
    formats_.Write(*loss, "a loss", this);
  }
}

// The first failure stays: what comes after it is mostly its consequence.
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
  // Asking for one byte too many is how to fail as Take does.
  const char* bytes = count <= remaining() / 8 ? Take(8 * count) : Take(remaining() + 1);
  for (std::size_t k = 0; bytes != nullptr && k < count; ++k) {
    values[k] = DoubleAt(bytes + 8 * k);
  }
  return bytes != nullptr;
}

std::vector<double> GraphReader::ReadVector(std::size_t count) {
  // Memory only for what is there; ReadDoubles fails, and touches nothing, if it is not.
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

// Divides rather than multiplies, for a product could overflow.
std::size_t GraphReader::ReadCount(std::size_t bytes_each) {
  const std::int64_t count = ReadLong();
  const std::size_t room = bytes_each > 0 ? remaining() / bytes_each : SIZE_MAX;
  if (ok() && (count < 0 || static_cast<std::uint64_t>(count) > room)) {
    Fail("a count of " + std::to_string(count) + " items, for which there is no room");
  }
  return ok() ? static_cast<std::size_t>(count) : 0;
}

// The lowest after a failure: a size or a number that its caller can go on with. With highest <
// lowest, as of an index into nothing, every number fails.
std::int32_t GraphReader::ReadIntIn(std::int32_t lowest, std::int32_t highest, const char* what) {
  const std::int32_t value = ReadInt();
  if (ok() && (value < lowest || value > highest)) {
    Fail(std::string(what) + " is " + std::to_string(value) + ", which it cannot be");
  }
  return ok() ? value : lowest;
}

// A byte tells null from an object.
std::shared_ptr<const Manifold> GraphReader::ReadManifold() {
  return ReadByte() != 0 ? formats_.ReadManifold("a manifold", this) : nullptr;
}

std::shared_ptr<const Loss> GraphReader::ReadLoss() {
  return ReadByte() != 0 ? formats_.ReadLoss("a loss", this) : nullptr;
}

}  // namespace inceres
