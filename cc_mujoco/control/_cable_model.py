r"""Cables as a controller assumes them: the kernel itself, run as an observer.

    model = CableModel(drive)
    model.follow(observation["motor_angle_rad"], observation["joint_torque_nm"])
    model.tension(0), model.slip(0)          # of the first cable, proximal to distal

Motor angle and joint torque are measured; they drive the model completely (position at
one end, tension at the other, thesis Fig. 2.2). The model estimates unmeasured
quantities: the parts of the cables that move, the tensions along them, the required
torque of the motor. It knows parameters, never the true state of the device. Where both
are noisy this pair is the better one: an end of a cable is stiff, so that the last bits
of a joint encoder would be newtons.

One model holds the cables of many environments; each row is computed by itself.

While a cable of wrap \(\phi\) slips as a whole in one direction s (1 where the motor
winds towards a positive torque at the joint), its tensions at motor and joint differ by
the factor \(e^{\mu \phi}\), and its stretch is that of its tension at the joint times a
mean factor: `full_slip_balance`. Between the two directions lies the backlash.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cc_mujoco._utils.exclusive import exclusive
from cc_mujoco.cable import PARAMETERS
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._friction import INDEX
from cc_mujoco.cable._layout import LENGTH, slips, tensions
from cc_mujoco.control import _guard as guard
from cc_mujoco.control._compensation import SCRATCH_ROWS, has_drag
from cc_mujoco.device._drive import CableDrive, Drive
from cc_mujoco.errors import CableError, CableWarning
from cc_mujoco.native import FloatArray, FloatCube, FloatMatrix, compiled, internal

_STATIC, _BRISTLE = INDEX["static_friction"], INDEX["bristle_length"]
_FRICTION_COEFFICIENTS = INDEX["friction"], _STATIC
_CRITICAL_SLIP = INDEX["critical_slip_distance"]
_STRIBECK, _AGEING = INDEX["stribeck_friction"], INDEX["ageing_friction"]
_PRETENSION = INDEX["pretension"]
_MAX_FRICTION = 5.0
ADOPTION_THRESHOLD = 0.01
"""Least relative change of a learned factor of friction that is adopted: packing a
cable for every last bit would take longer than stepping it."""
_EA = INDEX["axial_stiffness"]
_MOST_SOFTER = 1.5
"""Compliance at the pretension over that of the taut cable, from which laws warn."""


PROXIMAL, DISTAL, FRICTION, COMPLIANCE, PRETENSION = range(5)
"""Columns of the table of cables: arms at motor and joint [m/rad], mu times wrap,
length over axial stiffness [m/N], pretension [N]."""


class CableModel:
    """Cables driven by motor angle and joint torque, in every environment.

    Attributes:
        packed: parameters, (rows, cables, numbers), as `cable._pack.pack` makes them.
        state: (rows, cables, numbers), as the kernel has it.
        joint: estimated angle of the joint since the start (rows,) [rad].
        slip_direction: direction in which a cable last slipped as a whole, (rows,
            cables): 1 towards the joint, -1 towards the motor, 0 never.
        gain: proximal per distal tension at that moment (rows, cables); 1 before.
        arm: of every cable at the present motor angle (rows, cables) [m/rad].
        factor: factor on the drive's friction, (rows, cables).
    """

    def __init__(self, drive: Drive, weakening: bool = True) -> None:
        """Prepare; the number of environments is that of the first observation.

        Args:
            drive: The device; its `cables` must be known.
            weakening: False leaves out `stribeck_friction`, `ageing_friction` with the
                `critical_slip_distance` over which it is renewed, and static friction
                of cables with bristles.

        Raises:
            CableError: `cables` are not known.
        """
        require_known_cables(drive)
        self.drive = drive
        self._weakening = weakening
        cables = drive.cables
        self.segments: stepper.Counts = np.array([s.cable.segments for s in cables])
        self.proximal: FloatArray = np.array([s.proximal for s in cables])
        self.distal: FloatArray = np.array([s.distal for s in cables])
        self._sections = [np.array(s.cable.conduit, dtype=float) for s in cables]
        most = int(self.segments.max())
        self._size = kernel.parameter_size(most), kernel.state_size(most)
        self.work = np.empty(kernel.work_size(most))
        self.scratch = np.empty((SCRATCH_ROWS, len(cables)))
        self.new = np.zeros((len(cables), self._size[1]))
        self._asked = np.empty(len(PARAMETERS))
        self._angles: list[FloatArray] = []
        self._allocate(1)

    @exclusive
    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Take the next observation for the start of an episode: rest, pretension.

        `where` masks the environments that restart; all of them by default.
        """
        self._fresh |= True if where is None else where
        if where is None:
            self._angles = []

    @exclusive
    def follow(self, motor_angle: ArrayLike, joint_torque: ArrayLike) -> None:
        """Update by the measurements of the next instant, a number or (rows,) each.

        Args:
            motor_angle: [rad]; of a round pulley only its changes matter.
            joint_torque: of the cables on the joint [N m].
        """
        angle = np.ascontiguousarray(motor_angle, dtype=float)
        torque = np.ascontiguousarray(joint_torque, dtype=float)
        self.ready(angle)
        _follow_all(
            self.packed,
            self.segments,
            self.proximal,
            self.distal,
            self.state,
            angle,
            torque,
            self.joint,
            self.slip_direction,
            self.gain,
            self.arm,
            self.drive.period,
            self.new,
            self.work,
        )

    def ready(self, motor_angle: FloatArray) -> None:
        """Bring restarting environments to rest at motor angles (rows,) [rad]."""
        if motor_angle.size != self._rows:
            self._allocate(motor_angle.size)
        if self._fresh.any():
            self._begin(motor_angle)

    def scale_friction(self, factor: ArrayLike) -> None:
        """Scale the drive's friction by a number, (rows, 1) or (rows, cables)."""
        factors = np.broadcast_to(factor, (self._rows, self.segments.size))
        for row, cable in np.argwhere(factors != self.factor).tolist():
            self._pack(row, cable, float(factors[row, cable]))

    @exclusive
    def rebend(self, angles: Sequence[FloatArray]) -> None:
        """Set another path of the conduits in the model, until all are reset.

        The length of the path stays; friction is scaled as it was.

        Args:
            angles: wrap angles of the segments of every cable (segments,) [rad].

        Raises:
            CableError: other shapes, or an angle that is negative or not finite.
        """
        self._angles = checked_angles(angles, self.segments)
        for row in np.flatnonzero(~self._fresh).tolist():
            for cable in range(self.segments.size):
                self._bend(row, cable)

    def tension(self, cable: int) -> FloatArray:
        """Return the tension of every node of a cable (rows, segments + 1) [N]."""
        first = kernel.STATE_HEADER
        node = self.state[:, cable, first : first + self.segments[cable] + 1]
        tension: FloatArray = np.maximum(node, 0.0)
        return tension

    def slip(self, cable: int) -> NDArray[np.int8]:
        """Return the slip directions of the last step (rows, segments)."""
        n = int(self.segments[cable])
        first = kernel.STATE_HEADER + n + 1
        slip = np.sign(self.state[:, cable, first : first + n])
        direction: NDArray[np.int8] = slip.astype(np.int8)
        return direction

    def motor_torque(self) -> FloatArray:
        """Return the model's torque of the motor on the cables (rows,) [N m]."""
        found: FloatArray = np.zeros(self._rows)
        for cable, arm in enumerate(self.arm.T):
            found = found - arm * self.tension(cable)[:, 0]
        return found

    def _allocate(self, rows: int) -> None:
        cables = self.segments.size
        self._rows = rows
        self.packed: FloatArray = np.zeros((rows, cables, self._size[0]))
        self.factor: FloatArray = np.ones((rows, cables))
        self.state: FloatArray = np.zeros((rows, cables, self._size[1]))
        self.joint: FloatArray = np.zeros(rows)
        self.arm: FloatArray = np.tile(self.proximal, (rows, 1))
        self.slip_direction: FloatArray = np.zeros((rows, cables))
        self.gain: FloatArray = np.ones((rows, cables))
        self._fresh: NDArray[np.bool_] = np.ones(rows, dtype=np.bool_)

    def _begin(self, angle: FloatArray) -> None:
        for row in np.flatnonzero(self._fresh).tolist():
            for cable in range(self.segments.size):
                self._pack(row, cable, 1.0)
            _set_rest(
                self.packed[row],
                self.segments,
                self.proximal,
                self.distal,
                float(angle[row]),
                self.state[row],
            )
        fresh = self._fresh
        self.joint[fresh], self.slip_direction[fresh], self.gain[fresh] = 0.0, 0.0, 1.0
        fresh[:] = False

    def _pack(self, row: int, cable: int, factor: float) -> None:
        own = self.drive.cables[cable].cable
        pack(
            np.array(own.scalars),
            self._sections[cable],
            own.segments,
            factor,
            self._weakening,
            self._asked,
            self.packed[row, cable],
        )
        self.factor[row, cable] = factor
        if self._angles:
            self._bend(row, cable)

    def _bend(self, row: int, cable: int) -> None:
        prm, n = self.packed[row, cable], int(self.segments[cable])
        kernel.rebend(prm, n, self._angles[cable])
        kernel.expect_change(prm)


