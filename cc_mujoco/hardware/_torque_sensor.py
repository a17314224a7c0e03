"""Detection of a joint torque sensor that is dead or reversed.

The cables are elastic, so the angles of motor and joint alone predict how their torque
at the joint changes. Friction and stiffness of the scene may be wrong: they change the
size of the prediction, and no sign.

    sensor = TorqueSensor(drive, Watchdog(), most=2.0)
    sensor.reading(motor_angle, joint_angle, joint_torque)   # None, or one sentence
"""

from __future__ import annotations

import math

import numpy as np

from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.control._cable_model import CableModel
from cc_mujoco.device._drive import Drive
from cc_mujoco.native import FloatArray, FloatMatrix, compiled

STATISTICS_TIME = 1.0
"""Time constant of the statistics of measured and predicted torque [s]."""
REVERSED_CORRELATION = -0.8
"""Correlation below which the sensor is reversed."""


class TorqueSensor:
    """Comparison of measured torques with the cable model's."""

    def __init__(self, drive: Drive, readings: int, swing: float) -> None:
        """Prepare, with everything compiled, so that no cycle waits for that.

        A sensor may be dead after so many equal `readings`, and must show a `swing` of
        the predicted torque [N m].
        """
        self._model = CableModel(drive)
        self._share = -math.expm1(-drive.period / STATISTICS_TIME)
        self._settled = max(readings, round(STATISTICS_TIME / drive.period))
        self._readings, self._swing = readings, swing
        self._joint = 0.0
        self._count = 0
        self._moments = np.zeros(5)
        self._last = math.nan
        self._equal = 0
        self._range = (0.0, 0.0)
        self._predicted(0.0, 0.0)
        self._model.reset()

    def reading(self, motor: float, joint: float, torque: float) -> str | None:
        """Return the fault of the sensor in one sentence, or None."""
        if self._count == 0:
            self._joint = joint
        predicted = self._predicted(motor, joint - self._joint)
        self._count += 1
        return self._is_dead(torque, predicted) or self._is_reversed(torque, predicted)

    def _predicted(self, motor: float, joint: float) -> float:
        """Return the torque of the cables at the joint after a step [N m]."""
        model = self._model
        model.ready(np.array([motor]))
        return _predict_torque(
            model.packed[0], model.segments, model.proximal, model.distal,
            model.state[0], motor, joint, model.drive.period, model.new, model.work,
        )  # fmt: skip

    def _is_dead(self, torque: float, predicted: float) -> str | None:
        if torque != self._last:
            self._last, self._equal = torque, 0
            self._range = predicted, predicted
            return None
        self._equal += 1
        self._range = min(self._range[0], predicted), max(self._range[1], predicted)
        swing = self._range[1] - self._range[0]
        if self._equal < self._readings or swing < self._swing:
            return None
        return (
            f"the torque sensor is dead: {self._equal + 1} readings of {torque:.4g} "
            "N m while the angles of motor and joint changed the torque by "
            f"{swing:.3g} N m."
        )

    def _is_reversed(self, torque: float, predicted: float) -> str | None:
        """Return that the measured torque falls where the predicted one rises.

        Means and moments are exponential averages of `STATISTICS_TIME`.
        """
        moments = self._moments
        if self._count == 1:
            moments[:2] = torque, predicted
        off = torque - moments[0], predicted - moments[1]
        share, kept = self._share, 1.0 - self._share
        moments[0] += share * off[0]
        moments[1] += share * off[1]
        for place, product in enumerate(
            (off[0] * off[0], off[1] * off[1], off[0] * off[1]), 2
        ):
            moments[place] = kept * (moments[place] + share * product)
        measured, expected = math.sqrt(moments[2]), math.sqrt(moments[3])
        least = 0.5 * self._swing
        if self._count < self._settled or min(measured, expected) < least:
            return None
        correlation = moments[4] / (measured * expected)
        if correlation > REVERSED_CORRELATION:
            return None
        return (
            "the torque sensor is reversed: it falls where the angles of motor and "
            f"joint make the torque rise (correlation {correlation:.2f}); mend its "
            "sign."
        )


@compiled
def _predict_torque(
    prm: FloatMatrix,
    n: stepper.Counts,
    proximal: FloatArray,
    distal: FloatArray,
    state: FloatMatrix,
    motor: float,
    joint: float,
    dt: float,
    new: FloatMatrix,
    work: FloatArray,
) -> float:
    """Move cables by both ends; return their torque at the joint [N m]."""
    cables = stepper.Cables(prm, n, proximal, proximal, distal)
    stepper.move(cables, state, motor, joint, dt, new, work)
    for k in range(state.shape[0]):
        for i in range(state.shape[1]):
            state[k, i] = new[k, i]
    return float(stepper.torque(cables, state, True, motor)[0])
