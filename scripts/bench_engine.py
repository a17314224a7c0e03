"""Steps per second of the wrist scene with cables against an ideal transmission.

    python scripts/bench_engine.py

Both models are the same scene with the same joints, motor, wearer and number of
sensors. In one, two cables join motor and wrist; in the other the motor's torque acts
on the wrist through an ideal gear, which costs MuJoCo nothing (`ideal`), or the two
angles are tied by an equality constraint (`equality`). They run by turns in one
process, so that what else the machine does falls on all; then a batch of simulations
runs on one thread and on two. Prints ratios; bare times are of this machine only.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import mujoco
import numpy as np
from mujoco.batch import Batch

from cc_mujoco import engine
from cc_mujoco.assets import scene_path

ROUNDS = 15
"""Turns that each contestant takes."""


def main() -> None:
    """Print the ratios."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=4000, help="steps per turn")
    parser.add_argument("--simulations", type=int, default=64, help="in a batch")
    arguments = parser.parse_args()
    steps, count = arguments.steps, arguments.simulations

    cables = mujoco.MjSpec.from_file(str(scene_path("wrist"))).compile()
    segments = [c.segments for c in engine.from_mjcf(cables).values()]
    rivals = {"cables": cables, "ideal": ideal(False), "equality": ideal(True)}
    rates = compare({name: single(m, steps) for name, m in rivals.items()})
    print(f"wrist scene, cables of {segments} segments, steps per second:")
    for name, rate in rates.items():
        print(f"  {name:10} {rate:10.0f}")
    print(
        f"cables / ideal         {rates['cables'] / rates['ideal']:.2f}   (goal 0.75)"
    )
    print(f"cables / equality      {rates['cables'] / rates['equality']:.2f}")

    batches = {
        f"{threads} threads": batched(cables, count, threads, max(steps // count, 1))
        for threads in (1, 2)
    }
    rates = compare(batches)
    ratio = rates["2 threads"] / rates["1 threads"]
    print(f"batch of {count}, 2 / 1 threads   {ratio:.2f}   (goal 1.8)")


def ideal(equality: bool) -> mujoco.MjModel:
    """The wrist scene without cables: an ideal gear, or an equality constraint."""
    spec = mujoco.MjSpec.from_file(str(scene_path("wrist")))
    gears = {a.name: a.gear[0] for a in spec.actuators}
    ratio = gears["flexor_distal"] / gears["flexor_proximal"]
    for sensor in spec.sensors:
        if sensor.objname.startswith(("flexor_", "extensor_")):
            sensor.objname = "motor"
    for actuator in list(spec.actuators):
        if actuator.plugin.active:
            spec.delete(actuator)
    if equality:
        spec.add_equality(
            type=mujoco.mjtEq.mjEQ_JOINT,
            name1="motor",
            name2="wrist",
            data=[0.0, ratio] + [0.0] * 10,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
        )
    else:
        gear = spec.add_tendon(name="ideal")
        gear.wrap_joint("motor", 1.0)
        gear.wrap_joint("wrist", ratio)
        motor = spec.actuator("motor")
        motor.trntype = mujoco.mjtTrn.mjTRN_TENDON
        motor.target = "ideal"
    return spec.compile()


def single(model: mujoco.MjModel, steps: int) -> Callable[[], float]:
    """A turn of one simulation, its motor driven back and forth; steps per second."""
    data = mujoco.MjData(model)
    motor = model.actuator("motor").id
    phase = 0.0

    def turn() -> float:
        nonlocal phase
        start = time.perf_counter()
        for _ in range(steps // 10):
            phase += 0.02
            data.ctrl[motor] = 0.8 * np.sin(phase)
            mujoco.mj_step(model, data, 10)
        return steps / (time.perf_counter() - start)

    return turn


def batched(
    model: mujoco.MjModel, count: int, threads: int, steps: int
) -> Callable[[], float]:
    """A turn of a batch; simulation steps per second."""
    batch = Batch(model, count, nthread=threads)
    ctrl = batch.bind("ctrl")
    motor = model.actuator("motor").id
    phase = np.linspace(0.0, 6.0, count)

    def turn() -> float:
        start = time.perf_counter()
        for _ in range(steps):
            phase[:] += 0.02
            ctrl[:, motor] = 0.8 * np.sin(phase)
            batch.step(nstep=10)
        return 10 * count * steps / (time.perf_counter() - start)

    return turn


def compare(contestants: dict[str, Callable[[], float]]) -> dict[str, float]:
    """Steps per second of each: the median of its turns, the first one left out."""
    rates: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(ROUNDS + 1):
        for name, turn in contestants.items():
            rates[name].append(turn())
    return {name: float(np.median(found[1:])) for name, found in rates.items()}


if __name__ == "__main__":
    main()
