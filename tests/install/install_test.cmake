# Installs, moves and consumes the library, static and shared, by find_package, pkg-config, add_subdirectory,
# FetchContent and as a Debian package. Every consumer prints the hash of one frame, which must be the same.
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

# consumed(<what> <program>): it runs, and its hash is that of the consumers before it.
set(hash "")
function(consumed what program)
    run(${program})
    string(REGEX MATCH "hash [0-9a-f]+" here "${output}")
    if(NOT here OR (hash AND NOT here STREQUAL hash))
        message(FATAL_ERROR "${what}: ${output}\nwhere the others have ${hash}")
    endif()
    set(hash ${here} PARENT_SCOPE)
    message("${what}: ${output}")
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
    consumed("find_package, ${name}" ${WORK}/${name}-consumer/consumer)

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
        consumed("pkg-config, ${name}" ${WORK}/${name}-pc)
    endif()
    set(hash ${hash} PARENT_SCOPE)
endfunction()

file(REMOVE_RECURSE ${WORK})
consume(${BUILD} static)

# The Debian package, unpacked into a root of its own.
find_program(dpkg_deb dpkg-deb)
if(dpkg_deb)
    run(${CMAKE_CPACK_COMMAND} -G DEB --config ${BUILD}/CPackConfig.cmake -B ${WORK}/deb)
    file(GLOB package ${WORK}/deb/*.deb)
    run(${dpkg_deb} --info ${package})
    run(${dpkg_deb} -x ${package} ${WORK}/root)
    run(${CMAKE_COMMAND} -S ${CMAKE_CURRENT_LIST_DIR}/consumer -B ${WORK}/deb-consumer -G Ninja
        -DCMAKE_PREFIX_PATH=${WORK}/root/usr)
    run(${CMAKE_COMMAND} --build ${WORK}/deb-consumer)
    consumed("Debian package" ${WORK}/deb-consumer/consumer)
endif()

# FetchContent, with the sources that are here in place of a download, by a host whose flags are hostile to ours.
run(${CMAKE_COMMAND} -S ${CMAKE_CURRENT_LIST_DIR}/fetch -B ${WORK}/fetch -G Ninja -DCMAKE_BUILD_TYPE=Release
    -DFETCHCONTENT_SOURCE_DIR_NUSSELT=${SOURCE} -DFETCHCONTENT_FULLY_DISCONNECTED=ON -DNUSSELT_TBB=OFF
    "-DCMAKE_CXX_FLAGS=-march=native -ffast-math -fno-exceptions -fno-rtti -funsigned-char -fshort-enums"
    -DCMAKE_CXX_COMPILER_LAUNCHER=${LAUNCHER})
run(${CMAKE_COMMAND} --build ${WORK}/fetch --parallel 2)
consumed("FetchContent, without TBB" ${WORK}/fetch/consumer)

run(${CMAKE_COMMAND} -S ${CMAKE_CURRENT_LIST_DIR}/host -B ${WORK}/host -G Ninja -DCMAKE_BUILD_TYPE=Release
    -DNUSSELT_SOURCE=${SOURCE} -DBUILD_SHARED_LIBS=ON -DNUSSELT_INSTALL=ON -DNUSSELT_TBB=${TBB}
    -DCMAKE_CXX_COMPILER_LAUNCHER=${LAUNCHER})
run(${CMAKE_COMMAND} --build ${WORK}/host --parallel 2)
consumed("add_subdirectory, shared" ${WORK}/host/host)
consume(${WORK}/host shared)

# The shared library shows the public functions, all of them and nothing else.
find_program(nm nm)
file(GLOB_RECURSE shared ${WORK}/shared/*/libnusselt.so)
if(nm AND shared)
    run(${nm} -DC --defined-only ${shared})
    string(REGEX MATCHALL "[^\n]* [TBDRVW] [^\n]*" symbols "${output}")
    set(shown "")
    foreach(symbol ${symbols})
        if(symbol MATCHES " T (nusselt::([a-z_0-9]+)\\(|(nusselt_[a-z_0-9]+)$)")
            list(APPEND shown ${CMAKE_MATCH_2}${CMAKE_MATCH_3})
        else()
            message(FATAL_ERROR "the shared library shows more than public functions: ${symbol}")
        endif()
    endforeach()

    set(declared "")
    file(GLOB headers ${SOURCE}/runtime/include/nusselt/*.h)
    foreach(header ${headers})
        file(STRINGS ${header} lines REGEX "^[A-Za-z][A-Za-z0-9_:* ]* \\*?[a-z_0-9]+\\(")
        foreach(line ${lines})
            if(NOT line MATCHES "^(inline|constexpr|template|static) ")
                string(REGEX REPLACE "^[A-Za-z0-9_:* ]*[ *]([a-z_0-9]+)\\(.*" "\\1" name "${line}")
                list(APPEND declared ${name})
            endif()
        endforeach()
    endforeach()
    list(REMOVE_DUPLICATES shown)
    list(SORT shown)
    list(REMOVE_DUPLICATES declared)
    list(SORT declared)
    if(NOT shown STREQUAL declared)
        message(FATAL_ERROR "the shared library shows\n  ${shown}\nwhere the headers declare\n  ${declared}")
    endif()
endif()
file(REMOVE_RECURSE ${WORK})
