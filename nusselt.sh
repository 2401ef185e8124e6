#!/usr/bin/env bash
# The one script of nusselt. Usage: ./nusselt.sh COMMAND [ARGUMENTS]
#
#   demo [ARGS]      install what is missing, build, render the built-in scenes into out/demo; ARGS go to `nusselt demo`
#   test [ARGS]      install what is missing, build, run all tests; ARGS go to ctest (-R NAME, -L LABEL, -LE slow, ...)
#   build [TARGETS]  build the preset; the program lies in build/release/bin
#   bench [ARGS]     build and run the benchmarks, results in out/bench; ARGS go to Google Benchmark (--benchmark_filter=...)
#   scaling [ARGS]   build and run bench/scaling on 1 to all cores, results in out/scaling.json; ARGS: --quick, --threads N
#   stress [MINUTES] all stress tests, and fuzz targets, in about MINUTES (default 30); ledger in docs/trust-ledger.md
#   fuzz [SECONDS]   every fuzz target for SECONDS (default 10), and its planted bug; needs clang
#   sanitize [KIND]  the tests under sanitizers, or under one kind: address (and undefined behaviour), thread, memory,
#                    valgrind
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

need_clang() {
    command -v clang++ >/dev/null && return
    echo "nusselt.sh: $1 needs clang++, which is not here; get the package clang, and libclang-rt-dev where it is apart" >&2
    return 1
}

build_fuzzers() {
    (
        preset=fuzz
        cmake --preset fuzz >/dev/null
        # Whatever targets there are: fuzz_gltf, planted_gltf, ...
        # shellcheck disable=SC2046
        build $(cmake --build build/fuzz --target help | grep -oE '\b(fuzz|planted)_[a-z_]+' | grep -v _test | sort -u)
    )
}

fuzz() {
    local seconds=${1:-10}
    if ! [[ $seconds =~ ^[1-9][0-9]*$ ]]; then
        echo "nusselt.sh: fuzz takes a number of seconds, not '$seconds'" >&2
        exit 2
    fi
    third_party/install.sh sanitizers
    need_clang fuzz
    build_fuzzers
    tests/fuzz/fuzz.sh "$seconds" build/fuzz out/fuzz
}

stress() {
    local minutes=${1:-30}
    if ! [[ $minutes =~ ^[1-9][0-9]*$ ]]; then
        echo "nusselt.sh: stress takes a number of minutes, not '$minutes'" >&2
        exit 2
    fi
    third_party/install.sh sanitizers
    build stress_kernels_test stress_frame_test stress_faults_test program_faults_test
    if need_clang "fuzzing"; then
        build_fuzzers
        tests/stress/stress.sh "$minutes" "build/$preset" build/fuzz
    else
        tests/stress/stress.sh "$minutes" "build/$preset"
    fi
}

# The thread sanitizer knows nothing of TBB: what runs threads is built without it, on executors of the tests' own, and
# once with it, its own code left out. The memory sanitizer sees the library alone. Each has bugs planted that it must
# find (tests/sanitizers). A job whose tests fail doesn't keep the others from running.
sanitize() {
    local kinds=("$@") kind failed=0
    # It has nothing to see in what computes on one thread, and takes twenty times as long.
    local one_thread='ClosedForm.*:Contact.*:Direct.*:Falloff.*:Gloss.*:Inside.*:Hostile.*:Back.AsAlone*:Back.Streams*'
    one_thread+=':Objects.Proxies*:Objects.FarOnes*:Objects.Needed*:Objects.OneObject*:Memory.FramesAndHistories*'
    one_thread+=':Determinism.EveryIsa:Outputs.Beside*:Outputs.Through*:Frame.ReceiversWithout*'
    one_thread+=':Budget.NoVertex*:*BadPoses.*:History.RandomEdits*:Memory.AFrameOfMany*:VisibleSet.Changes*'
    one_thread+=':Watertight.Enclosures*'
    [[ ${#kinds[@]} != 0 ]] || kinds=(address thread memory valgrind)
    third_party/install.sh sanitizers
    for kind in "${kinds[@]}"; do
        case $kind in
            address)
                preset=asan-ubsan
                build
                run_tests -LE slow || failed=1
                ;;
            thread)
                preset=tsan
                build jobs_test runtime_test embed_test stress_frame_test stress_faults_test sanitizers_frames
                GTEST_FILTER="-$one_thread" \
                    run_tests -R 'jobs_test|runtime_test|embed_test|stress_f|sanitizers' || failed=1
                preset=tsan-tbb
                build sanitizers_frames
                run_tests -L sanitizers || failed=1
                ;;
            memory)
                need_clang "the memory sanitizer" || continue
                preset=msan
                build sanitizers_frames
                run_tests -L sanitizers || failed=1
                ;;
            valgrind)
                preset=release
                build sanitizers_frames
                run_tests -L sanitizers || failed=1
                ;;
            *)
                echo "nusselt.sh: sanitize knows address, thread, memory and valgrind, not '$kind'" >&2
                exit 2
                ;;
        esac
    done
    return $failed
}

run_tests() {
    ctest --test-dir "build/$preset" --output-on-failure --no-tests=error --parallel "$jobs" "$@"
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
    fuzz) fuzz "$@" ;;
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
