#!/usr/bin/env bash
# Golden hashes with every compiler and optimisation, and mutations that must change them.
# Usage: matrix.sh [quick | all | compilers [NAME[:LEVEL]...] | everything [SCENE] | mutations | arm]
# (default: all)
#   quick       the default compiler at -O2, one scene
#   all         compilers, everything, mutations and arm
#   compilers   g++-12, clang++-14 and clang++-19, or those named, x {-O0, -O2, -O3 with link-time optimisation},
#               or the one named (g++-12:O3): every entry of tests/golden/hashes.txt, some hundreds of checks each
#               (at -O0: the first scene's)
#   everything  the default compiler at -O2: scenes x instruction sets x workers x executors x floating-point modes
#   mutations   contraction, fast-math and a swapped sum: each must be found
#   arm         library and examples cross-built by CMake for aarch64, the first scene's hashes run by qemu-user
# Packages, where Debian's: third_party/install.sh compilers arm. What is not here is named and left out.
# Environment: JOBS=N parallel compilers.
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
work=build/determinism
jobs=${JOBS:-$(nproc)}
failed=0

wrong() {
    echo "WRONG $1"
    failed=1
}

# compile NAME COMPILER FLAGS...: $work/NAME/hashes from the sources in $root.
root=.
compile() {
    local name=$1 compiler=$2
    shift 2
    local out=$work/$name launcher=()
    command -v ccache >/dev/null && launcher=(ccache)
    rm -rf "$out"
    mkdir -p "$out"
    # Highway's assertions would need its library; the deprecation is libstdc++ 12's own, seen by clang 19.
    local base=("$compiler" -std=c++20 -pthread -ffp-contract=off -DHWY_IS_DEBUG_BUILD=0 -Wno-deprecated-declarations
        "-I$root" "-I$root/runtime/include" "-I$root/runtime/src" "$@")
    (cd "$root" && ls kernels/*.cpp jobs/*.cpp runtime/src/*.cpp bench/scenes/*.cpp tests/determinism/hashes.cpp) |
        xargs -P "$jobs" -I{} bash -c 'o=$1/$(echo "$2" | tr / _).o f=$2 r=$3; shift 3
            "$@" -c "$r/$f" -o "$o"' _ "$out" {} "$root" "${launcher[@]}" "${base[@]}" || return 1
    "${base[@]}" "$out"/*.o -o "$out/hashes"
}

# check NAME WANTED HOW [RUNNER...]: WANTED is same or other.
check() {
    local name=$1 wanted=$2 how=$3
    shift 3
    local output result=same
    # shellcheck disable=SC2086
    output=$("$@" "$work/$name/hashes" tests/golden/hashes.txt $how) || result=other
    # A program that broke down has not found another hash.
    [[ $output == *" wrong; "* ]] || result="not told"
    if [[ $result == "$wanted" ]]; then
        echo "ok    $name: $(tail -n 1 <<<"$output")"
    else
        wrong "$name: hashes are $result, $wanted was wanted"
        tail -n 5 <<<"$output"
    fi
}

# try NAME WANTED HOW COMPILER FLAGS...
try() {
    local name=$1 wanted=$2 how=$3
    shift 3
    if compile "$name" "$@"; then
        check "$name" "$wanted" "$how"
    else
        wrong "$name: does not compile"
    fi
}

# With link-time optimisation, where the compiler has what it needs for that.
compile_o3() {
    local compiler=$1 version=${1##*-}
    if [[ $compiler == g++* ]]; then
        try "$compiler-O3-lto" same some "$compiler" -O3 -flto=auto
    elif command -v "ld.lld-$version" >/dev/null; then
        try "$compiler-O3-lto" same some "$compiler" -O3 -flto "-fuse-ld=lld-$version" -Wno-unused-command-line-argument
    else
        echo "      ld.lld-$version is not here: no link-time optimisation with $compiler"
        try "$compiler-O3" same some "$compiler" -O3
    fi
}

compilers() {
    local named compiler level
    (($#)) || set -- g++-12 clang++-14 clang++-19
    for named in "$@"; do
        compiler=${named%%:*}
        level=${named#"$compiler"}
        if ! command -v "$compiler" >/dev/null; then
            echo "      $compiler is not here: left out"
            continue
        fi
        case $level in
            :O0 | '') try "$compiler-O0" same one "$compiler" -O0 ;;&
            :O2 | '') try "$compiler-O2" same some "$compiler" -O2 ;;&
            :O3 | '') compile_o3 "$compiler" ;;
            :O0 | :O2) ;;
            *) wrong "$named: the level is not one of O0, O2, O3" ;;
        esac
    done
}

everything() { try everything same "all ${1:-}" "${CXX:-c++}" -O2; }

# swap NAME FILE BEFORE AFTER: a copy of the sources with one line of one file changed, whose hashes must differ.
swap() {
    local name=$1 file=$2 before=$3 after=$4 text
    root=$work/$name-sources
    rm -rf "$root"
    mkdir -p "$root"
    cp -r kernels jobs runtime bench tests "$root/"
    text=$(<"$file")
    if [[ $text == *"$before"* ]]; then
        printf '%s\n' "${text/"$before"/"$after"}" >"$root/$file"
        try "$name" other one "${CXX:-c++}" -O2
    else
        wrong "$name: the line to change is gone from $file"
    fi
    root=.
}

mutations() {
    # With fused multiply-add at hand, contraction shows where it is allowed.
    try mutation-contraction other one "${CXX:-c++}" -O2 -mfma -ffp-contract=fast
    try mutation-fast-math other one "${CXX:-c++}" -O2 -ffast-math
    # A sum of the rotation into the caller's space. (One before the masks may change no bit of them: the kernels'
    # own tests find those.)
    swap mutation-swapped-sum kernels/sh_formulas.inl \
        'out[20] = (u * c[20] + r20 * c[22]) + r35 * c[24];' 'out[20] = u * c[20] + (r20 * c[22] + r35 * c[24]);'
    # The host's rounding reaches the work.
    swap mutation-float-environment jobs/float_environment.h '_mm_setcsr(power_on);' '(void)power_on;'
}

arm() {
    local tool
    for tool in aarch64-linux-gnu-g++ qemu-aarch64 cmake ninja; do
        if ! command -v "$tool" >/dev/null; then
            echo "matrix.sh: $tool is not here; third_party/install.sh arm gets it" >&2
            exit 77
        fi
    done
    # Headers without code of their own: the host's serve.
    mkdir -p "$work/headers"
    ln -sfn /usr/include/glm "$work/headers/glm"
    ln -sfn /usr/include/hwy "$work/headers/hwy"
    local build=$work/aarch64 output
    if ! output=$(cmake -S . -B "$build" -G Ninja -DCMAKE_TOOLCHAIN_FILE=cmake/aarch64.cmake -DCMAKE_BUILD_TYPE=Release \
        -DCMAKE_EXE_LINKER_FLAGS=-static -DNUSSELT_TBB=OFF -DNUSSELT_TOOLS=OFF -DNUSSELT_BENCH=OFF \
        -DNUSSELT_TESTS=OFF -DNUSSELT_DETERMINISM=ON -DNUSSELT_WERROR=ON \
        -DNUSSELT_HIGHWAY_INCLUDE_DIR="$PWD/$work/headers" -DNUSSELT_GLM_INCLUDE_DIR="$PWD/$work/headers" 2>&1 &&
        cmake --build "$build" --parallel "$jobs" 2>&1); then
        wrong "aarch64: does not build"
        tail -n 20 <<<"$output"
        return
    fi
    ln -sfn tests/determinism_hashes "$build/hashes"
    check aarch64 same one qemu-aarch64
}

case ${1:-all} in
    quick) try quick same one "${CXX:-c++}" -O2 ;;
    compilers)
        shift
        compilers "$@"
        ;;
    everything) everything "${2:-}" ;;
    mutations) mutations ;;
    arm) arm ;;
    all)
        compilers
        everything
        mutations
        (arm)
        case $? in 0) ;; 77) echo "      aarch64: left out" ;; *) failed=1 ;; esac
        ;;
    *)
        sed -n '2,/^set /{/^set /d;s/^# \{0,1\}//;p}' "$0" >&2
        exit 2
        ;;
esac
exit $failed
