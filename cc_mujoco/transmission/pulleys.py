"""Cables between pulleys: pull-pull pairs and single cables, motor to joint.

    >>> import numpy as np
    >>> from cc_mujoco.transmission import Cable, Section, Transmission
    >>> cable = Cable(friction=0.1, conduit=(Section(2.0, 0.28),))
    >>> drive = Transmission.pull_pull(cable, motor_radius=0.02, joint_radius=0.104)
    >>> torque = 0.1 * np.sin(np.linspace(0.0, 6.0, 500))
    >>> motion = drive.replay(0.001, motor_torque=torque, joint_angle=np.zeros(500))
    >>> bool(np.abs(motion.joint_torque).max() < 0.1 * drive.ratio)
    True

Positive motor rotation pulls the joint positive. `motor_torque` is what the motor puts
into the transmission, `joint_torque` what the transmission puts into the joint.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco.compiled import FloatArray, compiled
from cc_mujoco.errors import CableError
from cc_mujoco.transmission import kernel
from cc_mujoco.transmission.conduit import packed, rest_state
from cc_mujoco.transmission.eccentric import lever, wound
from cc_mujoco.transmission.parameters import Cable

ANGLE, TORQUE = 0, 1
"""What is prescribed on a side of the transmission."""


@dataclass(frozen=True)
class Driven:
    """A recorded motion of a transmission; arrays have one entry per sample.

    Attributes:
        motor_angle: [rad], of the motor shaft.
        motor_torque: [Nm], motor into transmission.
        joint_angle: [rad].
        joint_torque: [Nm], transmission into joint.
        tension_proximal: (cables, samples) [N]; agonist first.
        tension_distal: (cables, samples) [N].
        dissipated: (cables, samples) energy lost to friction so far [J].
    """

    motor_angle: FloatArray
    motor_torque: FloatArray
    joint_angle: FloatArray
    joint_torque: FloatArray
    tension_proximal: FloatArray
    tension_distal: FloatArray
    dissipated: FloatArray


def _shape(cable: Cable) -> tuple[float, float, float, float]:
    """What `eccentric.wound` and `eccentric.lever` take of the motor's pulley."""
    return (
        cable.eccentricity,
        cable.eccentricity_phase,
        cable.ovality,
        cable.ovality_phase,
    )


