"""The package and those that it adds to, imported in either order."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import cc_mujoco

ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(cc_mujoco.__file__).parents[1])}
LOADS = """
from cc_mujoco.assets import scene_path
assert mujoco.MjModel.from_xml_path(str(scene_path("wrist"))).nplugin
"""
KNOWS = 'assert "cc_mujoco/AnkleExo-v0" in gymnasium.registry'
SCRIPTS = {
    "both first": f"import gymnasium, mujoco, cc_mujoco{LOADS}{KNOWS}",
    "both second": f"import cc_mujoco, mujoco, gymnasium{LOADS}{KNOWS}",
    "a part of MuJoCo": f"import cc_mujoco, mujoco.introspect, mujoco{LOADS}",
    "the engine first": f"import cc_mujoco.engine, mujoco{LOADS}",
    "the environments first": f"import cc_mujoco.envs, gymnasium; {KNOWS}",
    "nothing else": (
        "import sys, cc_mujoco\n"
        "assert not {'gymnasium', 'mujoco', 'numba', 'numpy'} & set(sys.modules)\n"
        "assert cc_mujoco.read\n"
        "assert 'mujoco' in sys.modules"
    ),
}


@pytest.mark.parametrize("script", SCRIPTS.values(), ids=SCRIPTS)
def test_import(script: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, env=ENVIRONMENT
    )
    assert done.returncode == 0, done.stderr
