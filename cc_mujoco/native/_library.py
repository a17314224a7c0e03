"""Native library: found, or compiled once and cached.

It is in this package, as in a wheel, or in a cache folder of the user. Its name has a
digest of the syntax trees that it was made from, so a changed comment compiles nothing.
"""

import ast
import ctypes
import gc
import hashlib
import json
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from cc_mujoco._mujoco_import import OLDEST_MUJOCO
from cc_mujoco.errors import CableError

PACKAGE = Path(__file__).parents[1]
SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
CARRIED = Path(__file__).with_name(f"libcc_mujoco{SUFFIX}")  # the library of a wheel
DIGEST_NAME = "cc_mujoco_digest"
"""Name of the text in the library that identifies the code that it was made of."""
FLAGS = (
    "-std=c99", "-O3", "-ffp-contract=off", "-fno-strict-aliasing", "-fwrapv",
    "-fno-semantic-interposition", "-fno-plt",
    "-fno-math-errno", "-fno-trapping-math", "-fvisibility=hidden", "-g0",
)  # fmt: skip
"""Flags of the compiler. Nothing is contracted: every machine gives the same bits."""
_lock = threading.RLock()
_does_without = False


@cache
def entries() -> dict[str, Callable[..., Any]]:
    return methods(library())


def methods(found: ctypes.CDLL) -> dict[str, Callable[..., Any]]:
    """Return the functions of a library that Python calls, by their keys."""
    text = Path(__file__).with_name("python_calls.h").read_text()
    table = text.partition("static struct {")[2].partition("} api;")[0]
    values = [
        ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value
        for name in re.findall(r"\(\*(\w+)\)\(", table)
    ]
    values += [id(None), id(TypeError)]
    found.cc_use_python((ctypes.c_void_p * len(values))(*values))
    make = ctypes.pythonapi.PyCFunction_NewEx
    make.restype = ctypes.py_object
    make.argtypes = (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)
    methods: dict[str, Callable[..., Any]] = {}
    at = ctypes.addressof(ctypes.c_char.in_dll(found, "cc_methods"))
    while True:
        method = _Method.from_address(at)
        if not method.name:
            return methods
        methods[method.name.decode()] = make(at, None, None)
        at += ctypes.sizeof(_Method)


class _Method(ctypes.Structure):
    _fields_ = (
        ("name", ctypes.c_char_p),
        ("call", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


def library() -> ctypes.CDLL:
    with _lock:
        return _library()


@cache
def _library() -> ctypes.CDLL:
    if _does_without:
        compiler()  # says what to install
        raise NativeLibraryError("this process does without the native library.")
    return load(CARRIED if _is_carried() else keep(_kept_name(), build_library))


def load(path: Path) -> ctypes.CDLL:
    """Load a library; delete it if it does not load and is in the user's cache."""
    try:
        return ctypes.CDLL(str(path))
    except OSError as error:
        if path.parent == folder():  # perhaps it was compiled for another machine
            path.unlink(missing_ok=True)
        raise NativeLibraryError(
            f"the native library {path} does not load: {error}"
        ) from None


class NativeLibraryError(CableError, ImportError):
    """Failure to build, cache or load the native library."""


def _is_carried() -> bool:
    if not CARRIED.is_file():
        return False
    content = CARRIED.read_bytes()
    # The first digest is found without parsing.
    return sources_digest().encode() in content or digest().encode() in content


def _kept(name: str, suffix: str = SUFFIX) -> Path | None:
    for path in folder().glob(f"{name}-*{suffix}"):
        if path.stem.endswith(f"-{path.stat().st_size}"):
            _use(path)
            return path
    return None


def _use(path: Path) -> None:
    with suppress(OSError):
        os.utime(path)


def _kept_name() -> str:
    return f"libcc_mujoco-{digest()[:20]}-{platform.machine().lower()}"


def keep(name: str, build: Callable[[Path], Path]) -> Path:
    """Return the path of a library in the user's cache, built if it is not there.

    `name` identifies its code and machine; the file's name adds its size, to detect a
    partial file. `build` compiles it in a folder and returns its path.
    """
    found = _kept(name)
    if found is not None:
        return found
    with workplace() as place:
        if sys.stderr is not None:
            sys.stderr.write("cc_mujoco: compiling, once, for about 20 s\n")
        return _put(build(place), name)


def _put(made: Path, name: str) -> Path:
    size = made.stat().st_size
    return made.replace(folder() / f"{name}-{size}{made.suffix}")


@contextmanager
def workplace() -> Iterator[Path]:
    """Yield a temporary folder to compile in, inside the user's cache."""
    compiler()
    try:
        folder().mkdir(parents=True, exist_ok=True)
        _remove_old_files()
        with tempfile.TemporaryDirectory(dir=folder(), prefix="building-") as place:
            yield Path(place)
    except OSError as error:
        raise NativeLibraryError(
            f"cc_mujoco keeps its native library in {folder()}, which cannot be "
            f"written ({error.strerror}); set CC_MUJOCO_CACHE_DIR to another folder."
        ) from None


def _remove_old_files() -> None:
    """Delete libraries unused for 60 days and folders that killed processes left."""
    # Names of kept files, in a folder that may hold others
    kept = r"(lib\w+|unit)-[0-9a-f]{20}.*\.\w+|\w+-[0-9a-f]{32}\.json"
    for path in folder().iterdir():
        with suppress(OSError):  # another process has removed it, or has it open
            age = time.time() - path.stat().st_mtime
            if path.name.startswith("building-") and age > 3600.0:
                shutil.rmtree(path, ignore_errors=True)
            elif age > 60.0 * 86400.0 and re.fullmatch(kept, path.name):
                path.unlink()


def does_without() -> bool:
    return _does_without


def is_at_hand() -> bool:
    """Return whether there is a library of this code, or a compiler to build it."""
    try:
        return _is_carried() or _kept(_kept_name()) is not None or bool(compiler())
    except NativeLibraryError:
        return False


def do_without() -> None:
    """Never load the library in this process, which then has no cables in MuJoCo."""
    global _does_without
    _does_without = True


def write(path: str) -> None:
    do_without()
    gc.disable()  # trees of all functions are kept to the end
    import_module("cc_mujoco.plugin._native").write(path)


def folder() -> Path:
    chosen = os.environ.get("CC_MUJOCO_CACHE_DIR")
    if chosen:
        return Path(chosen)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home())) / "cc_mujoco"
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "cc_mujoco"


