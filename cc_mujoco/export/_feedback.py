"""The compiled step of a policy for C, and the numbers it rests on.

They are those of `control.Policy` but for the order of the sums of a layer and the
hyperbolic tangent of the C library: shares of the torque agree to 1e-6.
"""

from __future__ import annotations

import math

import numpy as np

from cc_mujoco.control import Network
from cc_mujoco.control import _law_steps as law_steps
from cc_mujoco.control._policy import ACTIVATIONS
from cc_mujoco.control._stepped_laws import LawTables
from cc_mujoco.device import Observed
from cc_mujoco.device._observation import (
    DESIRED_TORQUE,
    JOINT_ANGLE,
    JOINT_TORQUE,
    MOTOR_ANGLE,
    MOTOR_VELOCITY,
    OBSERVATION_LIMIT,
    PLAY_HALF_WIDTHS,
)
from cc_mujoco.native import FloatArray, IntArray, internal

_LOW, _HIGH, _WHOLE = range(3)
"""Places of the parameters: limits of the motor, its torque at a share of 1 [N m]."""
N_PARAMETERS = 4
"""Those, and the period."""
_PLAYS = 2 * len(PLAY_HALF_WIDTHS)
_TANH, _RELU, _ELU = (list(ACTIVATIONS).index(name) for name in ("tanh", "relu", "elu"))
_COLUMNS, _HOLD, _HISTORY, _MEMORY, _ACTIVATION, _SQUASHED, _LAYERS, _WIDTHS = range(8)
"""Places of `LawTables.shape`."""
_RATIO, _FAR, _REACH = range(3)
_UNITS = _REACH + len(PLAY_HALF_WIDTHS)
"""Places of `LawTables.numbers`; means, deviations and layers follow the units."""
_PARAMETERS = law_steps.OWN_MEMORY
_SAMPLE = _PARAMETERS + N_PARAMETERS
_SHARE, _PLAY = _SAMPLE + 1, _SAMPLE + 2
_PAST = _PLAY + _PLAYS
"""Places in the memory: parameters; samples since the last action, that action; plays;
then the past frames, the present one, and two rows of numbers of a layer."""


def policy_tables(net: Network, own: Observed) -> LawTables:
    """Return network and observation of a policy of one axis, for the compiled step."""
    kind = list(ACTIVATIONS).index(net.activation)
    flags = int(own.memory), kind, int(net.squashed), len(net.weights)
    widths = net.mean.size, *(len(biases) for biases in net.biases)
    reach = np.array(PLAY_HALF_WIDTHS) * own.units[0]
    parts = [np.array([own.ratio, net.far]), reach, np.array(own.units)]
    parts += [net.mean, net.deviation]
    for weights, biases in zip(net.weights, net.biases, strict=True):
        parts += [weights.ravel(), biases]
    past = own.history * (own.frame + 1)
    return LawTables(
        (own.frame, own.hold, own.history, *flags, *widths),
        tuple(map(float, np.concatenate(parts))),
        (_PAST + past + own.frame + 2 * max(widths),),
    )


def wrong_policy(
    shape: IntArray, parameters: FloatArray, least: FloatArray, most: FloatArray
) -> int:
    """Return 1 + the index of an impossible parameter, 0 if there is none."""
    wrong = law_steps.first_out_of_range(0, N_PARAMETERS, parameters, least, most)
    if wrong != 0:
        return wrong
    if not parameters[_LOW] < parameters[_HIGH]:
        return _HIGH + 1
    return 0


def store_policy(memory: FloatArray, shape: IntArray, parameters: FloatArray) -> None:
    for i in range(N_PARAMETERS):
        memory[_PARAMETERS + i] = parameters[i]


@internal
def _play_angle(seen: FloatArray, ratio: float, play: int) -> float:
    """Return the angle that a play follows: the first half are those of the motor."""
    if 2 * play < _PLAYS:
        return float(seen[MOTOR_ANGLE] / ratio)
    return float(seen[JOINT_ANGLE])


