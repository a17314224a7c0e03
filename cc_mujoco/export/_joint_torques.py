"""Readings for the law of each axis, from those of all axes, for C.

A law with a model reads the torques of its joint divided by the leverage ratio, as if
the joint had a round pulley. If axes are decoupled, they are the torques of its own
cable. Other readings are copied.

`shape` has the numbers of readings, axes and joints, the latter 0 without decoupling;
then rows (`_ROWS`) with a number for each axis; then the number of shared ratios, and
for each its joint, its axis and its index among the readings. `tables` are ratio, least
and greatest torque of every motor, then safe torque and scale of every joint.
"""

from dataclasses import dataclass

import numpy as np

from cc_mujoco.control import _decoupling as decoupling
from cc_mujoco.control._law_steps import part, rows_of, whole_rows_of
from cc_mujoco.native import FloatArray, IntArray

_OWN, _TORQUE, _DESIRED, _LEVERAGE, _IS_DIVIDED, _ROWS = range(6)
"""Numbers of an axis: its joint; indices among the readings of measured and desired
torque and of the leverage ratio, -1 without one; 1 where torques are divided by that
ratio, else 0. Then their count."""


@dataclass(frozen=True)
class JointTorques:
    """Numbers of a device that `own_readings` needs."""

    readings: int  # number of readings of all axes
    rows: tuple[tuple[int, ...], ...]  # `_OWN` to `_IS_DIVIDED` of every axis
    shared: tuple[tuple[int, int, int], ...] = ()
    """Joint, axis and place among the readings of every shared ratio."""
    ratios: tuple[float, ...] = ()  # joint torque per motor torque of every axis [-]
    coupling: decoupling.CouplingTables | None = None

    @property
    def changes(self) -> bool:
        """True if some law reads numbers other than the measured ones."""
        return self.coupling is not None or any(row[_IS_DIVIDED] for row in self.rows)

    @property
    def shape(self) -> tuple[int, ...]:
        joints = 0 if self.coupling is None else self.coupling.safe.size
        counts = self.readings, len(self.rows), joints
        by_row = np.transpose(self.rows).ravel().tolist()
        triples = [number for one in self.shared for number in one]
        return (*counts, *by_row, len(self.shared), *triples)

    @property
    def tables(self) -> tuple[float, ...]:
        if self.coupling is None:
            return ()
        return tuple(np.concatenate([self.ratios, *self.coupling[1:]]).tolist())

    @property
    def memory_size(self) -> int:
        if not self.changes:
            return 0
        axes, matrices = len(self.rows), decoupling.WORK_MATRICES
        if self.coupling is None:
            return self.readings
        size = axes * (self.coupling.safe.size + 4 + decoupling.WORK_VECTORS)
        return self.readings + size + matrices * axes * axes


def own_readings(
    memory: FloatArray, shape: IntArray, tables: FloatArray, readings: FloatArray
) -> None:
    """Write to `memory` what the law of each axis reads, from all `readings`."""
    count, axes, joints = shape[0], shape[1], shape[2]
    rows = whole_rows_of(shape, 3, _ROWS, axes)  # behind the three numbers
    memory[:count] = readings[:count]
    if joints > 0:
        place = count + joints * axes
        ratios = rows_of(memory, count, joints, axes)
        torques = rows_of(memory, place, 4, axes)
        place += 4 * axes
        scratch = rows_of(memory, place, decoupling.WORK_MATRICES * axes, axes)
        vectors = rows_of(memory, place + scratch.size, decoupling.WORK_VECTORS, axes)
        motors = rows_of(tables, 0, 3, axes)  # ratio, least and greatest torque
        safe = part(tables, 3 * axes, joints)
        scales = part(tables, 3 * axes + joints, joints)
        ratios[:] = 0.0
        for i in range(axes):
            leverage = 1.0
            if rows[_LEVERAGE, i] >= 0:
                leverage = readings[rows[_LEVERAGE, i]]
            ratios[rows[_OWN, i], i] = motors[0, i] * leverage
            torques[0, i] = readings[rows[_TORQUE, i]]
            torques[1, i] = readings[rows[_DESIRED, i]]
        first = 3 + _ROWS * axes
        for k in range(shape[first]):
            one = first + 1 + 3 * k
            ratios[shape[one], shape[one + 1]] = readings[shape[one + 2]]
        coupling = decoupling.CouplingTables(
            rows[_OWN], motors[1], motors[2], safe, scales
        )
        coupled = decoupling.Coupled(
            coupling, ratios, scratch[:axes], scratch[axes : 2 * axes],
            scratch[2 * axes :], vectors[0], vectors[1], vectors[2], vectors[3],
            vectors[4], vectors[5], vectors[6],
        )  # fmt: skip
        decoupling.own_torques(coupled, torques[0], torques[1], torques[2], torques[3])
        for i in range(axes):
            memory[rows[_TORQUE, i]] = torques[2, i]
            memory[rows[_DESIRED, i]] = torques[3, i]
    for i in range(axes):
        if rows[_IS_DIVIDED, i] != 0:
            leverage = readings[rows[_LEVERAGE, i]]
            memory[rows[_TORQUE, i]] /= leverage
            memory[rows[_DESIRED, i]] /= leverage
