"""Steps per second of a batch of the wrist scene on two threads against one.

    python scripts/benchmarks/bench_engine.py

With its cables, and with an ideal gear in their place, which costs MuJoCo nothing: the
same scene with the same joints, motor, wearer and number of sensors, where the motor's
torque acts on the wrist. Both numbers of threads run by turns in one process. Prints
ratios; `bench_steps.py` has those of single simulations.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import mujoco
import numpy as np
import tyro
from mujoco.batch import Batch
from turns import by_turns

from cc_mujoco.assets import scene_path

ROUNDS = 101  # turns that each contestant takes


def main(steps: int = 1000, simulations: int = 64) -> None:
    """Print the ratios.

    Args:
        steps: steps per turn.
        simulations: in a batch.
    """
    cables = mujoco.MjModel.from_xml_path(str(scene_path("wrist")))
    for name, model in {"cables": cables, "ideal": ideal(False)}.items():
        turns = {n: batched(model, simulations, n, steps) for n in (1, 2)}
        spent = by_turns(turns, ROUNDS, first=1)
        print(
            f"batch of {simulations}, {name}, threads 2 / 1  "
            f"{np.median(spent[1] / spent[2]):.2f}"
        )


def ideal(equality: bool) -> mujoco.MjModel:
    """Return the wrist scene with an ideal gear or equality constraint, not cables."""
    spec = mujoco.MjSpec.from_file(str(scene_path("wrist")))
    gears = {a.name: a.gear[0] for a in spec.actuators}
    gear = gears["flexor_distal"] / gears["flexor_proximal"]
    for sensor in spec.sensors:
        if sensor.objname.startswith(("flexor_", "extensor_")):
            sensor.objname = "motor"
    for actuator in list(spec.actuators):
        if actuator.plugin.active:
            spec.delete(actuator)
    if equality:
        spec.add_equality(
            type=mujoco.mjtEq.mjEQ_JOINT, name1="motor", name2="wrist",
            data=[0.0, gear] + [0.0] * 10, objtype=mujoco.mjtObj.mjOBJ_JOINT,
        )  # fmt: skip
    else:
        tendon = spec.add_tendon(name="ideal")
        tendon.wrap_joint("motor", 1.0)
        tendon.wrap_joint("wrist", gear)
        motor = spec.actuator("motor")
        motor.trntype = mujoco.mjtTrn.mjTRN_TENDON
        motor.target = "ideal"
    return spec.compile()


def single(model: mujoco.MjModel, steps: int) -> Callable[[], float]:
    """Return a function that simulates and returns the processor time per step [s]."""
    data = mujoco.MjData(model)
    motor = model.actuator("motor").id
    phase = 0.0

    def turn() -> float:
        nonlocal phase
        start = time.thread_time()
        for _ in range(steps // 10):
            phase += 0.02
            data.ctrl[motor] = 0.8 * np.sin(phase)
            mujoco.mj_step(model, data, 10)
        return (time.thread_time() - start) / steps

    return turn


def batched(
    model: mujoco.MjModel, count: int, threads: int, steps: int
) -> Callable[[], float]:
    """Return a function that steps a batch and returns the time per step [s]."""
    batch = Batch(model, count, nthread=threads)
    ctrl = batch.bind("ctrl")
    motor = model.actuator("motor").id
    phase = np.linspace(0.0, 6.0, count)

    each = max(4 * steps // count, 1)

    def turn() -> float:
        phase[:] += 0.05
        ctrl[:, motor] = 0.8 * np.sin(phase)
        start = time.perf_counter()
        batch.step(nstep=each)
        return (time.perf_counter() - start) / (count * each)

    return turn


if __name__ == "__main__":
    tyro.cli(main)
