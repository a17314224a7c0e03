"""Cables whose path a joint moves: bends that change, and pieces that lie open.

    drive = CoupledCables((cable,), (course,), motor_radius=0.008)
    drive.replay(dt, motor_angle=motor, joint_angle=joint).joint_torque

A `CoupledPath` tabulates the path over the angle of the joint; the cable is that of the
kernel. The length that a piece gains enters the cable there, and by virtual work each
tension acts on the joint with the gain of its piece per angle. Angles are positive
where the first cable pulls, and positive motor rotation winds that cable. If other
joints move the path, too, the table is over the samples of a recording, with slopes.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as layout
from cc_mujoco.cable import _moving_path as moving_path
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._cable import Cable
from cc_mujoco.cable._conduit import packed_parameters
from cc_mujoco.cable._nodes import recall_springs
from cc_mujoco.cable._pack import set_path
from cc_mujoco.cable._pulleys import Driven
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal, interrupted


@dataclass(frozen=True, eq=False)
class CoupledPath:
    """The path of one cable at every angle of the joint that moves it."""

    joint: FloatArray  # (angles,) angle of the joint, increasing by equal steps [rad]
    wrap: FloatArray  # (angles, n) wrap angle of the segments [rad]
    contact: FloatArray  # (angles, n) length over which the segments rub [m]
    gained: FloatArray  # (angles, n + 1) growth of the path at nodes since angle 0 [m]
    distal: FloatArray  # (angles,) distal displacement since angle 0 [m]; 0 if tied
    # (angles, n + 1) length of path at every node [m]; empty if all is in a conduit
    length: FloatArray
    guided: int  # number of segments inside a conduit
    # (angles, n + 1), (angles,) slopes of `gained` and `distal` by the joint's angle
    # [m/rad]; None: found from the table
    gain: FloatArray | None = None
    arm: FloatArray | None = None

    @property
    def open(self) -> bool:
        """True if pieces of the cable lie outside a conduit."""
        return self.length.size > 0

    @property
    def reach(self) -> FloatArray:
        """Growth of the path plus displacement of the distal end (angles,) [m]."""
        found: FloatArray = self.gained.sum(axis=1) + self.distal
        return found

    @property
    def slope(self) -> FloatArray:
        """Change of `reach` per angle of the joint (angles,) [m/rad]."""
        assert self.gain is not None and self.arm is not None
        found: FloatArray = self.gain.sum(axis=1) + self.arm
        return found


@dataclass(frozen=True)
class CoupledCables:
    """Cables on a motor's pulley, whose paths one joint moves."""

    cables: tuple[Cable, ...]  # agonist first
    courses: tuple[CoupledPath, ...]  # path of each cable, with its segments
    motor_radius: float  # radius of the motor's pulley [m]
    # factor on `distal` of the courses, for a pulley or lever of another radius
    distal_share: float = 1.0

    def replay(
        self, dt: float, *, motor_angle: ArrayLike, joint_angle: ArrayLike
    ) -> Driven:
        """Replay both angles (samples,) [rad], every `dt` [s], from rest in pretension.

        Beyond the tabulated angles the path stays as it is at the last one.
        """
        motor, joint = (
            np.ascontiguousarray(angle, dtype=np.float64)
            for angle in (motor_angle, joint_angle)
        )
        if motor.ndim != 1 or motor.shape != joint.shape or motor.size == 0:
            raise CableError(
                f"the angles have shapes {motor.shape} and {joint.shape}; both must be "
                "(samples,)"
            )
        if not (np.isfinite(motor).all() and np.isfinite(joint).all()):
            raise CableError("the angles of a motion must be finite")
        if not (math.isfinite(dt) and dt > 0.0):
            raise CableError(f"time step is {dt!r} s; it must be positive and finite")
        each = zip(self.cables, self.courses, (-1.0, 1.0), strict=False)
        played = np.array([self._played(*own, dt, motor, joint) for own in each])
        proximal, distal, torque, pull, lost = np.moveaxis(played, 0, 1)
        torques = pull.sum(axis=0), torque.sum(axis=0)
        return Driven(motor, torques[0], joint, torques[1], proximal, distal, lost)

    def _played(
        self, cable: Cable, course: CoupledPath, sign: float, dt: float,
        motor: FloatArray, joint: FloatArray,
    ) -> FloatArray:  # fmt: skip
        arm = np.array([sign * self.motor_radius])
        prm = _pack_on_path(cable, course)
        cables = stepper.Cables(
            prm[None], np.array([cable.segments]), arm, arm, np.zeros(1)
        )
        step, gain = course.joint[1] - course.joint[0], course.gain
        if gain is None:
            gain = np.gradient(course.gained, step, axis=0)
        reached = self.distal_share * course.distal
        if course.arm is None:
            slope = np.gradient(reached, step)
        else:
            slope = self.distal_share * course.arm
        tables = _Tables(
            float(course.joint[0]), float(step), course.wrap, course.contact,
            course.length, course.gained, gain, reached, slope,
        )  # fmt: skip
        n, out = cable.segments, np.empty((5, motor.size))
        _play(
            cables, tables, motor, joint, dt, np.zeros((2, kernel.state_size(n))),
            np.empty(kernel.work_size(n)), np.zeros((9, n + 1)), out,
        )  # fmt: skip
        return out


