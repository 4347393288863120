# MPI and PETSc, real numbers, for inceres::distributed: target PetscMpi::PetscMpi. Its headers are
# those of the system.
find_package(MPI QUIET COMPONENTS CXX)
find_package(PkgConfig QUIET)
if(PKG_CONFIG_FOUND)
  pkg_check_modules(PetscMpi_PETSC QUIET IMPORTED_TARGET PETSc>=3.18)
endif()
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(PetscMpi
  REQUIRED_VARS MPI_CXX_FOUND PetscMpi_PETSC_FOUND
  VERSION_VAR PetscMpi_PETSC_VERSION)
# Of both packages what is needed to compile and to link, and none of the flags that Debian built
# them with.
if(PetscMpi_FOUND AND NOT TARGET PetscMpi::PetscMpi)
  add_library(PetscMpi::PetscMpi INTERFACE IMPORTED)
  set_property(TARGET PetscMpi::PetscMpi PROPERTY INTERFACE_INCLUDE_DIRECTORIES
    ${PetscMpi_PETSC_INCLUDE_DIRS} ${MPI_CXX_INCLUDE_DIRS})
  set_property(TARGET PetscMpi::PetscMpi PROPERTY INTERFACE_LINK_LIBRARIES
    ${PetscMpi_PETSC_LINK_LIBRARIES} ${MPI_CXX_LIBRARIES})
endif()
