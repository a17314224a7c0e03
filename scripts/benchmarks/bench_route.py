"""Cost of a conduit that follows its route, against the same conduit with fixed bends.

    python scripts/benchmarks/bench_route.py

The ankle scene walks in three versions by turns in one process: bends fixed, bends of
the route, and no cable at all. Prints ratios of steps per second, and the ratio of what
the cable alone costs; bare times are of this machine only.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import mujoco
import numpy as np
import tyro
from turns import by_turns, quickest

from cc_mujoco import plugin
from cc_mujoco.assets import scene_path
from cc_mujoco.human import GAIT_ANGLES, GAIT_PERIOD

CABLE = "plantarflexor"
MOVERS = {"ankle": "wearer", "hip": "wearer_hip", "knee": "wearer_knee"}


def scene(bend: str | None, more: dict[str, float]) -> mujoco.MjModel:
    """Return the ankle scene with this kind of conduit bend, or without a cable."""
    spec = mujoco.MjSpec.from_file(str(scene_path("ankle")))
    if bend is None:
        for sensor in spec.sensors:
            if sensor.objname.startswith(CABLE):
                sensor.objname = "motor"
        for actuator in list(spec.actuators):
            if actuator.plugin.active:
                spec.delete(actuator)
    else:
        cable = plugin.from_mjcf(spec)[CABLE]
        plugin.to_mjcf(spec, CABLE, cable.replace(bend=bend, **more))
    return spec.compile()


def walker(model: mujoco.MjModel, steps: int) -> Callable[[], float]:
    """Return a function that simulates a walking leg and returns seconds per step."""
    data = mujoco.MjData(model)
    controls = {joint: data.actuator(name) for joint, name in MOVERS.items()}
    motor = data.actuator("motor")
    each = 10
    at = 0
    pulls = CABLE in plugin.cables(model)

    def turn() -> float:
        nonlocal at
        spent = 0.0
        for _ in range(steps // each):
            at += each
            phase = (at * model.opt.timestep / GAIT_PERIOD) % 1.0
            for joint, control in controls.items():
                control.ctrl[0] = GAIT_ANGLES[joint](phase)
            # Against its damping and stop, so that the cable is taut most of the time.
            motor.ctrl[0] = 4.0 + 3.0 * np.sin(2.0 * np.pi * phase)
            motor.ctrl[0] *= pulls
            begin = time.thread_time()
            mujoco.mj_step(model, data, each)
            spent += time.thread_time() - begin
        return spent / steps

    return turn


def main(steps: int = 1000, rounds: int = 101, segments: int = 30) -> None:
    """Print the ratios.

    Args:
        steps: steps per turn.
        rounds: turns of each version.
        segments: of the cable.
    """
    terms = {
        "Coulomb friction": {},
        "with viscous friction": {"viscous_friction": 10.0},
    }
    for name, term in terms.items():
        more = term | {"segments": segments}
        bends = (None, "fixed", "route")
        turns = {bend: walker(scene(bend, more), steps) for bend in bends}
        cost = quickest(by_turns(turns, rounds))
        cable = {bend: cost[bend] - cost[None] for bend in cost}
        whole = cost["fixed"] / cost["route"]
        print(f"ankle scene, {segments} segments, {name}:")
        print(f"  steps per second, moving / fixed route   {whole:.2f}")
        print(
            "  cost of the cable alone, moving / fixed  "
            f"{cable['route'] / cable['fixed']:.1f}   "
            f"({cable['route'] * 1e6:.1f} and {cable['fixed'] * 1e6:.1f} us a step, "
            f"the scene without it {cost[None] * 1e6:.1f} us)"
        )


if __name__ == "__main__":
    tyro.cli(main)
