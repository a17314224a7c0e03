"""Controls and columns of n devices, written and read by compiled code.

    wiring = Wiring(exo, [exo.device], count)
    wiring.seat(row, script)
    control = wiring.controls(share, samples, going)   # (n, physics steps, controls)
    table = wiring.read(physics, samples)
    columns = wiring.columns(table)                    # by name, (n,)

Environments, batches and compiled episodes read an axis by the same function,
`device._axis_record.read_axis`, so that their results are bit-identical.
"""

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.device import _axis_record as axis_record
from cc_mujoco.device._model import DeviceModel
from cc_mujoco.human import Spring, Task, Tunnel
from cc_mujoco.human._tasks import spring_torque, task_torque, tunnel_torque
from cc_mujoco.native import (
    BoolArray,
    FloatArray,
    FloatCube,
    FloatMatrix,
    IntArray,
    IntMatrix,
    compiled,
    internal,
)
from cc_mujoco.plugin._ffi import floats, words
from cc_mujoco.simulation import _reference_motion as reference_motion
from cc_mujoco.simulation._reference_motion import MARKS, Script, ScriptPart

if TYPE_CHECKING:
    from cc_mujoco.simulation._worn_device import WornDevice

OF_PHASE, TUNNEL, SPRING, OTHER = range(4)
"""Codes of tasks: known in advance, `Tunnel`, `Spring`, computed in Python alone."""

TASK_CODES: dict[type[Task], int] = {Tunnel: TUNNEL, Spring: SPRING}

_DESIRED, _WIDTH = axis_record.READINGS, axis_record.READINGS + 4
"""Place of the desired torque among the columns of an axis, before sine and cosine of
the phase and the reference; number of columns of an axis, but for its torque ratios."""

_tunnel, _spring = internal(tunnel_torque), internal(spring_torque)


