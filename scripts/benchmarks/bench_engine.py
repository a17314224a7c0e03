"""Steps per second of the wrist scene with cables against an ideal transmission.

    python scripts/benchmarks/bench_engine.py

Both models are the same scene with the same joints, motor, wearer and number of
sensors. In one, two cables join motor and wrist; in the other the motor's torque acts
on the wrist through an ideal gear, which costs MuJoCo nothing (`ideal`), or the two
angles are tied by an equality constraint (`equality`). They run by turns in one
process, so that what else the machine does falls on all; then a batch of simulations
runs on one thread and on two. Prints ratios; bare times are of this machine only.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import mujoco
import numpy as np
import tyro
from mujoco.batch import Batch
from turns import by_turns

from cc_mujoco import plugin
from cc_mujoco.assets import scene_path

ROUNDS = 101  # turns that each contestant takes


def main(steps: int = 1000, simulations: int = 64) -> None:
    """Print the ratios.

    Args:
        steps: steps per turn.
        simulations: in a batch.
    """
    cables = mujoco.MjSpec.from_file(str(scene_path("wrist"))).compile()
    segments = [c.segments for c in plugin.from_mjcf(cables).values()]
    rivals = {"cables": cables, "ideal": ideal(False), "equality": ideal(True)}
    rates = compare({name: single(m, steps) for name, m in rivals.items()})
    print(f"wrist scene, cables of {segments} segments, steps per second:")
    for name, rate in rates.items():
        print(f"  {name:10} {np.median(rate):10.0f}")
    for name in ("ideal", "equality"):
        goal = "   (goal 0.75)" if name == "ideal" else ""
        print(f"cables / {name:20} {ratio(rates['cables'], rates[name]):.2f}{goal}")

    for name in ("cables", "ideal"):
        batches = {
            str(threads): batched(rivals[name], simulations, threads, steps)
            for threads in (1, 2)
        }
        rates = compare(batches)
        goal = "   (goal 1.8)" if name == "cables" else ""
        print(
            f"batch of {simulations}, {name}, threads 2 / 1  "
            f"{ratio(rates['2'], rates['1']):.2f}{goal}"
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
            type=mujoco.mjtEq.mjEQ_JOINT,
            name1="motor",
            name2="wrist",
            data=[0.0, gear] + [0.0] * 10,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
        )
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


def compare(contestants: dict[str, Callable[[], float]]) -> dict[str, np.ndarray]:
    """Return the steps per second of each contestant in all rounds but the first."""
    spent = by_turns(contestants, ROUNDS, first=1)
    return {name: 1.0 / times for name, times in spent.items()}


def ratio(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Return the median over the rounds of the ratio of two turns of the same round."""
    return float(np.median(ours / theirs))


if __name__ == "__main__":
    tyro.cli(main)
