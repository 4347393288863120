#include "tools/command_line/read_progress.h"

#include <utility>

namespace inceres::tools {
namespace {

std::string Megabytes(std::int64_t bytes) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.0f MB", 1e-6 * static_cast<double>(bytes));
  return text;
}

std::string Percent(std::int64_t part, std::int64_t whole) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.0f %%",
                100.0 * static_cast<double>(part) / static_cast<double>(whole));
  return text;
}

}  // namespace

ReadProgressPrinter::ReadProgressPrinter(std::string path, std::FILE* out, double every_seconds)
    : path_(std::move(path)), lines_(out, every_seconds) {
}

void ReadProgressPrinter::operator()(std::int64_t bytes_read, std::int64_t file_bytes) {
  lines_([&] {
    return "reading " + path_ + ": " +
           (file_bytes > 0 ? Percent(bytes_read, file_bytes) + " of " + Megabytes(file_bytes)
                           : Megabytes(bytes_read));
  });
}

}  // namespace inceres::tools