def require_known_cables(drive: Drive) -> None:
    """Refuse a drive whose cables are not known."""
    if not drive.cables:
        raise CableError(
            "a controller with a model needs to know the cables; this Drive has none."
        )


def checked_angles(
    angles: Sequence[FloatArray], segments: stepper.Counts
) -> list[FloatArray]:
    """Return copies of the wrap angles of every cable; see `CableModel.rebend`."""
    own = [np.array(angle, dtype=float) for angle in angles]
    if [angle.shape for angle in own] != [(n,) for n in segments.tolist()]:
        raise CableError(
            f"wrap angles have shapes {[angle.shape for angle in own]}; they must be "
            f"those of {segments.tolist()} segments."
        )
    for cable, angle in enumerate(own):
        if not (np.all(np.isfinite(angle)) and np.all(angle >= 0.0)):
            raise CableError(
                f"wrap angles of cable {cable} are {angle.tolist()} rad; all must be "
                "finite and 0 or more."
            )
    return own


@compiled
def pack(
    values: FloatArray,
    sections: FloatMatrix,
    n: int,
    factor: float,
    weakening: bool,
    changed: FloatArray,
    prm: FloatArray,
) -> None:
    """Pack a cable, given as in `cable._pack.pack`, with a multiple of its friction.

    For `weakening` see `CableModel`; `changed` is scratch like `values`, `prm` is out.
    """
    for i in range(values.size):
        changed[i] = values[i]
    for place in _FRICTION_COEFFICIENTS:
        changed[place] = min(factor * changed[place], _MAX_FRICTION)
    if not weakening:
        changed[_STRIBECK] = 0.0
        if changed[_AGEING] > 0.0:
            changed[_AGEING] = changed[_CRITICAL_SLIP] = 0.0
        if changed[_BRISTLE] > 0.0:
            changed[_STATIC] = 0.0
    kernel.pack(changed, sections, n, prm)


