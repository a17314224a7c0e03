r"""Cables as a controller assumes them: the kernel itself, run as an observer.

    model = CableModel(drive)
    model.follow(observation["motor_angle_rad"], observation["joint_torque_nm"])
    model.tension(0), model.slip(0)          # of the first cable, proximal to distal

Motor angle and joint torque are measured; they determine the model completely (position
at one end, tension at the other, thesis Fig. 2.2). The model estimates unmeasured
quantities: the parts of the cables that move, the tensions along them, the required
torque of the motor. It has the parameters of the device, not its true state. Motor and
joint angles would be the worse pair: the end of a cable is so stiff that the last bit
of a joint encoder stands for newtons.

One model holds the cables of many environments; each row is computed by itself.

While a cable of wrap \(\phi\) slips as a whole in one direction s (1 where the motor
winds towards a positive torque at the joint), its tensions at motor and joint differ by
the factor \(e^{\mu \phi}\), and its stretch is that of its tension at the joint times a
mean factor: `full_slip_balance`. Between the two directions lies the backlash.
"""

import math
import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cc_mujoco._utils.exclusive import exclusive
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _nodes as nodes
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._friction import PLACE
from cc_mujoco.cable._layout import LENGTH, segment_angles, slips, tensions
from cc_mujoco.control import _guard as guard
from cc_mujoco.control._compensation import SCRATCH_ROWS, Model, has_drag
from cc_mujoco.device._drive import CableDrive, Drive
from cc_mujoco.errors import CableError, CableWarning
from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal

PROXIMAL, DISTAL, FRICTION, COMPLIANCE, PRETENSION = range(5)
"""Columns of the table of cables: arms at motor and joint [m/rad], mu times wrap,
compliance as in `set_stiffness` [m/N], pretension [N]."""

_MAX_OVERRATED = 0.25
"""Error of a linear spring's tension, over the largest one, above which is a warning:
half of that at which the guard would release a joint without torque."""


class CableModel:
    """Cables driven by motor angle and joint torque, in every environment.

    Attributes:
        cables: parameters and arms, as `stepper` has them.
        state: states of the cables, as the kernel has them (rows, cables, numbers).
        joint: estimated angle of the joint since the start (rows,) [rad].
        slip_direction: direction in which a cable last slipped as a whole, (rows,
            cables): 1 towards the joint, -1 towards the motor, 0 never.
        gain: proximal per distal tension at that moment (rows, cables); 1 before.
        arm: arm of every cable at the present motor angle (rows, cables) [m/rad].
    """

    def __init__(self, drive: Drive) -> None:
        """Prepare; the number of environments is that of the first observation.

        Raises:
            CableError: The `cables` of the drive are not known.
        """
        require_known_cables(drive)
        self.drive = drive
        self.cables = stepper_cables(drive.cables)
        self.new = stepper.rest_states(self.cables, 0.0, 0.0)
        self.work = stepper.scratch(self.cables)
        self._allocate(1)

    @exclusive
    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Put cables to rest at the next observation, in all environments or a mask."""
        self._fresh |= True if where is None else where

    @exclusive
    def follow(self, motor_angle: ArrayLike, joint_torque: ArrayLike) -> None:
        """Update by the measurements of the next instant, a number or (rows,) each.

        They are the motor angle [rad], of which only changes matter on a round pulley,
        and the torque of the cables on the joint [N m].
        """
        angle = np.ascontiguousarray(motor_angle, dtype=float)
        torque = np.ascontiguousarray(joint_torque, dtype=float)
        self.ready(angle)
        for row, model in enumerate(self.models):
            self.joint[row] = follow(
                model, angle[row], torque[row], self.joint[row], self.drive.period
            )

    def ready(self, motor_angle: FloatArray) -> None:
        """Bring restarting environments to rest at motor angles (rows,) [rad]."""
        if motor_angle.size != self.joint.size:
            self._allocate(motor_angle.size)
        for row in np.flatnonzero(self._fresh).tolist():
            stepper.set_rest(self.cables, motor_angle[row], 0.0, self.state[row])
            self.joint[row], self.slip_direction[row], self.gain[row] = 0.0, 0.0, 1.0
        self._fresh[:] = False

    def tension(self, cable: int) -> FloatArray:
        """Return the tension of every node of a cable (rows, segments + 1) [N]."""
        first, n = kernel.STATE_HEADER, self.cables.n[cable]
        return np.asarray(np.maximum(self.state[:, cable, first : first + n + 1], 0.0))

    def slip(self, cable: int) -> NDArray[np.int8]:
        """Return each segment's slip in the last step, 1, -1 or 0 (rows, segments)."""
        n = int(self.cables.n[cable])
        first = kernel.STATE_HEADER + n + 1
        return np.sign(self.state[:, cable, first : first + n]).astype(np.int8)

    def motor_torque(self) -> FloatArray:
        """Return the model's torque of the motor on the cables (rows,) [N m]."""
        return np.array([motor_torque(model) for model in self.models])

    def _allocate(self, rows: int) -> None:
        cables, size = self.new.shape
        self.state: FloatArray = np.zeros((rows, cables, size))
        self.joint: FloatArray = np.zeros(rows)
        self.arm: FloatArray = np.tile(self.cables.proximal, (rows, 1))
        self.slip_direction: FloatArray = np.zeros((rows, cables))
        self.gain: FloatArray = np.ones((rows, cables))
        self._fresh: NDArray[np.bool_] = np.ones(rows, dtype=np.bool_)
        scratch = np.empty((SCRATCH_ROWS, cables))
        each = zip(self.state, self.arm, self.slip_direction, self.gain, strict=True)
        self.models = [
            Model(self.cables, *own, scratch, self.new, self.work) for own in each
        ]


