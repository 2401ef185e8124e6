# Installs, moves and consumes the library, static and shared, by find_package, pkg-config and add_subdirectory.
# Usage: cmake -DSOURCE= -DBUILD= -DWORK= -DLAUNCHER= -DTBB= -P install_test.cmake
cmake_minimum_required(VERSION 3.24)

function(run)
    execute_process(COMMAND ${ARGV} RESULT_VARIABLE result OUTPUT_VARIABLE output ERROR_VARIABLE output)
    if(NOT result EQUAL 0)
        list(JOIN ARGV " " command)
        message(FATAL_ERROR "${command}\n${output}")
    endif()
    set(output "${output}" PARENT_SCOPE)
endfunction()

# Consumes the installation at `prefix`, after moving it: nothing in it may know where it was made.
function(consume build name)
    set(made ${WORK}/${name}-made)
    set(prefix ${WORK}/${name})
    run(${CMAKE_COMMAND} --install ${build} --prefix ${made})
    file(RENAME ${made} ${prefix})
    file(GLOB_RECURSE texts ${prefix}/*.cmake ${prefix}/*.pc)
    foreach(text ${texts})
        file(READ ${text} content)
        foreach(path ${SOURCE} ${WORK})
            string(FIND "${content}" "${path}" at)
            if(NOT at EQUAL -1)
                message(FATAL_ERROR "${text} names ${path}")
            endif()
        endforeach()
    endforeach()

    run(${CMAKE_COMMAND} -S ${CMAKE_CURRENT_LIST_DIR}/consumer -B ${WORK}/${name}-consumer -G Ninja
        -DCMAKE_PREFIX_PATH=${prefix})
    run(${CMAKE_COMMAND} --build ${WORK}/${name}-consumer)
    run(${WORK}/${name}-consumer/consumer)
    message("find_package, ${name}: ${output}")

    find_program(pkg_config NAMES pkg-config pkgconf)
    find_program(cxx NAMES c++ g++ clang++)
    file(GLOB_RECURSE pc ${prefix}/*.pc)
    if(pkg_config AND cxx)
        cmake_path(GET pc PARENT_PATH folder)
        cmake_path(GET folder PARENT_PATH libraries)
        run(${CMAKE_COMMAND} -E env PKG_CONFIG_PATH=${folder} ${pkg_config} --static --cflags --libs nusselt)
        separate_arguments(flags UNIX_COMMAND "${output}")
        run(${cxx} -std=c++17 ${CMAKE_CURRENT_LIST_DIR}/consumer/main.cpp -o ${WORK}/${name}-pc ${flags}
            -Wl,-rpath,${libraries})
        run(${WORK}/${name}-pc)
        message("pkg-config, ${name}: ${output}")
    endif()
endfunction()

file(REMOVE_RECURSE ${WORK})
consume(${BUILD} static)

run(${CMAKE_COMMAND} -S ${CMAKE_CURRENT_LIST_DIR}/host -B ${WORK}/host -G Ninja -DCMAKE_BUILD_TYPE=Release
    -DNUSSELT_SOURCE=${SOURCE} -DBUILD_SHARED_LIBS=ON -DNUSSELT_INSTALL=ON -DNUSSELT_TBB=${TBB}
    -DCMAKE_CXX_COMPILER_LAUNCHER=${LAUNCHER})
run(${CMAKE_COMMAND} --build ${WORK}/host --parallel 2)
run(${WORK}/host/host)
message("add_subdirectory, shared: ${output}")
consume(${WORK}/host shared)

# Only the public functions are to be seen.
find_program(nm nm)
file(GLOB shared ${WORK}/shared/lib*/libnusselt.so ${WORK}/shared/lib/*/libnusselt.so)
if(nm AND shared)
    run(${nm} -DC --defined-only ${shared})
    string(REGEX MATCHALL "[^\n]* [TBDR] [^\n]*" symbols "${output}")
    foreach(symbol ${symbols})
        if(NOT symbol MATCHES " T nusselt::[a-z_]+\\(")
            message(FATAL_ERROR "the shared library shows more than public functions: ${symbol}")
        endif()
    endforeach()
    list(LENGTH symbols count)
    message("shared library: ${count} functions")
endif()
file(REMOVE_RECURSE ${WORK})
