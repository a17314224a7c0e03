"""A screen for tests that open a window: the user's, or a virtual one."""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import cc_mujoco

ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(cc_mujoco.__file__).parents[1])}
PROBE = """
from cc_mujoco.errors import CableError
from cc_mujoco.viz._viewer import require_screen
try:
    require_screen()
except CableError as error:
    print(error)
"""


def run_in_a_window(script: str) -> str:
    """Return what a script prints that opens windows; skip where none can be opened."""
    if refusal := _run(PROBE):
        pytest.skip(refusal)
    return _run(script)


@functools.cache
def _run(script: str) -> str:
    words = [sys.executable, "-c", script]
    virtual = shutil.which("xvfb-run")
    if virtual and not os.environ.get("DISPLAY"):
        words = [virtual, "-a", "-s", "-screen 0 1280x800x24", *words]
    done = subprocess.run(
        words, capture_output=True, text=True, env=ENVIRONMENT, timeout=120
    )
    assert (done.returncode, done.stderr) == (0, ""), done.stdout + done.stderr
    return done.stdout
