"""Import, reload, fork, spawn: the plugin is registered once and stays usable."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import cc_mujoco
from engine.scenes import pull_pull

ROOT = Path(cc_mujoco.__file__).parents[1]
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
import cc_mujoco.engine
cc_mujoco.engine.register()
assert step()
""",
    "reload": """
import importlib
import cc_mujoco.engine, cc_mujoco.engine.plugin
first = step()
for module in (cc_mujoco.engine.plugin, cc_mujoco.engine, cc_mujoco):
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
import cc_mujoco.engine
assert step() == first
assert cc_mujoco.engine.from_mjcf(XML)
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
if __name__ == "__main__":
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
from cc_mujoco.engine import plugin
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


@pytest.mark.parametrize("name", SCRIPTS)
def test_process(name: str, tmp_path: Path) -> None:
    if name == "fork" and not hasattr(os, "fork"):
        pytest.skip("this system cannot fork")
    script = tmp_path / "script.py"
    script.write_text(STEP + SCRIPTS[name])
    done = subprocess.run(
        [sys.executable, str(script)],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert "rror" not in done.stderr
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()


@pytest.mark.slow
def test_read_only_install_without_a_cache(tmp_path: Path) -> None:
    """Where Numba may write nowhere, the callbacks are compiled without a cache."""
    script = tmp_path / "script.py"
    script.write_text(
        """
from numba.core import caching
for locator in caching.CacheImpl._locator_classes:
    locator.from_function = classmethod(lambda cls, function, file: None)
"""
        + STEP
        + "assert step()"
    )
    done = subprocess.run(
        [sys.executable, str(script)],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
