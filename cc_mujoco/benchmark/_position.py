"""Conditions of the suite `position`, in which a joint angle is commanded.

Plants are sampled around the scene as in all suites. Controllers know the cables of the
scene, and hysteresis parameters calibrated in a trial on the scene itself (conditions
`-stale`) or on the sampled plant (`-fitted`).
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from cc_mujoco.benchmark import _conditions as conditions
from cc_mujoco.benchmark._generic import device_motion
from cc_mujoco.benchmark._plant import POSITION_EFFECTS, sample_plants
from cc_mujoco.control import fit_hysteresis
from cc_mujoco.device import DeviceModel, Drive
from cc_mujoco.errors import CableError
from cc_mujoco.simulation import calibration_trials

WITH_SENSOR = ("distal_feedback",)  # controllers that measure the joint in any case


@dataclass(frozen=True)
class PositionCondition(conditions.Condition):
    fitted: bool = False  # true if a trial on the plant itself fits the controller

    @property
    def usual(self) -> bool:
        return self.name == f"ordinary{conditions.FITTED_ANEW}"


def position_conditions(scene: str) -> list[conditions.Condition]:
    motion, tasks = device_motion(DeviceModel.of(scene))
    if len(tasks) != 1 or not tasks[0].commands_angle:
        raise CableError(
            f"the suite 'position' plays devices of one axis whose task commands an "
            f"angle, and that of {scene} does not; `--suite generic` plays it."
        )
    plain = PositionCondition(
        scene, "", motion, tasks, conditions.OWN_LINER, "exact", duration=1.5
    )
    found = []
    # Effects in the plant that neither data sheet nor model has
    for effect in ("", *POSITION_EFFECTS, "seals"):
        for ending in (conditions.STALE, conditions.FITTED_ANEW):
            own = {"structure": effect, "fitted": ending == conditions.FITTED_ANEW}
            name = f"{effect or 'ordinary'}{ending}"
            found.append(conditions.named_condition(plain, name, **own))
    return found


def nominal_drive(condition: conditions.Condition) -> Drive:
    model = DeviceModel.of(condition.scene)
    drive = model.drives(model.description.period)[0]
    return dataclasses.replace(drive, commands_angle=True)


@lru_cache(maxsize=16)
def fresh_fits(
    condition: PositionCondition, seeds: tuple[int, ...], key: str = ""
) -> tuple[Mapping[str, Mapping[str, Any]], ...]:
    nominal = nominal_drive(condition)
    plants = [drawn.plant for drawn in sample_plants(condition, seeds, key)]
    trials = calibration_trials(plants, 4.0)  # [s]
    return tuple(fit_hysteresis(trial, nominal) for trial in trials)


def position_drives(
    condition: conditions.Condition,
    drive: Drive,
    plants: Sequence[tuple[conditions.Condition, tuple[int, ...], str]],
) -> tuple[Drive, list[Drive]]:
    """Return the drive with cables and hysteresis parameters of the unvaried scene.

    The second result has a drive for every seed of `plants` (condition, seeds, key of
    the run), calibrated on its plant if its condition is `fitted`.
    """
    known = nominal_drive(condition)
    drive = dataclasses.replace(drive, cables=known.cables, hysteresis=known.hysteresis)
    fits: list[Any] = []
    for own, seeds, key in plants:
        if isinstance(own, PositionCondition) and own.fitted:
            fits += fresh_fits(own, seeds, key)
        else:
            fits += [drive.hysteresis] * len(seeds)
    return drive, [dataclasses.replace(drive, hysteresis=fit) for fit in fits]