@internal
def _look(
    shape: IntArray,
    tables: FloatArray,
    seen: FloatArray,
    begins: bool,
    memory: FloatArray,
) -> None:
    """Follow the plays, compute the frame, and at the beginning the past.

    See `_observation.ObservationHistory`.
    """
    columns, history, ratio = shape[_COLUMNS], shape[_HISTORY], tables[_RATIO]
    for play in range(_PLAYS):
        reach = tables[_REACH + play % (_PLAYS // 2)]
        angle, position = _play_angle(seen, ratio, play), memory[_PLAY + play]
        near = min(max(position, angle - reach), angle + reach)
        memory[_PLAY + play] = angle if begins else near
    frame = _PAST + history * (columns + 1)
    for i in range(columns):
        value = seen[i]
        if i == MOTOR_ANGLE:
            value = value / ratio - seen[JOINT_ANGLE]
        elif i == MOTOR_VELOCITY:
            value = value / ratio
        elif i == JOINT_TORQUE:
            value = seen[DESIRED_TORQUE] - value
        value = value / tables[_UNITS + i]
        memory[frame + i] = min(max(value, -OBSERVATION_LIMIT), OBSERVATION_LIMIT)
    if not begins:
        return
    memory[_SAMPLE] = 0.0
    for k in range(history):
        place = _PAST + k * (columns + 1)
        for i in range(columns):
            memory[place + i] = memory[frame + i]
        memory[place + columns] = 0.0


@internal
def _observe(
    shape: IntArray, tables: FloatArray, seen: FloatArray, memory: FloatArray, into: int
) -> None:
    """Write the observation, rounded to single precision, into the memory."""
    columns, history, ratio = shape[_COLUMNS], shape[_HISTORY], tables[_RATIO]
    frame = _PAST + history * (columns + 1)
    for i in range(columns):
        memory[into + i] = np.float32(memory[frame + i])
    place = into + columns
    if shape[_MEMORY]:
        for play in range(_PLAYS):
            reach = tables[_REACH + play % (_PLAYS // 2)]
            moved = _play_angle(seen, ratio, play) - memory[_PLAY + play]
            memory[place + play] = np.float32(moved / reach)
        place += _PLAYS
    for k in range(history * (columns + 1)):
        memory[place + k] = np.float32(memory[_PAST + k])


@internal
def _share(
    shape: IntArray, tables: FloatArray, memory: FloatArray, first: int, other: int
) -> float:
    """Return the network's output; see `control.Network`.

    The observation begins at `first` in the memory and is overwritten; at `other` as
    many numbers are free.
    """
    size, far = shape[_WIDTHS], tables[_FAR]
    mean = _UNITS + shape[_COLUMNS]
    for i in range(size):
        value = (memory[first + i] - tables[mean + i]) / tables[mean + size + i]
        memory[first + i] = min(max(value, -far), far)
    place, x, y = mean + 2 * size, first, other
    for layer in range(shape[_LAYERS]):
        width, out = shape[_WIDTHS + layer], shape[_WIDTHS + layer + 1]
        for row in range(out):
            total = 0.0
            for i in range(width):
                total += tables[place + row * width + i] * memory[x + i]
            total += tables[place + out * width + row]
            if layer < shape[_LAYERS] - 1:
                if shape[_ACTIVATION] == _TANH:
                    total = math.tanh(total)
                elif shape[_ACTIVATION] == _RELU:
                    total = max(total, 0.0)
                elif shape[_ACTIVATION] == _ELU and total < 0.0:
                    total = math.expm1(total)
            memory[y + row] = total
        place += out * (width + 1)
        x, y = y, x
    value = float(memory[x])
    if shape[_SQUASHED]:
        value = math.tanh(value)
    return min(max(value, -1.0), 1.0)


def step_policy(
    memory: FloatArray, shape: IntArray, tables: FloatArray, readings: FloatArray
) -> float:
    columns, history = shape[_COLUMNS], shape[_HISTORY]
    begins = memory[law_steps.FIRST_STEP] != 0.0
    _look(shape, tables, readings, begins, memory)
    memory[law_steps.FIRST_STEP] = 0.0
    if memory[_SAMPLE] == 0.0:
        frame = _PAST + history * (columns + 1)
        widest = 0
        for layer in range(shape[_LAYERS] + 1):
            widest = max(widest, shape[_WIDTHS + layer])
        first = frame + columns
        _observe(shape, tables, readings, memory, first)
        share = np.float32(_share(shape, tables, memory, first, first + widest))
        memory[_SHARE] = share
        for k in range(history * (columns + 1) - 1, columns, -1):
            memory[_PAST + k] = memory[_PAST + k - columns - 1]
        if history:
            for i in range(columns):
                memory[_PAST + i] = memory[frame + i]
            memory[_PAST + columns] = share
    memory[_SAMPLE] += 1.0
    if memory[_SAMPLE] >= shape[_HOLD]:
        memory[_SAMPLE] = 0.0
    torque = float(memory[_SHARE] * memory[_PARAMETERS + _WHOLE])
    low, high = memory[_PARAMETERS + _LOW], memory[_PARAMETERS + _HIGH]
    return float(min(max(torque, low), high))
