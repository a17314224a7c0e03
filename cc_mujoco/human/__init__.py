"""The scripted human: what moves the joint, how stiffly, and what should be felt."""

from __future__ import annotations

from cc_mujoco.human.body import Body
from cc_mujoco.human.motion import Motion, Scripted, Trajectory
from cc_mujoco.human.moves import Ramp, Reach, Reversals, Sweep
from cc_mujoco.human.pace import Pace
from cc_mujoco.human.paced import Paced, paced
from cc_mujoco.human.perturbed import Perturbed
from cc_mujoco.human.profile import Profile
from cc_mujoco.human.recorded import Recorded, from_csv
from cc_mujoco.human.tasks import (
    TASKS,
    Assist,
    Hold,
    Spring,
    Swing,
    Task,
    Transparent,
    Tunnel,
    task,
)
from cc_mujoco.human.trajectories import TRAJECTORIES, trajectory
from cc_mujoco.human.walking import Walk
from cc_mujoco.human.waves import Chirp, Multisine, Sine
from cc_mujoco.human.wearer import ActuatorGains, Wearer

__all__ = [
    "TASKS",
    "TRAJECTORIES",
    "ActuatorGains",
    "Assist",
    "Body",
    "Chirp",
    "Hold",
    "Motion",
    "Multisine",
    "Pace",
    "Paced",
    "Perturbed",
    "Profile",
    "Ramp",
    "Reach",
    "Recorded",
    "Reversals",
    "Scripted",
    "Sine",
    "Spring",
    "Sweep",
    "Swing",
    "Task",
    "Trajectory",
    "Transparent",
    "Tunnel",
    "Walk",
    "Wearer",
    "from_csv",
    "paced",
    "task",
    "trajectory",
]
