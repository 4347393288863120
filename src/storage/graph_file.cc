#include "inceres/storage/graph_file.h"

#include <zlib.h>

#include <cstdint>
#include <cstring>
#include <new>
#include <utility>

#include "io/byte_sink.h"
#include "io/byte_source.h"
#include "storage/parse_graph.h"
#include "storage/print_graph.h"

namespace inceres {
namespace {

constexpr char kMagic[] = "INCEREGR";
constexpr std::size_t kMagicSize = sizeof(kMagic) - 1;
constexpr std::int32_t kVersion = 1;
constexpr std::size_t kHeadingSize = kMagicSize + 4 + 8 + 4;  // magic, version, size, checksum

std::int32_t Checksum(const char* data, std::size_t size) {
  const auto sum = crc32_z(0, reinterpret_cast<const Bytef*>(data), size);
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(sum));
}

Status Damaged(const std::string& what) {
  return Status::Error(StatusCode::kIo, what);
}

// What the heading says of the rest is true.
Status CheckHeading(const std::string& bytes, const GraphFormats& formats) {
  if (bytes.size() < kHeadingSize || std::memcmp(bytes.data(), kMagic, kMagicSize) != 0) {
    return Damaged("it is no graph that SaveGraph has written");
  }
  GraphReader heading(bytes.data() + kMagicSize, kHeadingSize - kMagicSize, formats);
  const std::int32_t version = heading.ReadInt();
  if (version != kVersion) {
    return Damaged("it is of version " + std::to_string(version) + "; this program reads version " +
                   std::to_string(kVersion));
  }
  const std::int64_t size = heading.ReadLong();
  const std::size_t rest = bytes.size() - kHeadingSize;
  if (size < 0 || static_cast<std::uint64_t>(size) != rest) {
    return Damaged("it should have " + std::to_string(size) +
                   " bytes behind its heading, and has " + std::to_string(rest) +
                   ": is it truncated?");
  }
  return heading.ReadInt() == Checksum(bytes.data() + kHeadingSize, rest)
             ? Status::Ok()
             : Damaged("its checksum does not match: it is damaged");
}

Status ReadAll(const std::string& path, const ReadOptions& options, std::string* bytes) {
  std::unique_ptr<internal::ByteSource> source;
  Status status = internal::OpenByteSource(path, &source, nullptr, options);
  std::vector<char> piece(1 << 18);
  std::size_t size = 1;
  while (status.ok() && size > 0) {
    status = source->Read(piece.data(), piece.size(), &size);
    if (!status.ok()) {
      status.message = path + ": " + status.message;
    } else {
      bytes->append(piece.data(), size);
    }
  }
  return status;
}

}  // namespace

Status SaveGraphToBytes(const FactorGraph& graph, const GraphFormats& formats, std::string* bytes) {
  Status status = graph.Validate();
  if (!status.ok()) {
    return status;
  }
  GraphWriter rest(formats);
  internal::PrintGraph(graph, &rest);
  if (!rest.status().ok()) {
    return rest.status();
  }
  GraphWriter heading(formats);
  heading.WriteInt(kVersion);
  heading.WriteLong(static_cast<std::int64_t>(rest.bytes().size()));
  heading.WriteInt(Checksum(rest.bytes().data(), rest.bytes().size()));
  *bytes = kMagic + heading.bytes() + rest.bytes();
  return status;
}

Status LoadGraphFromBytes(const std::string& bytes, const GraphFormats& formats, FactorGraph* graph,
                          LoadedFamilies* families) {
  try {
    Status status = CheckHeading(bytes, formats);
    if (!status.ok()) {
      return status;
    }
    GraphReader reader(bytes.data() + kHeadingSize, bytes.size() - kHeadingSize, formats);
    internal::GraphParts parts;
    LoadedFamilies loaded;
    internal::ParseGraph(&reader, &parts, &loaded.families);
    status = reader.status();
    if (status.ok()) {
      status = internal::GraphRestorer::Restore(std::move(parts), graph);
      status.code = status.ok() ? StatusCode::kOk : StatusCode::kIo;
    }
    if (status.ok() && families != nullptr) {
      *families = std::move(loaded);
    }
    return status;
  } catch (const std::bad_alloc&) {
    return Status::Error(StatusCode::kUnavailable, "there is no memory for it");
  }
}

Status SaveGraph(const std::string& path, const FactorGraph& graph, const GraphFormats& formats) {
  std::string bytes;
  Status status = SaveGraphToBytes(graph, formats, &bytes);
  std::unique_ptr<internal::ByteSink> sink;
  status = status.ok() ? internal::OpenByteSink(path, &sink) : status;
  status = status.ok() ? sink->Write(bytes.data(), bytes.size()) : status;
  return status.ok() ? sink->Finish() : status;
}

Status LoadGraph(const std::string& path, FactorGraph* graph, LoadedFamilies* families,
                 const GraphFormats& formats, const ReadOptions& options) {
  std::string bytes;
  Status status = ReadAll(path, options, &bytes);
  if (!status.ok()) {
    return status;
  }
  status = LoadGraphFromBytes(bytes, formats, graph, families);
  if (!status.ok()) {
    status.message = path + ": " + status.message;
  }
  return status;
}

}  // namespace inceres
