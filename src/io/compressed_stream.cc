#include <bzlib.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <climits>
#include <string>
#include <utility>

#include "io/byte_stream.h"

// gzip members and bzip2 streams as ByteSource and ByteSink, on the low-level calls of zlib and
// libbz2: their own functions for files would need a FILE, and the bytes here come from, and go to,
// another source or sink. (gzread() also takes a file without a gzip header for plain text and does
// not mind what follows the last member.) The libraries check sums and lengths by themselves; what
// is to be seen to here is where streams begin and end, that nothing else follows them, and that a
// file that stops in the middle of one is an error rather than an end.
//
// Both libraries name what a stream has of input and output alike, so one pair of classes serves
// for both, over decoders and encoders that hide in which calls they differ.

namespace inceres::internal {
namespace {

// Of a buffer: small beside the 900 kB of a block of bzip2, which the library holds.
constexpr std::size_t kPackedBytes = std::size_t{1} << 16;
constexpr int kGzipWindow = 15 + 16;  // largest window, gzip header (zlib.h)
constexpr int kBzip2BlockSize = 9;    // x 100 kB, the default of the bzip2 command

// The libraries count in 32 bits.
unsigned Clamp(std::size_t size) {
  return static_cast<unsigned>(std::min<std::size_t>(size, INT_MAX));
}

// Neither library writes to its input; zlib's bytes are unsigned.
template <typename Stream>
void SetInput(const char* data, unsigned size, Stream* stream) {
  stream->next_in = reinterpret_cast<decltype(stream->next_in)>(const_cast<char*>(data));
  stream->avail_in = size;
}

template <typename Stream>
void SetOutput(char* data, unsigned size, Stream* stream) {
  stream->next_out = reinterpret_cast<decltype(stream->next_out)>(data);
  stream->avail_out = size;
}

struct GzipDecoder {
  static constexpr const char* kName = "gzip";
  static constexpr const char* kLibrary = "zlib";
  static constexpr int kOk = Z_OK, kEnd = Z_STREAM_END;

  ~GzipDecoder() { inflateEnd(&stream); }
  // Expects a header next, at the place in input and output: what is no gzip member fails there.
  bool Start() {
    return inflateReset(&stream) == Z_OK || inflateInit2(&stream, kGzipWindow) == Z_OK;
  }
  int Run() { return inflate(&stream, Z_NO_FLUSH); }
  // zlib's own words, such as "incorrect data check".
  std::string Reason(int /*result*/) const {
    return stream.msg != nullptr ? std::string(" (") + stream.msg + ")" : "";
  }

  z_stream stream{};
};

struct Bzip2Decoder {
  static constexpr const char* kName = "bzip2";
  static constexpr const char* kLibrary = "libbz2";
  static constexpr int kOk = BZ_OK, kEnd = BZ_STREAM_END;

  ~Bzip2Decoder() { BZ2_bzDecompressEnd(&stream); }
  // The library has no reset: each stream gets a fresh decoder, which keeps the place in input and
  // output.
  bool Start() {
    const bz_stream place = stream;
    BZ2_bzDecompressEnd(&stream);
    stream = bz_stream{};
    const bool started = BZ2_bzDecompressInit(&stream, 0, 0) == BZ_OK;
    SetInput(place.next_in, place.avail_in, &stream);
    SetOutput(place.next_out, place.avail_out, &stream);
    return started;
  }
  int Run() { return BZ2_bzDecompress(&stream); }
  // A second stream without a header is what garbage behind the first one looks like.
  static std::string Reason(int result) {
    return result == BZ_DATA_ERROR_MAGIC ? " (no bzip2 header)"
           : result == BZ_DATA_ERROR     ? " (checksum or block)"
                                         : "";
  }

  bz_stream stream{};
};

// One or several streams, one after the other, as parallel compressors write them.
template <typename Decoder>
class UnpackingSource : public ByteSource {
 public:
  explicit UnpackingSource(std::unique_ptr<ByteSource> compressed)
      : compressed_(std::move(compressed)) {}

  // Turns until there is output or the end. A turn may give none: one that read a header, or the
  // sums at an end, or an empty stream; and bzip2 gives nothing of a block before it has all of it.
  Status Read(char* buffer, std::size_t capacity, std::size_t* size) override {
    *size = 0;
    auto& stream = decoder_.stream;
    const unsigned wanted = Clamp(capacity);
    SetOutput(buffer, wanted, &stream);
    while (stream.avail_out == wanted) {
      if (Status status = Refill(); !status.ok()) {
        return status;
      }
      // Right only between two streams; an empty file has had none. A decoder that has output left
      // has input left too, for the end of a stream is read after the last of its output: no output
      // is lost by asking this first.
      if (stream.avail_in == 0) {  // end of the file
        return any_stream_ && !running_ ? Status::Ok() : Failure("data is truncated");
      }
      if (!running_ && !decoder_.Start()) {
        return Status::Error(StatusCode::kIo,
                             std::string(Decoder::kLibrary) + " cannot start (out of memory?)");
      }
      running_ = any_stream_ = true;
      // At the end of a stream, what is left of the input is the next one, and the next turn starts
      // it.
      const int result = decoder_.Run();
      if (result == Decoder::kEnd) {
        running_ = false;
      } else if (result != Decoder::kOk) {
        return Failure("data is corrupt" + decoder_.Reason(result));
      }
    }
    *size = wanted - stream.avail_out;
    return Status::Ok();
  }

