"""Tendons of `cc_mujoco.add_friction`: each piece has a tension, and slips at bends."""

from __future__ import annotations

import cc_mujoco
from tendon_suite.plain_mujoco import ROPE, InMuJoCo, specify
from tendon_suite.tasks import Machine, Setting


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


_STEPS = {"cycles": 2e-4, "finger": 2e-4}


class _Engine:
    def settings(self, task: str, tune: bool) -> list[Setting]:
        stiffness, step = 4e5 if task == "cycles" else 1e5, _STEPS.get(task, 1e-3)
        best = {"timestep": step, "segments": 8, "axial_stiffness": stiffness}
        tried = [
            {"segments": segments, "axial_stiffness": share * stiffness}
            for segments in (2, 4, 8)
            for share in (0.1, 0.3, 1.0)
        ]
        return [best, *(best | change for change in tried if tune)]

    def build(self, machine: Machine, setting: Setting) -> _Simulation:
        return _Simulation(machine, setting)


ENGINES = {"cc_mujoco": _Engine()}
