"""A benchmark of torque controllers on the devices of this package.

    cc-mujoco benchmark --scene wrist --controllers pi stiction my_module:my_function

Every controller meets every trajectory, task and seed, through the environments with
inertia, limits of the motor, noisy and delayed sensors (`cc_mujoco.sensing`), and, if
it has a model, with a wrong one (`mismatch`). A seed is the same noise, the same wrong
model and the same motion for every controller, so that controllers are compared in
pairs.
"""

from __future__ import annotations

from cc_mujoco.benchmark.cell import Cell, CellResult, play
from cc_mujoco.benchmark.report import Interval, interval, markdown
from cc_mujoco.benchmark.runner import Plan, run
from cc_mujoco.benchmark.scores import SCORES, Score

__all__ = [
    "SCORES",
    "Cell",
    "CellResult",
    "Interval",
    "Plan",
    "Score",
    "interval",
    "markdown",
    "play",
    "run",
]
"""Everything that a program of its own needs to run cells and to sum them up."""