 private:
  static Status Failure(const std::string& what) {
    return Status::Error(StatusCode::kIo, std::string("the ") + Decoder::kName + " " + what);
  }

  // Nothing new while there is input: bytes that the decoder has not taken stay where they are.
  Status Refill() {
    if (decoder_.stream.avail_in > 0) {
      return Status::Ok();
    }
    std::size_t size = 0;
    Status status = compressed_->Read(input_.data(), input_.size(), &size);
    SetInput(input_.data(), static_cast<unsigned>(size), &decoder_.stream);
    return status;
  }

  std::unique_ptr<ByteSource> compressed_;
  Decoder decoder_;
  bool running_ = false;  // inside a stream
  bool any_stream_ = false;
  std::array<char, kPackedBytes> input_;
};

struct GzipEncoder {
  static constexpr const char* kRefusal = "zlib cannot start (out of memory?)";

  // The second to last argument, 8, is zlib's default of memory.
  GzipEncoder()
      : ready(deflateInit2(&stream, Z_DEFAULT_COMPRESSION, Z_DEFLATED, kGzipWindow, 8,
                           Z_DEFAULT_STRATEGY) == Z_OK) {}
  ~GzipEncoder() { deflateEnd(&stream); }

  // Done when zlib leaves room in the output: all input is then consumed. Its result says nothing
  // more: with valid arguments the only other one is that there was nothing to do, as where the
  // last call has just filled the buffer.
  bool Run(bool finish, bool* done) {
    deflate(&stream, finish ? Z_FINISH : Z_NO_FLUSH);
    *done = stream.avail_out > 0;
    return true;
  }

  z_stream stream{};
  bool ready;
};

struct Bzip2Encoder {
  static constexpr const char* kRefusal = "libbz2 cannot compress (out of memory?)";

  Bzip2Encoder() : ready(BZ2_bzCompressInit(&stream, kBzip2BlockSize, 0, 0) == BZ_OK) {}
  ~Bzip2Encoder() { BZ2_bzCompressEnd(&stream); }

  // A call may stop for want of room in the output, and a last block may fill many buffers.
  // Negative results are errors; what is positive says how far it has come.
  bool Run(bool finish, bool* done) {
    const int result = BZ2_bzCompress(&stream, finish ? BZ_FINISH : BZ_RUN);
    *done = finish ? result == BZ_STREAM_END : stream.avail_in == 0;
    return result >= 0;
  }

  bz_stream stream{};
  bool ready;
};

// One stream. A failure to start is told by the first Write, since a constructor cannot return it.
template <typename Encoder>
class PackingSink : public ByteSink {
 public:
  explicit PackingSink(std::unique_ptr<ByteSink> file) : file_(std::move(file)) {}

  Status Write(const char* data, std::size_t size) override {
    while (size > 0) {
      // Larger data in several pieces.
      const unsigned piece = Clamp(size);
      SetInput(data, piece, &encoder_.stream);
      if (Status status = Run(false); !status.ok()) {
        return status;
      }
      data += piece;
      size -= piece;
    }
    return Status::Ok();
  }

  // Writes what the library has kept back and the sums at the end, then completes the file below.
  Status Finish() override {
    Status status = Run(true);
    return status.ok() ? file_->Finish() : status;
  }

 private:
  // Everything that has come out is written at once, so the buffer is empty at each call.
  Status Run(bool finish) {
    for (bool done = false; !done;) {
      SetOutput(output_.data(), kPackedBytes, &encoder_.stream);
      if (!encoder_.ready || !encoder_.Run(finish, &done)) {
        return Status::Error(StatusCode::kIo, Encoder::kRefusal);
      }
      if (Status status = file_->Write(output_.data(), kPackedBytes - encoder_.stream.avail_out);
          !status.ok()) {
        return status;
      }
    }
    return Status::Ok();
  }

  std::unique_ptr<ByteSink> file_;
  Encoder encoder_;
  std::array<char, kPackedBytes> output_;
};

}  // namespace

std::unique_ptr<ByteSource> MakeGzipSource(std::unique_ptr<ByteSource> compressed) {
  return std::make_unique<UnpackingSource<GzipDecoder>>(std::move(compressed));
}

std::unique_ptr<ByteSource> MakeBzip2Source(std::unique_ptr<ByteSource> compressed) {
  return std::make_unique<UnpackingSource<Bzip2Decoder>>(std::move(compressed));
}

std::unique_ptr<ByteSink> MakeGzipSink(std::unique_ptr<ByteSink> file) {
  return std::make_unique<PackingSink<GzipEncoder>>(std::move(file));
}

std::unique_ptr<ByteSink> MakeBzip2Sink(std::unique_ptr<ByteSink> file) {
  return std::make_unique<PackingSink<Bzip2Encoder>>(std::move(file));
}

}  // namespace inceres::internal
