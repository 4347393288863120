#include <cstring>

#include "inceres/storage/graph_formats.h"
#include "inceres/storage/graph_stream.h"

namespace inceres {
namespace {

template <typename Unsigned>
void AppendLittleEndian(Unsigned value, std::string* bytes) {
  for (std::size_t k = 0; k < sizeof(value); ++k) {
    bytes->push_back(static_cast<char>(static_cast<unsigned char>(value >> (8 * k))));
  }
}

}  // namespace

void GraphWriter::Fail(const std::string& what) {
  if (status_.ok()) {
    status_ = Status::Error(StatusCode::kInvalidArgument, what);
  }
}

void GraphWriter::WriteInt(std::int32_t value) {
  AppendLittleEndian(static_cast<std::uint32_t>(value), &bytes_);
}

void GraphWriter::WriteLong(std::int64_t value) {
  AppendLittleEndian(static_cast<std::uint64_t>(value), &bytes_);
}

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

void GraphWriter::WriteString(const std::string& text) {
  WriteLong(static_cast<std::int64_t>(text.size()));
  bytes_ += text;
}

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
