#include <bzlib.h>

#include <algorithm>
#include <array>
#include <climits>
#include <string>
#include <utility>

#include "io/byte_sink.h"
#include "io/byte_source.h"

// bzip2 streams as ByteSource and ByteSink, on libbz2's low-level calls: its own functions for
// files would need a FILE, and the bytes here come from, and go to, another source or sink. The
// library checks each block's sum by itself; what is to be seen to here is where streams begin and
// end, and that a file that stops in the middle of one is an error rather than an end.

namespace inceres::internal {
namespace {

// Of packed bytes: small beside the 900 kB of a block, which the library holds.
constexpr std::size_t kBufferSize = std::size_t{1} << 16;
constexpr int kBlockSize = 9;  // x 100 kB, the default of the bzip2 command

// The library counts in 32 bits.
unsigned Clamp(std::size_t size) {
  return static_cast<unsigned>(std::min<std::size_t>(size, INT_MAX));
}

// One or several bzip2 streams, one after the other, as parallel compressors write them.
class Bzip2Source : public ByteSource {
 public:
  explicit Bzip2Source(std::unique_ptr<ByteSource> compressed)
      : compressed_(std::move(compressed)) {}
  ~Bzip2Source() override { BZ2_bzDecompressEnd(&stream_); }

  // Turns until there is output or the end. A turn may give none, as with a block whose bytes are
  // not all there yet: bzip2 gives nothing of a block before it has all of it.
  Status Read(char* buffer, std::size_t capacity, std::size_t* size) override {
    *size = 0;
    stream_.next_out = buffer;
    stream_.avail_out = Clamp(capacity);
    const unsigned wanted = stream_.avail_out;
    while (stream_.avail_out == wanted) {
      if (Status status = Refill(); !status.ok()) {
        return status;
      }
      // Right only between two streams. A decoder that has output left has input left too, for the
      // end of a stream is read after the last of its output: no output is lost by asking this
      // first.
      if (stream_.avail_in == 0) {  // end of the file
        return any_stream_ && !running_
                   ? Status::Ok()
                   : Status::Error(StatusCode::kIo, "the bzip2 data is truncated");
      }
      if (Status status = Start(); !status.ok()) {
        return status;
      }
      // At the end of a stream, what is left of the input is the next one, and the next turn starts
      // it.
      const int result = BZ2_bzDecompress(&stream_);
      if (result == BZ_STREAM_END) {
        running_ = false;
      } else if (result != BZ_OK) {
        return Status::Error(StatusCode::kIo, "the bzip2 data is corrupt" + Reason(result));
      }
    }
    *size = wanted - stream_.avail_out;
    return Status::Ok();
  }

 private:
  // The library has no reset: each stream gets a fresh decoder, which keeps the place in the input
  // and output.
  Status Start() {
    // Between the first and the last byte of a stream there is nothing to do.
    if (running_) {
      return Status::Ok();
    }
    bz_stream place = stream_;
    BZ2_bzDecompressEnd(&stream_);
    stream_ = bz_stream{};
    if (BZ2_bzDecompressInit(&stream_, 0, 0) != BZ_OK) {
      return Status::Error(StatusCode::kIo, "libbz2 cannot start (out of memory?)");
    }
    stream_.next_in = place.next_in;
    stream_.avail_in = place.avail_in;
    stream_.next_out = place.next_out;
    stream_.avail_out = place.avail_out;
    running_ = any_stream_ = true;
    return Status::Ok();
  }

  // Nothing new while there is input: bytes that the decoder has not taken stay where they are.
  Status Refill() {
    if (stream_.avail_in > 0) {
      return Status::Ok();
    }
    std::size_t size = 0;
    Status status = compressed_->Read(input_.data(), input_.size(), &size);
    stream_.next_in = input_.data();
    stream_.avail_in = static_cast<unsigned>(size);
    return status;
  }

  // A second stream without a header is what garbage behind the first one looks like.
  static std::string Reason(int result) {
    return result == BZ_DATA_ERROR_MAGIC ? " (no bzip2 header)"
           : result == BZ_DATA_ERROR     ? " (checksum or block)"
                                         : "";
  }

  std::unique_ptr<ByteSource> compressed_;
  bz_stream stream_{};
  bool running_ = false;     // inside a stream
  bool any_stream_ = false;  // an empty file is no bzip2 file
  std::array<char, kBufferSize> input_;
};

// One stream. A failure to start is told by the first Write, since a constructor cannot return it.
class Bzip2Sink : public ByteSink {
 public:
  explicit Bzip2Sink(std::unique_ptr<ByteSink> file) : file_(std::move(file)) {
    ready_ = BZ2_bzCompressInit(&stream_, kBlockSize, 0, 0) == BZ_OK;
  }
  ~Bzip2Sink() override { BZ2_bzCompressEnd(&stream_); }

  // The library takes its input by a pointer to char that it does not write to.
  Status Write(const char* data, std::size_t size) override {
    while (size > 0) {
      const unsigned piece = Clamp(size);
      stream_.next_in = const_cast<char*>(data);
      stream_.avail_in = piece;
      // One call may stop for want of room in the output; each call has a new buffer.
      while (stream_.avail_in > 0) {
        if (Status status = Compress(BZ_RUN, nullptr); !status.ok()) {
          return status;
        }
      }
      data += piece;
      size -= piece;
    }
    return Status::Ok();
  }

  // BZ_FINISH has to be repeated until the library says that it is done: a last block may fill many
  // buffers.
  Status Finish() override {
    for (bool done = false; !done;) {
      if (Status status = Compress(BZ_FINISH, &done); !status.ok()) {
        return status;
      }
    }
    return file_->Finish();
  }

 private:
  // Everything that has come out is written at once, so the buffer is empty at each call.
  Status Compress(int action, bool* done) {
    stream_.next_out = output_.data();
    stream_.avail_out = kBufferSize;
    // Negative results are errors; what is positive says how far it has come.
    const int result = ready_ ? BZ2_bzCompress(&stream_, action) : BZ_MEM_ERROR;
    if (result < 0) {
      return Status::Error(StatusCode::kIo, "libbz2 cannot compress (out of memory?)");
    }
    if (done != nullptr) {
      *done = result == BZ_STREAM_END;
    }
    return file_->Write(output_.data(), kBufferSize - stream_.avail_out);
  }

  std::unique_ptr<ByteSink> file_;
  bz_stream stream_{};
  // A failure of the constructor.
  bool ready_ = false;
  std::array<char, kBufferSize> output_;
};

}  // namespace

std::unique_ptr<ByteSource> MakeBzip2Source(std::unique_ptr<ByteSource> compressed) {
  return std::make_unique<Bzip2Source>(std::move(compressed));
}

std::unique_ptr<ByteSink> MakeBzip2Sink(std::unique_ptr<ByteSink> file) {
  return std::make_unique<Bzip2Sink>(std::move(file));
}

}  // namespace inceres::internal
