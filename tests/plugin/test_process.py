"""Import, reload, fork, spawn: the plugin is registered once and stays usable."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

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


def load(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run code in a process whose native library is not compiled yet."""
    return subprocess.run(
        [sys.executable, "-P", "-c", code],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=300,
    )


def test_library_that_cannot_be_kept_is_one_sentence(tmp_path: Path) -> None:
    """As of a read-only home, or of a file where the folder would be."""
    taken = tmp_path / "taken"
    taken.write_text("mine")
    done = load("import cc_mujoco.plugin", CC_MUJOCO_CACHE_DIR=str(taken))
    last = done.stderr.splitlines()[-1]
    assert done.returncode == 1
    assert f"in {taken}, which cannot be written" in last
    assert "CC_MUJOCO_CACHE_DIR" in last
    assert taken.read_text() == "mine"


def test_machine_without_a_compiler_is_told_what_to_install(tmp_path: Path) -> None:
    code = "import sys; sys.modules['ziglang'] = None; import cc_mujoco.plugin"
    done = load(code, CC_MUJOCO_CACHE_DIR=str(tmp_path), PATH="", CC="")
    last = done.stderr.splitlines()[-1]
    assert done.returncode == 1
    assert "needs a C compiler once and finds none; install `gcc`" in last
    assert not list(tmp_path.glob("libcc_mujoco*"))


def test_two_processes_compile_one_library(tmp_path: Path) -> None:
    """Neither sees half a file of the other, and nothing else is left."""
    both = [
        subprocess.Popen(
            [sys.executable, "-P", "-c", "import cc_mujoco.plugin"],
            env=os.environ | {"CC_MUJOCO_CACHE_DIR": str(tmp_path)},
        )
        for _ in range(2)
    ]
    assert [one.wait(timeout=300) for one in both] == [0, 0]
    left = sorted(path.name for path in tmp_path.iterdir())
    assert len(left) == 2
    assert left[0].startswith("libcc_mujoco-")
    assert left[1] == "trees.json"


def test_library_that_is_not_whole_is_compiled_anew(tmp_path: Path) -> None:
    """As of a disk that was full, or a copy that was cut off."""
    code = "import cc_mujoco.plugin"
    assert load(code, CC_MUJOCO_CACHE_DIR=str(tmp_path)).returncode == 0
    (library,) = tmp_path.glob("libcc_mujoco-*")
    content = library.read_bytes()
    library.write_bytes(content[:1000])
    (tmp_path / "trees.json").write_text("[]")
    assert load(code, CC_MUJOCO_CACHE_DIR=str(tmp_path)).returncode == 0
    assert library.stat().st_size == len(content)


def test_command_without_a_compiler_is_one_sentence(tmp_path: Path) -> None:
    code = (
        "import sys; sys.modules['ziglang'] = None; from cc_mujoco.cli import main; "
        "sys.exit(main(['play', 'wrist']))"
    )
    done = load(code, CC_MUJOCO_CACHE_DIR=str(tmp_path), PATH="", CC="")
    assert done.returncode == 2
    assert done.stderr.startswith("cc-mujoco: cc_mujoco needs a C compiler once")
    assert done.stderr.count("\n") == 1
