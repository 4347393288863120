# cmake -P script: makes OUTPUT, the man page of the program TOOL, of what its --help and --version
# say. HELP2MAN is that program.
execute_process(COMMAND ${TOOL} --help OUTPUT_VARIABLE help COMMAND_ERROR_IS_FATAL ANY)
if(NOT help MATCHES "^Usage: [^\n]*\n([A-Z][^\n]+)\\.\n")
  message(FATAL_ERROR "${TOOL} --help does not begin with a line of usage and a sentence:\n${help}")
endif()
execute_process(
  COMMAND ${HELP2MAN} --no-info --section=1 --source=inceres --manual=inceres
    --name=${CMAKE_MATCH_1} ${TOOL}
  OUTPUT_VARIABLE page COMMAND_ERROR_IS_FATAL ANY)

# What help2man does not know: examples keep their lines, and exit codes are a section.
string(REPLACE ".SH EXAMPLES\n" ".SH EXAMPLES\n.nf\n" page "${page}")
string(REPLACE ".SS \"Exit codes:\"\n" ".SH \"EXIT CODES\"\n" page "${page}")
file(WRITE ${OUTPUT} "${page}")
