"""Import, reload, fork, spawn: the plugin is registered once and stays usable."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from plugin.processes import ROOT, Ended, processes
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


READ_ONLY = """
import numba
from numba.core.caching import InTreeCacheLocator
class Locator(InTreeCacheLocator):
    refused = ("callbacks.py", "script.py")
    @classmethod
    def from_function(cls, function, file):
        return None if file.endswith(cls.refused) else super().from_function(
            function, file)
real = numba.cfunc
def cfunc(*given, cache, **options):
    if not cache:  # half a minute's work, taken from what is kept
        Locator.refused = ("script.py",)
    return real(*given, cache=True, **options)
numba.cfunc = cfunc
"""


def test_what_numba_may_not_keep_is_compiled_without_a_cache(tmp_path: Path) -> None:
    """As of a read-only install."""
    (tmp_path / "read_only.py").write_text(READ_ONLY)
    script = tmp_path / "script.py"
    script.write_text(
        f"import read_only{STEP}assert step()\n"
        "assert read_only.Locator.refused == ('script.py',)\n"
        "from cc_mujoco._utils.compilation import compiled\n"
        "assert compiled(lambda x: 2 * x)(3) == 6\n"
    )
    done = subprocess.run(
        [sys.executable, str(script)],
        env=os.environ
        | {
            "PYTHONPATH": str(ROOT),
            "NUMBA_CACHE_LOCATOR_CLASSES": "read_only.Locator",
        },
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
