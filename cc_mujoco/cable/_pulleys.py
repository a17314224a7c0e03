"""Cables between pulleys: pull-pull pairs and single cables, motor to joint.

    >>> import numpy as np
    >>> from cc_mujoco.cable import Cable, Section, Transmission
    >>> cable = Cable(friction=0.1, conduit=(Section(2.0, 0.28),))
    >>> drive = Transmission.pull_pull(cable, motor_radius=0.02, joint_radius=0.104)
    >>> torque = 0.1 * np.sin(np.linspace(0.0, 6.0, 500))
    >>> motion = drive.replay(0.001, motor_torque=torque, joint_angle=np.zeros(500))
    >>> bool(np.abs(motion.joint_torque).max() < 0.1 * drive.ratio)
    True

Positive motor rotation pulls the joint positive. `motor_torque` is what the motor puts
into the transmission, `joint_torque` what the transmission puts into the joint.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco._utils.arguments import MAX_FORCE, numbers, require_kind
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._cable import Cable
from cc_mujoco.cable._conduit import MAX_TRAVEL, TIME_STEP, require_no_overflow
from cc_mujoco.cable._layout import tensions
from cc_mujoco.cable._parameter import Parameter
from cc_mujoco.errors import CableError, shown, with_known_names
from cc_mujoco.native import FloatArray, FloatMatrix, compiled, interrupted

ANGLE, TORQUE = 0, 1
"""Kinds of a side: its angle or its torque is prescribed."""

PULLEYS = (
    Parameter("motor_radius", "m", "radius of the motor's pulley", 1e-6, 1e3),
    Parameter("joint_radius", "m", "radius of the joint's pulley", 1e-6, 1e3),
    Parameter("gear_ratio", "1", "turns of the motor per turn", 1e-6, 1e6),
    Parameter("backlash", "rad", "play of the joint in its pulley", 0.0, 1e3),
)
"""Bounds of the fields of a `Transmission`."""


@dataclass(frozen=True)
class Driven:
    """A recorded motion of a transmission; arrays have one entry per sample.

    Attributes:
        motor_angle: angle of the motor's shaft [rad].
        motor_torque: torque of the motor on the transmission [N m].
        joint_angle: angle of the joint [rad].
        joint_torque: torque of the transmission on the joint [N m].
        tension_proximal: proximal tension (cables, samples) [N]; agonist first.
        tension_distal: distal tension (cables, samples) [N].
        dissipated: energy lost to friction so far (cables, samples) [J].
    """

    motor_angle: FloatArray
    motor_torque: FloatArray
    joint_angle: FloatArray
    joint_torque: FloatArray
    tension_proximal: FloatArray
    tension_distal: FloatArray
    dissipated: FloatArray


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
        if not isinstance(self.cables, tuple) or len(self.cables) not in (1, 2):
            raise CableError(
                f"a transmission has a tuple of 1 or 2 cables, not {shown(self.cables)}"
            )
        for cable in self.cables:
            require_kind("each of `cables`", cable, Cable)
        for described in PULLEYS:
            described.check(getattr(self, described.name))
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

    @classmethod
    def pull_pull(
        cls,
        cable: Cable,
        motor_radius: float,
        joint_radius: float,
        gear_ratio: float = 1.0,
    ) -> "Transmission":
        """Return two equal cables that pull the joint both ways (thesis Fig. 2.7)."""
        return cls((cable, cable), motor_radius, joint_radius, gear_ratio)

    @classmethod
    def single(
        cls,
        cable: Cable,
        motor_radius: float,
        joint_radius: float,
        gear_ratio: float = 1.0,
    ) -> "Transmission":
        """Return one cable that pulls the joint positive, and otherwise goes slack."""
        return cls((cable,), motor_radius, joint_radius, gear_ratio)

    @property
    def ratio(self) -> float:
        """Motor angle per joint angle of the ideal transmission."""
        return self.gear_ratio * self.joint_radius / self.motor_radius

    @with_known_names
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

        Exactly one quantity is given per side, (samples,) each; a torque on one side at
        most (modes of thesis Fig. 2.2). The first sample is the rest state, and only
        changes of angle matter. A torque that a single cable cannot give (it would have
        to push) leaves the cable slack with no tension at that end.

        Args:
            dt: time between samples [s].
            motor_angle: [rad], or
            motor_torque: [N m].
            joint_angle: [rad], or
            joint_torque: [N m].

        Raises:
            CableError: not one quantity per side, torque on both, unequal lengths, or
                values that are not finite or too large.
        """
        proximal_kind, proximal = _prescribed_side("motor", motor_angle, motor_torque)
        distal_kind, distal = _prescribed_side("joint", joint_angle, joint_torque)
        if proximal_kind == distal_kind == TORQUE:
            raise CableError(
                "both sides are driven by torque; at least one must be driven by angle"
            )
        if self.backlash > 0.0 and TORQUE in (proximal_kind, distal_kind):
            raise CableError(
                "a transmission with backlash is played only from both angles; give "
                "motor_angle and joint_angle"
            )
        if proximal.size != distal.size:
            raise CableError(
                f"the motor side has {proximal.size} samples and the joint side "
                f"{distal.size}; both must have the same number"
            )
        TIME_STEP.check(dt)
        # Winding the motor draws the agonist towards proximal, lets the other one out.
        ways = (-1.0, 1.0)[: len(self.cables)]
        arm = self.motor_radius / self.gear_ratio
        arms = arm, self.motor_radius, self.joint_radius
        near, gear, far = ([way * radius for way in ways] for radius in arms)
        cables = stepper.make_cables(self.cables, near, far, gear)
        count, most = len(self.cables), max(each.segments for each in self.cables)
        out = np.empty((2 + 4 * count, proximal.size))
        state, new = np.zeros((2, count, kernel.state_size(most)))
        _drive(
            cables, proximal_kind, proximal, distal_kind, distal, 0.5 * self.backlash,
            dt, state, new, np.empty(kernel.work_size(most)), out,
        )  # fmt: skip
        require_no_overflow(out, proximal, distal)
        lever, proximal, distal, lost = out[2:].reshape(4, count, -1)
        motor_torque = _net_tension(proximal * lever) * arm
        joint_torque = _net_tension(distal) * self.joint_radius
        torques = motor_torque, out[1], joint_torque
        return Driven(out[0], *torques, proximal, distal, lost)