def kept(kind: str, follows: Iterable[str], make: Callable[[], Any]) -> Any:
    """Return what `make` returns, as JSON cached in the user's folder.

    `kind` is the first word of the file's name. The cache is used for equal `follows`,
    the inputs of `make`, and equal code of this package.
    """
    whole = hashlib.sha256("\0".join([sources_digest(), *follows]).encode())
    path = folder() / f"{kind}-{whole.hexdigest()[:32]}.json"
    with suppress(OSError, ValueError):
        found = json.loads(path.read_text())
        _use(path)
        return found
    found = make()
    with suppress(OSError):  # it is made anew another time
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, partial = tempfile.mkstemp(dir=path.parent, prefix=path.name)
        with os.fdopen(handle, "w") as file:
            json.dump(found, file)
        Path(partial).replace(path)
    return found


@cache
def digest() -> str:
    """Return a digest of the library's code: its syntax trees without docstrings."""
    found: str = kept("trees", (), _digest)  # a second of parsing
    return found


def _digest() -> str:
    whole = hashlib.sha256()
    for name, content in _sources():
        meaning = content.hex()
        if name.endswith(".py"):
            tree = ast.parse(content)
            for node in ast.walk(tree):
                match getattr(node, "body", None):
                    case [ast.Expr(ast.Constant(str())), *_]:
                        del node.body[0]  # type: ignore[attr-defined]
            meaning = hashlib.sha256(ast.dump(tree).encode()).hexdigest()[:32]
        whole.update(f"{name} {meaning}\n".encode())
    return whole.hexdigest()


@cache
def sources_digest() -> str:
    """Return a digest of the library's files byte by byte, comments included."""
    whole = hashlib.sha256()
    for name, content in _sources():
        whole.update(name.encode() + hashlib.sha256(content).digest())
    return whole.hexdigest()


def _sources() -> Iterator[tuple[str, bytes]]:
    """Yield names and contents of the package's files that may be in the library."""
    for path in sorted(PACKAGE.rglob("*")):
        place = path.relative_to(PACKAGE)
        elsewhere = place.parts[0] in ("assets", "envs")  # of a checkout
        if not elsewhere and path.suffix in (".py", ".h", ".c", ".csv", ".toml"):
            yield place.as_posix(), path.read_bytes()


