# Sourced by the scripts beside it: sets `root` (this checkout) and `python` (the
# interpreter of .venv), and makes .venv match requirements.lock and pyproject.toml.
# Needs Python 3.11 to 3.14 and, when .venv is missing or out of date, a network.

# A user's own search paths (ROS sets one for Python) are not to be mixed in.
unset CDPATH PYTHONHOME PYTHONPATH
export PYTHONNOUSERSITE=1
# Else every process compiles all that it imports anew, the tests' hundred ones, too.
unset PYTHONDONTWRITEBYTECODE

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)

# Prints the first usable interpreter. A command can exist and still be unusable: too
# old, a version manager's placeholder, or a system Python without venv and pip.
find_python() {
    local candidate
    for candidate in python3 python3.13 python3.12 python3.11 python3.14 python; do
        if "$candidate" -c '
import ensurepip, sys, venv
sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 14))' >/dev/null 2>&1; then
            echo "$candidate"
            return
        fi
    done
    echo "cc_mujoco needs Python 3.11 to 3.14 with its venv module, and none was" \
        "found on PATH." >&2
    return 1
}

# .venv/Scripts is where Windows puts it.
venv_python() {
    local candidate
    for candidate in "$root/.venv/bin/python" "$root/.venv/Scripts/python.exe"; do
        if [ -x "$candidate" ]; then
            echo "$candidate"
            return
        fi
    done
    return 1
}

# What the environment depends on: the two files and, because an editable install and
# its commands hold absolute paths, the place of the checkout. Fails if .venv's own
# interpreter no longer starts.
wanted_stamp() {
    local interpreter
    interpreter=$(venv_python) || return 1
    "$interpreter" - "$root" <<'PYTHON' 2>/dev/null
import hashlib, pathlib, sys
root = pathlib.Path(sys.argv[1])
digest = hashlib.sha256(f"{root} {sys.version}".encode())
for name in "pyproject.toml", "requirements.lock":
    digest.update((root / name).read_bytes())
print(digest.hexdigest())
PYTHON
}

# Installs everything into a new .venv with the interpreter given.
build_environment() {
    # Of ten thousand modules most are never imported; Python compiles those that are.
    local install=(-m pip install --quiet --disable-pip-version-check --no-compile)
    echo "Setting up $root/.venv (once; takes a few minutes) ..." >&2
    rm -rf "$root/.venv" || return 1
    "$1" -m venv "$root/.venv" || return 1
    python=$(venv_python) || return 1
    "$python" "${install[@]}" --only-binary :all: --require-hashes \
        --requirement "$root/requirements.lock" >&2 || return 1
    "$python" "${install[@]}" --no-deps --no-index --no-build-isolation \
        --editable "$root" >&2 || return 1
    # Written last, so that an interrupted set-up is started again.
    wanted_stamp >"$root/.venv/stamp"
}

stamp=$(wanted_stamp) || stamp=""
if [ -z "$stamp" ] || [ "$stamp" != "$(cat "$root/.venv/stamp" 2>/dev/null)" ]; then
    base=$(find_python) || exit 1
    if ! build_environment "$base"; then
        echo "cc_mujoco could not set up $root/.venv: see the message above." >&2
        exit 1
    fi
fi
python=$(venv_python)

# The native library is compiled by Zig where this machine has no compiler.
if [ -z "${CC:-}" ] && ! command -v cc clang gcc >/dev/null &&
    ! "$python" -c 'import ziglang' 2>/dev/null; then
    echo "There is no C compiler: installing Zig's, about 100 MB (once) ..." >&2
    "$python" -m pip install --quiet --disable-pip-version-check --no-compile \
        --no-deps --only-binary :all: --require-hashes \
        --requirement "$root/scripts/compiler.lock" >&2 || exit 1
fi