def _net_tension(tension: FloatArray) -> FloatArray:
    """Return the agonist's tension less the antagonist's (samples,) [N]."""
    pull: FloatArray = tension[0] - tension[1] if len(tension) == 2 else tension[0]
    return pull


def _prescribed_side(
    side: str, angle: ArrayLike | None, torque: ArrayLike | None
) -> tuple[int, FloatArray]:
    if angle is not None and torque is None:
        kind, values = ANGLE, numbers(f"{side}_angle", angle, None, MAX_TRAVEL, "rad")
    elif torque is not None and angle is None:
        name = f"{side}_torque"
        kind, values = TORQUE, numbers(name, torque, None, MAX_FORCE, "N m")
    else:
        raise CableError(
            f"prescribe either {side}_angle or {side}_torque, not both or neither"
        )
    if values.ndim != 1 or values.size == 0:
        raise CableError(
            f"the motion of the {side} has shape {values.shape}, not (samples,)"
        )
    return kind, np.ascontiguousarray(values)


@compiled
def _drive(
    cables: stepper.Cables, proximal_kind: int, proximal: FloatArray, distal_kind: int,
    distal: FloatArray, play: float, dt: float, state: FloatMatrix, new: FloatMatrix,
    work: FloatArray, out: FloatMatrix,
) -> None:  # fmt: skip
    motor = proximal[0] if proximal_kind == ANGLE else 0.0
    joint = distal[0] if distal_kind == ANGLE else 0.0
    pulley, count = joint, cables.n.size
    stepper.set_rest(cables, motor, joint, state)
    for k in range(count):
        for i in range(state.shape[1]):
            new[k, i] = state[k, i]
    free = np.inf
    for row in range(proximal.size):
        if interrupted(row):
            return
        if proximal_kind == ANGLE:
            motor = proximal[row]
        if distal_kind == ANGLE:
            joint = distal[row]
        if proximal_kind == TORQUE:
            load = stepper.Load(proximal[row], 0.0, -free, free)
            motor = stepper.balance(
                cables, state, False, joint, motor, load, dt, new, work
            )
        elif distal_kind == TORQUE:
            load = stepper.Load(distal[row], 0.0, -free, free)
            joint = stepper.balance(
                cables, state, True, motor, joint, load, dt, new, work
            )
        elif play > 0.0:
            load = stepper.Load(0.0, 0.0, joint - play, joint + play)
            pulley = stepper.balance(
                cables, state, True, motor, pulley, load, dt, new, work
            )
        else:
            stepper.move(cables, state, motor, joint, dt, new, work)
        state, new = new, state
        out[0, row], out[1, row] = motor, joint
        for k in range(count):
            tension = tensions(state[k], cables.n[k])
            out[2 + k, row] = stepper.proximal_displacement(cables, k, motor)[1]
            out[2 + count + k, row] = max(tension[0], 0.0)
            out[2 + 2 * count + k, row] = max(tension[cables.n[k]], 0.0)
            out[2 + 3 * count + k, row] = state[k, 2]
