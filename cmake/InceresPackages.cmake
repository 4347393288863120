# Debian packages, one for each install component: `cpack` in a build directory of preset deb, or
# tools/package_deb.sh. Configure with the prefix /usr, for which the folders are Debian's.
set(INCERES_PACKAGE_MAINTAINER "inceres authors <inceres@users.noreply.github.com>"
  CACHE STRING "Who answers for the .deb packages: a name and an <address>")

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME inceres)
set(CPACK_PACKAGE_VENDOR inceres)
set(CPACK_PACKAGE_CONTACT "${INCERES_PACKAGE_MAINTAINER}")
set(CPACK_PACKAGE_DIRECTORY ${PROJECT_BINARY_DIR}/packages)
set(CPACK_PACKAGING_INSTALL_PREFIX ${CMAKE_INSTALL_PREFIX})
set(CPACK_STRIP_FILES ON)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_GROUPING IGNORE)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_GENERATE_SHLIBS ON)
set(CPACK_DEBIAN_PACKAGE_GENERATE_SHLIBS_POLICY ">=")
# Where dpkg-shlibdeps finds the libraries of the other packages.
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS
  ${PROJECT_BINARY_DIR}/src ${PROJECT_BINARY_DIR}/src/io ${PROJECT_BINARY_DIR}/adapters/ceres)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(triggers ${PROJECT_SOURCE_DIR}/packaging/deb/triggers)  # of packages with a shared library

# Debian's version and the names with the SONAME in them.
set(deb_version ${PROJECT_VERSION}-${CPACK_DEBIAN_PACKAGE_RELEASE})
set(deb_core libinceres${INCERES_SOVERSION})
set(deb_ceres libinceres-ceres${INCERES_SOVERSION})
set(same "(= ${deb_version})")

# What every package has to have: who may do what with it, and what changed.
file(STRINGS packaging/deb/changelog changelog_head LIMIT_COUNT 1)
if(NOT changelog_head MATCHES "^inceres \\(${deb_version}\\)")
  message(FATAL_ERROR
    "packaging/deb/changelog begins with \"${changelog_head}\": not ${deb_version}")
endif()
find_program(GZIP_PROGRAM gzip REQUIRED)
mark_as_advanced(GZIP_PROGRAM)
execute_process(COMMAND ${GZIP_PROGRAM} -9n
  INPUT_FILE ${PROJECT_SOURCE_DIR}/packaging/deb/changelog
  OUTPUT_FILE ${PROJECT_BINARY_DIR}/cmake/changelog.Debian.gz COMMAND_ERROR_IS_FATAL ANY)

# inceres_add_deb(COMPONENT PACKAGE SECTION DEPENDS SUMMARY TEXT): one package. Shared libraries
# that its programs load are added to DEPENDS by dpkg-shlibdeps.
set(CPACK_COMPONENTS_ALL)
macro(inceres_add_deb component package section depends summary text)
  list(APPEND CPACK_COMPONENTS_ALL ${component})
  string(TOUPPER ${component} upper)
  set(CPACK_DEBIAN_${upper}_PACKAGE_NAME ${package})
  set(CPACK_DEBIAN_${upper}_PACKAGE_SECTION ${section})
  set(CPACK_DEBIAN_${upper}_PACKAGE_DEPENDS "${depends}")
  if("${section}" STREQUAL libs)
    set(CPACK_DEBIAN_${upper}_PACKAGE_CONTROL_EXTRA ${triggers})
  endif()
  set(CPACK_DEBIAN_${upper}_DESCRIPTION "${summary}\n${text}")
  install(FILES packaging/deb/copyright ${PROJECT_BINARY_DIR}/cmake/changelog.Debian.gz
    DESTINATION ${CMAKE_INSTALL_DATAROOTDIR}/doc/${package}
    COMPONENT ${component} EXCLUDE_FROM_ALL)
endmacro()

string(CONCAT about
  "inceres minimizes bundle-adjustment problems and pose graphs, at once or\n"
  "step by step as they grow.")
inceres_add_deb(core ${deb_core} libs ""
  "bundle-adjustment solver, incremental: shared libraries"
  "${about}\nThis package has the solver and the readers of problem files.")
inceres_add_deb(core_dev libinceres-dev libdevel
  "${deb_core} ${same}, libtbb-dev, libsuitesparse-dev, libmetis-dev, zlib1g-dev, libbz2-dev"
  "bundle-adjustment solver, incremental: development files"
  "${about}\nThis package has headers, static libraries, and files for CMake and\npkg-config.")
set(needs_ceres "libceres-dev, libgoogle-glog-dev, libeigen3-dev")
if(TARGET inceres_ceres_shared)
  inceres_add_deb(ceres ${deb_ceres} libs "${deb_core} ${same}"
    "bundle-adjustment solver for problems written with Ceres: shared library"
    "${about}\nThis package has inceres::Solve for a ceres::Problem. It brings Ceres.")
  inceres_add_deb(ceres_dev libinceres-ceres-dev libdevel
    "${deb_ceres} ${same}, libinceres-dev ${same}, inceres-dropin ${same}, ${needs_ceres}"
    "bundle-adjustment solver for problems written with Ceres: development files"
    "${about}\nThis package has headers and libraries to call it from code written with\nCeres.")
endif()
if(TARGET inceres_dropin)
  inceres_add_deb(dropin inceres-dropin libs ""
    "bundle-adjustment solver that takes the place of Ceres in a program"
    "${about}\nThis package has a library to preload into programs that use the shared\nCeres.")
endif()
if(INCERES_BUILD_TOOLS)
  inceres_add_deb(tools inceres-tools science ""
    "bundle-adjustment solver, incremental: command line tools"
    "${about}\nThis package solves, replays, generates and compares problems from files.")
endif()
# The Python package, where a target installs component python.
if(TARGET inceres_python)
  inceres_add_deb(python python3-inceres python "python3, python3-numpy"
    "bundle-adjustment solver, incremental: Python package"
    "${about}\nThis package is the Python interface, on NumPy arrays.")
endif()

include(CPack)
