# Ceres::ceres may be the static library (Debian's is). Target Ceres::shared: the shared one with the same headers, where there is one;
# INCERES_SHARED_CERES is its file. A program that the drop-in is to be preloaded into links this one.
find_library(INCERES_SHARED_CERES libceres.so DOC "The shared Ceres, which inceres::dropin stands in front of")
mark_as_advanced(INCERES_SHARED_CERES)
if(INCERES_SHARED_CERES AND NOT TARGET Ceres::shared)
  add_library(Ceres::shared SHARED IMPORTED GLOBAL)
  set_target_properties(Ceres::shared PROPERTIES IMPORTED_LOCATION ${INCERES_SHARED_CERES})
  target_include_directories(Ceres::shared INTERFACE $<TARGET_PROPERTY:Ceres::ceres,INTERFACE_INCLUDE_DIRECTORIES>)
  target_link_libraries(Ceres::shared INTERFACE glog::glog Eigen3::Eigen)
endif()
