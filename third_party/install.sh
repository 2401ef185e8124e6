#!/usr/bin/env bash
# Installs what the build needs and this machine lacks. Usage: third_party/install.sh [GROUP...]
#   tests       also the browser in which a test opens the page of `nusselt compare`; skipped without it
#   compilers   also the compilers of tests/determinism/matrix.sh
#   arm         also the cross compiler and the emulator of its aarch64
#   sanitizers  also clang with its fuzzer and memory sanitizer, and valgrind
#
# On Debian and its kin: only the missing packages, by apt-get, as root or through sudo, without questions of its own.
# Elsewhere, or without sudo: prints the packages to get and returns 0, so that a build can go on with what is there.
set -euo pipefail

packages=(
    git g++ cmake ninja-build clang-format pkgconf python3 python3-numpy
    libtbb-dev libhwy-dev libglm-dev libmeshoptimizer-dev
    libtinygltf-dev libstb-dev libcli11-dev nlohmann-json3-dev libembree-dev libopenexr-dev
    libgtest-dev libbenchmark-dev
)
for more in "$@"; do
    case $more in
        tests) packages+=(chromium) ;;
        compilers) packages+=(g++-12 clang-14 lld-14 clang-19 lld-19) ;; # all in Debian 12 itself
        arm) packages+=(g++-aarch64-linux-gnu qemu-user) ;;
        sanitizers) packages+=(clang libclang-rt-14-dev llvm-14 valgrind) ;;
        *)
            echo "install.sh: nothing called '$more'; choose from tests, compilers, arm, sanitizers" >&2
            exit 2
            ;;
    esac
done

if ! command -v apt-get >/dev/null || ! command -v dpkg-query >/dev/null; then
    cat >&2 <<'TEXT'
This system has no apt-get. nusselt needs a C++20 compiler, git, CMake 3.24, Ninja, and these packages; going on with
what is there. (Tests use pkgconf and Python with NumPy, where they are.)
  Fedora:   gcc-c++ cmake ninja-build git clang-tools-extra tbb-devel highway-devel glm-devel meshoptimizer-devel
            tinygltf-devel stb_image-devel cli11-devel json-devel embree3-devel openexr-devel gtest-devel
            google-benchmark-devel
  Arch:     base-devel cmake ninja git clang onetbb highway glm meshoptimizer tinygltf stb cli11 nlohmann-json embree3
            openexr gtest benchmark
  Homebrew: cmake ninja git clang-format tbb highway glm meshoptimizer tinygltf cli11 nlohmann-json embree@3 openexr
            googletest google-benchmark, and stb from its repository
The names are those of Debian's libraries as other systems call them; a few may differ.
TEXT
    exit 0
fi

missing=()
for package in "${packages[@]}"; do
    status=$(dpkg-query --show --showformat='${db:Status-Status}' "$package" 2>/dev/null || true)
    [[ $status == installed ]] || missing+=("$package")
done
(( ${#missing[@]} )) || exit 0

as_root=()
if (( EUID != 0 )); then
    if ! command -v sudo >/dev/null; then
        echo "Not root and no sudo. Missing, and to be installed by who can: ${missing[*]}; going on without." >&2
        exit 0
    fi
    as_root=(sudo)
fi

echo "Installing: ${missing[*]}"
apt() { "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -q -y "$@" </dev/null; }
apt update
apt install --no-install-recommends "${missing[@]}"
