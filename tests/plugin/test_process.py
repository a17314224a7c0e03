"""Import, reload, fork, spawn: the plugin is registered once and stays usable."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from cc_mujoco.errors import CableError
from cc_mujoco.native import _library as native_library
from cc_mujoco.native._library import library
from plugin.processes import Ended, processes
from plugin.scenes import pull_pull

STEP = f"""
import mujoco, cc_mujoco
XML = {pull_pull()!r}
def step():
    m = mujoco.MjModel.from_xml_string(XML)
    d = mujoco.MjData(m)
    d.ctrl[0] = 0.5
    mujoco.mj_step(m, d, 50)
    return d.actuator_force[1:].sum() != 0.0 and float(d.plugin_state.sum())
"""
SCRIPTS = {
    "twice": """
import cc_mujoco.plugin
cc_mujoco.plugin.register()
assert step()
""",
    "reload": """
import importlib
import cc_mujoco.plugin, cc_mujoco.plugin._registration
first = step()
for module in (cc_mujoco.plugin._registration, cc_mujoco.plugin, cc_mujoco):
    importlib.reload(module)
assert step() == first
""",
    "import anew": """
import gc, sys
first = step()
kept = mujoco.MjData(mujoco.MjModel.from_xml_string(XML))
for name in [n for n in sys.modules if n.split(".")[0] == "cc_mujoco"]:
    del sys.modules[name]
del cc_mujoco
gc.collect()
assert step() == first
import cc_mujoco.plugin
assert step() == first
assert cc_mujoco.plugin.from_mjcf(XML)
""",
    "fork": """
import os
first = step()
child = os.fork()
if child == 0:
    os._exit(0 if step() == first else 3)
assert os.waitpid(child, 0)[1] == 0
assert step() == first
""",
    "spawn": """
import multiprocessing
with multiprocessing.get_context("spawn").Pool(1) as pool:
    assert pool.apply(step) == step()
""",
    "threads": """
from concurrent.futures import ThreadPoolExecutor
first = step()
with ThreadPoolExecutor(4) as pool:
    assert set(pool.map(lambda _: step(), range(40))) == {first}
""",
    "name taken": """
import ctypes, gc
from cc_mujoco.plugin import _registration as plugin
class Other:
    KEYS = ("other",)
plugin.KEYS = Other.KEYS
try:
    plugin.register()
except ImportError as error:
    assert "only one version" in str(error), error
else:
    raise SystemExit(3)
assert step()
""",
    "exit with data alive": """
model = mujoco.MjModel.from_xml_string(XML)
alive = mujoco.MjData(model)
import builtins
builtins.alive = alive
""",
}


@pytest.fixture(scope="module")
def ended(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Ended]:
    return processes(STEP, SCRIPTS, tmp_path_factory.mktemp("scripts"))


@pytest.mark.parametrize("name", SCRIPTS)
def test_process(name: str, ended: dict[str, Ended]) -> None:
    if name == "fork" and not hasattr(os, "fork"):
        pytest.skip("this system cannot fork")
    code, said, folder = ended[name]
    assert code == 0, said
    assert "rror" not in said
    assert not (folder / "MUJOCO_LOG.TXT").exists()


def start(code: str, cache: Path, **environment: str) -> subprocess.Popen[str]:
    """Run code in a process with a folder of its own for the native library.

    Digests of syntax trees are known there, which takes nothing away but time.
    """
    for trees in native_library.folder().glob(TREES) if cache.is_dir() else ():
        shutil.copy(trees, cache)
    return subprocess.Popen(
        [sys.executable, "-P", "-c", code],
        env=os.environ | {"CC_MUJOCO_CACHE_DIR": str(cache)} | environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def said(process: subprocess.Popen[str]) -> list[str]:
    """Return what a process says on standard error."""
    return process.communicate(timeout=300)[1].splitlines()


TREES = "trees-*.json"
ONE = '__attribute__((visibility("default"))) int one(void) { return 1; }\n'
ONE_UNIT = f"#if CC_UNIT != 2\n{ONE}#else\nint two;\n#endif\n"
NOTICE = "cc_mujoco: compiling, once, for about 20 s"
WITHOUT = {"PATH": "", "CC": ""}
NO_ZIG = "import sys; sys.modules['ziglang'] = None; "


def test_library_that_cannot_be_kept_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As of a read-only home, or of a file where the folder would be."""
    taken = tmp_path / "taken"
    taken.write_text("mine")
    monkeypatch.setenv("CC_MUJOCO_CACHE_DIR", str(taken))
    with pytest.raises(native_library.NativeLibraryError) as failure:
        native_library.keep("libone", build_one)
    assert f"in {taken}, which cannot be written" in str(failure.value)
    assert "CC_MUJOCO_CACHE_DIR" in str(failure.value)
    assert taken.read_text() == "mine"


