"""Compilation by Numba, once for all tests: a minute on two cores.

Each worker would otherwise compile the code again. As a script, it compiles one part.
"""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
STUDY = HERE.parent / "scripts" / "diagnosis_study"
STILL = [0.0, 0.0]


def compile_all() -> int:
    """Compile every part, two at a time, and return the last one that failed, or 0."""
    # The rigs' equations are compiled apart from the package's.
    others = [_beside("rigs")]
    _kernel()
    # The plugin takes longest: what it has no use for is compiled beside it.
    others.append(_beside("laws"))
    _plugin()
    return max(abs(other.wait()) for other in others)


def _beside(part: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-P", str(Path(__file__)), part],
        env=os.environ | {"PYTHONPATH": os.pathsep.join((str(STUDY), str(HERE)))},
    )


def _kernel() -> None:
    import cc_mujoco.cable._pack
    import cc_mujoco.cable._stepper  # noqa: F401, compiles it


def _transmission() -> None:
    from cc_mujoco.cable import Cable, Transmission, replay

    cable = Cable()
    replay(cable, 1e-3, u_proximal=STILL, u_distal=STILL)
    pulleys = Transmission.pull_pull(cable, motor_radius=0.02, joint_radius=0.05)
    pulleys.replay(1e-3, motor_angle=STILL, joint_angle=STILL)


def _plugin() -> None:
    import cc_mujoco.plugin  # noqa: F401, compiles it


def _laws() -> None:
    """Compile transmissions, controllers, their export and the predecessor models."""
    _transmission()
    from cc_mujoco.control import CONTROLLERS, controller
    from cc_mujoco.device import TENSION_COLUMN, Sensing
    from cc_mujoco.export import EXPORTED, TARGETS, ExportPlan, write
    from cc_mujoco.export import _files as files
    from cc_mujoco.thesis import BristleChain, Distributed, EndSpring
    from cc_mujoco.thesis.predecessors import (
        LuGreChain,
        LumpedMasses,
        PassiveDistributed,
    )
    from control.devices import cable, pull_pull

    known = dataclasses.replace(pull_pull(), inertia=1e-4)
    drive = Sensing(torque_noise=0.01, tension_noise=0.1).equip(known)
    seen: dict[str, Any] = dict.fromkeys(
        (
            "motor_angle_rad",
            "motor_velocity_rad_s",
            "joint_angle_rad",
            "joint_velocity_rad_s",
            "joint_torque_nm",
            "desired_torque_nm",
        ),
        0.0,
    )
    seen[TENSION_COLUMN] = np.full((2, 3), 10.0)
    several = {name: np.tile(value, 2) for name, value in seen.items()}
    several[TENSION_COLUMN] = np.full((2, 2, 3), 10.0)
    for name in CONTROLLERS:
        for columns in (seen, several):
            controller(name, drive).torque(columns)
    for kind in (
        BristleChain, Distributed, LumpedMasses, LuGreChain, PassiveDistributed,
    ):  # fmt: skip
        kind(cable()).replay(1e-3, STILL, EndSpring(500.0))
    files.emit = lambda *_: b""  # machine code, which nothing keeps
    with tempfile.TemporaryDirectory() as folder:
        for name in EXPORTED:
            write(
                folder,
                ExportPlan.of(name, [drive], [("one", "two")]),
                TARGETS["host"],
                name,
            )


def _rigs() -> None:
    from rig.dataset import make_trials, run, truth_of
    from rig.nominal import make_rig

    trial = make_trials("rich", 0)[0]
    trial = dataclasses.replace(
        trial, command=trial.command[:2], target=trial.target[:2]
    )
    for make in ("bristles", "guides"):  # others are studied only
        rig = make_rig(0, make=make)
        run(truth_of(rig, {}, 0), rig, trial)


if __name__ == "__main__":
    {"rigs": _rigs, "laws": _laws}[sys.argv[1]]()
