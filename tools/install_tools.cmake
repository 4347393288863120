# Installs what users run, with a man page each where there is help2man to make one. The fuzzer
# has a man page, and stays: it judges the build that it is part of.
set(installed_tools bal_solve pose_graph_solve ab_compare covariance_compare replay bal_generate vio_simulate)
if(TARGET living_problem)
  list(APPEND installed_tools living_problem)
endif()
if(TARGET bal_solve_mpi)
  list(APPEND installed_tools bal_solve_mpi)
endif()
# What a partial build lacks is left out.
install(TARGETS ${installed_tools}
  RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT tools OPTIONAL)

# The script lies beside its package and the version, which in the source tree it has from
# CMakeLists.txt.
file(CONFIGURE OUTPUT ${CMAKE_CURRENT_BINARY_DIR}/version.txt CONTENT "@PROJECT_VERSION@\n" @ONLY)
set(script_folder ${CMAKE_INSTALL_DATADIR}/inceres)
install(PROGRAMS ab_report DESTINATION ${script_folder} COMPONENT tools)
install(DIRECTORY ab_page DESTINATION ${script_folder} COMPONENT tools
  FILES_MATCHING PATTERN "*.py" PATTERN "*.css")
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/version.txt
  DESTINATION ${script_folder}/ab_page COMPONENT tools)
file(RELATIVE_PATH script_from_bin
  ${CMAKE_INSTALL_FULL_BINDIR} ${CMAKE_INSTALL_FULL_DATADIR}/inceres/ab_report)
install(CODE "
  set(link \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/${CMAKE_INSTALL_BINDIR}/ab_report\")
  get_filename_component(folder \"\${link}\" DIRECTORY)
  file(MAKE_DIRECTORY \"\${folder}\")
  file(CREATE_LINK ${script_from_bin} \"\${link}\" SYMBOLIC)" COMPONENT tools)

find_program(INCERES_HELP2MAN help2man DOC "Makes the man pages of the tools")
if(NOT INCERES_HELP2MAN OR CMAKE_CROSSCOMPILING)
  message(STATUS "The tools get no man pages: no help2man")
  return()
endif()

# inceres_add_man_page(NAME PROGRAM): the page of a program, in the list man_pages.
set(man_pages)
function(inceres_add_man_page name program)
  set(page ${CMAKE_CURRENT_BINARY_DIR}/man/${name}.1)
  set(script ${CMAKE_CURRENT_SOURCE_DIR}/man/make_man_page.cmake)
  file(MAKE_DIRECTORY ${CMAKE_CURRENT_BINARY_DIR}/man)
  add_custom_command(OUTPUT ${page}
    COMMAND ${CMAKE_COMMAND}
      -D HELP2MAN=${INCERES_HELP2MAN} -D TOOL=${program} -D OUTPUT=${page} -P ${script}
    DEPENDS ${script} ${ARGN} COMMENT "Man page of ${name}" VERBATIM)
  set(man_pages ${man_pages} ${page} PARENT_SCOPE)
endfunction()

foreach(tool IN LISTS installed_tools)
  inceres_add_man_page(${tool} $<TARGET_FILE:${tool}> ${tool})
endforeach()
inceres_add_man_page(ab_report
  ${CMAKE_CURRENT_SOURCE_DIR}/ab_report ${CMAKE_CURRENT_SOURCE_DIR}/ab_page/habits.py)
install(FILES ${man_pages} DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 COMPONENT tools OPTIONAL)
inceres_add_man_page(differential_fuzzer
  $<TARGET_FILE:differential_fuzzer> differential_fuzzer)

# With the rest where programs can be run as they are built; with a sanitizer's runtime in them,
# when asked.
if(CMAKE_CXX_FLAGS MATCHES "-fsanitize")
  add_custom_target(man_pages DEPENDS ${man_pages})
else()
  add_custom_target(man_pages ALL DEPENDS ${man_pages})
endif()
