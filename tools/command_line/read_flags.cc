#include "tools/command_line/read_flags.h"

#include <gflags/gflags.h>

DEFINE_int64(max_unpacked_bytes, 0,
             "What a compressed file may unpack to; 0: 64 MiB, or 200 times the size of the file, "
             "whichever is more.");

namespace inceres::tools {

ReadOptions ReadOptionsFromFlags() {
  ReadOptions options;
  options.max_unpacked_bytes = FLAGS_max_unpacked_bytes;
  return options;
}

}  // namespace inceres::tools
