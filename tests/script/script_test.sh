#!/usr/bin/env bash
# Tries nusselt.sh and third_party/install.sh with stand-ins for apt-get, dpkg-query and sudo.
# Usage: script_test.sh REPOSITORY WORK
set -euo pipefail
root=$1 work=$2

fail() {
    echo "FAILED: $*" >&2
    exit 1
}

stand_in() { # stand_in NAME: the body comes on stdin
    printf '#!/bin/bash\n' >"$work/bin/$1"
    cat >>"$work/bin/$1"
    chmod +x "$work/bin/$1"
}

rm -rf "$work"
mkdir -p "$work/bin" "$work/empty"
for tool in bash env cat; do
    ln -s "$(command -v "$tool")" "$work/bin/$tool"
    ln -s "$(command -v "$tool")" "$work/empty/$tool"
done

# help lists every command of the script; what is no command goes to stderr with 2.
"$root/nusselt.sh" help >"$work/help"
while read -r name; do
    grep -q "^  $name " "$work/help" || fail "help does not list '$name'"
done < <(sed -n '/^case \$command/,/^esac/s/^    \([a-z]*\)[ )|].*/\1/p' "$root/nusselt.sh" | grep .)
code=0
"$root/nusselt.sh" nonsense >"$work/out" 2>"$work/err" || code=$?
[[ $code == 2 && ! -s $work/out ]] || fail "unknown command: exit $code"
grep -q nonsense "$work/err" || fail "unknown command is not named"

# Two packages are missing: one update, one install of these two alone.
export LOG=$work/log
stand_in apt-get <<<'echo "apt-get $*" >>"$LOG"'
stand_in sudo <<<'"$@"'
stand_in dpkg-query <<'TEXT'
[[ ${!#} == libtbb-dev || ${!#} == libhwy-dev ]] || printf installed
TEXT
PATH=$work/bin "$root/third_party/install.sh" </dev/null >"$work/out"
expected='apt-get -q -y update
apt-get -q -y install --no-install-recommends libtbb-dev libhwy-dev'
[[ $(<"$LOG") == "$expected" ]] || fail "installing two packages ran: $(<"$LOG")"

# A group adds its own; one that isn't is told.
stand_in dpkg-query <<'TEXT'
[[ ${!#} == qemu-user || ${!#} == clang-19 ]] || printf installed
TEXT
rm "$LOG"
PATH=$work/bin "$root/third_party/install.sh" arm </dev/null >"$work/out"
[[ $(tail -n 1 "$LOG") == *"--no-install-recommends qemu-user" ]] || fail "installing for arm ran: $(<"$LOG")"
code=0
PATH=$work/bin "$root/third_party/install.sh" sparc </dev/null 2>"$work/err" || code=$?
[[ $code == 2 ]] && grep -q sparc "$work/err" || fail "an unknown group: exit $code"

# The tests' browser only when it is asked for.
rm "$LOG"
stand_in dpkg-query <<<'[[ ${!#} == chromium ]] || printf installed'
PATH=$work/bin "$root/third_party/install.sh" tests </dev/null >"$work/out"
grep -q "recommends chromium$" "$LOG" || fail "the browser was not asked for: $(<"$LOG")"
rm "$LOG"
PATH=$work/bin "$root/third_party/install.sh" </dev/null >"$work/out"
[[ ! -e $LOG ]] || fail "the browser was installed unasked"
touch "$LOG"

# None is missing: nothing runs, nothing is said.
rm "$LOG"
stand_in dpkg-query <<<'printf installed'
PATH=$work/bin "$root/third_party/install.sh" </dev/null >"$work/out" 2>&1
[[ ! -e $LOG && ! -s $work/out ]] || fail "apt-get ran with nothing to do"

# No apt-get: names the packages and goes on.
PATH=$work/empty "$root/third_party/install.sh" </dev/null >"$work/out" 2>&1 || fail "no apt-get: install.sh failed"
grep -q Fedora "$work/out" || fail "no apt-get: no packages named"

# A sanitizer's job whose first half fails runs its second half all the same, and fails in the end.
ln -s "$(command -v dirname)" "$work/bin/dirname"
stand_in cmake <<<':'
stand_in ctest <<<'echo "$2" >>"$LOG"; [[ $2 != build/tsan ]]'
code=0
PATH=$work/bin "$root/nusselt.sh" sanitize thread >"$work/out" 2>&1 || code=$?
[[ $code == 1 && $(<"$LOG") == $'build/tsan\nbuild/tsan-tbb' ]] || fail "sanitize thread: exit $code, ran $(<"$LOG")"
rm "$LOG"
stand_in ctest <<<'echo "$2" >>"$LOG"'
PATH=$work/bin "$root/nusselt.sh" sanitize thread valgrind >"$work/out" 2>&1 || fail "sanitize: failed without a reason"
[[ $(wc -l <"$LOG") == 3 ]] || fail "sanitize thread valgrind ran: $(<"$LOG")"

rm -rf "$work"
