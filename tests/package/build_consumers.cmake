# cmake -P script: installs BINARY_DIR below WORK_DIR, moves the installation elsewhere, then
# configures, builds and runs each consumer project against it.
cmake_minimum_required(VERSION 3.25)

function(run)
  execute_process(COMMAND ${ARGV} COMMAND_ECHO STDOUT RESULT_VARIABLE result)
  if(NOT result EQUAL 0)
    message(FATAL_ERROR "failed (${result}): ${ARGV}")
  endif()
endfunction()

# expect_libraries(PROGRAM WITH WITHOUT): what it loads matches the first regular expression and not
# the second.
function(expect_libraries program with without)
  execute_process(COMMAND ldd ${program} OUTPUT_VARIABLE libraries COMMAND_ERROR_IS_FATAL ANY)
  if(NOT libraries MATCHES "${with}" OR libraries MATCHES "${without}|not found")
    message(FATAL_ERROR "${program} is to load ${with}, not ${without}; it loads\n${libraries}")
  endif()
endfunction()

# consume(NAME OPTIONS…): builds and runs the project of this name; OPTIONS go to its
# configure step.
function(consume name)
  set(build ${WORK_DIR}/${name})
  if("-Dinceres_SHARED=ON" IN_LIST ARGN)
    string(APPEND build _shared)
  endif()
  run(${CMAKE_COMMAND} -S ${CMAKE_CURRENT_LIST_DIR}/${name} -B ${build} -G ${GENERATOR}
    --no-warn-unused-cli -DCMAKE_CXX_COMPILER=${CXX_COMPILER} "-DCMAKE_CXX_FLAGS=${CXX_FLAGS}"
    -DCMAKE_BUILD_TYPE=Release -DCMAKE_PREFIX_PATH=${prefix}
    -DCMAKE_FIND_USE_PACKAGE_REGISTRY=OFF ${ARGN})
  run(${CMAKE_COMMAND} --build ${build})
  if(EXISTS ${build}/consumer)
    run(${build}/consumer)
  endif()
endfunction()

# consume_pc(NAME OPTIONS…): the same program by pkg-config alone; OPTIONS go to the compiler, after
# its flags.
function(consume_pc name)
  set(program ${WORK_DIR}/${name}/pc_consumer)
  set(ENV{PKG_CONFIG_PATH} ${prefix}/${LIB_DIR}/pkgconfig)
  execute_process(COMMAND pkg-config --cflags --libs inceres-${name}
    OUTPUT_VARIABLE flags OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
  separate_arguments(flags UNIX_COMMAND "${flags} ${CXX_FLAGS}")
  run(${CXX_COMPILER} -std=c++17 -O1 ${CMAKE_CURRENT_LIST_DIR}/${name}/main.cc -o ${program}
    ${flags} ${ARGN})
  run(${CMAKE_COMMAND} -E env LD_LIBRARY_PATH=${prefix}/${LIB_DIR} ${program})
endfunction()

# No file that others read has a path of this machine in it, neither where it was built nor where it
# was installed first.
function(expect_no_paths)
  file(GLOB_RECURSE files ${prefix}/*.cmake ${prefix}/*.pc ${prefix}/*.h)
  list(LENGTH files count)
  if(count LESS 50)
    message(FATAL_ERROR "${count} files were installed: not what a package has")
  endif()
  foreach(file IN LISTS files)
    file(STRINGS ${file} lines REGEX "${BINARY_DIR}|${WORK_DIR}|/lib[a-z]+\\.(so|a)\"|[\"=;]/usr")
    foreach(line IN LISTS lines)
      if(NOT line MATCHES "_IMPORT_PREFIX|_inceres_")
        message(FATAL_ERROR "${file} is not relocatable: ${line}")
      endif()
    endforeach()
  endforeach()
  file(GLOB libraries ${prefix}/${LIB_DIR}/*.so)
  foreach(library IN LISTS libraries)
    execute_process(COMMAND readelf --dynamic --wide ${library}
      OUTPUT_VARIABLE entries COMMAND_ERROR_IS_FATAL ANY)
    if(entries MATCHES "R(UN)?PATH[^\n]*\\[/")
      message(FATAL_ERROR "${library} looks for libraries in a fixed folder:\n${entries}")
    endif()
  endforeach()
endfunction()

file(REMOVE_RECURSE ${WORK_DIR})
run(${CMAKE_COMMAND} --install ${BINARY_DIR} --prefix ${WORK_DIR}/installed_first)
set(prefix ${WORK_DIR}/moved/prefix)
file(MAKE_DIRECTORY ${WORK_DIR}/moved)
file(RENAME ${WORK_DIR}/installed_first ${prefix})
expect_no_paths()

# Users of the core need neither Ceres nor what only the inside of inceres uses. Of CHOLMOD, whose
# supernodal part is under the GPL, the core links nothing: it orders by AMD and METIS.
set(no_ceres -DCMAKE_DISABLE_FIND_PACKAGE_Ceres=ON)
set(core_alone ${no_ceres} -DCMAKE_DISABLE_FIND_PACKAGE_Eigen3=ON
  -DCMAKE_DISABLE_FIND_PACKAGE_ZLIB=ON -DCMAKE_DISABLE_FIND_PACKAGE_BZip2=ON)
consume(core ${core_alone})
expect_libraries(${WORK_DIR}/core/consumer "libamd" "libinceres|libcholmod|libceres")
if(WITH_SHARED)
  consume(core ${core_alone} -Dinceres_SHARED=ON)
  expect_libraries(${WORK_DIR}/core_shared/consumer
    "moved/prefix/[^\n]*libinceres_core\\.so\\.[0-9.]+ " "libcholmod|libceres")
endif()
consume_pc(core)
consume(headers ${no_ceres} -DCMAKE_DISABLE_FIND_PACKAGE_Eigen3=ON)
consume(eigen ${no_ceres})
if(WITH_CERES)
  consume(ceres)
  consume_pc(ceres)
  if(WITH_SHARED AND WITH_DROPIN)
    consume(ceres -Dinceres_SHARED=ON)
    expect_libraries(${WORK_DIR}/ceres_shared/consumer "libinceres_ceres\\.so\\.[0-9.]+ " "nothing")
  endif()
endif()
if(WITH_DROPIN)
  consume(dropin)
  consume_pc(dropin)
endif()
if(WITH_DISTRIBUTED)
  consume(distributed ${no_ceres})
  run(${MPIEXEC} --map-by :OVERSUBSCRIBE -n 3 ${WORK_DIR}/distributed/consumer)
  expect_libraries(${WORK_DIR}/distributed/consumer "libpetsc.*libmpi|libmpi.*libpetsc" "libceres")
endif()
