# What every target of this project has in common.
function(inceres_set_defaults target)
  target_compile_features(${target} PUBLIC cxx_std_17)
  set_target_properties(${target} PROPERTIES
    CXX_EXTENSIONS OFF
    CXX_VISIBILITY_PRESET hidden
    VISIBILITY_INLINES_HIDDEN ON
    POSITION_INDEPENDENT_CODE ON)
  target_compile_options(${target} PRIVATE -Wall -Wextra -Wshadow -Wconversion -Wno-sign-conversion)
  if(CMAKE_UNITY_BUILD AND CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
    # GCC takes the sources compiled together for headers; and it is a tenth faster where it need not collect its garbage, in up to
    # 2 GB.
    target_compile_options(${target} PRIVATE -Wno-subobject-linkage --param=ggc-min-heapsize=2000000)
  endif()
  if(INCERES_WARNINGS_AS_ERRORS)
    target_compile_options(${target} PRIVATE -Werror)
  endif()
endfunction()

# One folder of src/ that becomes part of inceres::core: an object library that sees the public
# headers and src/.
function(inceres_add_module name)
  add_library(inceres_${name} OBJECT ${ARGN})
  inceres_set_defaults(inceres_${name})
  target_include_directories(inceres_${name} PUBLIC
    $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/include> $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/src>)
endfunction()

# A component of the package, in two forms made of the same objects: inceres_NAME is static,
# inceres_NAME_shared is shared and there if INCERES_BUILD_SHARED. This project's programs and tests
# link the static one, for they look inside; where the project is part of another, inceres::NAME is
# the form that BUILD_SHARED_LIBS asks for.
#   inceres_add_component(NAME OBJECT_LIBRARY…)
function(inceres_add_component name)
  list(TRANSFORM ARGN REPLACE "(.+)" "$<TARGET_OBJECTS:\\1>" OUTPUT_VARIABLE objects)
  add_library(inceres_${name} STATIC ${objects})
  add_library(inceres::${name}_static ALIAS inceres_${name})
  set(preferred inceres_${name})
  if(INCERES_BUILD_SHARED)
    add_library(inceres_${name}_shared SHARED ${objects})
    add_library(inceres::${name}_shared ALIAS inceres_${name}_shared)
    inceres_set_shared(inceres_${name}_shared inceres_${name})
    if(BUILD_SHARED_LIBS AND NOT PROJECT_IS_TOP_LEVEL)
      set(preferred inceres_${name}_shared)
    endif()
  endif()
  add_library(inceres::${name} ALIAS ${preferred})
  foreach(target inceres_${name} inceres_${name}_shared)
    if(TARGET ${target})
      inceres_set_defaults(${target})
      set_target_properties(${target} PROPERTIES LINKER_LANGUAGE CXX)
      target_include_directories(${target} PUBLIC
        $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/include>
        $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
    endif()
  endforeach()
endfunction()

# target_link_libraries for both forms of a component.
function(inceres_link_component name)
  foreach(target inceres_${name} inceres_${name}_shared)
    if(TARGET ${target})
      target_link_libraries(${target} ${ARGN})
    endif()
  endforeach()
endfunction()

# A shared library of this project: its SONAME, and nothing exported but what is marked
# INCERES_EXPORT (docs/abi.md). Its calls of its own functions go straight there, as in the static
# one.
function(inceres_set_shared target output_name)
  set(map ${PROJECT_BINARY_DIR}/cmake/exports.map)
  configure_file(${PROJECT_SOURCE_DIR}/cmake/exports.map.in ${map} @ONLY)
  set_target_properties(${target} PROPERTIES
    OUTPUT_NAME ${output_name}
    VERSION ${PROJECT_VERSION}
    SOVERSION ${INCERES_SOVERSION}
    LINK_DEPENDS ${map})
  target_link_options(${target} PRIVATE
    LINKER:--version-script=${map} LINKER:-z,defs LINKER:-Bsymbolic-functions)
  inceres_keep_loaded(${target})
endfunction()

# A shared library that stays where it is when whoever loaded it is unloaded: threads of oneTBB's,
# which it brings, sleep there between two solves.
function(inceres_keep_loaded target)
  target_link_options(${target} PRIVATE LINKER:-z,nodelete)
endfunction()
