# Writes inceres_tools_build_info.h at every build, so that the commit it names cannot go stale; touches the file only if it changed.
# Arguments: SOURCE_DIR OUTPUT COMPILER FLAGS BUILD_TYPE
execute_process(COMMAND git describe --always --dirty --abbrev=12 WORKING_DIRECTORY ${SOURCE_DIR}
                OUTPUT_VARIABLE commit OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET RESULT_VARIABLE failed)
if(failed)
  set(commit "unknown (not built from a git checkout)")
endif()
set(content "#pragma once

namespace inceres::tools {
inline constexpr char kBuildCommit[] = \"${commit}\";
inline constexpr char kBuildCompiler[] = \"${COMPILER}\";
inline constexpr char kBuildFlags[] = \"${FLAGS}\";
inline constexpr char kBuildType[] = \"${BUILD_TYPE}\";
}  // namespace inceres::tools
")
if(EXISTS ${OUTPUT})
  file(READ ${OUTPUT} old_content)
endif()
if(NOT "${content}" STREQUAL "${old_content}")
  file(WRITE ${OUTPUT} "${content}")
endif()
