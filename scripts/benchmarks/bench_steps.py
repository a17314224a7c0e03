"""Steps per second of scenes with cables against the same scenes without their cost.

    python scripts/benchmarks/bench_steps.py

Scenes take turns in one process. Prints median and middle half of the ratios of time in
the same round: cables against ideal transmissions, a conduit that follows its route and
an open path against fixed bends, and a batch on two threads against one.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import mujoco
import numpy as np
import tyro
from mujoco.batch import Batch
from turns import by_turns, spread

from cc_mujoco import plugin
from cc_mujoco.assets import scene_path
from cc_mujoco.human import GAIT_ANGLES, GAIT_PERIOD

EACH = 10  # steps between two commands
LEG = {"ankle": "wearer", "hip": "wearer_hip", "knee": "wearer_knee"}
Command = Callable[[mujoco.MjData], None]


def with_cable(scene: str, name: str, **changes: object) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_file(str(scene_path(scene)))
    cable = plugin.from_mjcf(spec)[name]
    plugin.to_mjcf(spec, name, cable.replace(**changes))
    return spec.compile()


def ideal_wrist() -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_file(str(scene_path("wrist")))
    gears = {a.name: a.gear[0] for a in spec.actuators}
    for sensor in spec.sensors:
        if sensor.objname.startswith(("flexor_", "extensor_")):
            sensor.objname = "motor"
    for actuator in list(spec.actuators):
        if actuator.plugin.active:
            spec.delete(actuator)
    tendon = spec.add_tendon(name="ideal")
    tendon.wrap_joint("motor", 1.0)
    tendon.wrap_joint("wrist", gears["flexor_distal"] / gears["flexor_proximal"])
    motor = spec.actuator("motor")
    motor.trntype = mujoco.mjtTrn.mjTRN_TENDON
    motor.target = "ideal"
    return spec.compile()


def ideal_finger() -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_file(str(scene_path("finger")))
    for element in [*spec.sensors, *spec.actuators]:
        spec.delete(element)
    pull = spec.add_actuator(name="motor", target="extensor")
    pull.trntype = mujoco.mjtTrn.mjTRN_TENDON
    pull.gear = [-1.0 / 0.008] + [0.0] * 5
    return spec.compile()


def hands(ideal: bool) -> mujoco.MjModel:
    """Return five hands with four open cables each, or with `ideal` tendons instead."""
    spec = mujoco.MjSpec.from_file(str(scene_path("hand")))
    for k in range(1, 5):
        other = mujoco.MjSpec.from_file(str(scene_path("hand")))
        place = spec.worldbody.add_frame(pos=[0.0, 0.2 * k, 0.0])
        spec.attach(other, prefix=f"{k}_", frame=place)
    for cable in spec.plugins:
        cable.config = {**cable.config, "route": cable.name}
    for actuator in list(spec.actuators if ideal else []):
        if actuator.plugin.active:
            for sensor in spec.sensors:
                if sensor.objname == actuator.name:
                    sensor.objname = spec.actuators[0].name
            spec.delete(actuator)
        elif "motor_" in actuator.name:
            actuator.trntype = mujoco.mjtTrn.mjTRN_TENDON
            actuator.target = actuator.target.replace("drum_", "")
            actuator.gear = [-1.0 / 0.008] + [0.0] * 5
    return spec.compile()


def turn_wrist(data: mujoco.MjData) -> None:
    data.actuator("motor").ctrl[0] = 0.8 * np.sin(40.0 * data.time)


def pull_finger(data: mujoco.MjData) -> None:
    data.ctrl[0] = 0.08 + 0.07 * np.sin(6.0 * data.time)


def pull_hands(data: mujoco.MjData) -> None:
    motors = np.arange(data.ctrl.size) % (data.ctrl.size // 5) < 4
    phase = np.linspace(0.0, 6.0, np.count_nonzero(motors))
    data.ctrl[motors] = 0.08 + 0.07 * np.sin(6.0 * data.time + phase)


def walk(data: mujoco.MjData) -> None:
    phase = (data.time / GAIT_PERIOD) % 1.0
    for joint, name in LEG.items():
        data.actuator(name).ctrl[0] = GAIT_ANGLES[joint](phase)
    # Against its damping and stop, so that the cable is taut most of the time.
    data.actuator("motor").ctrl[0] = 4.0 + 3.0 * np.sin(2.0 * np.pi * phase)


def single(model: mujoco.MjModel, command: Command, steps: int) -> Callable[[], float]:
    """Return a function that simulates; it returns processor time per step [s]."""
    data = mujoco.MjData(model)

    def turn() -> float:
        spent = 0.0
        for _ in range(steps // EACH):
            command(data)
            begin = time.thread_time()
            mujoco.mj_step(model, data, EACH)
            spent += time.thread_time() - begin
        return spent / steps

    return turn


def batched(
    model: mujoco.MjModel, count: int, threads: int, steps: int
) -> Callable[[], float]:
    """Return a function that steps a batch and returns the real time per step [s]."""
    batch = Batch(model, count, nthread=threads)
    ctrl, motor = batch.bind("ctrl"), model.actuator("motor").id
    phase, each = np.linspace(0.0, 6.0, count), max(4 * steps // count, 1)

    def turn() -> float:
        phase[:] += 0.05
        ctrl[:, motor] = 0.8 * np.sin(phase)
        begin = time.perf_counter()
        batch.step(nstep=each)
        return (time.perf_counter() - begin) / (count * each)

    return turn


def main(steps: int = 1000, rounds: int = 101, simulations: int = 64) -> None:
    """Print the ratios.

    Args:
        steps: steps per turn.
        rounds: turns of each scene.
        simulations: in a batch.
    """
    wrist = mujoco.MjModel.from_xml_path(str(scene_path("wrist")))
    finger = {"name": "extensor", "segments": 20}
    ankle = {"name": "plantarflexor", "segments": 30}
    thick = {**ankle, "viscous_friction": 10.0}
    fixed = with_cable("finger", **finger, path="guided", bend="fixed")
    models: dict[str, tuple[mujoco.MjModel, Command]] = {
        "wrist": (wrist, turn_wrist),
        "ideal wrist": (ideal_wrist(), turn_wrist),
        "open": (with_cable("finger", **finger, path="open"), pull_finger),
        "fixed": (fixed, pull_finger),
        "ideal finger": (ideal_finger(), pull_finger),
        "hands": (hands(ideal=False), pull_hands),
        "ideal hands": (hands(ideal=True), pull_hands),
        "moving": (with_cable("ankle", **ankle, bend="route"), walk),
        "still": (with_cable("ankle", **ankle, bend="fixed"), walk),
        "moving, viscous": (with_cable("ankle", **thick, bend="route"), walk),
        "still, viscous": (with_cable("ankle", **thick, bend="fixed"), walk),
    }
    turns = {name: single(*made, steps) for name, made in models.items()}
    for threads in (1, 2):
        turns[f"{threads} threads"] = batched(wrist, simulations, threads, steps)
    cost = by_turns(turns, rounds, first=1)
    for title, ours, theirs in (
        ("wrist: two cables / ideal gear", "wrist", "ideal wrist"),
        ("finger: open cable / ideal tendon", "open", "ideal finger"),
        ("finger: open cable / fixed bends", "open", "fixed"),
        ("hands: 20 open cables / ideal tendons", "hands", "ideal hands"),
        ("ankle: moving route / fixed bends", "moving", "still"),
        ("the same, viscous friction", "moving, viscous", "still, viscous"),
        (f"batch of {simulations} wrists: 2 threads / 1", "2 threads", "1 threads"),
    ):
        print(f"{title:38} {spread(cost[theirs] / cost[ours])}")


if __name__ == "__main__":
    tyro.cli(main)