@dataclass(frozen=True)
class Transmission:
    """Cables on a motor pulley and a joint pulley.

    Attributes:
        cables: (agonist,) or (agonist, antagonist).
        motor_radius: radius of the motor's pulley [m].
        joint_radius: radius of the joint's pulley, or lever arm [m].
        gear_ratio: turns of the motor per turn of its pulley.
        backlash: play between the joint's pulley and the joint [rad]; counts only
            where both sides are driven by angle, and starts in its middle.
    """

    cables: tuple[Cable, ...]
    motor_radius: float
    joint_radius: float
    gear_ratio: float = 1.0
    backlash: float = 0.0

    def __post_init__(self) -> None:
        if len(self.cables) not in (1, 2):
            raise CableError(
                f"a transmission has 1 or 2 cables, got {len(self.cables)}"
            )
        for name in ("motor_radius", "joint_radius", "gear_ratio"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise CableError(f"{name} is {value!r}; it must be positive and finite")
        if not (math.isfinite(self.backlash) and self.backlash >= 0.0):
            raise CableError(f"backlash is {self.backlash!r} rad; it must be 0 or more")
        first = self.cables[0]
        for cable in self.cables:
            for name, size in (
                ("eccentricity", cable.eccentricity),
                ("ovality", cable.eccentricity + cable.ovality),
            ):
                if size >= self.motor_radius:
                    raise CableError(
                        f"cable parameter `{name}` is {getattr(cable, name)!r}; "
                        "`eccentricity` and `ovality` together must be less than "
                        f"motor_radius = {self.motor_radius!r}"
                    )
            if _shape(cable) != _shape(first):
                raise CableError(
                    "both cables of a transmission run on one motor pulley; their "
                    "`eccentricity`, `ovality` and both phases must be the same"
                )

    @classmethod
    def pull_pull(
        cls,
        cable: Cable,
        motor_radius: float,
        joint_radius: float,
        gear_ratio: float = 1.0,
    ) -> Transmission:
        """Two like cables that pull the joint both ways (thesis Fig. 2.7)."""
        return cls((cable, cable), motor_radius, joint_radius, gear_ratio)

    @classmethod
    def single(
        cls,
        cable: Cable,
        motor_radius: float,
        joint_radius: float,
        gear_ratio: float = 1.0,
    ) -> Transmission:
        """One cable that pulls the joint positive; it goes slack the other way."""
        return cls((cable,), motor_radius, joint_radius, gear_ratio)

    @property
    def ratio(self) -> float:
        """Motor angle per joint angle of the ideal transmission."""
        return self.gear_ratio * self.joint_radius / self.motor_radius

    def replay(
        self,
        dt: float,
        *,
        motor_angle: ArrayLike | None = None,
        motor_torque: ArrayLike | None = None,
        joint_angle: ArrayLike | None = None,
        joint_torque: ArrayLike | None = None,
    ) -> Driven:
        """Play a recorded motion through the transmission, in one compiled call.

        Exactly one quantity per side, (samples,) each; torque on one side at most
        (modes of thesis Fig. 2.2). The first sample is the rest state as far as angles
        go: only their changes matter. A torque that a single cable cannot give (it
        would have to push) leaves the cable slack with no tension at that end.

        Args:
            dt: time between samples [s].
            motor_angle: [rad], or
            motor_torque: [Nm].
            joint_angle: [rad], or
            joint_torque: [Nm].

        Raises:
            CableError: not one quantity per side, torque on both, unequal lengths, or
                values that are not finite.
        """
        near_kind, near = _side("motor", motor_angle, motor_torque)
        far_kind, far = _side("joint", joint_angle, joint_torque)
        if near_kind == far_kind == TORQUE:
            raise CableError(
                "both sides are driven by torque; at least one must be driven by angle"
            )
        if self.backlash > 0.0 and TORQUE in (near_kind, far_kind):
            raise CableError(
                "a transmission with backlash is played only from both angles; give "
                "motor_angle and joint_angle"
            )
        if near.size != far.size:
            raise CableError(
                f"the motor side has {near.size} samples and the joint side "
                f"{far.size}; both must have the same number"
            )
        if not (math.isfinite(dt) and dt > 0.0):
            raise CableError(f"time step is {dt!r} s; it must be positive and finite")
        # Cables see the pulley: displacement r * angle, force torque / r.
        near_arm = self.motor_radius / self.gear_ratio
        far_arm = self.joint_radius
        first = self.cables[0]
        shape = _shape(first)
        round_pulley = shape[0] == shape[2] == 0.0
        if near_kind == TORQUE and not round_pulley:
            raise CableError(
                "motor_torque is prescribed and the motor pulley is not round; "
                "prescribe motor_angle, or set `eccentricity` and `ovality` to 0"
            )
        turned, levers = near, np.ones(near.size)
        near = near * near_arm if near_kind == ANGLE else near / near_arm
        if not round_pulley:
            radius = self.motor_radius
            levers = np.array([lever(x, radius, *shape) for x in near])
            near = np.array([wound(x, radius, *shape) for x in near])
        far = far * far_arm if far_kind == ANGLE else far / far_arm
        second = self.cables[-1]
        count = len(self.cables)
        out = np.empty((4 + 3 * count, near.size))
        _drive(
            packed(first),
            packed(second),
            first.segments,
            second.segments,
            rest_state(first),
            rest_state(second),
            count,
            near_kind,
            near,
            far_kind,
            far,
            0.5 * self.backlash * far_arm,
            dt,
            out,
        )
        return Driven(
            turned if near_kind == ANGLE else out[0] / near_arm,
            out[1] * near_arm * levers,
            out[2] / far_arm,
            out[3] * far_arm,
            out[4 : 4 + count],
            out[4 + count : 4 + 2 * count],
            out[4 + 2 * count :],
        )


def _side(
    side: str, angle: ArrayLike | None, torque: ArrayLike | None
) -> tuple[int, FloatArray]:
    if angle is not None and torque is None:
        kind, values = ANGLE, np.ascontiguousarray(angle, dtype=np.float64)
    elif torque is not None and angle is None:
        kind, values = TORQUE, np.ascontiguousarray(torque, dtype=np.float64)
    else:
        raise CableError(
            f"prescribe either {side}_angle or {side}_torque, not both or neither"
        )
    if values.ndim != 1 or values.size == 0 or not np.all(np.isfinite(values)):
        raise CableError(f"the motion of the {side} must be (samples,) finite numbers")
    return kind, values


@compiled
def _net(
    prm: FloatArray,
    prm_2: FloatArray,
    n: int,
    n_2: int,
    state: FloatArray,
    state_2: FloatArray,
    count: int,
    near: float,
    far: float,
    dt: float,
    new: FloatArray,
    new_2: FloatArray,
    work: FloatArray,
    at_far: bool,
) -> float:
    """Step both cables to rim displacements; return the net rim force of one side [N].

    Winding the motor pulley by `near` draws the agonist towards proximal and lets the
    antagonist out.
    """
    t = kernel.STATE_HEADER
    kernel.advance(prm, n, state, -near, -far, dt, new, work)
    force: float = max(new[t + n], 0.0) if at_far else max(new[t], 0.0)
    if count == 2:
        kernel.advance(prm_2, n_2, state_2, near, far, dt, new_2, work)
        force -= max(new_2[t + n_2], 0.0) if at_far else max(new_2[t], 0.0)
    return force


@compiled
def _balance(
    prm: FloatArray,
    prm_2: FloatArray,
    n: int,
    n_2: int,
    state: FloatArray,
    state_2: FloatArray,
    wanted: float,
    near: float,
    far: float,
    dt: float,
    new: FloatArray,
    new_2: FloatArray,
    work: FloatArray,
    at_far: bool,
) -> float:
    """Rim displacement of the side driven by torque at which the net force is `wanted`.

    The net force grows with the motor's displacement and falls with the joint's, and is
    piecewise linear: bracket from where the side is, then regula falsi with the
    Illinois rule. `new`, `new_2` are left at the answer.
    """
    t = kernel.STATE_HEADER
    sign = -1.0 if at_far else 1.0
    at = far if at_far else near
    low, high, reach = at, at, 1e-9
    f_low, f_high = -1.0, 1.0
    has_low, has_high = False, False
    side = 0
    for _ in range(200):
        force = _net(
            prm, prm_2, n, n_2, state, state_2, 2,
            near if at_far else at, at if at_far else far,
            dt, new, new_2, work, at_far,
        )  # fmt: skip
        error = sign * (force - wanted)
        scale = abs(wanted) + max(new[t], new_2[t], new[t + n], new_2[t + n_2])
        if abs(error) <= 1e-12 * scale:
            break
        if error > 0.0:
            high, f_high, has_high = at, error, True
            if side > 0:
                f_low *= 0.5
            side = 1
        else:
            low, f_low, has_low = at, error, True
            if side < 0:
                f_high *= 0.5
            side = -1
        if has_low and has_high:
            if high - low <= 4e-16 * (abs(high) + abs(low)):
                break
            at = low - f_low * (high - low) / (f_high - f_low)
            if at <= low or at >= high:
                at = 0.5 * (low + high)
        else:
            at = at - reach if error > 0.0 else at + reach
            reach *= 4.0
            side = 0
    return at


@compiled
def _within(
    prm: FloatArray,
    prm_2: FloatArray,
    n: int,
    n_2: int,
    state: FloatArray,
    state_2: FloatArray,
    count: int,
    near: float,
    low: float,
    high: float,
    dt: float,
    new: FloatArray,
    new_2: FloatArray,
    work: FloatArray,
) -> float:
    """Rim displacement of the joint's pulley between its stops, `low` and `high`.

    Between them the net force is 0; it falls as the pulley advances. The pulley leans
    on the stop to which the cables pull it.
    """
    force = _net(
        prm, prm_2, n, n_2, state, state_2, count, near, high, dt, new, new_2, work,
        True,
    )  # fmt: skip
    if force >= 0.0:
        return high
    force = _net(
        prm, prm_2, n, n_2, state, state_2, count, near, low, dt, new, new_2, work,
        True,
    )  # fmt: skip
    if force <= 0.0:
        return low
    for _ in range(60):
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        force = _net(
            prm, prm_2, n, n_2, state, state_2, count, near, middle, dt, new, new_2,
            work, True,
        )  # fmt: skip
        if force > 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@compiled
def _drive(
    prm: FloatArray,
    prm_2: FloatArray,
    n: int,
    n_2: int,
    state: FloatArray,
    state_2: FloatArray,
    count: int,
    near_kind: int,
    near: FloatArray,
    far_kind: int,
    far: FloatArray,
    play: float,
    dt: float,
    out: FloatArray,
) -> None:
    new, new_2 = state.copy(), state_2.copy()
    work = np.empty(kernel.work_size(max(n, n_2)))
    t = kernel.STATE_HEADER
    x = near[0] if near_kind == ANGLE else 0.0
    y = far[0] if far_kind == ANGLE else 0.0
    state[0], state[1], state_2[0], state_2[1] = -x, -y, x, y
    for row in range(near.size):
        if near_kind == ANGLE:
            x = near[row]
        if far_kind == ANGLE:
            y = far[row]
        if near_kind == ANGLE and far_kind == ANGLE:
            if play > 0.0:
                pulley = _within(
                    prm, prm_2, n, n_2, state, state_2, count, x, y - play, y + play,
                    dt, new, new_2, work,
                )  # fmt: skip
            else:
                pulley = y
            _net(
                prm, prm_2, n, n_2, state, state_2, count, x, pulley, dt, new, new_2,
                work, False,
            )  # fmt: skip
        elif count == 1:
            # A torque on a single cable is a tension: the kernel solves for the motion.
            if near_kind == TORQUE:
                kernel.step(
                    prm, n, state, kernel.TENSION, max(near[row], 0.0),
                    kernel.POSITION, -y, dt, new, work,
                )  # fmt: skip
                x = -new[0]
            else:
                kernel.step(
                    prm, n, state, kernel.POSITION, -x,
                    kernel.TENSION, max(far[row], 0.0), dt, new, work,
                )  # fmt: skip
                y = -new[1]
        else:
            at_far = far_kind == TORQUE
            found = _balance(
                prm, prm_2, n, n_2, state, state_2,
                far[row] if at_far else near[row], x, y, dt, new, new_2, work, at_far,
            )  # fmt: skip
            if at_far:
                y = found
            else:
                x = found
        state[:] = new
        out[0, row], out[2, row] = x, y
        out[1, row] = max(new[t], 0.0)
        out[3, row] = max(new[t + n], 0.0)
        out[4, row] = out[1, row]
        out[4 + count, row] = out[3, row]
        out[4 + 2 * count, row] = new[2]
        if count == 2:
            state_2[:] = new_2
            out[5, row] = max(new_2[t], 0.0)
            out[5 + count, row] = max(new_2[t + n_2], 0.0)
            out[5 + 2 * count, row] = new_2[2]
            out[1, row] -= out[5, row]
            out[3, row] -= out[5 + count, row]
