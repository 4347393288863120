#include <cstring>

#include "inceres/storage/graph_formats.h"
#include "inceres/storage/graph_stream.h"

// Appends numbers to a string of bytes, little-endian on any machine, without names, types or
// padding: whoever reads them has to know the order, which is the format. A failure is kept and
// nothing stops; SaveGraph asks for it at the end.

namespace inceres {
namespace {

// Unsigned, for shifting a negative number to the right is the compiler's business before C++20.
template <typename Unsigned>
void AppendLittleEndian(Unsigned value, std::string* bytes) {
  for (std::size_t k = 0; k < sizeof(value); ++k) {
    bytes->push_back(static_cast<char>(static_cast<unsigned char>(value >> (8 * k))));
  }
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

}  // namespace inceres
