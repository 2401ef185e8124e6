# What every target of the project has in common.
include_guard(GLOBAL)

# nusselt_target(<target>): C++20, warnings, exact arithmetic. Everything is PRIVATE: nothing reaches who links it.
# Includes are written from the root ("kernels/mask.h") or as a public header ("nusselt/mesh.h").
function(nusselt_target target)
    set_target_properties(${target} PROPERTIES
        CXX_STANDARD 20
        CXX_STANDARD_REQUIRED ON
        CXX_EXTENSIONS OFF
        CXX_VISIBILITY_PRESET hidden
        VISIBILITY_INLINES_HIDDEN ON)
    get_target_property(type ${target} TYPE)
    if(NOT type STREQUAL "EXECUTABLE")
        set_target_properties(${target} PROPERTIES POSITION_INDEPENDENT_CODE ON)
    endif()
    target_compile_options(${target} PRIVATE
        -ffp-contract=off
        # clang counts sign conversions in -Wconversion, gcc does not.
        -Wall -Wextra -Wshadow -Wconversion -Wno-sign-conversion -Wnon-virtual-dtor -Woverloaded-virtual
        -Wundef -Wvla
        # gcc 12 sees overlapping copies in sums of strings that are none (its bug 105651).
        $<$<AND:$<CXX_COMPILER_ID:GNU>,$<VERSION_LESS:$<CXX_COMPILER_VERSION>,13>>:-Wno-restrict>)
    if(NUSSELT_WERROR)
        target_compile_options(${target} PRIVATE -Werror)
    endif()
    if(NUSSELT_SANITIZE)
        target_compile_options(${target} PRIVATE -fsanitize=${NUSSELT_SANITIZE} -fno-omit-frame-pointer
            -fno-sanitize-recover=all)
        # INTERFACE as well: a library with instrumented code needs the run-time library in what links it.
        target_link_options(${target} PUBLIC -fsanitize=${NUSSELT_SANITIZE})
    endif()
    if(NUSSELT_FUZZ)
        target_compile_options(${target} PRIVATE -fsanitize=fuzzer-no-link)
    endif()
    if(NUSSELT_COVERAGE)
        target_compile_options(${target} PRIVATE --coverage -fprofile-update=atomic)
        target_link_options(${target} PUBLIC --coverage)
    endif()
    if(NUSSELT_TBB)
        target_compile_definitions(${target} PRIVATE NUSSELT_TBB=1)
    endif()
    target_include_directories(${target} PRIVATE ${NUSSELT_ROOT} ${NUSSELT_ROOT}/runtime/include)
endfunction()

# nusselt_library(<target>): a part of the library, inside a host's build: what the host has in CMAKE_CXX_FLAGS
# (-ffast-math, -fno-exceptions) comes first and is undone here.
function(nusselt_library target)
    target_compile_options(${target} PRIVATE -fno-fast-math -fexceptions) # before -ffp-contract, which clang would undo
    nusselt_target(${target})
endfunction()

# nusselt_optimized(<target>): at least -O2 whatever the build type; kernels at -O0 are 34 times slower.
function(nusselt_optimized target)
    target_compile_options(${target} PRIVATE $<$<NOT:$<CONFIG:Release>>:-O2>)
endfunction()

# nusselt_test(<name> SOURCES ... [LIBS ...] [LABELS ...] [TIMEOUT seconds] [ARGS ...] [NAMES])
# A GoogleTest executable <name>, run by ctest as one test of that name; NAMES makes a ctest test of each test case.
# NUSSELT_SHARED_DIR is the folder of real data: GTEST_SKIP() where it is absent.
function(nusselt_test name)
    cmake_parse_arguments(PARSE_ARGV 1 arg "NAMES" "TIMEOUT" "SOURCES;LIBS;LABELS;ARGS")
    if(arg_UNPARSED_ARGUMENTS)
        message(FATAL_ERROR "nusselt_test(${name}): unknown arguments ${arg_UNPARSED_ARGUMENTS}")
    endif()
    if(NOT arg_TIMEOUT)
        set(arg_TIMEOUT 300)
    endif()
    if(NUSSELT_SANITIZE)
        math(EXPR arg_TIMEOUT "6 * ${arg_TIMEOUT}")
    endif()
    cmake_path(GET CMAKE_CURRENT_SOURCE_DIR FILENAME module)
    add_executable(${name} ${arg_SOURCES})
    nusselt_target(${name})
    set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${NUSSELT_BUILD}/tests)
    target_link_libraries(${name} PRIVATE ${arg_LIBS} GTest::gtest GTest::gtest_main)
    target_compile_definitions(${name} PRIVATE NUSSELT_SHARED_DIR="${NUSSELT_SHARED}")
    if(arg_NAMES)
        include(GoogleTest)
        gtest_discover_tests(${name} EXTRA_ARGS ${arg_ARGS} DISCOVERY_TIMEOUT 60
            PROPERTIES TIMEOUT ${arg_TIMEOUT} LABELS "${module};${arg_LABELS}")
    else()
        add_test(NAME ${name} COMMAND ${name} ${arg_ARGS})
        set_tests_properties(${name} PROPERTIES TIMEOUT ${arg_TIMEOUT} LABELS "${module};${arg_LABELS}")
    endif()
endfunction()

# nusselt_fuzz(<name> SOURCES ... [LIBS ...]): a libFuzzer program in <build>/fuzz; nothing without NUSSELT_FUZZ.
function(nusselt_fuzz name)
    if(NOT NUSSELT_FUZZ)
        return()
    endif()
    cmake_parse_arguments(PARSE_ARGV 1 arg "" "" "SOURCES;LIBS")
    add_executable(${name} ${arg_SOURCES})
    nusselt_target(${name})
    set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${NUSSELT_BUILD}/fuzz)
    target_link_libraries(${name} PRIVATE ${arg_LIBS})
    target_link_options(${name} PRIVATE -fsanitize=fuzzer)
endfunction()
