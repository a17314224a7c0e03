"""A benchmark of torque controllers on the devices of this package.

    cc-mujoco benchmark --suite v1 --controllers pi stiction my_module:my_function

Every controller meets every condition of a suite (`conditions`) with every seed: a
plant that is drawn (`plant`), sensors with noise, bias and delay (`sensors`), and, if
it has a model, a wrong one. A condition and a seed are the same plant, noise and motion
for every controller, so that controllers are compared in pairs (`ranking`), beside
references that give the numbers a scale (`references`).
"""

from __future__ import annotations

from cc_mujoco.benchmark.cell import Cell, CellResult, play, play_group, together
from cc_mujoco.benchmark.conditions import SUITES, Condition, Suite
from cc_mujoco.benchmark.ranking import normalised, ranking
from cc_mujoco.benchmark.references import REFERENCES, Reference
from cc_mujoco.benchmark.report import Interval, interval, markdown
from cc_mujoco.benchmark.runner import BenchmarkPlan, run
from cc_mujoco.benchmark.scores import SCORES

__all__ = [
    "REFERENCES",
    "SCORES",
    "SUITES",
    "BenchmarkPlan",
    "Cell",
    "CellResult",
    "Condition",
    "Interval",
    "Reference",
    "Suite",
    "interval",
    "markdown",
    "normalised",
    "play",
    "play_group",
    "ranking",
    "run",
    "together",
]
"""Everything that a program of its own needs to run cells and to sum them up."""
