#include "tools/command_line/json_report.h"

#include <cstdio>
#include <string>

#include <gflags/gflags.h>
#include <nlohmann/json.hpp>

#include "tools/command_line/text_file.h"

DEFINE_string(json, "",
              "Write the report to this file as JSON; -: to standard output, which then gets "
              "nothing else.");

namespace inceres::tools {
namespace {

Status Write(const nlohmann::json& report, int indent, const char* how) {
  if (!WantsJson()) {
    return Status::Ok();
  }
  const std::string text =
      report.dump(indent, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
  if (FLAGS_json == "-") {
    return std::fputs(text.c_str(), stdout) >= 0 && std::fflush(stdout) == 0
               ? Status::Ok()
               : Status::Error(StatusCode::kIo, "--json -: cannot write to standard output");
  }
  Status status = WriteTextFile(FLAGS_json, text, how);
  status.message = status.ok() ? "" : "--json " + status.message;
  return status;
}

}  // namespace

bool WantsJson() {
  return !FLAGS_json.empty();
}

Status WriteJsonReport(const nlohmann::json& report) {
  return Write(report, 2, "w");
}

Status AppendJsonReport(const nlohmann::json& report) {
  return Write(report, -1, "a");
}

}  // namespace inceres::tools
