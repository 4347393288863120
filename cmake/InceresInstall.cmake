# Installs libraries, headers, tools, a find_package(inceres) configuration with one export set per
# library, so that a user of inceres::core needs no Ceres, and .pc files. No file has a path of this
# machine in it: the prefix can be moved.
#
# Each file belongs to one of the install components, which are Debian packages too
# (cmake/InceresPackages.cmake):
#   core, core_dev   shared libraries of core and io; what one builds against them with
#   ceres, ceres_dev the same for the adapter to Ceres
#   dropin           the library to preload
#   tools            programs
#   distributed_dev  the solver over MPI, static, where it is built; in no Debian package
include(CMakePackageConfigHelpers)

set(INCERES_CONFIG_DIR ${CMAKE_INSTALL_LIBDIR}/cmake/inceres)

# inceres_install_library(NAME EXPORT_NAME COMPONENT DEVELOPMENT_COMPONENT), if this build has it.
function(inceres_install_library name export_name component dev_component)
  if(NOT TARGET inceres_${name})
    return()
  endif()
  set_target_properties(inceres_${name} PROPERTIES EXPORT_NAME ${export_name})
  install(TARGETS inceres_${name} EXPORT inceres_${export_name}_targets
    ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT ${dev_component}
    LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT ${component}
    NAMELINK_COMPONENT ${dev_component})
  install(EXPORT inceres_${export_name}_targets NAMESPACE inceres::
    FILE inceres_${export_name}.cmake DESTINATION ${INCERES_CONFIG_DIR} COMPONENT ${dev_component})
endfunction()

inceres_install_library(core core_static core core_dev)
inceres_install_library(core_shared core_shared core core_dev)
inceres_install_library(io io_static core core_dev)
inceres_install_library(io_shared io_shared core core_dev)
inceres_install_library(ceres ceres_static ceres ceres_dev)
inceres_install_library(ceres_shared ceres_shared ceres ceres_dev)
inceres_install_library(distributed distributed distributed_dev distributed_dev)
inceres_install_library(dropin dropin dropin ceres_dev)
inceres_install_library(dropin_static dropin_static ceres ceres_dev)

install(DIRECTORY include/inceres DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT core_dev
  FILES_MATCHING PATTERN "*.h" PATTERN "distributed" EXCLUDE)
if(TARGET inceres_distributed)
  install(DIRECTORY include/inceres/distributed DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/inceres
    COMPONENT distributed_dev FILES_MATCHING PATTERN "*.h")
  install(FILES cmake/FindPetscMpi.cmake DESTINATION ${INCERES_CONFIG_DIR}
    COMPONENT distributed_dev)
endif()
if(TARGET inceres_ceres)
  install(DIRECTORY adapters/ceres/include/inceres DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}
    COMPONENT ceres_dev FILES_MATCHING PATTERN "*.h")
  install(FILES cmake/SharedCeres.cmake DESTINATION ${INCERES_CONFIG_DIR} COMPONENT ceres_dev)
endif()
configure_package_config_file(
  cmake/inceresConfig.cmake.in ${PROJECT_BINARY_DIR}/cmake/inceresConfig.cmake
  INSTALL_DESTINATION ${INCERES_CONFIG_DIR}
  NO_SET_AND_CHECK_MACRO NO_CHECK_REQUIRED_COMPONENTS_MACRO)
write_basic_package_version_file(
  ${PROJECT_BINARY_DIR}/cmake/inceresConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES
  ${PROJECT_BINARY_DIR}/cmake/inceresConfig.cmake
  ${PROJECT_BINARY_DIR}/cmake/inceresConfigVersion.cmake
  cmake/FindSparseOrdering.cmake
  DESTINATION ${INCERES_CONFIG_DIR} COMPONENT core_dev)

include(InceresPkgConfig)
