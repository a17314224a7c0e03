"""Position controllers that compensate hysteresis, and the fit of all of them.

found = fit_hysteresis(HysteresisTrial.of(motor, joint, drive.ratio), drive)
law = controller("backlash_inverse", replace(drive, hysteresis=found))
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.control._cable_course import (
    CableCourse,
    CableParameters,
    fit_cable,
    require_cables,
)
from cc_mujoco.control._hysteresis import Array, HysteresisTrial
from cc_mujoco.control._hysteresis_models import MODELS
from cc_mujoco.control._position import BANDWIDTH, PositionController
from cc_mujoco.device._drive import Drive
from cc_mujoco.errors import CableError, look_up

CABLE_INVERSE = "cable_inverse"
"""Name of the controller with the model of the cables."""

FITTED = (*MODELS, CABLE_INVERSE)
"""Controllers with parameters of a trial."""


def fit_hysteresis(
    trial: HysteresisTrial, drive: Drive, names: Iterable[str] = FITTED
) -> dict[str, dict[str, Any]]:
    """Fit the models of position controllers to a trial.

    Args:
        trial: Slow course of motor and joint.
        drive: The device; `cable_inverse` needs its cables.
        names: Of the controllers, see `FITTED`.

    Returns:
        Parameters by the name of the controller, for `Drive.hysteresis`.

    Raises:
        CableError: A name is unknown, or a model cannot be fitted.
    """
    found: dict[str, dict[str, Any]] = {}
    for name in names:
        look_up("fitted controller", name, dict.fromkeys(FITTED))
        if name == CABLE_INVERSE:
            found[name] = dataclasses.asdict(fit_cable(trial, drive))
        else:
            found[name] = MODELS[name].fit(trial).to_dict()
    return found


def known_parameters(drive: Drive, name: str) -> Mapping[str, Any]:
    if name not in drive.hysteresis:
        raise CableError(
            f"controller {name!r} needs parameters of a trial, which this device does "
            "not have: fit them by `cc-mujoco calibrate`, or take `none`."
        )
    return drive.hysteresis[name]


class HysteresisInverse(PositionController):
    """Inverse of a model of hysteresis; subclasses name it."""

    model_name: ClassVar[str]
    """Key of `MODELS`."""

    def __init__(self, drive: Drive, bandwidth: float = BANDWIDTH) -> None:
        """Prepare for the first episode.

        Args:
            drive: The device to be driven; its `hysteresis` has the parameters.
            bandwidth: Of the servo, see `PositionController` [rad/s].

        Raises:
            CableError: The device has no parameters of this model.
        """
        super().__init__(drive, bandwidth)
        name = self.model_name
        given = known_parameters(drive, name)
        self.model = MODELS[name].from_dict(name, given)
        self._state = self.model.rest(0)

    def begin(self, rows: NDArray[np.intp], count: int) -> None:
        if len(self._state) != count:
            self._state = self.model.rest(count)
        self._state[rows] = self.model.rest(rows.size)

    def motor_angle(self, joint: Array, observation: Mapping[str, Any]) -> Array:
        return self.drive.ratio * self.model.invert(self._state, joint)


class LinearFit(HysteresisInverse):
    """A straight line fitted to a trial: mean stretch, no hysteresis."""

    model_name = "linear"


class SmoothBacklashInverse(HysteresisInverse):
    """Inverse of a smooth backlash (Tao and Kokotović 1993), fitted to a trial."""

    model_name = "backlash_inverse"


class PrandtlIshlinskiiInverse(HysteresisInverse):
    """Inverse of the modified Prandtl-Ishlinskii operator (Kuhnen 2003), fitted."""

    model_name = "prandtl_ishlinskii"


class BoucWenFeedForward(HysteresisInverse):
    """Feed-forward of a Bouc-Wen model (Do et al. 2014), fitted to a trial."""

    model_name = "bouc_wen"


class CableInverse(PositionController):
    """Inverse of the model of distributed friction, fitted to a trial."""

    def __init__(self, drive: Drive, bandwidth: float = BANDWIDTH) -> None:
        """Prepare for the first episode.

        Args:
            drive: The device to be driven; its cables must be known, and `hysteresis`
                has the parameters.
            bandwidth: Of the servo, see `PositionController` [rad/s].

        Raises:
            CableError: Cables or parameters are not known.
        """
        super().__init__(drive, bandwidth)
        require_cables(drive)
        given = known_parameters(drive, CABLE_INVERSE)
        kinds = {field.name for field in dataclasses.fields(CableParameters)}
        if set(given) != kinds:
            raise CableError(
                f"{CABLE_INVERSE!r} needs the parameters {', '.join(sorted(kinds))}, "
                f"not {', '.join(sorted(given))}."
            )
        self.parameters = CableParameters(**given)
        self._courses: list[CableCourse] = []

    def begin(self, rows: NDArray[np.intp], count: int) -> None:
        known = self.drive.cables
        if len(self._courses) != count:
            self._courses = [CableCourse(known, self.parameters)] * count
        for row in rows:
            self._courses[row] = CableCourse(known, self.parameters)

    def motor_angle(self, joint: Array, observation: Mapping[str, Any]) -> Array:
        found = [
            course.advance(float(angle))
            for course, angle in zip(self._courses, joint, strict=True)
        ]
        return self.drive.ratio * np.array(found)
