"""Error of a cable at the model's own time step, with explicit and with implicit ends.

    python scripts/benchmarks/check_step.py [--armature 2e-4] [--seconds 2]

On models that Gymnasium brings, with the torso held and no contacts, so that the cable
alone is measured; then free and in contact. A motor (`--armature`, drum of 30 mm) pulls
each joint by a lever of 50 mm through 1 m of cable that wraps half a turn (friction
0.1, 50 segments), at 100 N more or less 80 N. Printed are the largest RMS error of an
end tension, in percent of its largest, and the ratio of what friction took, against a
step 32 times shorter, for explicit ends and as they are by default; and the time of a
step over that of a step with explicit ends.

Explicit and by default: half-cheetah (10 ms, EA 50 kN) 1690 and 3.0 %, ant (the same,
RK4) 1210 and 3.0 %, humanoid (3 ms, RK4, 150 kN) 16 and 1.7 %; free and in contact the
default errs by 0.8 to 3.1 %.
"""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import mujoco
import numpy as np
import tyro

from cc_mujoco import Cable, Section, read
from cc_mujoco.cable import ENDS
from cc_mujoco.plugin import settle, to_mjcf

FINER = 32
DRUM, LEVER = 0.03, 0.05
PULL, SWING, FREQUENCY = 100.0, 80.0, 0.5

GYMNASIUM = Path(gymnasium.__file__).parent / "envs/mujoco/assets"


class Case(NamedTuple):
    """Joints of a model that get a cable, and its stiffness EA [N]."""

    model: Path
    joints: tuple[str, ...]
    stiffness: float


CASES = (
    Case(GYMNASIUM / "half_cheetah.xml", ("bthigh", "bshin", "bfoot"), 5e4),
    Case(GYMNASIUM / "ant.xml", ("hip_1", "ankle_1"), 5e4),
    Case(GYMNASIUM / "hopper.xml", ("leg_joint", "foot_joint"), 1.5e5),
    Case(GYMNASIUM / "walker2d.xml", ("leg_joint", "foot_joint"), 1.5e5),
    Case(GYMNASIUM / "humanoid.xml", ("right_knee", "right_elbow"), 1.5e5),
)


def with_cables(case: Case, ends: str, armature: float, held: bool) -> Any:
    spec = mujoco.MjSpec.from_file(str(case.model))
    if held:
        for body in spec.worldbody.bodies:
            for joint in list(body.joints):
                spec.delete(joint)
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    cable = Cable(
        conduit=(Section(1.0, 1.0 / math.pi),), axial_stiffness=case.stiffness,
        friction=0.1, pretension=PULL, segments=50, ends=ends,
    )  # fmt: skip
    for joint in case.joints:
        motor = f"{joint}_motor"
        body = spec.worldbody.add_body(name=motor, mass=0.1, inertia=[1e-6] * 3)
        body.add_joint(
            name=motor, armature=armature, limited=0, stiffness=0, damping=0,
            frictionloss=0,
        )  # fmt: skip
        to_mjcf(spec, joint, cable, (motor, DRUM), (joint, LEVER))
        for end in ("proximal", "distal"):
            spec.actuator(f"{joint}_{end}").forcelimited = 0
    return spec.compile()


def run(model: Any, case: Case, seconds: float) -> tuple[Any, float, float]:
    """Return end tensions [N], energy lost to friction [J] and time of a step [s]."""
    data = mujoco.MjData(model)
    settle(model, data)
    dofs = [model.joint(f"{joint}_motor").dofadr[0] for joint in case.joints]
    steps = round(seconds / model.opt.timestep)
    tension = np.empty((steps, 2 * len(case.joints)))
    started = time.perf_counter()
    for step in range(steps):
        for k, dof in enumerate(dofs):
            phase = 2.0 * math.pi * FREQUENCY * data.time + k
            data.qfrc_applied[dof] = -DRUM * (PULL + SWING * math.sin(phase))
        mujoco.mj_step(model, data)
        readings = (read(model, data, joint) for joint in case.joints)
        ends = [(r.tension_proximal, r.tension_distal) for r in readings]
        tension[step] = np.ravel(ends)
    spent = (time.perf_counter() - started) / steps
    lost = sum(float(read(model, data, j).dissipated) for j in case.joints)
    return tension, lost, spent


def main(armature: float = 2e-4, seconds: float = 2.0) -> None:
    """Simulate all cases and print them; `armature` is that of the motors [kg m^2]."""
    print(f"{'':24}{'explicit':>26}{'by default':>26}  time of a step, ratio")
    for held in (True, False):
        print("torso held, no contacts" if held else "free and in contact")
        for case in CASES:
            fine = with_cables(case, ENDS[0], armature, held)
            step = fine.opt.timestep
            fine.opt.timestep = step / FINER
            right, lost, _ = run(fine, case, seconds)
            right = right[::FINER]
            cells, spent = [], []
            for ends in reversed(ENDS):
                model = with_cables(case, ends, armature, held)
                found, taken, each = run(model, case, seconds)
                both = min(len(found), len(right))
                error = np.sqrt(((found[:both] - right[:both]) ** 2).mean(axis=0))
                worst = 100.0 * (error / right.max(axis=0)).max()
                cells.append(f"{worst:14.2f} % {taken / lost:9.2f}")
                spent.append(each)
            name = f"{case.model.stem} {1e3 * step:g} ms"
            print(f"{name:24}{''.join(cells)}  {spent[1] / spent[0]:.2f}", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
