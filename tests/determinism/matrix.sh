#!/usr/bin/env bash
# Golden hashes with every compiler and optimisation, and mutations that must change them.
# Usage: matrix.sh [quick|all|mutations|arm]   (default: all and mutations)
#   quick      the default compiler at -O2, one scene
#   all        {g++ 12, clang++ 14, clang++ 19: those that are here} x {-O0, -O2, -O3 with link-time optimisation}
#   mutations  contraction, fast-math and a swapped sum: each must be found
#   arm        cross-built for aarch64, run by qemu-user (Debian: g++-aarch64-linux-gnu qemu-user)
# Environment: JOBS=N parallel compilers; SCENES=N only the first N scenes of tests/golden/hashes.txt.
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
work=build/determinism
jobs=${JOBS:-$(nproc)}
failed=0

# compile NAME COMPILER FLAGS...: $work/NAME/hashes from the sources in $root.
root=.
compile() {
    local name=$1 compiler=$2
    shift 2
    local out=$work/$name
    mkdir -p "$out"
    local base=(-std=c++20 -pthread -ffp-contract=off "-I$root" "-I$root/runtime/include" "-I$root/runtime/src" "$@")
    (cd "$root" && ls kernels/*.cpp jobs/*.cpp runtime/src/*.cpp bench/scenes/*.cpp tests/determinism/hashes.cpp) |
        xargs -P "$jobs" -I{} bash -c 'o=$1/$(echo "$2" | tr / _).o; shift; f=$1; shift; r=$1; shift
            "$@" -c "$r/$f" -o "$o"' _ "$out" {} "$root" "$compiler" "${base[@]}" || return 1
    "$compiler" "${base[@]}" "$out"/*.o -o "$out/hashes"
}

# check NAME WANTED [RUNNER...]: WANTED is same or other.
check() {
    local name=$1 wanted=$2
    shift 2
    local output result=same
    output=$("$@" "$work/$name/hashes" tests/golden/hashes.txt ${SCENES:-}) || result=other
    if [[ $result == "$wanted" && -n $output ]]; then
        echo "ok    $name: $(tail -n 1 <<<"$output")"
    else
        echo "WRONG $name: hashes are $result, $wanted was wanted"
        tail -n 5 <<<"$output"
        failed=1
    fi
}

try() {
    local name=$1 wanted=$2
    shift 2
    if compile "$name" "$@"; then
        check "$name" "$wanted"
    else
        echo "WRONG $name: does not compile"
        failed=1
    fi
}

all() {
    local compiler
    for compiler in g++-12 clang++-14 clang++-19; do
        if ! command -v "$compiler" >/dev/null; then
            echo "      $compiler is not here: left out"
            continue
        fi
        SCENES=${SCENES:-1} try "$compiler-O0" same "$compiler" -O0
        try "$compiler-O2" same "$compiler" -O2
        if [[ $compiler == clang* ]] && ! command -v "ld.lld-${compiler##*-}" >/dev/null; then
            try "$compiler-O3" same "$compiler" -O3 # link-time optimisation needs its own lld
        else
            local linker=()
            [[ $compiler == clang* ]] && linker=(-fuse-ld=lld-"${compiler##*-}" -Wno-unused-command-line-argument)
            try "$compiler-O3-lto" same "$compiler" -O3 -flto "${linker[@]}"
        fi
    done
}

# On a machine with fused multiply-add, contraction shows in the reference when it may be used.
mutations() {
    export SCENES=1
    try mutation-contraction other g++ -O2 -mfma -ffp-contract=fast
    try mutation-fast-math other g++ -O2 -ffast-math
    root=$work/swapped
    rm -rf "$root"
    mkdir -p "$root"
    cp -r kernels jobs runtime bench tests "$root/"
    # The dot product of the SIMD kernels, summed in another order.
    sed -i 's/return hn::Add(hn::Add(hn::Mul(ax, bx), hn::Mul(ay, by)), hn::Mul(az, bz));/return hn::Add(hn::Mul(ax, bx), hn::Add(hn::Mul(ay, by), hn::Mul(az, bz)));/' \
        "$root/kernels/simd.cpp"
    if cmp -s kernels/simd.cpp "$root/kernels/simd.cpp"; then
        echo "WRONG mutation-swapped-sum: the line to mutate is gone from kernels/simd.cpp"
        failed=1
    else
        try mutation-swapped-sum other g++ -O2
    fi
    root=.
}

arm() {
    local tool
    for tool in aarch64-linux-gnu-g++ qemu-aarch64; do
        if ! command -v "$tool" >/dev/null; then
            echo "matrix.sh: $tool is not here; get g++-aarch64-linux-gnu and qemu-user" >&2
            exit 77
        fi
    done
    # Headers without code of their own: the host's serve.
    mkdir -p "$work/headers"
    ln -sfn /usr/include/glm "$work/headers/glm"
    ln -sfn /usr/include/hwy "$work/headers/hwy"
    if compile aarch64 aarch64-linux-gnu-g++ -O2 -march=armv8-a+crypto -static "-I$work/headers"; then
        check aarch64 same qemu-aarch64
    else
        failed=1
    fi
}

case ${1:-} in
    quick) SCENES=1 try quick same "${CXX:-c++}" -O2 ;;
    all) all ;;
    mutations) mutations ;;
    arm) arm ;;
    '')
        all
        mutations
        ;;
    *)
        sed -n '2,/^set /{/^set /d;s/^# \{0,1\}//;p}' "$0" >&2
        exit 2
        ;;
esac
exit $failed
