"""The environment `cc_mujoco/AnkleExo-v0`."""

from __future__ import annotations

from pathlib import Path

from cc_mujoco.human import Task, Trajectory, Wearer

from .device import Setup
from .scalar import ExoEnv
from .vector import ExoVectorEnv

SETUP = Setup(
    scene="ankle",
    joint="ankle",
    reach=0.3,
    torque_scale=10.0,
    bounds={
        "motor_angle_rad": 20.0,
        "motor_velocity_rad_s": 500.0,
        "joint_angle_rad": 1.0,
        "joint_velocity_rad_s": 20.0,
        "joint_torque_nm": 1000.0,
        "desired_torque_nm": 1000.0,
        "phase_sine": 1.0,
        "phase_cosine": 1.0,
    },
    companions={"hip": "wearer_hip", "knee": "wearer_knee"},
)


class AnkleExo(ExoEnv):
    r"""A motor pulls the heel of a walking wearer through one long Bowden cable.

    ## Description

    An off-board motor with a drum of 25 mm pulls a heel lever through the conduit
    `plantarflexor`, past hip and knee. One cable only pulls: it plantarflexes the
    ankle, and hangs slack when the motor has paid out enough. The wearer moves ankle,
    hip and knee along a gait cycle, as springs and dampers pulling the joints to it.
    The device should make the wearer feel the task: by default, help with push-off.

    ## Action space

    `Box(-1, 1, (1,), float32)`: torque of the motor; 1 is 50 Nm at its drum, 240 Nm of
    plantarflexion at the ankle if there were no friction. Positive winds the cable,
    negative pays it out until the drum is at its stop. Values outside are clipped.
    `unwrapped.action(torque)` makes the action of a torque in Nm.

    ## Observation space

    `Box(8, float64)`: what the device can measure. Sensors saturate at their range.

    | | observation | range | unit |
    |-|-------------|-------|------|
    | 0 | angle of the motor | +-20 | rad |
    | 1 | velocity of the motor | +-500 | rad/s |
    | 2 | angle of the ankle, dorsiflexion positive | +-1 | rad |
    | 3 | velocity of the ankle | +-20 | rad/s |
    | 4 | torque of the cable on the ankle, plantarflexion negative | +-1000 | Nm |
    | 5 | desired torque | +-1000 | Nm |
    | 6 | sine of the phase of the gait cycle | +-1 | 1 |
    | 7 | cosine of the phase of the gait cycle | +-1 | 1 |

    The phase is 0 at heel strike; of a trajectory other than `walk` it is that of its
    own period. Where the wearer aims is for the wearer to know; it is in `info` only.

    ## Reward

    `reward = reward_tracking + reward_effort`, both in `info`, at most 0:

    - `reward_tracking` = \(-((\tau_j - \tau_d) / 10\,\text{Nm})^2\) with the torque of
      the cable on the ankle \(\tau_j\) and the desired torque \(\tau_d\);
    - `reward_effort` = \(-0.001\,a^2\) with the clipped action \(a\).

    ## Info

    After every reset and step a fresh dictionary with the columns of an episode log
    (`cc_mujoco.recording.columns`): time, angles, velocities, torques, the wearer's
    reference; the cable's true tensions at both ends and at the nodes, the part that
    slips and the direction of slip of every segment, slack, dissipated energy; and
    `qpos`. Angles and velocities are those at that time, torques and tensions those
    that acted in the physics step before it (0.5 ms).

    ## Start and end

    An episode starts at rest at the first pose of the trajectory, the cable at
    pretension. Random trajectories are drawn from `np_random`, so a seed determines an
    episode. It is truncated after `duration`, and terminated only if MuJoCo warns that
    the simulation has become unstable. Actions of another shape or not finite are a
    `CableError`.

    ## Arguments

    | argument | default | meaning |
    |----------|---------|---------|
    | `trajectory` | `"walk"` | the wearer's motion: a name, CSV file or `Trajectory` |
    | `task` | `"assist"` | what the wearer should feel: a name or a `Task` |
    | `duration` | 10 | length of an episode [s] |
    | `frame_skip` | 2 | physics steps of 0.5 ms in a control step: control at 1 kHz |
    | `wearer` | `None` | a `Wearer`; by default 2 kNm/rad and 20 Nm s/rad (scene) |
    | `render_mode` | `None` | `None` or `"rgb_array"` |

    Names are those of `cc_mujoco.human`: `TRAJECTORIES`, scaled down to 0.3 rad where
    they go further, and `TASKS`. Hip and knee rest at 0 unless the trajectory moves
    them. The wearer's command changes with every physics step; `wearer` is that of the
    ankle.

    ## Version history

    - v0: first version.
    """

    SETUP = SETUP

    def __init__(
        self,
        trajectory: str | Path | Trajectory = "walk",
        task: str | Task = "assist",
        duration: float = 10.0,
        frame_skip: int = 2,
        wearer: Wearer | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Load the scene; the arguments are those of the class documentation."""
        super().__init__(trajectory, task, duration, frame_skip, wearer, render_mode)


class AnkleExoVector(ExoVectorEnv):
    """Many `AnkleExo` environments in one batch; see `ExoVectorEnv`."""

    SETUP = SETUP

    def __init__(
        self,
        num_envs: int = 1,
        trajectory: str | Path | Trajectory = "walk",
        task: str | Task = "assist",
        duration: float = 10.0,
        frame_skip: int = 2,
        wearer: Wearer | None = None,
        render_mode: str | None = None,
        max_episode_steps: int | None = None,
        threads: int = 0,
    ) -> None:
        """Load the scene; arguments as in `AnkleExo` and `ExoVectorEnv`."""
        super().__init__(
            num_envs,
            trajectory,
            task,
            duration,
            frame_skip,
            wearer,
            render_mode,
            max_episode_steps,
            threads,
        )
