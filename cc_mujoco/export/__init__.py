"""Controllers in C: an object file of the library's own compiled functions."""

from __future__ import annotations

from cc_mujoco.export.laws import EXPORTED, Field, Plan
from cc_mujoco.export.machine import TARGETS, Target
from cc_mujoco.export.writing import FILES, require_ours, write

__all__ = [
    "EXPORTED",
    "FILES",
    "TARGETS",
    "Field",
    "Plan",
    "Target",
    "require_ours",
    "write",
]
