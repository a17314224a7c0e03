"""Walking trajectory of the ankle, with hip and knee."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from cc_mujoco._validation import bounded
from cc_mujoco.errors import CableError
from cc_mujoco.human import _gait as gait
from cc_mujoco.human._gait import GaitJoint, gait_joints
from cc_mujoco.human._motion import Array, Motion, Scripted, minimum_jerk, pointwise
from cc_mujoco.human._pace import MEASURED_SPEED, SCENE_WEARER, Body, Pace


@dataclass(frozen=True)
class Walk(Scripted):
    """Level walking: the ankle, and as companions all three joints of the leg.

    The cadence grows from standstill at heel strike to its full value in the time
    `start`, as a minimum-jerk step, so that the motion begins at rest. Phase: the gait
    cycle. Angles as in `gait`; all joints scale with the amplitude of the ankle. At
    another speed than the measured one joints move further or less and the foot leaves
    the ground earlier or later, see `Pace`; `Walk.at` has its stride time, too.
    """

    amplitude: float = 0.252  # peak of the ankle in a cycle, rounded up
    period: float = bounded(gait.GAIT_PERIOD, 0.2, 20.0, "s")
    """Duration of a gait cycle at full cadence [s]."""
    start: float = bounded(1.0, 0.01, 1e4, "s")
    """Time in which the cadence grows from 0 [s]."""
    speed: float = MEASURED_SPEED
    """Walking speed [m/s]."""
    joints: tuple[GaitJoint, ...] = ()
    """Joints of a device that walk; by default one leg's, `ankle`, `knee` and `hip`."""

    @classmethod
    def at(cls, speed: float | None, body: Body = SCENE_WEARER) -> Walk:
        """Return the walk at a speed [m/s], with the stride time that goes with it.

        For the speed see `Body.pace`. If the size of the body is not that of the wearer
        of the scenes, the `speed` of the walk is that at which the latter walks
        similarly.

        Raises:
            CableError: If no data cover walking at that speed.
        """
        pace = body.pace(speed)
        return cls(period=gait.GAIT_PERIOD * pace.stride * body.time, speed=pace.speed)

    def on_joints(self, joints: Mapping[str, tuple[float, float]]) -> Walk:
        """Return the walk of a device's joints; see `gait_joints`.

        `joints` are their ranges [rad] by name, that of the driven joint first.

        Raises:
            CableError: If the driven joint is none that walks.
        """
        driven = next(iter(joints))
        found = gait_joints(joints)
        if driven not in {joint.name for joint in found}:
            raise CableError(
                f"a walk moves {', '.join(gait.GAIT_ANGLES)}, and the device drives "
                f"the joint {driven!r}; choose another trajectory, such as 'sine'."
            )
        plain = tuple(GaitJoint(joint.name, joint.name) for joint in found)
        same = driven in gait.GAIT_ANGLES and found == plain
        return self if same else replace(self, joints=found)

    def describe(self) -> str:
        """Return a sentence that says which joints of the device walk."""
        each = []
        for joint in self.joints:
            words = f"as {joint.part}"
            words += ", half a cycle later" if joint.other_leg else ""
            words += ", turned" if joint.turned else ""
            words += f", shifted by {joint.shift:g} rad" if joint.shift else ""
            each.append(f"{joint.name} ({words})")
        return f"the walk moves {', '.join(each or gait.GAIT_ANGLES)}"

    @property
    def pace(self) -> Pace:
        """Ratios that change with the speed."""
        return Pace(self.speed)

    def __post_init__(self) -> None:
        super().__post_init__()
        Pace(self.speed)

    @pointwise
    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        step = minimum_jerk(time / self.start)
        cycles = step.integral * self.start / self.period
        rate = step.value / self.period
        acceleration = step.rate / self.start / self.period
        # The default amplitude is the peak rounded up; it means the angles as measured.
        scale = self.amplitude / Walk.amplitude
        pace = self.pace

        def leg(start: float) -> _Leg:
            phase = np.asarray(np.mod(cycles + start, 1.0))
            slowed = pace.slope(phase)
            bent = slowed * acceleration + pace.bend(phase) * rate**2
            return _Leg(phase, pace.phase(phase), slowed * rate, bent)

        def joint(
            leg: _Leg, name: str, far: float, others: dict[str, Motion]
        ) -> Motion:
            profile, at = gait.GAIT_ANGLES[name], leg.measured
            slope = profile.derivative()
            far = far * pace.excursion(name)
            bent = slope.derivative()(at) * leg.rate**2 + slope(at) * leg.acceleration
            velocity = far * slope(at) * leg.rate
            angle = far * profile(at)
            return Motion(time, angle, velocity, far * bent, leg.phase, others, at)

        first = leg(0.0)
        if not self.joints:
            others = {name: joint(first, name, scale, {}) for name in gait.GAIT_ANGLES}
            return joint(first, "ankle", scale, others)
        legs = {False: first, True: leg(0.5)}
        moved = {}
        for one in self.joints:
            far = -scale if one.turned else scale
            motion = joint(legs[one.other_leg], one.part, far, {})
            moved[one.name] = replace(motion, angle=motion.angle + one.shift)
        return replace(moved[self.joints[0].name], companions=moved)


class _Leg(NamedTuple):
    """Progress of a leg (n + 1,): phase, that of the measured walk, its derivatives."""

    phase: Array
    measured: Array
    rate: Array
    acceleration: Array
