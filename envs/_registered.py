"""Environments by their ids, with their observations and rewards."""

from __future__ import annotations

from cc_mujoco.device._registry import DEVICES

from ._scalar import ExoEnv
from ._vector import ExoVectorEnv


class WristHandle(ExoEnv):
    """A motor moves the wrist of a wearer through two Bowden cables.

    ## Description

    The test bed of A. Borowski, "Model-based control of remote actuation based on
    cable-conduit transmissions", section 2.4: a motor with a 20 mm pulley pulls a
    handle with a 104 mm pulley through two conduits of 2 m, `flexor` and `extensor`.
    The wearer moves the handle along a trajectory, as a spring and a damper pulling the
    wrist to it. The device should make the wearer feel a virtual environment: the task
    maps the motion of the wrist to a desired torque. Friction, stretch and slack of the
    cables stand in the way.

    ## Action space

    `Box(-1, 1, (1,), float32)`: torque of the motor; 1 is 1 N m at its pulley, 5.2 N m
    at the wrist if there were no friction. Positive pulls the wrist into flexion.
    Values outside are clipped. `unwrapped.action(torque)` makes the action of a torque
    in N m.

    ## Observation space

    That of `ExoEnv`, with 6 numbers in a frame. What counts as 1:
    0.02 rad of twist, 2 rad/s, 0.5 rad of flexion, 1 N m. Where the
    wearer aims is for the wearer to know; it is in `info` only.

    ## Reward

    That of `ExoEnv`; an error of 1 N m costs 1 per second.

    ## Arguments

    Those of `ExoEnv`: `trajectory` is `"sweep"` and `task` `"tunnel"` by default,
    `wearer` 50 N m/rad and 0.8 N m s/rad. Named trajectories are scaled down to 1 rad.

    ## Version history

    - v1: observations of the size of 1, reward per second, plants that are drawn.
    """

    SETUP = DEVICES["wrist"]


class WristHandleVector(ExoVectorEnv):
    """Many `WristHandle` environments in one batch; see `ExoVectorEnv`."""

    SETUP = DEVICES["wrist"]


class AnkleExo(ExoEnv):
    """A motor pulls the heel of a walking wearer through one long Bowden cable.

    ## Description

    An off-board motor with a drum of 25 mm pulls a heel lever through the conduit
    `plantarflexor`, past hip and knee. One cable only pulls: it plantarflexes the
    ankle, and hangs slack when the motor has paid out enough. The wearer moves ankle,
    hip and knee along a gait cycle, as springs and dampers pulling the joints to it.
    The device should make the wearer feel the task: by default, help with push-off.

    ## Action space

    `Box(-1, 1, (1,), float32)`: torque of the motor; 1 is 50 N m at its drum, 240 N m
    of plantarflexion at the ankle if there were no friction. Positive winds the cable,
    negative pays it out until the drum is at its stop. Values outside are clipped.
    `unwrapped.action(torque)` makes the action of a torque in N m.

    ## Observation space

    That of `ExoEnv`, with 8 numbers in a frame. What counts as 1:
    0.2 rad of twist, 2 rad/s, 0.2 rad of dorsiflexion, 5 N m of error and 10 N m of
    desired torque (plantarflexion negative). The phase is 0 at heel strike; of a
    trajectory other than `walk` it is that of its own period. Where the
    wearer aims is for the wearer to know; it is in `info` only.

    ## Reward

    That of `ExoEnv`; an error of 5 N m costs 1 per second.

    ## Arguments

    Those of `ExoEnv`: `trajectory` is `"walk"` and `task` `"assist"` by default,
    `wearer` (of the ankle) 2 kN m/rad and 20 N m s/rad. Named trajectories are scaled
    down to 0.3 rad. Hip and knee rest at 0 unless the trajectory moves them.

    ## Version history

    - v1: observations of the size of 1, reward per second, plants that are drawn.
    """

    SETUP = DEVICES["ankle"]


class AnkleExoVector(ExoVectorEnv):
    """Many `AnkleExo` environments in one batch; see `ExoVectorEnv`."""

    SETUP = DEVICES["ankle"]