@compiled
def has_changed(factor: float, believed: float) -> bool:
    """Return whether to adopt a learned factor of friction."""
    return abs(factor / believed - 1.0) > ADOPTION_THRESHOLD


def joint_stiffness(cables: Sequence[CableDrive]) -> float:
    """Return the stiffness of all cables of a device at its joint [N m/rad].

    That of taut cables: a cable with much clearance in its bends is softer, which
    warns.
    """
    for cable in (one.cable for one in cables):
        taut, seated = cable.length / cable.axial_stiffness, cable.seating_tension
        play = cable.clearance * cable.wrap * seated
        softer = 1.0 + play / (cable.pretension + seated) ** 2 / taut
        if softer > _MOST_SOFTER:
            warnings.warn(
                f"controllers and their guards take cables for taut, but `clearance` "
                f"makes one {softer:.1f} times softer at its pretension of "
                f"{cable.pretension:g} N; they may let go of the joint at once.",
                CableWarning,
                stacklevel=2,
            )
    prm, _, _, _, distal = stepper.make_cables(
        [one.cable for one in cables],
        [one.proximal for one in cables],
        [one.distal for one in cables],
    )
    return stiffness(prm, distal)


def joint_spring(cables: Sequence[CableDrive]) -> FloatArray:
    """Return all cables of a device as a spring at its joint; see `guard.STIFFNESS`."""
    spring = np.zeros(guard.SPRING_SIZE)
    for one in cables:
        sections = np.array(one.cable.conduit, dtype=float).reshape(-1, 2)
        add_preload(np.array(one.cable.scalars), sections, one.distal, spring)
    spring[guard.STIFFNESS] = joint_stiffness(cables) if cables else 0.0
    return spring


