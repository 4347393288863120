# Ceres::ceres may be the static library (Debian's is). Target Ceres::shared: the shared one with
# the same headers, where there is one beside it; INCERES_SHARED_CERES is its file. A program that
# the drop-in is to be preloaded into links this one; the drop-in and the shared adapter bring it.
# Part of the build and of the installed package: its path is that of whose machine it is.
get_target_property(_inceres_ceres_file Ceres::ceres LOCATION)
get_filename_component(_inceres_ceres_folder ${_inceres_ceres_file} DIRECTORY)
find_library(INCERES_SHARED_CERES libceres.so PATHS ${_inceres_ceres_folder} NO_DEFAULT_PATH
  DOC "The shared Ceres, which inceres::dropin stands in front of")
mark_as_advanced(INCERES_SHARED_CERES)
if(INCERES_SHARED_CERES AND NOT TARGET Ceres::shared)
  add_library(Ceres::shared SHARED IMPORTED GLOBAL)
  set_target_properties(Ceres::shared PROPERTIES IMPORTED_LOCATION ${INCERES_SHARED_CERES})
  target_include_directories(Ceres::shared INTERFACE
    $<TARGET_PROPERTY:Ceres::ceres,INTERFACE_INCLUDE_DIRECTORIES>)
  target_link_libraries(Ceres::shared INTERFACE glog::glog Eigen3::Eigen)
endif()
