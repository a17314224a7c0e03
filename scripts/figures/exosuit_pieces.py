"""Torques of an exosuit's open cable on hip and knee, and those of a single tension.

    python scripts/figures/exosuit_pieces.py

prints a table: torques of cable `thigh` over a stride of the scene `exosuit`, with the
tension of each piece where it pulls, and with that of one of its ends all along.
"""

from __future__ import annotations

import gymnasium
import mujoco
import numpy as np
from numpy.typing import NDArray

import cc_mujoco  # noqa: F401, registers the environments
from cc_mujoco.control import CONTROLLERS
from cc_mujoco.human import GAIT_PERIOD
from cc_mujoco.report import _markdown as markdown

JOINTS = {"hip": "wearer", "knee": "wearer_knee"}
"""Joints that the cable passes, and who else acts on them."""
LAW, WARM_UP = "pi", 1.0 + GAIT_PERIOD


def stride() -> NDArray[np.float64]:
    """Return torques by pieces, by the winch's and the shin's (samples, joints, 3)."""
    env = gymnasium.make(
        "cc_mujoco/HipKneeExosuit-v2",
        duration=WARM_UP + GAIT_PERIOD,
        disable_env_checker=True,
    ).unwrapped
    model, data = env.model, env.data
    law = CONTROLLERS[LAW](env.drive)
    law.reset()
    _, info = env.reset(seed=0)
    rows, over = [], False
    while not over:
        *_, over, info = env.step(env.action(law.torque(info)))
        ends = (info["tension_thigh_proximal_n"], info["tension_thigh_distal_n"])
        if info["time_s"] > WARM_UP:
            rows.append([felt(model, data, joint, ends) for joint in JOINTS])
    return np.array(rows)


def felt(
    model: mujoco.MjModel, data: mujoco.MjData, joint: str, ends: tuple[float, float]
) -> list[float]:
    """Return a cable's joint torque by pieces, and with either end's tension."""
    place = int(model.joint(joint).dofadr[0])
    passive = data.qfrc_passive - data.qfrc_spring - data.qfrc_damper
    own = data.qfrc_actuator[place] - data.actuator(JOINTS[joint]).force[0]
    arm = np.zeros((model.nu, model.nv))
    mujoco.mju_sparse2dense(
        arm, data.actuator_moment, data.moment_rownnz, data.moment_rowadr,
        data.moment_colind,
    )  # fmt: skip
    lever = -arm[model.actuator("thigh_distal").id, place]
    return [own + passive[place], *(lever * tension for tension in ends)]


def table(torques: NDArray[np.float64]) -> str:
    """Return the Markdown of what a stride has of each joint."""
    rows = []
    for place, joint in enumerate(JOINTS):
        pieces, winch, shin = torques[:, place].T
        off = (np.abs(other - pieces).max() for other in (winch, shin))
        rows.append((joint, *(f"{x:.1f}" for x in (pieces.max(), *off))))
    return markdown.table(
        (
            "joint",
            "largest torque [N m]",
            "off by, were all tension the winch's",
            "off by, were it the shin's",
        ),
        rows,
        numbers=[1, 2, 3],
    )


if __name__ == "__main__":
    print(table(stride()))