@compiled
def add_preload(
    values: FloatArray, sections: FloatMatrix, distal: float, spring: FloatArray
) -> None:
    """Add the pretension of a cable to a spring, and its friction if larger.

    `values` are the scalars of the cable, `distal` its arm at the joint [m/rad]; for
    `spring` see `guard.STIFFNESS`.
    """
    wrap = 0.0
    for i in range(sections.shape[0]):
        wrap += sections[i, 0] / sections[i, 1]
    spring[guard.REST] += abs(distal) * values[_PRETENSION]
    friction = values[_FRICTION_COEFFICIENTS[0]] * wrap
    spring[guard.FRICTION] = max(spring[guard.FRICTION], friction)


@compiled
def stiffness(prm: FloatMatrix, distal: FloatArray) -> float:
    """Return `joint_stiffness` of packed cables (cables, numbers).

    Their arms are `distal` (cables,) [m/rad].
    """
    total = 0.0
    for k in range(distal.size):
        total += distal[k] ** 2 * prm[k, _EA] / prm[k, LENGTH]
    return total


@compiled
def _set_rest(
    prm: FloatMatrix,
    n: stepper.Counts,
    proximal: FloatArray,
    distal: FloatArray,
    motor: float,
    state: FloatMatrix,
) -> None:
    """Bring the cables of an environment to rest at a motor angle and joint angle 0."""
    stepper.set_rest(
        stepper.Cables(prm, n, proximal, proximal, distal), motor, 0.0, state
    )


@compiled
def follow(
    cables: stepper.Cables,
    state: FloatMatrix,
    motor: float,
    torque: float,
    joint: float,
    slip_direction: FloatArray,
    gain: FloatArray,
    arm: FloatArray,
    dt: float,
    new: FloatMatrix,
    work: FloatArray,
) -> float:
    """Step the cables of one environment; return the joint angle [rad].

    State, slip directions, gains and arms (see `CableModel`) are updated. The motor has
    an angle [rad], the cables a torque on the joint [N m], and the joint had an angle
    before [rad]. `new` is scratch like `state`, `work` of `cable._layout.work_size`.
    """
    n = cables.n
    load = stepper.Load(torque, 0.0, -np.inf, np.inf)
    found = stepper.balance(cables, state, True, motor, joint, load, dt, new, work)
    for k in range(n.size):
        arm[k] = cables.proximal[k] * stepper.proximal_displacement(cables, k, motor)[1]
        slip, tension = slips(new[k], n[k]), tensions(new[k], n[k])
        sign = np.sign(slip[0])
        for j in range(n[k]):
            if slip[j] * sign <= 0.0:
                sign = 0.0
        low, high = tension[0], tension[n[k]]
        if sign != 0.0 and min(low, high) > 0.0:
            slip_direction[k] = sign
            gain[k] = low / high
        elif sign != 0.0 and has_drag(cables.prm[k]):
            slip_direction[k] = sign  # drag slips by, with slack at the motor
        for i in range(state.shape[1]):
            state[k, i] = new[k, i]
    return found


