# What find_package(Ceres) has found: INCERES_CERES_RELEASE, "2.1", and INCERES_CERES_SONAME, the SONAME of that release's shared
# library, by which a running program is recognized to use it.
string(REGEX MATCH "^[0-9]+\\.[0-9]+" INCERES_CERES_RELEASE "${Ceres_VERSION}")
set(soversion_of_2.0 2)
set(soversion_of_2.1 3)
set(soversion_of_2.2 4)
if(NOT DEFINED soversion_of_${INCERES_CERES_RELEASE})
  message(FATAL_ERROR "The Ceres adapter is written for Ceres 2.0, 2.1 and 2.2; this is ${Ceres_VERSION}, in ${Ceres_DIR}")
endif()
set(INCERES_CERES_SONAME libceres.so.${soversion_of_${INCERES_CERES_RELEASE}})

# Ceres::ceres may be the static library (Debian's is). Target Ceres::shared: the shared one with the same headers, where there is
# one beside it; INCERES_SHARED_CERES is its file. A program that the drop-in is to be preloaded into links this one.
get_target_property(ceres_file Ceres::ceres LOCATION)
get_filename_component(ceres_folder ${ceres_file} DIRECTORY)
find_library(INCERES_SHARED_CERES libceres.so PATHS ${ceres_folder} NO_DEFAULT_PATH
  DOC "The shared Ceres, which inceres::dropin stands in front of")
mark_as_advanced(INCERES_SHARED_CERES)
if(INCERES_SHARED_CERES AND NOT TARGET Ceres::shared)
  add_library(Ceres::shared SHARED IMPORTED GLOBAL)
  set_target_properties(Ceres::shared PROPERTIES IMPORTED_LOCATION ${INCERES_SHARED_CERES})
  target_include_directories(Ceres::shared INTERFACE $<TARGET_PROPERTY:Ceres::ceres,INTERFACE_INCLUDE_DIRECTORIES>)
  target_link_libraries(Ceres::shared INTERFACE glog::glog Eigen3::Eigen)
endif()