def _pack_on_path(cable: Cable, course: CoupledPath) -> FloatArray:
    n = cable.segments
    if course.wrap.shape[1] != n:
        raise CableError(
            f"the course has {course.wrap.shape[1]} segments and the cable {n}"
        )
    prm = packed_parameters(cable)
    if course.open:
        layout.segment_angles(prm, n)[:] = course.wrap[0]
        layout.contact_length(prm, n)[:] = course.contact[0]
        layout.node_length(prm, n)[:] = course.length[0]
        prm[layout.LENGTH] = course.length[0].sum()
        prm[layout.GUIDED] = course.guided
        play, seating = layout.clearance_factors(prm, n), layout.seating_factors(prm, n)
        play[:], seating[:] = 0.0, 1.0
        if (k := course.guided) > 0:
            inside = packed_parameters(cable.replace(segments=k))
            play[:k] = layout.clearance_factors(inside, k)
            seating[:k] = layout.seating_factors(inside, k)
        kernel.pack_mesh(np.array(cable.scalars), n, prm)
    kernel.expect_change(prm)
    if course.open:
        kernel.expect_lengthening(prm)
    return prm


class _Tables(NamedTuple):
    """`CoupledPath` with all slopes, over angles from `first` in steps `step` [rad]."""

    first: float
    step: float
    wrap: FloatMatrix
    contact: FloatMatrix
    length: FloatMatrix
    gained: FloatMatrix
    gain: FloatMatrix
    distal: FloatArray
    arm: FloatArray


@internal
def _interpolate_row(
    table: FloatMatrix, row: int, share: float, out: FloatArray
) -> None:
    for i in range(out.size):
        out[i] = table[row, i] + share * (table[row + 1, i] - table[row, i])


@internal
def _between_rows(table: FloatArray, row: int, share: float) -> float:
    return float(table[row] + share * (table[row + 1] - table[row]))


@internal
def _table_position(tables: _Tables, joint: float) -> tuple[int, float]:
    """Return the row at or before an angle, and the fraction to the next, or NaN."""
    at = (joint - tables.first) / tables.step
    if math.isnan(at):
        return 0, at
    at = min(max(at, 0.0), tables.distal.size - 1.0)
    row = min(int(at), tables.distal.size - 2)
    return row, at - row


@compiled
def _play(
    cables: stepper.Cables, tables: _Tables, motor: FloatArray, joint: FloatArray,
    dt: float, states: FloatMatrix, work: FloatArray, nodes: FloatMatrix,
    out: FloatMatrix,
) -> None:  # fmt: skip
    """Replay angles of `motor` and `joint` (samples,) [rad] through one cable.

    Rows of `out` (5, samples): proximal and distal tension [N], torque on joint and on
    motor [N m], heat of friction so far [J]. `states` (2, size) and `nodes` (9, n + 1)
    are scratch of zeros.
    """
    n, prm = cables.n[0], cables.prm[0]
    state, new = states[0], states[1]
    wrap, contact, bent = nodes[0, :n], nodes[1, :n], nodes[8, :n]
    before, gained, gain = nodes[2], nodes[3], nodes[4]
    longer, length, was = nodes[5], nodes[6], nodes[7]
    lengthens = prm[layout.PATH_LENGTHENS] != 0.0
    row, share = _table_position(tables, joint[0])
    _interpolate_row(tables.gained, row, share, before)
    if lengthens:
        _interpolate_row(tables.length, row, share, length)
    _interpolate_row(tables.wrap, row, share, wrap)
    _interpolate_row(tables.contact, row, share, contact)
    set_path(prm, n, wrap, contact)
    u_distal = _between_rows(tables.distal, row, share)
    u_proximal, _ = stepper.proximal_displacement(cables, 0, motor[0])
    kernel.initialize(prm, n, u_proximal, u_distal, state)
    for k in range(motor.size):
        if interrupted(k):
            return
        u_proximal, lever = stepper.proximal_displacement(cables, 0, motor[k])
        bent[:] = wrap
        if k == 0 or joint[k] != joint[k - 1]:
            row, share = _table_position(tables, joint[k])
            _interpolate_row(tables.wrap, row, share, wrap)
            _interpolate_row(tables.contact, row, share, contact)
            _interpolate_row(tables.gained, row, share, gained)
            _interpolate_row(tables.gain, row, share, gain)
            u_distal = _between_rows(tables.distal, row, share)
            set_path(prm, n, wrap, contact)
        if lengthens:
            was, length = length, was
            _interpolate_row(tables.length, row, share, length)
            for i in range(n + 1):
                longer[i] = gained[i] - before[i]
                before[i] = gained[i]
            recall_springs(prm, state)
            moving_path.carry(
                prm, n, layout.tensions(state, n), was, length, longer, bent, wrap
            )
        kernel.advance(prm, n, state, u_proximal, u_distal, dt, new, work)
        state, new = new, state
        tension = layout.tensions(state, n)
        torque = -_between_rows(tables.arm, row, share) * max(tension[n], 0.0)
        for i in range(n + 1):
            torque -= gain[i] * max(tension[i], 0.0)
        out[0, k], out[1, k] = max(tension[0], 0.0), max(tension[n], 0.0)
        out[2, k] = torque
        out[3, k] = -cables.proximal[0] * lever * max(tension[0], 0.0)
        out[4, k] = state[2]