@pytest.mark.parametrize(
    ("named", "reason"),
    [
        ("", "needs a C compiler once and finds none; install `gcc`"),
        ("nocc -m64", "the variable CC names a compiler that is not found, `nocc`"),
    ],
)
def test_machine_without_a_compiler_is_told_what_to_install(
    named: str, reason: str, tmp_path: Path
) -> None:
    code = NO_ZIG + "import cc_mujoco.plugin"
    done = start(code, tmp_path, **WITHOUT | {"CC": named})
    assert reason in said(done)[-1]
    assert done.returncode == 1
    assert not list(tmp_path.glob("libcc_mujoco*"))


def test_two_processes_and_their_threads_compile_one_library(
    quick_compiler: str, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Nobody sees half a file of another, and of the killed nothing is left.

    What was not used for long is removed, but for files of others.
    """
    old, young = tmp_path / "building-old", tmp_path / "building-young"
    for left in (old, young):
        (left / "part").mkdir(parents=True)
    digits = "0123456789abcdef0123"
    unused = tmp_path / f"libcc_mujoco-{digits}-x86_64-7.so"
    kept, other = tmp_path / f"unit-{digits}-1-7.o", tmp_path / "liblab-2.1.so"
    for file in (unused, kept, other):
        file.write_bytes(b"library")
    for path in (old, unused, other):
        os.utime(path, (0, 0))
    meeting = tmp_path_factory.mktemp("meeting")
    code = f"""
import os, pathlib, time
from concurrent.futures import ThreadPoolExecutor
from cc_mujoco.native import _library as native_library
meeting = pathlib.Path({str(meeting)!r})
(meeting / str(os.getpid())).touch()
while len([*meeting.iterdir()]) < 2:
    time.sleep(0.01)
write = lambda source: source.write_text({ONE_UNIT!r})
native_library._kept_name, native_library.write_source = lambda: "libone", write
library = native_library.library
with ThreadPoolExecutor(4) as pool:
    found = pool.map(lambda _: library()._handle, range(4))
    assert len({{*found}}) == 1
"""
    both = [start(code, tmp_path, CC=quick_compiler) for _ in range(2)]
    assert [said(one) for one in both] == [[NOTICE], [NOTICE]]
    assert [one.returncode for one in both] == [0, 0]
    assert not unused.exists()
    kept.unlink()
    other.unlink()
    left = sorted(path.name for path in tmp_path.iterdir() if not path.match(TREES))
    first, library_name, *units = left
    assert first == young.name
    assert library_name.startswith("libone-")
    assert [name.split("-")[::2] for name in units] == [["unit", "1"], ["unit", "2"]]


@pytest.mark.study  # the usual run compiles a small library for it, below
def test_library_that_is_not_whole_is_compiled_anew(
    quick_compiler: str, tmp_path: Path
) -> None:
    """As of a disk that was full, or a copy that was cut off."""
    file = tmp_path / Path(library()._name).name
    file.write_bytes(Path(library()._name).read_bytes()[:1000])
    assert said(start("import cc_mujoco.plugin", tmp_path, CC=quick_compiler)) == [
        NOTICE
    ]
    assert said(start("import cc_mujoco.plugin", tmp_path, **WITHOUT)) == []


def test_command_without_a_compiler_is_one_sentence(tmp_path: Path) -> None:
    """Names of what is no model are listed all the same."""
    code = NO_ZIG + "from cc_mujoco.cli import main; sys.exit(main(%r))"
    listing = start(code % ["list", "controllers"], tmp_path, **WITHOUT)
    playing = start(code % ["play", "wrist"], tmp_path, **WITHOUT)
    listed, error = listing.communicate(timeout=300)
    assert (listing.returncode, error) == (0, "")
    assert "predictive" in listed
    (error,) = said(playing)
    assert playing.returncode == 2
    assert error.startswith("cc-mujoco: cc_mujoco needs a C compiler once")


def build_one(place: Path) -> Path:
    source = place / "one.c"
    source.write_text(ONE)
    return native_library.compile_library(
        place / f"libone{native_library.SUFFIX}", source
    )


def test_changed_statement_that_changes_no_c_compiles_nothing(
    quick_compiler: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC_MUJOCO_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("CC", quick_compiler)
    units: list[list[str]] = []
    for name, text in (
        ("first", ONE_UNIT),
        ("again", "/* line 2 */\n" + ONE_UNIT),
        ("other", ONE_UNIT.replace("1;", "2;")),
    ):
        place = tmp_path / name
        place.mkdir()
        monkeypatch.setattr(
            native_library,
            "write_source",
            lambda source, text=text: source.write_text(text),
        )
        with native_library.workplace():
            made = native_library.build_library(place)
        assert native_library.digest().encode() in made.read_bytes()
        assert native_library.load(made).one() == (2 if name == "other" else 1)
        units.append(sorted(path.name for path in (tmp_path / "cache").glob("unit-*")))
    assert [len(found) for found in units] == [2, 2, 4]


COMPILERS = {
    "no binary": ("", "says: Exec format error"),
    "silent": ("#!/bin/sh\nexit 3", "says: nothing, and ends with 3"),
    "idle": ("#!/bin/sh\nexit 0", "says: nothing, and ends with 0"),
    "loud": (
        "#!/bin/sh\necho 'In file\nx.c:1: error: no such thing\nstopped' >&2\nexit 1",
        "says: x.c:1: error: no such thing",
    ),
}


@pytest.mark.skipif(sys.platform == "win32", reason="its scripts are others")
@pytest.mark.parametrize("kind", COMPILERS)
def test_a_compiler_that_fails_is_one_sentence(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text, reason = COMPILERS[kind]
    compiler = tmp_path / "cc"
    compiler.write_text(text)
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", str(compiler))
    monkeypatch.setenv("CC_MUJOCO_CACHE_DIR", str(tmp_path / "kept"))
    with pytest.raises(native_library.NativeLibraryError) as failure:
        native_library.keep("libone", build_one)
    assert str(failure.value).endswith(f"`{compiler}` {reason}")
    assert not [*(tmp_path / "kept").iterdir()]
    monkeypatch.setenv("CC", "'gcc")
    with pytest.raises(CableError, match="CC is no command, `'gcc`: No closing"):
        native_library.keep("libone", build_one)


def test_any_kept_library_that_is_of_no_use_is_compiled_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As one that is cut off, or of a compiler for another machine."""
    monkeypatch.setenv("CC_MUJOCO_CACHE_DIR", str(tmp_path))
    path = native_library.keep("libone", build_one)
    size = path.stat().st_size
    assert native_library.keep("libone", build_one) == path
    for content in (path.read_bytes()[:100], bytes(size)):
        path.write_bytes(content)
        with pytest.raises(native_library.NativeLibraryError, match="does not load"):
            native_library.load(path)
        assert native_library.keep("libone", build_one).stat().st_size == size
