"""Several occasions of one rig: shared effects, a baseline of its own for each.

Between two days a rig is run in, dismantled or left in the sun. Friction, pretension,
stiffness, offsets and clocks then differ, while the effects that the scene lacks are
still there. The baseline is that of the last occasion. For every earlier one the fit
has a parameter `<name>@<occasion>`: the ratio to the last occasion where the parameter
is fitted as a logarithm, the difference from it elsewhere. So the interval of a change
does not contain the error that both occasions have in common.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from cc_mujoco.cable import PARAMETERS, Parameter
from cc_mujoco.diagnosis._rig.records import Record
from cc_mujoco.estimation._least_squares import Tuned

_CHANGE_DEVIATIONS = {"friction": 1.0, "pretension": 1.0, "axial_stiffness": 0.3}
"""Prior standard deviation of the logarithm of a ratio between two occasions.

A pretension that is declared for every trial changes by its own uncertainty only.
"""
_CHANGING = (
    *_CHANGE_DEVIATIONS,
    "motor_torque_offset",
    "joint_torque_offset",
    "joint_angle_offset",
    "clock_offset",
    "motor_torque_late",
    "joint_torque_late",
    "friction_balance",
)
"""Parameters of the baseline that may change between occasions."""
_LARGEST = {p.name: p.high for p in PARAMETERS if p.name in _CHANGE_DEVIATIONS}
_MAX_LOG_RATIO = math.log(30.0)
"""Largest ratio of two occasions that is fitted, as a logarithm."""
_BOTH = math.sqrt(2.0)
"""Deviation of a difference over that of both parts."""


def change_name(name: str, occasion: str) -> str:
    """Return the name of the change of a parameter between an occasion and the last."""
    return f"{name}@{occasion}"


def base_name(name: str) -> str:
    """Return the name of the parameter that changes; any other name as it is."""
    return name.partition("@")[0]


def is_change(name: str) -> bool:
    return "@" in name


def occasions_of(records: Sequence[Record]) -> tuple[str, ...]:
    """Return the occasions in order of their first trials."""
    return tuple(dict.fromkeys(record.occasion for record in records))


def values_on(values: Mapping[str, float], occasion: str) -> Mapping[str, float]:
    own = {
        name: values[there]
        for name in _CHANGING
        if (there := change_name(name, occasion)) in values
    }
    if not own:
        return values
    found = dict(values)
    for name, change in own.items():
        if name in _CHANGE_DEVIATIONS:
            found[name] = min(values[name] * change, 0.9 * _LARGEST[name])
        else:
            found[name] = values[name] + change
    return found


def change_parameters(
    baseline: Sequence[Tuned],
    records: Sequence[Record],
    angle_offset: Callable[[Sequence[Record]], float],
) -> list[Tuned]:
    """Return the changes that are fitted for each occasion but the last.

    `baseline` has the parameters of one occasion; `angle_offset` estimates the joint's
    zero from some of the records [rad].
    """
    *earlier, last = occasions_of(records)
    found = []
    by_occasion = {
        name: [record for record in records if record.occasion == name]
        for name in (*earlier, last)
    }
    for occasion in earlier:
        both = [*by_occasion[occasion], *by_occasion[last]]
        declared = all(record.pretension is not None for record in both)
        for tuned in baseline:
            if tuned.name not in _CHANGING:
                continue
            described = replace(tuned.parameter, name=change_name(tuned.name, occasion))
            if tuned.factor:
                prior = _CHANGE_DEVIATIONS[tuned.name]
                if tuned.name == "pretension" and declared:
                    prior = _BOTH * tuned.scale * tuned.prior
                ratio = Parameter(described.name, "1", described.meaning, scale="log")
                found.append(
                    Tuned(ratio, 1.0, 1.0, -_MAX_LOG_RATIO, _MAX_LOG_RATIO, prior)
                )
                continue
            start = 0.0
            if tuned.name == "joint_angle_offset":
                start = angle_offset(by_occasion[occasion])
                start -= angle_offset(by_occasion[last])
            found.append(
                tuned._replace(
                    parameter=described,
                    start=start,
                    low=2.0 * tuned.low,
                    high=2.0 * tuned.high,
                    prior=_BOTH * tuned.prior,
                )
            )
    return found
