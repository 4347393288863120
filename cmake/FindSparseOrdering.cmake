# What orders sparse matrices: AMD and CAMD of SuiteSparse, METIS 5. Target SparseOrdering::SparseOrdering. All names are this
# file's own: Ceres looks for some of the same libraries, and keeps what it finds under theirs.
set(_sparse_ordering_libraries)
foreach(library amd camd metis)
  find_path(SparseOrdering_${library}_INCLUDE_DIR ${library}.h PATH_SUFFIXES suitesparse)
  find_library(SparseOrdering_${library}_LIBRARY ${library})
  mark_as_advanced(SparseOrdering_${library}_INCLUDE_DIR SparseOrdering_${library}_LIBRARY)
  list(APPEND _sparse_ordering_libraries SparseOrdering_${library}_LIBRARY SparseOrdering_${library}_INCLUDE_DIR)
endforeach()
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(SparseOrdering REQUIRED_VARS ${_sparse_ordering_libraries})
if(SparseOrdering_FOUND AND NOT TARGET SparseOrdering::SparseOrdering)
  add_library(SparseOrdering::SparseOrdering INTERFACE IMPORTED)
  foreach(library amd camd metis)
    set_property(TARGET SparseOrdering::SparseOrdering APPEND PROPERTY
      INTERFACE_INCLUDE_DIRECTORIES ${SparseOrdering_${library}_INCLUDE_DIR})
    set_property(TARGET SparseOrdering::SparseOrdering APPEND PROPERTY
      INTERFACE_LINK_LIBRARIES ${SparseOrdering_${library}_LIBRARY})
  endforeach()
endif()