def compiler() -> list[str]:
    given = os.environ.get("CC", "")
    try:
        chosen = shlex.split(given, posix=os.name != "nt")
    except ValueError as error:
        raise NativeLibraryError(
            f"the variable CC is no command, `{given}`: {error}."
        ) from None
    if chosen:
        found = shutil.which(chosen[0])
        if found is None:
            raise NativeLibraryError(
                f"the variable CC names a compiler that is not found, `{chosen[0]}`; "
                "name another or unset it."
            )
        return [found, *chosen[1:]]
    for name in ("cc", "clang", "gcc"):
        found = shutil.which(name)
        if found:
            return [found]
    if find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "cc"]
    raise NativeLibraryError(
        "cc_mujoco needs a C compiler once and finds none; install `gcc` or `clang`, "
        "or `pip install ziglang`."
    )


def build_library(place: Path) -> Path:
    """Compile the library of this package in a folder; return its path."""
    # Without an import of MuJoCo, which would load the library.
    installed = tuple(map(int, version("mujoco").split(".")[:2]))
    if installed < OLDEST_MUJOCO:
        oldest = ".".join(map(str, OLDEST_MUJOCO))
        raise NativeLibraryError(
            f"cc_mujoco needs mujoco {oldest} or newer to compile its native library: "
            "`pip install --upgrade mujoco`, or install a wheel, which has it."
        )
    source, stamp = place / "cc_mujoco.c", place / "stamp.c"
    head = Path(__file__).with_name("native.h").read_text()
    stamp.write_text("\n".join([head, *identity(), ""]))
    stamped = place / "stamp.o"
    # This short file first: a compiler that does not work fails before the long one.
    run([*compiler(), *FLAGS, "-fPIC", "-c", str(stamp), "-o", str(stamped)], stamped)
    write_source(source)
    return compile_library(place / CARRIED.name, *_units(source), stamped)


def identity() -> Iterator[str]:
    for name, text in (
        (DIGEST_NAME, digest()),
        ("cc_mujoco_sources", sources_digest()),
    ):
        yield f'CC_EXPORT const char {name}[] = "{text}";'


def _units(source: Path) -> list[Path]:
    """Return the two object files of a source, compiled in parallel.

    Each defines `CC_UNIT` as 1 or 2. They are cached by the source's lines of C.
    """
    text = re.sub(r"/\*.*?\*/", "", source.read_text(), flags=re.DOTALL)
    lines = [line for line in text.splitlines() if line.strip()]
    command = [*compiler(), *FLAGS, "-fPIC", "-c"]
    whole = hashlib.sha256("\0".join([platform.machine(), *command, *lines]).encode())

    def unit(number: int) -> Path:
        name = f"unit-{whole.hexdigest()[:20]}-{number}"
        made = source.with_name(f"{name}.o")
        found = _kept(name, made.suffix)
        if found is None:
            given = [f"-DCC_UNIT={number}", str(source), "-o", str(made)]
            run([*command, *given], made)
            found = _put(made, name)
        return found

    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(unit, (1, 2)))


def compile_library(path: Path, *parts: Path) -> Path:
    libraries = [] if sys.platform == "win32" else ["-lm"]
    built = ["-fPIC", "-shared", "-o", str(path), *map(str, parts), *libraries]
    run([*compiler(), *FLAGS, *built], path)
    return path


def write_source(path: Path) -> None:
    """Write the library's source in C, in a separate process."""
    code = "import sys; from cc_mujoco.native._library import write; write(sys.argv[1])"
    paths = filter(None, [str(PACKAGE.parent), os.environ.get("PYTHONPATH")])
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    run([sys.executable, "-P", "-c", code, str(path)], path, environment)


def run(
    command: list[str], made: Path, environment: dict[str, str] | None = None
) -> None:
    """Run a command that makes a file; raise its first error if it fails."""
    try:
        done = subprocess.run(command, env=environment, capture_output=True, text=True)
        said, code = done.stderr.splitlines(), done.returncode
    except OSError as failure:
        said, code = [failure.strerror or ""], failure.errno or 1
    if code == 0 and made.is_file():
        return
    lines = [line.strip() for line in said if line.strip()]
    last = lines[-1] if lines else f"nothing, and ends with {code}"
    first = next((line for line in lines if re.search(r"\berror: ", line)), last)
    error = NativeLibraryError(
        f"the native library cannot be compiled; `{command[0]}` says: {first}"
    )
    error.add_note("\n".join(said[-30:]))
    raise error
