# What find_package(Ceres) has found: INCERES_CERES_RELEASE, "2.1", and INCERES_CERES_SONAME, the
# SONAME of that release's shared library, by which a running program is recognized to use it.
string(REGEX MATCH "^[0-9]+\\.[0-9]+" INCERES_CERES_RELEASE "${Ceres_VERSION}")
set(soversion_of_2.0 2)
set(soversion_of_2.1 3)
set(soversion_of_2.2 4)
if(NOT DEFINED soversion_of_${INCERES_CERES_RELEASE})
  message(FATAL_ERROR
    "The Ceres adapter is written for Ceres 2.0, 2.1 and 2.2; this is ${Ceres_VERSION}, "
    "in ${Ceres_DIR}")
endif()
set(INCERES_CERES_SONAME libceres.so.${soversion_of_${INCERES_CERES_RELEASE}})
