"""The environments by their ids, each with what it observes and rewards."""

from __future__ import annotations

from cc_mujoco.devices import DEVICES

from .scalar import ExoEnv
from .vector import ExoVectorEnv


class WristHandle(ExoEnv):
    r"""A motor moves the wrist of a wearer through two Bowden cables.

    ## Description

    The test bed of A. Borowski, "Model-based control of remote actuation based on
    cable-conduit transmissions", section 2.4: a motor with a 20 mm pulley pulls a
    handle with a 104 mm pulley through two conduits of 2 m, `flexor` and `extensor`.
    The wearer moves the handle along a trajectory, as a spring and a damper pulling the
    wrist to it. The device should make the wearer feel a virtual environment: the task
    maps the motion of the wrist to a desired torque. Friction, stretch and slack of the
    cables stand in the way.

    ## Action space

    `Box(-1, 1, (1,), float32)`: torque of the motor; 1 is 1 Nm at its pulley, 5.2 Nm at
    the wrist if there were no friction. Positive pulls the wrist into flexion. Values
    outside are clipped. `unwrapped.action(torque)` makes the action of a torque in Nm.

    ## Observation space

    `Box(6, float64)`: what the device can measure. Sensors saturate at their range.

    | | observation | range | unit |
    |-|-------------|-------|------|
    | 0 | angle of the motor | +-10 | rad |
    | 1 | velocity of the motor | +-500 | rad/s |
    | 2 | angle of the wrist, flexion positive | +-1.5 | rad |
    | 3 | velocity of the wrist | +-20 | rad/s |
    | 4 | torque of the cables on the wrist | +-50 | Nm |
    | 5 | desired torque | +-50 | Nm |

    Where the wearer aims is for the wearer to know; it is in `info` only.

    ## Reward

    `reward = reward_tracking + reward_effort`, both in `info`, at most 0:

    - `reward_tracking` = \(-((\tau_j - \tau_d) / 0.1\,\text{Nm})^2\) with the torque of
      the cables on the wrist \(\tau_j\) and the desired torque \(\tau_d\);
    - `reward_effort` = \(-0.001\,a^2\) with the clipped action \(a\).

    ## Info

    After every reset and step a fresh dictionary with the columns of an episode log
    (`cc_mujoco.recording.columns`): time, angles, velocities, torques, the wearer's
    reference; for each cable the true tensions at both ends and at the nodes, the part
    that slips and the direction of slip of every segment, slack, dissipated energy; and
    `qpos`. Angles and velocities are those at that time, torques and tensions those
    that acted in the physics step before it (0.5 ms).

    ## Start and end

    An episode starts at rest at the first angle of the trajectory, both cables at
    pretension. Random trajectories are drawn from `np_random`, so a seed determines an
    episode. It is truncated after `duration`, and terminated only if MuJoCo warns that
    the simulation has become unstable. Actions of another shape or not finite are a
    `CableError`.

    ## Arguments

    | argument | default | meaning |
    |----------|---------|---------|
    | `trajectory` | `"sweep"` | the wearer's motion: a name, CSV file or `Trajectory` |
    | `task` | `"tunnel"` | what the wearer should feel: a name or a `Task` |
    | `duration` | 10 | length of an episode [s] |
    | `frame_skip` | 2 | physics steps of 0.5 ms in a control step: control at 1 kHz |
    | `wearer` | `None` | a `Wearer`; by default 50 Nm/rad and 0.8 Nm s/rad (scene) |
    | `render_mode` | `None` | `None` or `"rgb_array"` |
    | `model` | `None` | a variant of the scene, compiled |

    Names are those of `cc_mujoco.human`: `TRAJECTORIES`, scaled down to 1 rad where
    they go further, and `TASKS`. The wearer's command changes with every physics step.

    ## Version history

    - v0: first version.
    """

    SETUP = DEVICES["wrist"]


class WristHandleVector(ExoVectorEnv):
    """Many `WristHandle` environments in one batch; see `ExoVectorEnv`."""

    SETUP = DEVICES["wrist"]


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
    | `model` | `None` | a variant of the scene, compiled |

    Names are those of `cc_mujoco.human`: `TRAJECTORIES`, scaled down to 0.3 rad where
    they go further, and `TASKS`. Hip and knee rest at 0 unless the trajectory moves
    them. The wearer's command changes with every physics step; `wearer` is that of the
    ankle.

    ## Version history

    - v0: first version.
    """

    SETUP = DEVICES["ankle"]


class AnkleExoVector(ExoVectorEnv):
    """Many `AnkleExo` environments in one batch; see `ExoVectorEnv`."""

    SETUP = DEVICES["ankle"]
