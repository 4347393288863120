# Installs libraries, headers and a find_package(inceres) configuration with one export set per component, so that a user of
# inceres::core needs no Ceres.
include(CMakePackageConfigHelpers)

set(INCERES_CONFIG_DIR ${CMAKE_INSTALL_LIBDIR}/cmake/inceres)

# In the order of their dependencies; a component that this build does not have is left out.
set(INCERES_COMPONENTS)
foreach(component core io ceres dropin dropin_static)
  if(NOT TARGET inceres_${component})
    continue()
  endif()
  list(APPEND INCERES_COMPONENTS ${component})
  set_target_properties(inceres_${component} PROPERTIES EXPORT_NAME ${component})
  install(TARGETS inceres_${component} EXPORT inceres_${component}_targets
    ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR}
    LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR})
  install(EXPORT inceres_${component}_targets
    NAMESPACE inceres:: FILE inceres_${component}.cmake DESTINATION ${INCERES_CONFIG_DIR})
endforeach()

install(DIRECTORY include/inceres DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} FILES_MATCHING PATTERN "*.h")
if(TARGET inceres_ceres)
  install(DIRECTORY adapters/ceres/include/inceres DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} FILES_MATCHING PATTERN "*.h")
endif()

configure_package_config_file(cmake/inceresConfig.cmake.in ${PROJECT_BINARY_DIR}/cmake/inceresConfig.cmake
  INSTALL_DESTINATION ${INCERES_CONFIG_DIR} NO_SET_AND_CHECK_MACRO NO_CHECK_REQUIRED_COMPONENTS_MACRO)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/cmake/inceresConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES
  ${PROJECT_BINARY_DIR}/cmake/inceresConfig.cmake
  ${PROJECT_BINARY_DIR}/cmake/inceresConfigVersion.cmake
  cmake/FindSparseOrdering.cmake
  DESTINATION ${INCERES_CONFIG_DIR})
