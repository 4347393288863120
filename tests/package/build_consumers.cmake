# cmake -P script: installs BINARY_DIR below WORK_DIR, then configures, builds and runs each consumer project against it.
cmake_minimum_required(VERSION 3.25)

function(run)
  execute_process(COMMAND ${ARGV} COMMAND_ECHO STDOUT RESULT_VARIABLE result)
  if(NOT result EQUAL 0)
    message(FATAL_ERROR "failed (${result}): ${ARGV}")
  endif()
endfunction()

# consume(NAME OPTIONS…): OPTIONS go to the consumer's configure step.
function(consume name)
  set(build ${WORK_DIR}/${name})
  run(${CMAKE_COMMAND} -S ${CMAKE_CURRENT_LIST_DIR}/${name} -B ${build} -G ${GENERATOR} --no-warn-unused-cli
    -DCMAKE_CXX_COMPILER=${CXX_COMPILER} "-DCMAKE_CXX_FLAGS=${CXX_FLAGS}" -DCMAKE_BUILD_TYPE=Release
    -DCMAKE_PREFIX_PATH=${WORK_DIR}/prefix -DCMAKE_FIND_USE_PACKAGE_REGISTRY=OFF ${ARGN})
  run(${CMAKE_COMMAND} --build ${build})
  if(EXISTS ${build}/consumer)
    run(${build}/consumer)
  endif()
endfunction()

file(REMOVE_RECURSE ${WORK_DIR})
run(${CMAKE_COMMAND} --install ${BINARY_DIR} --prefix ${WORK_DIR}/prefix)

# Users of the core need neither Ceres nor what only the inside of inceres uses.
set(no_ceres -DCMAKE_DISABLE_FIND_PACKAGE_Ceres=ON)
consume(core ${no_ceres}
  -DCMAKE_DISABLE_FIND_PACKAGE_Eigen3=ON -DCMAKE_DISABLE_FIND_PACKAGE_ZLIB=ON -DCMAKE_DISABLE_FIND_PACKAGE_BZip2=ON)
# Of CHOLMOD, whose supernodal part is under the GPL, the core links nothing: it orders by AMD and METIS.
execute_process(COMMAND ldd ${WORK_DIR}/core/consumer OUTPUT_VARIABLE libraries COMMAND_ERROR_IS_FATAL ANY)
if(NOT libraries MATCHES "libamd" OR libraries MATCHES "libcholmod|libceres")
  message(FATAL_ERROR "a program with the core alone is to load libamd, neither libcholmod nor libceres; it loads\n${libraries}")
endif()
consume(headers ${no_ceres} -DCMAKE_DISABLE_FIND_PACKAGE_Eigen3=ON)
consume(eigen ${no_ceres})
if(WITH_CERES)
  consume(ceres)
endif()
if(WITH_DROPIN)
  consume(dropin)
endif()