class TendonFinger(ExoEnv):
    """A winch extends a finger by an open tendon over post, guide and knuckle.

    ## Description

    A motor with a drum of 8 mm pulls the tendon `extensor`, which no conduit leads: it
    lies over a fixed post, runs through a guide and over the knuckle, and where it is
    bent it rubs. A tendon only pulls: it extends the finger, and hangs slack when the
    motor has paid out enough. The wearer moves the finger along a trajectory, as a
    spring and a damper pulling it there, against a weak spring that curls it. The
    device should hold a torque at the knuckle, whichever way the tendon slides: by
    default 0.15 N m, 2.7 N at a fingertip 55 mm away.

    ## Action space

    `Box(-1, 1, (1,), float32)`: torque of the motor; 1 is 0.4 N m at its drum, 0.6 N m
    of extension at the finger if there were no friction. Positive winds the tendon,
    negative pays it out until the drum is at its stop. Values outside are clipped.
    `unwrapped.action(torque)` makes the action of a torque in N m.

    ## Observation space

    That of `ExoEnv`, with 6 numbers in a frame. What counts as 1:
    0.05 rad of twist, 2 rad/s, 0.5 rad of flexion (0 half flexed), 0.1 N m (extension
    negative). Where the
    wearer aims is for the wearer to know; it is in `info` only.

    ## Reward

    That of `ExoEnv`; an error of 0.1 N m costs 1 per second.

    ## Arguments

    Those of `ExoEnv`: `trajectory` is `"sine"` and `task` `"hold"` by default, `wearer`
    2 N m/rad and 0.02 N m s/rad. Named trajectories are scaled down to 0.6 rad.

    ## Version history

    - v1: observations of the size of 1, reward per second, plants that are drawn.
    """

    SETUP = DEVICES["finger"]


class TendonFingerVector(ExoVectorEnv):
    """Many `TendonFinger` environments in one batch; see `ExoVectorEnv`."""

    SETUP = DEVICES["finger"]


class HipKneeExosuit(ExoEnv):
    """A motor at the waist pulls hip and knee of a walking wearer by one open cable.

    ## Description

    A soft exosuit. A winch of 18 mm at the front of the belt pulls the cable `thigh`,
    which no conduit leads: it lies over two guides on the thigh and the cap of a knee
    brace and ends at the shin. It bends the hip and straightens the knee, each with the
    tension of the piece that passes it, and only pulls. A second motor at the belt
    pulls a lever at the heel through the cable `heel`, in a conduit as far as the
    shank; it follows the gait by itself, with up to 8 N m at push-off, and is not an
    action. The wearer moves hip, knee and ankle along a gait cycle, as springs and
    dampers pulling the joints to it. The device should make the wearer feel the task at
    the hip: by default, help with the swing of the leg. What it does at the knee comes
    with it.

    ## Action space

    `Box(-1, 1, (1,), float32)`: torque of the motor of the thigh's cable; 1 is 6 N m at
    its drum, 40 N m of flexion at the hip. Positive winds the cable, negative pays it
    out until the drum is at its stop. Values outside are clipped.
    `unwrapped.action(torque)` makes the action of a torque in N m.

    ## Observation space

    That of `ExoEnv`, with 8 numbers in a frame. What counts as 1:
    0.5 rad of twist, 2 rad/s, 0.5 rad of hip flexion, 1 N m of error and 5 N m of
    desired torque. The phase is 0 at heel strike; of a
    trajectory other than `walk` it is that of its own period. Where the
    wearer aims is for the wearer to know; it is in `info` only.

    ## Reward

    That of `ExoEnv`; an error of 1 N m costs 1 per second.

    ## Arguments

    Those of `ExoEnv`: `trajectory` is `"walk"` and `task` `"swing"` by default,
    `wearer` (of the hip) 6 kN m/rad and 200 N m s/rad. Named trajectories are scaled
    down to 0.5 rad. Knee and ankle rest at 0 unless the trajectory moves them.

    ## Version history

    - v1: observations of the size of 1, reward per second, plants that are drawn.
    """

    SETUP = DEVICES["exosuit"]


class HipKneeExosuitVector(ExoVectorEnv):
    """Many `HipKneeExosuit` environments in one batch; see `ExoVectorEnv`."""

    SETUP = DEVICES["exosuit"]