def stepper_cables(cables: Sequence[CableDrive]) -> stepper.Cables:
    each = [(one.cable, one.proximal, one.distal) for one in cables]
    return stepper.make_cables(*zip(*each, strict=True))


def require_known_cables(drive: Drive) -> None:
    """Raise a `CableError` if the cables of a drive are not known."""
    if not drive.cables:
        raise CableError(
            "a controller with a model needs to know the cables; this Drive has none."
        )


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

    Without `weakening`, `stribeck_friction`, `ageing_friction` with the
    `critical_slip_distance` over which it is renewed, and static friction of cables
    with bristles are left out. `changed` is scratch like `values`, `prm` is out.
    """
    changed[:] = values
    # At most 5, as of a `Cable`.
    changed[PLACE.friction] = min(factor * values[PLACE.friction], 5.0)
    changed[PLACE.static_friction] = min(factor * values[PLACE.static_friction], 5.0)
    if not weakening:
        changed[PLACE.stribeck_friction] = 0.0
        if changed[PLACE.ageing_friction] > 0.0:
            changed[PLACE.ageing_friction] = changed[PLACE.critical_slip_distance] = 0.0
        if changed[PLACE.bristle_length] > 0.0:
            changed[PLACE.static_friction] = 0.0
    kernel.pack(changed, sections, n, prm)


def joint_spring(cables: Sequence[CableDrive], limits: guard.DriveLimits) -> FloatArray:
    """Return all cables of a device as a spring at its joint; see `guard.STIFFNESS`.

    A `CableWarning` is given if a cable is much less taut at small torques than a
    linear spring of that stiffness, as one with clearance in its bends may be.
    """
    spring = np.zeros(guard.SPRING_SIZE)
    if not cables:
        return spring
    made, most = stepper_cables(cables), guard.largest_torque(limits)
    for k, one in enumerate(cables):
        sections = np.array(one.cable.conduit, dtype=float)
        add_preload(np.array(one.cable.scalars), sections, one.distal, spring)
        largest = most / abs(one.distal)
        if soft_compliance(made.prm[k], made.n[k], largest) == 0.0:
            continue  # a linear spring, as most are
        shares = np.linspace(0.02, 1.0, 50)
        give = np.full(shares.size, one.cable.length / one.cable.axial_stiffness)
        for i, share in enumerate(shares):
            give[i] += soft_compliance(made.prm[k], made.n[k], share * largest)
        over = float(np.max(shares * (give / give[-1] - 1.0)))
        if over > _MAX_OVERRATED:
            warnings.warn(
                "controllers take cables for linear springs, guards all but ends that "
                "harden, but `clearance` or springs at its ends make one so much "
                "softer slack than taut that they overrate its tension by up to "
                f"{over * largest:.3g} of {largest:.3g} N; they may let go of the "
                "joint at once.",
                CableWarning,
                stacklevel=2,
            )
    set_stiffness(made, most, spring)
    return spring


@compiled
def add_preload(
    values: FloatArray, sections: FloatMatrix, distal: float, spring: FloatArray
) -> None:
    """Add a cable's pretension to a spring, and raise the spring's friction to its own.

    `values` are the scalars of the cable, `distal` its arm at the joint [m/rad]; for
    `spring` see `guard.STIFFNESS`.
    """
    wrap = 0.0
    for i in range(sections.shape[0]):
        wrap += sections[i, 0] / sections[i, 1]
    spring[guard.REST] += abs(distal) * values[PLACE.pretension]
    spring[guard.FRICTION] = max(spring[guard.FRICTION], values[PLACE.friction] * wrap)


@compiled
def soft_compliance(prm: FloatArray, n: int, tension: float) -> float:
    """Return the compliance of end springs and clearance, loaded to a tension [m/N].

    It is their stretch over that tension. `prm` is packed, `n` its number of segments.
    """
    seated = nodes.seated_stretch(prm, n, segment_angles(prm, n), tension)
    return float((nodes.rest_spring_stretch(prm, tension) + seated) / tension)


@internal
def _rigidity(cables: stepper.Cables, k: int, largest: float) -> float:
    """Return the joint stiffness by cable `k` at a torque `largest` [N m/rad]."""
    prm, arm = cables.prm[k], cables.distal[k]
    soft = soft_compliance(prm, cables.n[k], largest / abs(arm))
    if soft == 0.0:
        return float(arm**2 * prm[PLACE.axial_stiffness] / prm[LENGTH])
    return float(arm**2 / (prm[LENGTH] / prm[PLACE.axial_stiffness] + soft))


@compiled
def set_stiffness(cables: stepper.Cables, largest: float, spring: FloatArray) -> None:
    """Set stiffness, and ends that harden or lose work, of packed cables as a `spring`.

    The stiffness is that of a linear spring that stretches as the cables do at the
    `largest` torque [N m]. Cables that turn the joint together have the mean stretch,
    weighted by the share of that torque that each has.
    """
    whole = 0.0
    for k in range(cables.n.size):
        whole += _rigidity(cables, k, largest)
    spring[guard.STIFFNESS] = whole
    taut, soft, hardening, loss = 0.0, 0.0, 0.0, 0.0
    for k in range(cables.n.size):
        prm, arm = cables.prm[k], abs(cables.distal[k])
        own = _rigidity(cables, k, largest)
        share, weight = own / whole, (own / whole / arm) ** 2
        tension = largest / arm
        taut += share * share / own
        taut -= weight * nodes.soft_rest_stretch(prm, tension) / tension
        for end in range(2):
            if not nodes.is_soft(prm, end):
                continue
            hardens, lost = prm[PLACE.end_hardening], prm[PLACE.end_loss]
            if end == 0:
                hardens, lost = prm[PLACE.proximal_hardening], prm[PLACE.proximal_loss]
            give = weight * nodes.spring_compliance(prm, end)
            soft += give
            hardening += give * hardens * share / arm
            loss += give * lost
    if soft > 0.0:
        spring[guard.TAUT], spring[guard.SOFT] = taut, soft
        spring[guard.HARDENING], spring[guard.LOSS] = hardening / soft, loss / soft


@compiled
def follow(model: Model, motor: float, torque: float, joint: float, dt: float) -> float:
    """Step the cables of one environment by `dt` [s]; return the joint angle [rad].

    `motor` is the measured motor angle [rad], `torque` that of the cables on the joint
    [N m], `joint` the joint angle before [rad]. `model` is updated.
    """
    cables, state, new, n = model.cables, model.state, model.new, model.cables.n
    load = stepper.Load(torque, 0.0, -np.inf, np.inf)
    found = stepper.balance(
        cables, state, True, motor, joint, load, dt, new, model.work
    )
    for k in range(n.size):
        lever = stepper.proximal_displacement(cables, k, motor)[1]
        model.arm[k] = cables.proximal[k] * lever
        slip, tension = slips(new[k], n[k]), tensions(new[k], n[k])
        sign = np.sign(slip[0])
        for j in range(n[k]):
            if slip[j] * sign <= 0.0:
                sign = 0.0
        low, high = tension[0], tension[n[k]]
        if sign != 0.0 and min(low, high) > 0.0:
            model.direction[k] = sign
            model.gain[k] = low / high
        elif sign != 0.0 and has_drag(cables.prm[k]):
            model.direction[k] = sign  # drag slips by, with slack at the motor
    state[:] = new
    return found


@internal
def motor_torque(model: Model) -> float:
    """Return the torque of the motor on the cables of one environment [N m]."""
    total, n = 0.0, model.cables.n
    for k in range(n.size):
        total -= model.arm[k] * max(tensions(model.state[k], n[k])[0], 0.0)
    return total


def cable_table(cables: Sequence[CableDrive], limits: guard.DriveLimits) -> FloatArray:
    """Return columns `PROXIMAL` to `PRETENSION` of the cables (cables, 5)."""
    table, made = np.empty((len(cables), 5)), stepper_cables(cables)
    for k, one in enumerate(cables):
        largest = guard.largest_torque(limits) / abs(one.distal)
        soft = one.cable.length / one.cable.axial_stiffness
        soft += soft_compliance(made.prm[k], made.n[k], largest)
        friction = one.cable.friction * one.cable.wrap
        table[k] = one.proximal, one.distal, friction, soft, one.cable.pretension
    return table


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
    """Return motor torque [N m] and stretch [rad] of cables that slip as a whole.

    The stretch is the motor angle over the ratio, less the joint angle. `cables` is a
    `cable_table`. `sense` is 1 where the motor turns towards a positive torque of the
    joint, -1 the other way, and between for a smooth transition. `desired` is the
    torque at the joint [N m].
    """
    count, turned = cables.shape[0], 0.0
    for again in range(2):  # without cables that would be slack
        constant, slope, slack = 0.0, 0.0, False
        for k in range(count):
            arm, soft = cables[k, DISTAL], cables[k, COMPLIANCE]
            if again == 1 and soft * cables[k, PRETENSION] + arm * turned < 0.0:
                continue
            unit = soft * _share(cables[k, FRICTION], np.sign(arm) * sense)
            constant -= arm * soft * cables[k, PRETENSION] / unit
            slope -= arm * arm / unit
        if slope == 0.0:
            break
        turned = (desired - constant) / slope
        for k in range(count):
            rest = cables[k, COMPLIANCE] * cables[k, PRETENSION]
            slack |= count > 1 and rest + cables[k, DISTAL] * turned < 0.0
        if not slack:
            break
    torque = 0.0
    for k in range(count):
        arm, soft = cables[k, DISTAL], cables[k, COMPLIANCE]
        slip = np.sign(arm) * sense
        stretched = soft * cables[k, PRETENSION] + arm * turned
        tension = max(stretched, 0.0) / (soft * _share(cables[k, FRICTION], slip))
        torque -= cables[k, PROXIMAL] * tension * np.exp(-slip * cables[k, FRICTION])
    return float(torque), float(-turned)
