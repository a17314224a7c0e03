r"""Linear quadratic Gaussian control of the joint torque with disturbance observers.

law = LinearQuadraticGaussian(env.unwrapped.drive)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.control import _guard as guard
from cc_mujoco.control._cable_model import joint_spring, joint_stiffness
from cc_mujoco.control._compiled_laws import LAW_INPUTS
from cc_mujoco.control._controller import Controller, as_round_pulley, readings
from cc_mujoco.control._tuned_feedback import (
    loop_gains,
    require_known_motor,
    total_delay,
)
from cc_mujoco.device._drive import Drive
from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal

_MOTOR, _MOTOR_SPEED, _JOINT, _JOINT_SPEED, _TORQUE, _DESIRED = range(len(LAW_INPUTS))
STATES = 4
_STRETCH, _SPEED, _LOAD, _LACK = range(STATES)
"""Motor angle less ratio times joint angle; its rate; torque on the motor and torque at
the joint that the linear model lacks."""
_ENCODER_NOISE = 3e-4
"""Standard deviation of an angle [rad]."""
_LOAD_WALK, _LACK_WALK = 0.2, 0.5
"""Random walks of both, in a second, over the greatest torque."""
_SLIP_SIGMAS = 8.0
"""Change of the innovation of the stretch in a step, in its standard deviations, beyond
what the motor can do, from which an encoder has slipped."""
_EFFORT, _SINGLE_EFFORT = 1.0, 0.4
"""Weights of motor torque to torque error at the joint, both over the greatest: of a
pair of cables, and of a single one, with which the ankle is passive."""
_RIGIDITY, _RELEASE, _SLIP, GAINS = range(guard.LIMITS, guard.LIMITS + 4)
"""Places of the gains behind `DriveLimits`, and their number."""
_STARTED, _OFFSET, _OFF, GUARD = range(4)
LAST_COMMAND = GUARD + guard.COMMAND
_HEADER = GUARD + guard.MEMORY_SIZE


class Design(NamedTuple):
    """Model and gains of observer and regulator.

    Attributes:
        model: state after a step, from state and torque (4, 5).
        read: stretch and torque of the joint, from the state (2, 4).
        kalman: gains of the observer (4, 2).
        regulator: of stretch and its rate (2,).
    """

    model: FloatMatrix
    read: FloatMatrix
    kalman: FloatMatrix
    regulator: FloatArray


class LinearQuadraticGaussian(Controller):
    r"""LQG of the joint torque with observers of both disturbances; no friction known.

    The model is linear, a rotor on a spring: with the stretch
    \(z = \theta_m - \rho \theta_j\) and the stiffness k of the cables at the motor,

    \[ J \ddot z = \tau_m + d_m - k z, \qquad \tau_j = \rho k z + d_j \]

    A Kalman filter finds z, its rate and the two disturbances, random walks, from
    angles and torque, as late as they are; a prediction over the delay and a linear
    quadratic regulator bring z to where the model makes the desired torque less
    \(d_j\). Where an encoder slips, as an innovation shows that changes in one step by
    more than any motion makes it, its zero is moved. Disturbance observers after K.
    Ohnishi, M. Shibata, T. Murakami, "Motion control for advanced mechatronics",
    IEEE/ASME Trans. Mechatronics 1, 1996.
    """

    def __init__(self, drive: Drive) -> None:
        """Prepare for the first episode.

        Args:
            drive: The device; its `cables` and the motor's inertia must be known.

        Raises:
            CableError: They are not known.
        """
        from scipy.linalg import expm, solve_discrete_are

        super().__init__(drive)
        require_known_motor(drive)
        ratio, period, inertia = drive.ratio, drive.period, drive.inertia
        rigidity = joint_stiffness(drive.cables)
        most = max(map(abs, drive.reach))
        self.limits = guard.motor_limits(drive)
        self.gains = np.zeros(GAINS)
        """Numbers of the law, `DriveLimits` first."""
        self.gains[: guard.LIMITS] = self.limits
        drift = np.zeros((STATES + 1, STATES + 1))
        drift[_STRETCH, _SPEED] = 1.0
        drift[_SPEED, _STRETCH] = -rigidity / ratio**2 / inertia
        drift[_SPEED, _SPEED] = -drive.damping / inertia
        drift[_SPEED, _LOAD] = drift[_SPEED, STATES] = 1.0 / inertia
        step = expm(period * drift)
        a, b = step[:STATES, :STATES], step[:STATES, STATES:]
        seen = np.zeros((2, STATES))
        seen[0, _STRETCH] = 1.0
        seen[1, _STRETCH], seen[1, _LACK] = rigidity / ratio, 1.0
        noise = np.diag(
            [
                (_ENCODER_NOISE * (1.0 + abs(ratio))) ** 2,
                max(drive.torque_noise, 1e-4 * most) ** 2,
            ]
        )
        walk = np.zeros(STATES)
        walk[_LOAD] = (_LOAD_WALK * most / ratio) ** 2 * period
        walk[_LACK] = (_LACK_WALK * most) ** 2 * period
        walk[_SPEED] = 1e-9 * (most / ratio / inertia) ** 2 * period
        spread = solve_discrete_are(a.T, seen.T, np.diag(walk), noise)
        gain = spread @ seen.T @ np.linalg.inv(seen @ spread @ seen.T + noise)
        deviation = math.sqrt((seen @ spread @ seen.T + noise)[0, 0])
        push = max(map(abs, (drive.low, drive.high))) / inertia * period**2
        self.gains[_SLIP] = _SLIP_SIGMAS * deviation + push
        cost = np.diag([(rigidity / ratio / most) ** 2, 0.0])
        weight = _SINGLE_EFFORT if drive.one_way else _EFFORT
        effort = np.array([[(weight * ratio / most) ** 2]])
        value = solve_discrete_are(a[:2, :2], b[:2], cost, effort)
        own = b[:2].T @ value
        regulator = np.linalg.solve(effort + own @ b[:2], own @ a[:2, :2])
        self.design = Design(
            np.ascontiguousarray(step[:STATES]),
            seen,
            np.ascontiguousarray(gain),
            np.ascontiguousarray(regulator[0]),
        )
        self.gains[_RIGIDITY] = rigidity
        self.spring = joint_spring(drive.cables)
        """See `guard.STIFFNESS`."""
        self.gains[_RELEASE] = loop_gains(drive).settling * rigidity / ratio**2
        late = round(total_delay(drive) / period - 0.5)
        self.memory_size = _HEADER + STATES + late
        """Numbers that the law keeps; the last is the last torque."""
        self._memory: FloatArray = np.zeros((0, self.memory_size))

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Start at rest in the pretension; see `Controller.reset`."""
        if where is None:
            self._memory = np.zeros((0, self.memory_size))
        elif len(self._memory):
            self._memory[where] = 0.0

    def given(self, torque: Any) -> None:
        """Accept the torque that the motor got; see `Controller.given`."""
        for place in (-1, LAST_COMMAND):
            np.copyto(self._memory[:, place], torque, where=guard.is_heard(torque))

    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Return the torque of the motor [N m]; see `Controller.torque`."""
        seen = readings(as_round_pulley(observation, self.drive), LAW_INPUTS)
        if len(self._memory) != len(seen):
            self._memory = np.zeros((len(seen), self.memory_size))
        found = np.empty(len(seen))
        _torques(
            self.gains,
            self.spring,
            self.design,
            self._memory,
            seen,
            np.empty((2, STATES)),
            found,
        )
        numbers = np.ndim(observation[LAW_INPUTS[0]]) == 0
        return float(found[0]) if numbers else found


@compiled
def _advance(
    model: FloatMatrix, state: FloatArray, torque: float, new: FloatArray
) -> None:
    """Advance the state by a step with a torque of the motor."""
    for i in range(STATES):
        new[i] = model[i, STATES] * torque
        for j in range(STATES):
            new[i] += model[i, j] * state[j]
    for i in range(STATES):
        state[i] = new[i]


@internal
def motor_torque(
    gains: FloatArray,
    spring: FloatArray,
    design: Design,
    memory: FloatArray,
    seen: FloatArray,
    scratch: FloatMatrix,
) -> float:
    """Return the torque of the motor of one device [N m].

    Args:
        gains: see `LinearQuadraticGaussian.gains`.
        spring: see `guard.STIFFNESS`.
        design: of the law.
        memory: (`LinearQuadraticGaussian.memory_size`,), 0 at the start.
        seen: in the order of `LAW_INPUTS`; changed.
        scratch: (2, `STATES`).
    """
    limits, own = guard.limits_of(gains), memory[GUARD:_HEADER]
    model, read, kalman = design.model, design.read, design.kalman
    ratio, ahead, new = limits.ratio, scratch[0], scratch[1]
    guard.admit(limits, spring, own, seen)
    state = memory[_HEADER : _HEADER + STATES]
    applied = memory[_HEADER + STATES :]
    stretch = seen[_MOTOR] - ratio * seen[_JOINT]
    if memory[_STARTED] == 0.0:
        memory[_STARTED], memory[_OFFSET] = 1.0, stretch
    _advance(model, state, applied[0], new)
    off_0 = stretch - memory[_OFFSET] - state[_STRETCH]
    if abs(off_0 - memory[_OFF]) > gains[_SLIP]:
        # No motion does that in a step: the encoder has slipped, the cable has not.
        memory[_OFFSET] += off_0 - memory[_OFF]
        off_0 = memory[_OFF]
    memory[_OFF] = off_0
    off_1 = seen[_TORQUE]
    for j in range(STATES):
        off_1 -= read[1, j] * state[j]
    for i in range(STATES):
        state[i] += kalman[i, 0] * off_0 + kalman[i, 1] * off_1
        ahead[i] = state[i]
    for i in range(1, applied.size):
        _advance(model, ahead, applied[i], new)
    torque = _regulated(gains, design.regulator, ahead, seen[_DESIRED])
    torque = guard.passed(gains, spring, own, gains[_RELEASE], torque)
    for i in range(applied.size - 1):
        applied[i] = applied[i + 1]
    applied[applied.size - 1] = torque
    return float(torque)


@compiled
def _regulated(
    gains: FloatArray, regulator: FloatArray, state: FloatArray, desired: float
) -> float:
    """Return the torque of the regulator [N m]."""
    ratio = gains[guard.RATIO]
    wanted = (desired - state[_LACK]) * ratio / gains[_RIGIDITY]
    if guard.limits_of(gains).one_way != 0.0:
        # A single cable cannot push, and what hangs need not hang further.
        least = -abs(desired) * abs(ratio) / gains[_RIGIDITY]
        wanted = max(wanted, least)
    hold = gains[_RIGIDITY] / ratio**2 * wanted - state[_LOAD]
    off = regulator[0] * (state[_STRETCH] - wanted) + regulator[1] * state[_SPEED]
    return float(hold - off)


@compiled
def _torques(
    gains: FloatArray,
    spring: FloatArray,
    design: Design,
    memory: FloatMatrix,
    seen: FloatMatrix,
    scratch: FloatMatrix,
    found: FloatArray,
) -> None:
    for row in range(found.size):
        found[row] = motor_torque(
            gains, spring, design, memory[row], seen[row], scratch
        )