@compiled
def _follow_all(
    prm: FloatCube,
    n: stepper.Counts,
    proximal: FloatArray,
    distal: FloatArray,
    state: FloatCube,
    motor: FloatArray,
    torque: FloatArray,
    joint: FloatArray,
    slip_direction: FloatMatrix,
    gain: FloatMatrix,
    arm: FloatMatrix,
    dt: float,
    new: FloatMatrix,
    work: FloatArray,
) -> None:
    for row in range(motor.size):
        cables = stepper.Cables(prm[row], n, proximal, proximal, distal)
        joint[row] = follow(
            cables, state[row], motor[row], torque[row], joint[row],
            slip_direction[row], gain[row], arm[row], dt, new, work,
        )  # fmt: skip


@internal
def motor_torque(n: stepper.Counts, arm: FloatArray, state: FloatMatrix) -> float:
    """Return the torque of the motor on the cables of one environment [N m]."""
    total = 0.0
    for k in range(n.size):
        total -= arm[k] * max(tensions(state[k], n[k])[0], 0.0)
    return total


def cable_table(cables: Sequence[CableDrive]) -> FloatArray:
    """Return the table of cables (cables, 5)."""
    return np.array(
        [
            (
                one.proximal,
                one.distal,
                one.cable.friction * one.cable.wrap,
                one.cable.length / one.cable.axial_stiffness,
                one.cable.pretension,
            )
            for one in cables
        ]
    ).reshape(-1, 5)


@compiled
def _share(friction: float, slip: float) -> float:
    """Return the mean tension along a cable over that at the joint.

    `friction` is mu times wrap; `slip` is 1 towards the joint, -1 towards the motor, or
    between.
    """
    exponent = -slip * friction
    if abs(exponent) < 1e-6:
        return 1.0
    return float(math.expm1(exponent) / exponent)


@compiled
def full_slip_balance(
    cables: FloatMatrix, sense: float, desired: float
) -> tuple[float, float]:
    """Return motor torque and stretch of cables that slip as a whole.

    The stretch is the angle of the motor over the ratio, ahead of the joint [rad].
    `sense` is the direction in which the motor turns, 1 or -1 or, softly, between:
    positive towards a positive torque of the joint. `desired` is the torque at the
    joint [N m].
    """
    count = cables.shape[0]
    constant, slope = 0.0, 0.0
    for k in range(count):
        arm = cables[k, DISTAL]
        soft = cables[k, COMPLIANCE]
        unit = soft * _share(cables[k, FRICTION], np.sign(arm) * sense)
        constant -= arm * soft * cables[k, PRETENSION] / unit
        slope -= arm * arm / unit
    turned = (desired - constant) / slope
    slack = False
    for k in range(count):
        rest = cables[k, COMPLIANCE] * cables[k, PRETENSION]
        slack |= count > 1 and rest + cables[k, DISTAL] * turned < 0.0
    if slack:
        constant, slope = 0.0, 0.0
        for k in range(count):
            arm, soft = cables[k, DISTAL], cables[k, COMPLIANCE]
            if soft * cables[k, PRETENSION] + arm * turned < 0.0:
                continue
            unit = soft * _share(cables[k, FRICTION], np.sign(arm) * sense)
            constant -= arm * soft * cables[k, PRETENSION] / unit
            slope -= arm * arm / unit
        turned = (desired - constant) / slope if slope != 0.0 else turned
    torque = 0.0
    for k in range(count):
        arm, soft = cables[k, DISTAL], cables[k, COMPLIANCE]
        slip = np.sign(arm) * sense
        stretched = soft * cables[k, PRETENSION] + arm * turned
        tension = max(stretched, 0.0) / (soft * _share(cables[k, FRICTION], slip))
        torque -= cables[k, PROXIMAL] * tension * np.exp(-slip * cables[k, FRICTION])
    return float(torque), float(-turned)
