#include "tools/command_line/json_report.h"

#include <cstdio>

#include <gflags/gflags.h>

#include "tools/command_line/text_file.h"

DEFINE_string(json, "",
              "Write the report to this file as JSON; -: to standard output, which then gets "
              "nothing else.");

namespace inceres::tools {
namespace {

Status Write(const std::string& json, const char* how) {
  if (!WantsJson()) {
    return Status::Ok();
  }
  if (FLAGS_json == "-") {
    return std::fputs((json + "\n").c_str(), stdout) >= 0 && std::fflush(stdout) == 0
               ? Status::Ok()
               : Status::Error(StatusCode::kIo, "--json -: cannot write to standard output");
  }
  Status status = WriteTextFile(FLAGS_json, json + "\n", how);
  status.message = status.ok() ? "" : "--json " + status.message;
  return status;
}

}  // namespace

bool WantsJson() {
  return !FLAGS_json.empty();
}

Status WriteJsonReport(const std::string& json) {
  return Write(json, "w");
}

Status AppendJsonReport(const std::string& json) {
  return Write(json, "a");
}

}  // namespace inceres::tools
