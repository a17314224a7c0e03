"""Trials that most rigs can run, from which experiments are chosen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cc_mujoco._utils.compilation import FloatArray
from cc_mujoco.datasets._bench import Bench
from cc_mujoco.diagnosis._inference.records import wind_up_angle

MOTION_STEP = 0.008
"""Time between the samples of a motion [s]."""
MOTION_DURATION = 40.0
"""Length of a motion."""
TURN_ROUNDING_TIME = 0.03
"""Time over which a triangle is rounded where it turns [s]."""
QUARTER_TURN = 0.5 * np.pi
"""Angle that a rig is turned by, so that its weights pull otherwise [rad]."""
SPRING_LOAD_SHARE = 0.8
"""Change of the tensions over the pretension where a spring holds the joint."""


@dataclass(frozen=True)
class CataloguedTrial:
    """A trial that most rigs can run.

    Attributes:
        description: what to do.
        motor: angle of the motor (samples,) [rad].
        joint: angle of the joint (samples,) [rad].
        pretension: relative to what the data had.
        tilt: angle by which the rig is turned about the joint's axis [rad].
        usual: whether it stays within the limits of the motor.
    """

    description: str
    motor: FloatArray
    joint: FloatArray
    pretension: float = 1.0
    tilt: float = 0.0
    usual: bool = True


def motions(
    bench: Bench, swing: float, rate: float, load: float | None = None
) -> list[CataloguedTrial]:
    """Return trials within these limits, one of twice the swing and one turned.

    They go to and fro about `middle_angle`.

    Args:
        bench: the rig.
        swing: largest angle of the motor to either side of the middle [rad].
        rate: largest speed of the motor [rad/s].
        load: stiffness of a known load that the joint turns in every trial [N m/rad].
    """
    from scipy.ndimage import gaussian_filter1d

    ratio = bench.motor_radius / bench.joint_radius
    wind = wind_up_angle(bench)
    motor_middle = middle_angle(bench, swing)
    (joint_middle,) = bench.carried(np.array([motor_middle]))

    def free(motor: FloatArray) -> FloatArray:
        """Change of the joint's angle as the motor carries it along."""
        found: FloatArray = bench.carried(motor_middle + motor) - joint_middle
        return found

    time = np.arange(0.0, MOTION_DURATION, MOTION_STEP)

    def triangle(size: float, speed: float | FloatArray) -> FloatArray:
        phase = (
            np.cumsum(np.broadcast_to(speed, time.shape)) * MOTION_STEP / (4.0 * size)
        )
        wave = size * (1.0 - 4.0 * np.abs((phase + 0.25) % 1.0 - 0.5))
        # No motor turns in an instant.
        found: FloatArray = gaussian_filter1d(
            wave, TURN_ROUNDING_TIME / MOTION_STEP, mode="nearest"
        )
        return found

    steps = np.repeat((0.02, 0.06, 0.2, 0.5, 1.0), -(-time.size // 5))[: time.size]
    ladder = triangle(swing, rate * steps)
    loudness = min(0.3 * swing, rate / (2.0 * np.pi * 3.3))
    chirp = loudness * np.sin(2.0 * np.pi * (0.1 * time + 0.04 * time**2))
    cable = bench.cables[0]
    # The spring takes what loosens one cable nearly and tightens the other as much.
    stretch = (
        SPRING_LOAD_SHARE * cable.pretension / cable.axial_stiffness * cable.length
    )
    give = 1.0 - stretch / (ratio * swing * bench.joint_radius)
    sweep = triangle(swing, rate * 0.2)
    dwell = swing * np.interp(
        time, [0, 1, 2, 3, 6, 7, 15, 16, 38, 39, 40], [0, 1, 1, 0, 0, 1, 1, 0, 0, 1, 1]
    )
    small = triangle(2.0 * wind, rate * 0.1)
    still = np.zeros(time.size)

    def taut(motor: FloatArray) -> FloatArray:
        """Return the motor angle, shifted to one side if there is only one cable."""
        if len(bench.cables) == 2:
            return motor
        found: FloatArray = 0.5 * (motor - motor.min())
        return found

    if load is not None:
        stiffness = len(bench.cables) * cable.axial_stiffness / cable.length
        kept = 1.0 / (1.0 + load / (stiffness * bench.joint_radius**2))
        found = [
            CataloguedTrial(
                f"joint turning its load, {how}", each, free(kept * each), share
            )
            for how, each, share in (
                ("triangles at five speeds", ladder, 1.0),
                ("chirp from 0.1 to 3 Hz", chirp, 1.0),
                ("moves with rests of 1, 3, 8 and 22 s", dwell, 1.0),
                ("small reversals within the wind-up of the cable", small, 1.0),
                ("slow triangle over the whole range, pretension halved", sweep, 0.5),
            )
        ]
        return [_centre_motion(each, motor_middle, joint_middle) for each in found]
    found = [
        CataloguedTrial(
            "joint free, triangles at five speeds from 2 % to 100 % of the fastest",
            ladder,
            free(ladder),
        ),
        CataloguedTrial("joint free, chirp from 0.1 to 3 Hz", chirp, free(chirp)),
        CataloguedTrial(
            "joint free, moves with rests of 1, 3, 8 and 22 s", dwell, free(dwell)
        ),
        CataloguedTrial(
            "joint locked, slow triangles of the motor a few times its wind-up",
            taut(triangle(4.0 * wind, wind)),
            still,
        ),
        CataloguedTrial(
            "joint locked, small reversals of the motor within its wind-up",
            taut(small),
            still,
        ),
        CataloguedTrial(
            "motor locked, joint moved slowly to and fro by hand",
            still,
            triangle(4.0 * wind * ratio, wind),
        ),
        CataloguedTrial(
            "joint free, slow triangle over the whole range, pretension halved",
            sweep,
            free(sweep),
            0.5,
        ),
        CataloguedTrial(
            "joint free, slow triangle over twice the range, if the rig allows",
            triangle(2.0 * swing, rate * 0.2),
            free(triangle(2.0 * swing, rate * 0.2)),
            usual=False,
        ),
        CataloguedTrial(
            "joint free, slow triangle over the whole range, the rig turned by 90 "
            f"degrees about the joint's axis (`tilt = {QUARTER_TURN:.3f}`), if it "
            "allows",
            sweep,
            free(sweep),
            tilt=QUARTER_TURN,
        ),
        CataloguedTrial(
            "joint locked, slow triangles, pretension halved",
            taut(triangle(4.0 * wind, wind)),
            still,
            0.5,
        ),
        CataloguedTrial(
            "joint against a spring, triangles at five speeds",
            ladder,
            free(give * ladder),
        ),
        CataloguedTrial(
            "joint against a spring, chirp from 0.1 to 3 Hz",
            chirp,
            free(give * chirp),
        ),
    ]
    return [_centre_motion(each, motor_middle, joint_middle) for each in found]


def middle_angle(bench: Bench, swing: float) -> float:
    """Return the angle of the motor about which it can go to and fro by a swing [rad].

    That is where the joint is in the middle of its named motions, or else what is
    nearest to it with the joint where the scene knows it.
    """
    low, high = np.sort(bench.following(np.array(bench.span)))
    if high - low < 2.0 * swing:
        return 0.5 * float(low + high)
    middle = float(bench.following(np.array([bench.centre]))[0])
    return min(max(middle, float(low) + swing), float(high) - swing)


def _centre_motion(
    motion: CataloguedTrial, motor: float, joint: float
) -> CataloguedTrial:
    """Return the same motion about these angles of motor and joint [rad]."""
    return replace(motion, motor=motor + motion.motor, joint=joint + motion.joint)
