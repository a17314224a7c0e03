"""Tendons of `cc_mujoco.add_friction`: each piece has a tension, and slips at bends."""

from __future__ import annotations

import cc_mujoco
from tendon_suite.plain_mujoco import ROPE, InMuJoCo, specify
from tendon_suite.tasks import Engine, Machine, Setting


class _Simulation(InMuJoCo):
    def __init__(self, machine: Machine, setting: Setting) -> None:
        bends, arc = len(machine.bends), setting["segments"]
        spec = specify(machine, setting["timestep"])
        # A site between two arcs is a segment, too, without a turn.
        cc_mujoco.add_friction(
            spec, ROPE, motor=("pull", machine.drum) if machine.drum else None,
            friction=min(machine.friction, 2.0), segments=arc * bends + bends - 1,
            axial_stiffness=setting["axial_stiffness"], pretension=machine.tension,
        )  # fmt: skip
        super().__init__(machine, spec.compile())


def _settings(task: str, tune: bool) -> list[Setting]:
    stiffness = 4e5 if task == "cycles" else 1e5
    step = 2e-4 if task in ("cycles", "finger") else 1e-3
    best = {"timestep": step, "segments": 8, "axial_stiffness": stiffness}
    tried = [
        best | {"segments": segments, "axial_stiffness": share * stiffness}
        for segments in (2, 4, 8)
        for share in (0.1, 0.3, 1.0)
    ]
    return [best, *(tried if tune else [])]


ENGINES = {"cc_mujoco": Engine(_settings, _Simulation)}
