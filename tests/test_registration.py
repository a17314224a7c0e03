"""MuJoCo knows the cables, and Gymnasium the environments, in any order of imports."""

from __future__ import annotations

import pytest

from plugin.processes import Ended, processes

LOADS = """
from cc_mujoco.assets import scene_path
assert mujoco.MjModel.from_xml_path(str(scene_path("wrist"))).nplugin
"""
KNOWS = """
from cc_mujoco.envs import IDS
assert {*IDS, "cc_mujoco/Device-v1"} <= set(gymnasium.registry)
"""
SCRIPTS = {
    "both first": f"import gymnasium, mujoco, cc_mujoco{LOADS}{KNOWS}",
    "both second": f"import cc_mujoco, mujoco, gymnasium{LOADS}{KNOWS}",
    "a part of MuJoCo": f"import cc_mujoco, mujoco.introspect, mujoco{LOADS}",
    "the engine first": f"import cc_mujoco.plugin, mujoco{LOADS}",
    "the environments first": f"import cc_mujoco.envs, gymnasium{KNOWS}",
    "a diagnosis, and what takes long to load": (
        "import sys, cc_mujoco.control, cc_mujoco.diagnosis._diagnose\n"
        "slow = {'matplotlib', 'rerun'}\n"
        "slow |= {'scipy.optimize', 'scipy.signal', 'scipy.stats'}\n"
        "assert not slow & set(sys.modules)"
    ),
    "MuJoCo alone": "import sys, mujoco\nassert 'cc_mujoco' not in sys.modules",
    "the physics and estimation": (
        "import sys, cc_mujoco.cable, cc_mujoco.estimation\n"
        "assert cc_mujoco.cable.replay and cc_mujoco.estimation.calibrate\n"
        "assert not {'mujoco', 'cc_mujoco.plugin'} & set(sys.modules)"
    ),
    "a MuJoCo too old for the plugin": (
        "import sys, mujoco\n"
        "mujoco.__version__, mujoco.mj_version = '3.16.0', lambda: 3_016_000\n"
        "import cc_mujoco.cable\n"
        "assert 'cc_mujoco.plugin' not in sys.modules\n"
        "try:\n"
        "    cc_mujoco.read\n"
        "except ImportError as error:\n"
        "    assert 'need mujoco 3.17 or newer, not 3.16.0' in str(error), error\n"
        "else:\n"
        "    raise AssertionError"
    ),
    "nothing else": (
        "import sys, cc_mujoco\n"
        "assert not {'mujoco', 'scipy'} & set(sys.modules)\n"
        "assert cc_mujoco.read\n"
        "assert 'mujoco' in sys.modules"
    ),
}


@pytest.fixture(scope="module")
def ended(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Ended]:
    home = tmp_path_factory.mktemp("scripts")
    alone = {name: SCRIPTS[name] for name in ("MuJoCo alone", "nothing else")}
    others = {name: text for name, text in SCRIPTS.items() if name not in alone}
    # What takes longest to import, whose place in the order is of no account.
    start = "import scipy.linalg"
    return processes(start, others, home) | processes("", alone, home)


@pytest.mark.parametrize("name", SCRIPTS)
def test_import(name: str, ended: dict[str, Ended]) -> None:
    assert ended[name].code == 0, ended[name].said
