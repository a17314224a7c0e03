"""Text on the screen of a live episode."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Mapping
from typing import Any

from cc_mujoco.viz._live_controls import Knobs

CAPTION_WIDTH = 60
"""Width of a sentence [letters]."""


def state_rows(
    knobs: Knobs,
    columns: Mapping[str, Any],
    cables: Iterable[str],
    *,
    controller: str,
    pretension: float,
    factor: float,
    highest: float,
) -> tuple[tuple[str, str], ...]:
    """Name and value of all that changes.

    `columns` are those of an episode log, at this time. `pretension` is that of the
    cables over that of the scene, `factor` simulated over real time, NaN before it is
    known, and `highest` the tension of the brightest colour [N].
    """
    torque, desired = columns["joint_torque_nm"], columns["desired_torque_nm"]
    return (
        ("time", f"{columns['time_s']:.1f} s{_speed_text(knobs, factor)}"),
        ("controller", controller),
        *_cable_rows(knobs, pretension),
        ("joint torque", f"{torque:.2f} of {desired:.2f} N m"),
        *((cable, _tension_text(columns, cable)) for cable in cables),
        ("brightest", f"{highest:g} N; grey is slack"),
    )


def view_rows(
    knobs: Knobs,
    scene: str,
    time: float,
    ends: Mapping[str, tuple[float, float]],
    *,
    pretension: float,
    factor: float,
    highest: float,
) -> tuple[tuple[str, str], ...]:
    """Name and value of all that changes in a scene that nobody controls.

    `ends` are the tensions at the motor and at the joint, by cable [N], `time` is
    simulated [s]; other arguments as in `state_rows`.
    """
    return (
        ("scene", scene),
        ("time", f"{time:.1f} s{_speed_text(knobs, factor)}"),
        *_cable_rows(knobs, pretension),
        *((cable, _ends_text(*both)) for cable, both in ends.items()),
        ("brightest", f"{highest:g} N; grey is slack"),
    )


def _cable_rows(knobs: Knobs, pretension: float) -> tuple[tuple[str, str], ...]:
    laid = _factor_text(pretension)
    if knobs.pretension != pretension:
        laid += f"; {_factor_text(knobs.pretension)} at the next start"
    return ("friction", _factor_text(knobs.friction)), ("pretension", laid)


def _speed_text(knobs: Knobs, factor: float) -> str:
    if knobs.paused:
        return ", paused"
    return "" if math.isnan(factor) else f", {factor:.2f} of real time"


def wrap_sentence(text: str) -> tuple[tuple[str, str], ...]:
    """Return the lines of a sentence, in the second column; none of an empty one."""
    return tuple(("", line) for line in textwrap.wrap(text, CAPTION_WIDTH))


def _factor_text(factor: float) -> str:
    return "as in the scene" if factor == 1.0 else f"{factor:.3g} times the scene's"


def _tension_text(columns: Mapping[str, Any], cable: str) -> str:
    near, far = (columns[f"tension_{cable}_{end}_n"] for end in ("proximal", "distal"))
    return _ends_text(near, far)


def _ends_text(near: float, far: float) -> str:
    return f"{near:.1f} N at the motor, {far:.1f} N at the joint"
