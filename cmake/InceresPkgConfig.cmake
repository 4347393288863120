# A .pc file for each shared library, or for the static one where no shared one is built. The prefix
# is where the file is found: it can be moved. Ceres, SuiteSparse and METIS have no .pc file in
# Debian and are named as the linker knows them.
file(RELATIVE_PATH INCERES_PC_TO_PREFIX
  ${CMAKE_INSTALL_FULL_LIBDIR}/pkgconfig ${CMAKE_INSTALL_PREFIX})
string(REGEX REPLACE "/$" "" INCERES_PC_TO_PREFIX ${INCERES_PC_TO_PREFIX})

# inceres_install_pc(NAME LIBRARY COMPONENT DESCRIPTION REQUIRES LIBS REQUIRES_INSIDE LIBS_INSIDE):
# the last two are what the library itself needs, of which a program sees nothing where it is
# shared.
function(inceres_install_pc
  name library component description requires libs requires_inside libs_inside)
  set(private .private)
  if(NOT TARGET inceres_${library}_shared AND NOT library STREQUAL dropin)
    set(private)
  endif()
  if(private)
    set(lines
      "Requires: ${requires}" "Requires.private: ${requires_inside}"
      "Libs: -L\${libdir} -linceres_${library} ${libs}" "Libs.private: ${libs_inside}")
  else()
    set(lines
      "Requires: ${requires} ${requires_inside}"
      "Libs: -L\${libdir} -linceres_${library} ${libs} ${libs_inside}")
  endif()
  list(TRANSFORM lines STRIP)
  list(FILTER lines EXCLUDE REGEX ":$")
  list(JOIN lines "\n" lines)
  configure_file(${PROJECT_SOURCE_DIR}/cmake/inceres.pc.in
    ${PROJECT_BINARY_DIR}/cmake/inceres-${name}.pc @ONLY)
  install(FILES ${PROJECT_BINARY_DIR}/cmake/inceres-${name}.pc
    DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT ${component})
endfunction()

inceres_install_pc(core core core_dev "incremental bundle adjustment"
  "" "" "tbb" "-lamd -lcamd -lmetis -lstdc++ -lm")
inceres_install_pc(io io core_dev "files of bundle-adjustment problems and pose graphs"
  "inceres-core = ${PROJECT_VERSION}" "" "zlib" "-lbz2 -lstdc++ -lm")
if(TARGET inceres_ceres)
  inceres_install_pc(ceres ceres ceres_dev "bundle adjustment of a ceres::Problem"
    "inceres-core = ${PROJECT_VERSION} libglog eigen3" "-lceres" "" "-lstdc++ -lm")
endif()
if(TARGET inceres_dropin)
  inceres_install_pc(dropin dropin ceres_dev "ceres::Solve in front of Ceres"
    "libglog eigen3" "-lceres" "" "")
endif()
