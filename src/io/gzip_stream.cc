#include <zlib.h>

#include <algorithm>
#include <array>
#include <climits>
#include <string>
#include <utility>

#include "io/byte_sink.h"
#include "io/byte_source.h"

// gzip members as ByteSource and ByteSink, on zlib's inflate and deflate, for the reasons that
// bzip2_stream.cc gives. zlib checks the CRC and the length at the end of each member; that the
// file ends with a member, and that nothing else follows it, is seen to here.

namespace inceres::internal {
namespace {

// Of packed bytes.
constexpr std::size_t kBufferSize = std::size_t{1} << 16;
constexpr int kGzipWindow = 15 + 16;  // largest window, gzip header (zlib.h)

// zlib counts in 32 bits.
unsigned Clamp(std::size_t size) {
  return static_cast<unsigned>(std::min<std::size_t>(size, INT_MAX));
}

// One or several gzip members, one after the other. Stricter than gzread(), which takes a file
// without a gzip header for plain text and does not mind what follows the last member.
class GzipSource : public ByteSource {
 public:
  explicit GzipSource(std::unique_ptr<ByteSource> compressed) : compressed_(std::move(compressed)) {
    ready_ = inflateInit2(&stream_, kGzipWindow) == Z_OK;
  }
  ~GzipSource() override { inflateEnd(&stream_); }

  // Turns until there is output or the end. A turn may give none: one that read a header, or the
  // sums at the end of a member, or an empty member.
  Status Read(char* buffer, std::size_t capacity, std::size_t* size) override {
    *size = 0;
    if (!ready_) {
      return Status::Error(StatusCode::kIo, "zlib cannot start (out of memory?)");
    }
    stream_.next_out = reinterpret_cast<Bytef*>(buffer);
    stream_.avail_out = Clamp(capacity);
    const unsigned wanted = stream_.avail_out;
    while (stream_.avail_out == wanted) {
      if (Status status = Refill(); !status.ok()) {
        return status;
      }
      // Right only between two members; an empty file has had none and is truncated. The sums at
      // the end of a member are read after its last output, so no output is left where there is no
      // input.
      if (stream_.avail_in == 0) {  // end of the file
        return between_members_ ? Status::Ok()
                                : Status::Error(StatusCode::kIo, "the gzip data is truncated");
      }
      between_members_ = false;
      const int result = inflate(&stream_, Z_NO_FLUSH);
      if (result == Z_STREAM_END) {
        // inflateReset keeps the place in input and output, and expects a header next: what is no
        // gzip member fails there.
        between_members_ = true;
        inflateReset(&stream_);
      } else if (result != Z_OK) {
        return Status::Error(StatusCode::kIo, "the gzip data is corrupt" + Reason());
      }
    }
    *size = wanted - stream_.avail_out;
    return Status::Ok();
  }

 private:
  // Nothing new while there is input.
  Status Refill() {
    if (stream_.avail_in > 0) {
      return Status::Ok();
    }
    std::size_t size = 0;
    Status status = compressed_->Read(input_.data(), input_.size(), &size);
    stream_.next_in = reinterpret_cast<Bytef*>(input_.data());
    stream_.avail_in = static_cast<unsigned>(size);
    return status;
  }

  // zlib's own words, such as "incorrect data check".
  std::string Reason() const {
    return stream_.msg != nullptr ? std::string(" (") + stream_.msg + ")" : "";
  }

  std::unique_ptr<ByteSource> compressed_;
  z_stream stream_{};
  // A failure of the constructor, told by the first call that can return it.
  bool ready_ = false;
  bool between_members_ = false;
  std::array<char, kBufferSize> input_;
};

// One member. The second to last argument of deflateInit2, 8, is zlib's default of memory.
class GzipSink : public ByteSink {
 public:
  explicit GzipSink(std::unique_ptr<ByteSink> file) : file_(std::move(file)) {
    ready_ = deflateInit2(&stream_, Z_DEFAULT_COMPRESSION, Z_DEFLATED, kGzipWindow, 8,
                          Z_DEFAULT_STRATEGY) == Z_OK;
  }
  ~GzipSink() override { deflateEnd(&stream_); }

  Status Write(const char* data, std::size_t size) override {
    while (size > 0) {
      // Larger data in several pieces.
      const unsigned piece = Clamp(size);
      stream_.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(data));
      stream_.avail_in = piece;
      if (Status status = Deflate(Z_NO_FLUSH); !status.ok()) {
        return status;
      }
      data += piece;
      size -= piece;
    }
    return Status::Ok();
  }

  // Writes what zlib has kept back and the sums of the member, then completes the file below.
  Status Finish() override {
    if (Status status = Deflate(Z_FINISH); !status.ok()) {
      return status;
    }
    return file_->Finish();
  }

 private:
  // Runs until zlib leaves room in the output: all input is then consumed.
  Status Deflate(int flush) {
    if (!ready_) {
      return Status::Error(StatusCode::kIo, "zlib cannot start (out of memory?)");
    }
    do {
      stream_.next_out = reinterpret_cast<Bytef*>(output_.data());
      stream_.avail_out = kBufferSize;
      // Its result says nothing more: with valid arguments the only other one is that there was
      // nothing to do, as where the last call has just filled the buffer.
      deflate(&stream_, flush);
      if (Status status = file_->Write(output_.data(), kBufferSize - stream_.avail_out);
          !status.ok()) {
        return status;
      }
    } while (stream_.avail_out == 0);
    return Status::Ok();
  }

  std::unique_ptr<ByteSink> file_;
  z_stream stream_{};
  bool ready_ = false;
  std::array<char, kBufferSize> output_;
};

}  // namespace

std::unique_ptr<ByteSource> MakeGzipSource(std::unique_ptr<ByteSource> compressed) {
  return std::make_unique<GzipSource>(std::move(compressed));
}

std::unique_ptr<ByteSink> MakeGzipSink(std::unique_ptr<ByteSink> file) {
  return std::make_unique<GzipSink>(std::move(file));
}

}  // namespace inceres::internal
