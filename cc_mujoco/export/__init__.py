"""Controllers in C: an object file of the library's own compiled functions."""

from __future__ import annotations

from cc_mujoco.export.laws import EXPORTED, ExportPlan, Field
from cc_mujoco.export.machine import TARGETS, Target
from cc_mujoco.export.writing import FILES, require_ours, write

__all__ = [
    "EXPORTED",
    "FILES",
    "TARGETS",
    "ExportPlan",
    "Field",
    "Target",
    "require_ours",
    "write",
]
