"""Judgement of what a diagnosis reports of an event that happened to a rig."""

from __future__ import annotations

import math
from typing import Any

from cc_mujoco.diagnosis import Diagnosis
from rig.events import Happening

NAMES = {
    "cable_off": ("silent",), "cable_off_for_good": ("silent",),
    "slip": ("joint_angle_offset",), "slip_between": ("joint_angle_offset",),
    "zeroed": ("joint_angle_offset",), "zeroed_between": ("joint_angle_offset",),
    "dead": ("dead",), "frozen": ("",), "gain": ("gain",),
    "gain_between": ("gain",), "friction": ("friction",),
    "pretension": ("pretension",), "one_trial": ("pretension",),
    "drift": ("drift",), "saturated": ("",),
    "devices": ("device", "axial_stiffness", "friction", "pretension"),
}  # fmt: skip
"""Right kinds of `Event` by what happened; "" where the reader itself reports it."""
MOST = 0.2  # error of the time up to which an event is found [s]


def judged(found: Diagnosis, happened: Happening | None) -> dict[str, Any]:
    """Return whether the event was found and named, its time's error, and others."""
    kinds = [event.kind for event in found.events]
    if happened is None:
        return {"found": not kinds, "kinds": kinds, "late": 0.0, "sure": True}
    trial, late, sure = f"trial_{happened.trial:02d}", math.inf, True
    before = f"trial_{happened.trial - 1:02d}"
    for event in found.events:
        parts = math.isnan(event.time) and happened.time == 0.0
        # Either side of a division of the trials may be called the event.
        if parts and (trial in event.spans) != (before in event.spans):
            late = 0.0
            break
        if event.file.endswith(f"{trial}.csv") and not math.isnan(event.time):
            late = event.time - happened.time
            low, high = event.interval
            sure = low - MOST / 10 <= happened.time <= high + MOST / 10
            break
    if "" in NAMES[happened.kind] and not kinds:
        late = 0.0 if trial in found.question else math.inf
        kinds = [""]
    known = abs(late) <= MOST and kinds[0] in NAMES[happened.kind]
    return {"found": known, "kinds": kinds, "late": late, "sure": sure}
