#!/bin/sh
# Makes .venv match pyproject.toml and requirements.lock; does nothing when it already does.
# Usage: environment.sh venv|run|dev    (PYTHON=... chooses the interpreter)
set -eu
cd "$(dirname "$0")/.."

level=$1
venv=.venv
lock=requirements.lock
incomplete=$venv/.incomplete # stands from the start of an installation until it has succeeded
oldest='(3, 11)'
newest='(3, 14)' # the locked versions have wheels up to here
unset PYTHONHOME PYTHONPATH PIP_TARGET PIP_PREFIX
export PIP_USER=0 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_INPUT=1

case $(uname -s) in
    MINGW* | MSYS* | CYGWIN*) python=$venv/Scripts/python.exe ;;
    *) python=$venv/bin/python ;;
esac

say() { printf 'pfviz: %s\n' "$*" >&2; }
die() { say "error: $*"; exit 1; }
is_debian_root() { [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; }

# The interpreter behind $1 (outside any active environment), if it is of a suitable version and has the modules $2.
base_interpreter() {
    "$1" -c "
import sys, $2
if not $oldest <= sys.version_info[:2] <= $newest:
    raise SystemExit(1)
print(getattr(sys, '_base_executable', sys.executable))" </dev/null 2>/dev/null
}

find_python() {
    if [ -n "${PYTHON:-}" ]; then
        base_interpreter "$PYTHON" os || die "PYTHON=$PYTHON is not a Python from 3.11 to 3.14"
        return
    fi
    for modules in venv,ensurepip os; do
        for name in python3.14 python3.13 python3.12 python3.11 python3 python; do
            base_interpreter "$name" "$modules" && return
        done
    done
    die "no Python from 3.11 to 3.14 found; install one, or name it: make PYTHON=/path/to/python3 ..."
}

works() { [ ! -e "$incomplete" ] && "$python" -c 'import pip' 2>/dev/null; }

install_debian_venv() {
    is_debian_root || return 1
    package=$("$1" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])')
    say "installing $package with apt-get"
    export DEBIAN_FRONTEND=noninteractive
    { apt-get update -qq && apt-get install -y -qq "$package"; } </dev/null >/dev/null
}

with_ensurepip() { "$1" -m venv --clear "$venv" >/dev/null 2>&1; }
with_uv() { command -v uv >/dev/null && uv venv --quiet --clear --seed --python "$1" "$venv"; }
with_systems_pip() {
    "$1" -m venv --clear --without-pip "$venv" && "$1" -m pip --python "$python" install --quiet pip
} 2>/dev/null

create_venv() {
    base=$(find_python)
    say "making $venv with $base"
    with_ensurepip "$base" || { install_debian_venv "$base" && with_ensurepip "$base"; } ||
        with_uv "$base" || with_systems_pip "$base" ||
        die "$base cannot make a virtual environment; install its venv module (on Debian and Ubuntu: python3-venv)"
}

install() {
    quiet=--quiet
    if [ -t 1 ]; then quiet=; fi
    say "installing the locked dependencies into $venv (a few minutes at first, seconds from then on)"
    # The build backend comes from the lock too, hence no isolated build.
    "$python" -m pip install $quiet -c "$lock" hatchling </dev/null
    "$python" -m pip install $quiet -c "$lock" --no-build-isolation --editable "$1" </dev/null
}

wanted=$({ pwd -P; cat pyproject.toml "$lock"; } | cksum)
is_current() { [ "$(cat "$venv/.installed-$1" 2>/dev/null)" = "$wanted" ]; }

if works; then
    case $level in
        venv) exit ;;
        run) if is_current run || is_current dev; then exit; fi ;;
        dev) if is_current dev; then exit; fi ;;
    esac
else
    create_venv
fi

case $level in
    venv) exit ;;
    run) project=. ;;
    dev) project=.[dev] ;;
    *) die "$level: expected venv, run or dev" ;;
esac
touch "$incomplete"
rm -f "$venv"/.installed-*
install "$project"
printf '%s\n' "$wanted" >"$venv/.installed-$level"
rm "$incomplete"