class Wiring:
    """Addresses of controls, readings and scripts of n devices of equal layout."""

    def __init__(
        self, exo: "WornDevice", devices: Sequence[DeviceModel], count: int
    ) -> None:
        """Look up all addresses, of one device for all rows or one for each.

        Call `seat` for every row before it is driven or read.
        """
        self._held: list[NDArray[Any]] = []
        first = devices[0]
        axes = [axis for device in devices for axis in device.axes]
        self._records = np.concatenate([axis.record(self.hold) for axis in axes])
        self._address = int(self._records.ctypes.data)
        self._devices, self._axes = len(devices), len(first.axes)
        codes = [
            TASK_CODES.get(type(task), OF_PHASE if is_scripted else OTHER)
            for task, is_scripted in exo.author.tasks
        ]
        self._codes = np.array(codes, np.int64)
        self._parameters = np.array([parameters_of(task) for task in exo.tasks])
        self._script_controls = np.array(first.script_controls, np.int64)
        self.scripts: list[Script | None] = [None] * count
        """Script that each row follows."""
        self._parts: list[ScriptPart | None] = [None] * count
        self._rows = np.zeros((count, 4), np.int64)
        """Addresses of commands and marks of the part of each row's script, its first
        sample, and that of the next part."""
        self._physics: axis_record.Physics | None = None
        self._sampling = exo.sampling
        self._control = np.zeros((count, exo.frame_skip, first.model.nu))
        self.names: list[str] = []
        """Columns in the order of the table; the clock of each axis follows them, and
        the time."""
        starts = []
        for axis, prefix in zip(first.axes, first.prefixes, strict=True):
            starts.append(len(self.names))
            own = [*axis_record.READING_COLUMNS, "desired_torque_nm", "phase_sine"]
            own += ["phase_cosine", "reference_angle_rad", *axis.ratio_columns]
            self.names += [prefix + name for name in own]
        others = [n for n, code in enumerate(codes) if code == OTHER]
        after = len(self.names)
        self._python_tasks = [(exo.tasks[n], starts[n], after + n) for n in others]

    def hold(self, array: NDArray[Any]) -> int:
        """Return the address of an array that stays alive as long as this object."""
        self._held.append(array)
        return int(array.ctypes.data)

    def axis_address(self, row: int) -> int:
        """Return the address of the record of the first axis of device `row`."""
        first = row % self._devices * self._axes
        return self._address + axis_record.AXIS_SIZE * first

    def seat(self, row: int, script: Script) -> None:
        self.scripts[row] = script
        self._take_part(row, 0)

    def take(self, other: "Wiring") -> None:
        """Copy scripts, and the position in them, from another object."""
        self.scripts, self._parts = list(other.scripts), list(other._parts)
        self._rows[:] = other._rows

    def _take_part(self, row: int, number: int) -> None:
        script, length = self.scripts[row], reference_motion.PART_STEPS
        assert script is not None
        part = self._parts[row] = script.part(number)
        addresses = (array.ctypes.data for array in part)
        self._rows[row] = *addresses, number * length, (number + 1) * length

    def _turn(self, samples: NDArray[np.int64]) -> None:
        for row in np.flatnonzero(samples >= self._rows[:, 3]).tolist():
            self._take_part(row, int(samples[row]) // reference_motion.PART_STEPS)

    def controls(
        self,
        share: NDArray[np.float64],
        samples: NDArray[np.int64],
        going: NDArray[np.bool_],
    ) -> NDArray[np.float64]:
        """Return the controls up to the next sample, (n, physics steps, controls).

        `share` (n, axes) is the torque of each motor over its largest. Rows `going`
        (n,) increase their entry of `samples`; controls of the others stay as they
        were.
        """
        given = (
            self._address, self._devices, self._rows, samples, going, share,
            self._script_controls, self._control,
        )  # fmt: skip
        if not _drive(*given):
            self._turn(samples)
            _drive(*given)
        return self._control

    def read(
        self, physics: axis_record.Physics, samples: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Return a new table of the present columns of all rows, (columns, n)."""
        if physics is not self._physics:
            self._physics = physics
            rows = np.arange(len(samples))
            places = [field.ctypes.data + field.strides[0] * rows for field in physics]
            self._places = np.stack(places, axis=1)
        table = np.empty((len(self.names) + self._axes + 1, len(samples)))
        given = (
            self._address, self._devices, self._codes, self._parameters, self._rows,
            samples, self._places, self._sampling, table,
        )  # fmt: skip
        if not _read(*given):
            self._turn(samples)
            _read(*given)
        for task, start, clock in self._python_tasks:
            angle = table[start + axis_record.JOINT_ANGLE]
            velocity = table[start + axis_record.JOINT_VELOCITY]
            if task.about_reference:
                angle = angle - table[start + _WIDTH - 1]
            table[start + _DESIRED] = task_torque(task, angle, velocity, table[clock])
        return table

    def columns(self, table: NDArray[np.float64]) -> dict[str, Any]:
        """Return the columns of a table by name, each (n,), as views."""
        return dict(zip(self.names, table, strict=False), time_s=table[-1])


def parameters_of(task: Task) -> NDArray[np.float64]:
    """Return the parameters (3,) of a task that compiled code knows, else zeros."""
    given = np.zeros(3)
    if type(task) in TASK_CODES:
        own = dataclasses.astuple(task)  # type: ignore[call-overload]
        given[: len(own)] = own
    return given


@internal
def desired_torque(
    code: int, parameters: FloatArray, angle: float, in_script: float
) -> float:
    """Return a task's torque [N m] at an angle [rad]; one of phase is `in_script`."""
    if code == TUNNEL:
        return float(_tunnel(angle, parameters[0], parameters[1], parameters[2]))
    if code == SPRING:
        return float(_spring(angle, parameters[0]))
    return in_script


@internal
def _in_parts(scripts: IntMatrix, samples: IntArray) -> bool:
    for row in range(samples.size):
        if samples[row] >= scripts[row, 3]:
            return False
    return True


@compiled
def _drive(
    axes: int,
    devices: int,
    scripts: IntMatrix,
    samples: IntArray,
    going: BoolArray,
    share: FloatMatrix,
    script_controls: IntArray,
    control: FloatCube,
) -> bool:
    """Write the controls up to the next sample, and increase `samples`.

    If a row is beyond the loaded part of its script, do nothing and return False.
    """
    if not _in_parts(scripts, samples):
        return False
    count, skip, scripted_count = share.shape[1], control.shape[1], script_controls.size
    for row in range(samples.size):
        if not going[row]:
            continue
        first = skip * (samples[row] - scripts[row, 2])
        commands = scripts[row, 0] + 8 * scripted_count * first
        for n in range(count):
            axis = axis_record.axis_at(
                axes + axis_record.AXIS_SIZE * (row % devices * count + n)
            )
            value = share[row, n] * axis.motor_scale
            for step in range(skip):
                control[row, step, axis.motor_control] = value
        for step in range(skip):
            for i in range(scripted_count):
                value = axis_record.real(commands, step * scripted_count + i)
                control[row, step, script_controls[i]] = value
        samples[row] = samples[row] + 1
    return True


@compiled
def _read(
    axes: int,
    devices: int,
    codes: IntArray,
    parameters: FloatMatrix,
    scripts: IntMatrix,
    samples: IntArray,
    physics: IntMatrix,
    sampling: float,
    table: FloatMatrix,
) -> bool:
    """Write the columns of all rows into `table`; return False as `_drive` does."""
    if not _in_parts(scripts, samples):
        return False
    count = codes.size
    clocks = table.shape[0] - count - 1
    found = np.empty(axis_record.READINGS)
    for row in range(samples.size):
        at = physics[row]
        table[clocks + count, row] = samples[row] * sampling
        marks = scripts[row, 1] + 8 * MARKS * count * (samples[row] - scripts[row, 2])
        first = 0
        for n in range(count):
            axis = axis_record.axis_at(
                axes + axis_record.AXIS_SIZE * (row % devices * count + n)
            )
            mark = floats(marks + 8 * MARKS * n, MARKS)  # in the order of `MARKS`
            axis_record.read_axis(axis, at, found)
            for i in range(axis_record.READINGS):
                table[first + i, row] = found[i]
            table[first + _DESIRED, row] = desired_torque(
                codes[n], parameters[n], found[axis_record.JOINT_ANGLE], mark[4]
            )
            table[first + _DESIRED + 1, row] = mark[2]
            table[first + _DESIRED + 2, row] = mark[3]
            table[first + _DESIRED + 3, row] = mark[0]
            shared = axis.shared
            arms = words(axis.shared_arms, shared)
            scales = floats(axis.shared_scales, shared)
            for i in range(shared):
                arm = axis_record.real(at[axis_record.MOMENT], arms[i])
                table[first + _WIDTH + i, row] = scales[i] * arm
            table[clocks + n, row] = mark[1]
            first = first + _WIDTH + shared
    return True
