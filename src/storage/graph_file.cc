#include "inceres/storage/graph_file.h"

#include <zlib.h>

#include <cstdint>
#include <cstring>
#include <new>
#include <utility>

#include "io/byte_stream.h"
#include "storage/graph_layout.h"

// A graph in a file: a heading of fixed size, then what print_graph.cc writes. The heading has the
// size and the CRC-32 of the rest, so that a file that was cut or damaged is told as such, before
// anything of it is looked at; a checksum that matches says nothing of who wrote it, so parsing
// trusts no number either.
//
// Both directions are all or nothing. Saving collects all bytes before the file is opened; loading
// makes a graph of its own (problem/graph_restorer.h), and only one that is valid replaces the
// caller's.

namespace inceres {
namespace {

constexpr char kMagic[] = "INCEREGR";
constexpr std::size_t kMagicSize = sizeof(kMagic) - 1;
constexpr std::int32_t kVersion = 1;
constexpr std::size_t kHeadingSize = kMagicSize + 4 + 8 + 4;  // magic, version, size, checksum

// zlib's CRC-32, with the overload that takes sizes beyond 4 GiB. Signed in the file, as all its
// integers are: the bits are the same.
std::int32_t Checksum(const char* data, std::size_t size) {
  const auto sum = crc32_z(0, reinterpret_cast<const Bytef*>(data), size);
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(sum));
}

Status Damaged(const std::string& what) {
  return Status::Error(StatusCode::kIo, what);
}

// What the heading says of the rest is true.
// In the order of what each check needs: magic, version, size, checksum. Another version is told
// before the size, which might stand elsewhere in it.
Status CheckHeading(const std::string& bytes, const GraphFormats& formats) {
  if (bytes.size() < kHeadingSize || std::memcmp(bytes.data(), kMagic, kMagicSize) != 0) {
    return Damaged("it is no graph that SaveGraph has written");
  }
  // Long enough, as just checked: its reads cannot fail.
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

// Through the decoder that the name asks for, piece by piece: the unpacked size is not known
// before.
Status ReadAll(const std::string& path, const ReadOptions& options, std::string* bytes) {
  std::unique_ptr<internal::ByteSource> source;
  Status status = internal::OpenByteSource(path, &source, nullptr, options);
  std::vector<char> piece(1 << 18);
  // Anything but the 0 that ends the loop.
  std::size_t size = 1;
  while (status.ok() && size > 0) {
    status = source->Read(piece.data(), piece.size(), &size);
    if (!status.ok()) {
      // Messages of sources do not name the file; that of a failure to open does, and does not come
      // here.
      status.message = path + ": " + status.message;
    } else {
      bytes->append(piece.data(), size);
    }
  }
  return status;
}

}  // namespace

// A graph that Validate refuses would be refused when it is loaded: it is not written in the first
// place. `bytes` changes only on success.
Status SaveGraphToBytes(const FactorGraph& graph, const GraphFormats& formats, std::string* bytes) {
  Status status = graph.Validate();
  if (!status.ok()) {
    return status;
  }
  // The rest before the heading, which has its size and sum.
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

// Parts first, then a graph of them: a parser reads what stands there, and the restorer decides
// whether it fits together.
Status LoadGraphFromBytes(const std::string& bytes, const GraphFormats& formats, FactorGraph* graph,
                          LoadedFamilies* families) {
  try {
    Status status = CheckHeading(bytes, formats);
    if (!status.ok()) {
      return status;
    }
    GraphReader reader(bytes.data() + kHeadingSize, bytes.size() - kHeadingSize, formats);
    // Parts may contradict each other; they are not a graph yet.
    internal::GraphParts parts;
    LoadedFamilies loaded;
    internal::ParseGraph(&reader, &parts, &loaded.families);
    status = reader.status();
    if (status.ok()) {
      status = internal::GraphRestorer::Restore(std::move(parts), graph);
      // The restorer calls it an invalid argument; here the argument is a file.
      status.code = status.ok() ? StatusCode::kOk : StatusCode::kIo;
    }
    // Last: a graph that was refused must not leave its families behind.
    if (status.ok() && families != nullptr) {
      *families = std::move(loaded);
    }
    return status;
    // Counts are held against the bytes that are there, so memory is some multiple of the file's
    // size; that may still be more than there is.
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
  Status status;
  try {
    status = ReadAll(path, options, &bytes);
  } catch (const std::bad_alloc&) {
    return Status::Error(StatusCode::kUnavailable, path + ": there is no memory for it");
  }
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
