#!/usr/bin/env bash
# The one script of nusselt. Usage: ./nusselt.sh COMMAND [ARGUMENTS]
#
#   demo [ARGS]      install what is missing, build, render the built-in scenes into out/demo; ARGS go to `nusselt demo`
#   test [ARGS]      install what is missing, build, run all tests; ARGS go to ctest (-R NAME, -L LABEL, -LE slow, ...)
#   build [TARGETS]  build the preset; the program lies in build/release/bin
#   bench [ARGS]     build and run the benchmarks, results in out/bench; ARGS go to Google Benchmark (--benchmark_filter=...)
#   scaling [ARGS]   build and run bench/scaling on 1 to all cores, results in out/scaling.json; ARGS: --quick, --threads N
#   stress [MINUTES] all stress tests and fuzz targets within MINUTES (default 30), and their ledger, docs/trust-ledger.md
#   sanitize         all tests under the address and undefined-behaviour sanitizers, threads under the thread sanitizer
#   determinism [HOW]
#                    golden hashes with every compiler, optimisation, executor and floating-point mode, and mutations
#                    that must be found (an hour); HOW: quick, compilers, everything, mutations or arm instead of all
#   arm              the same kernels cross-built for aarch64, run by qemu-user against the same hashes
#   install          install the packages that build and tests need (third_party/install.sh)
#   format           format all C++ files with clang-format 14
#   check            fail where clang-format 14 would change a file or an include points the wrong way
#   lint             check, then clang-tidy where it is installed
#   clean            remove build/ and out/
#   help             this text
#
# Environment:
#   PRESET=NAME      the CMake preset (default release): dev, release, ci, asan-ubsan, tsan, coverage, fuzz
#   JOBS=N           parallel jobs (default: the number of processors)
#
# `demo` and `test` work on a fresh Debian 12, as root or as a user with sudo. On another system they say which
# packages to get, and go on with what is there.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"

preset=${PRESET:-release}
jobs=${JOBS:-$(nproc 2>/dev/null || echo 2)}

# The header comment above is the manual.
usage() { sed -n '2,/^set /{/^set /d;s/^# \{0,1\}//;p}' nusselt.sh; }

cxx_files() { git ls-files '*.h' '*.hpp' '*.cpp' '*.cc'; }

clang_format() {
    local tool
    for tool in clang-format-14 clang-format; do
        if command -v "$tool" >/dev/null && "$tool" --version | grep -q 'version 14\.'; then
            echo "$tool"
            return
        fi
    done
    echo "nusselt.sh: clang-format 14 is not here; run ./nusselt.sh install, or get that version" >&2
    return 1
}

install() { third_party/install.sh "$@"; }

build() {
    local launcher=()
    if command -v ccache >/dev/null; then
        launcher=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
    fi
    cmake --preset "$preset" ${launcher[@]+"${launcher[@]}"}
    cmake --build "build/$preset" --parallel "$jobs" ${1:+--target "$@"}
}

check_format() {
    local tool
    tool=$(clang_format)
    cxx_files | xargs -r "$tool" --dry-run -Werror
}

check_includes() { cmake -DROOT="$PWD" -P tests/structure/includes.cmake; }

check() {
    check_format
    check_includes
}

lint() {
    check
    if ! command -v clang-tidy >/dev/null; then
        echo "clang-tidy is not here: left out" >&2
        return
    fi
    [[ -f build/$preset/compile_commands.json ]] || build
    git ls-files 'kernels/*.cpp' 'jobs/*.cpp' 'runtime/*.cpp' 'tools/*.cpp' 'bench/*.cpp' 'examples/*.cpp' |
        xargs -r -P "$jobs" -n 1 clang-tidy --quiet -p "build/$preset"
}

stress() {
    local minutes=${1:-30}
    if ! [[ $minutes =~ ^[1-9][0-9]*$ ]]; then
        echo "nusselt.sh: stress takes a number of minutes, not '$minutes'" >&2
        exit 2
    fi
    build stress_kernels_test stress_frame_test
    if command -v clang++ >/dev/null; then
        local own=$preset targets
        preset=fuzz
        cmake --preset fuzz
        # Whatever targets there are: fuzz_gltf, planted_gltf, ...
        targets=$(cmake --build build/fuzz --target help | grep -oE '\b(fuzz|planted)_[a-z_]+' | grep -v _test | sort -u)
        # shellcheck disable=SC2086
        cmake --build build/fuzz --parallel "$jobs" --target $targets
        preset=$own
        tests/stress/stress.sh "$minutes" "build/$preset" build/fuzz
    else
        echo "clang++ is not here: the fuzz targets are left out" >&2
        tests/stress/stress.sh "$minutes" "build/$preset"
    fi
}

# The thread sanitizer knows nothing of TBB: what runs threads is built without it, on executors of the tests' own.
sanitize() {
    preset=asan-ubsan
    build
    ctest --test-dir build/asan-ubsan --output-on-failure --no-tests=error --parallel "$jobs" -LE slow "$@"
    preset=tsan
    build
    ctest --test-dir build/tsan --output-on-failure --no-tests=error --parallel "$jobs" -R 'jobs|runtime_test|embed_test|stress' "$@"
}

command=${1:-}
shift || true
case $command in
    demo)
        install
        build nusselt_program
        "build/$preset/bin/nusselt" demo --out out/demo "$@"
        ;;
    test)
        install tests
        build
        ctest --test-dir "build/$preset" --output-on-failure --no-tests=error --parallel "${JOBS:-2}" "$@"
        ;;
    build) build "$@" ;;
    bench)
        install
        build
        mkdir -p out/bench
        for program in "build/$preset"/bin/bench_*; do
            # bench/compare.py compares two of these files.
            "$program" --benchmark_out="out/bench/${program##*/}.json" --benchmark_out_format=json "$@"
        done
        ;;
    stress) stress "$@" ;;
    sanitize) sanitize "$@" ;;
    determinism)
        case ${1:-all} in
            all) third_party/install.sh compilers arm ;;
            compilers | arm) third_party/install.sh "$1" ;;
            *) install ;;
        esac
        tests/determinism/matrix.sh "$@"
        ;;
    arm)
        third_party/install.sh arm
        tests/determinism/matrix.sh arm
        ;;
    scaling)
        build scaling
        mkdir -p out
        "build/$preset/bin/scaling" --json out/scaling.json "$@"
        ;;
    install) install tests ;;
    format) cxx_files | xargs -r "$(clang_format)" -i ;;
    lint) lint ;;
    check) check ;;
    clean) rm -rf build out ;;
    help | -h | --help) usage ;;
    *)
        if [[ -n $command ]]; then
            echo "nusselt.sh: no command '$command'" >&2
        fi
        usage >&2
        exit 2
        ;;
esac
