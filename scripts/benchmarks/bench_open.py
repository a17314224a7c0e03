"""Cost of a cable on an open path, against a guided one and a tendon without friction.

    python scripts/benchmarks/bench_open.py

The finger pulls its tendon, of six pieces, in versions by turns in one process. Prints
ratios of steps per second and of what the cable alone costs.
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

NAME = "extensor"
VERSIONS = {
    "none": None,
    "ideal": None,
    "fixed": {"path": "guided", "bend": "fixed"},
    "route": {"path": "guided", "bend": "route"},
    "open": {"path": "open"},
}
EACH = 10


def scene(version: str, segments: int) -> mujoco.MjModel:
    """Return the finger with a cable, a directly pulled tendon, or only its winch."""
    spec = mujoco.MjSpec.from_file(str(scene_path("finger")))
    change = VERSIONS[version]
    if change is not None:
        cable = plugin.from_mjcf(spec)[NAME]
        plugin.to_mjcf(spec, NAME, cable.replace(segments=segments, **change))
        return spec.compile()
    for element in [*spec.sensors, *spec.actuators]:
        spec.delete(element)
    pull = spec.add_actuator(
        name="motor", target=NAME if version == "ideal" else "motor"
    )
    pull.trntype = mujoco.mjtTrn.mjTRN_JOINT
    pull.gear = [0.0] * 6  # a winch that pulls nothing would run into its stop
    if version == "ideal":
        pull.trntype = mujoco.mjtTrn.mjTRN_TENDON
        pull.gear[0] = -1.0 / 0.008
    return spec.compile()


def player(model: mujoco.MjModel, steps: int) -> Callable[[], float]:
    """Return a function that simulates and returns the processor time per step [s]."""
    data = mujoco.MjData(model)

    def turn() -> float:
        spent = 0.0
        for _ in range(steps // EACH):
            data.ctrl[0] = 0.08 + 0.07 * np.sin(6.0 * data.time)
            begin = time.thread_time()
            mujoco.mj_step(model, data, EACH)
            spent += time.thread_time() - begin
        return spent / steps

    return turn


def main(segments: int = 20, steps: int = 1000, rounds: int = 101) -> None:
    """Print the ratios.

    Args:
        segments: of the cable.
        steps: steps per turn.
        rounds: turns of each version.
    """
    turns = {name: player(scene(name, segments), steps) for name in VERSIONS}
    cost = quickest(by_turns(turns, rounds))
    alone = {name: cost[name] - cost["none"] for name in cost}
    rows = {
        "cost of the cable, open / fixed bends": alone["open"] / alone["fixed"],
        "cost of the cable, open / moving route": alone["open"] / alone["route"],
        "steps per second, open / fixed bends": cost["fixed"] / cost["open"],
        "steps per second, open / ideal tendon": cost["ideal"] / cost["open"],
    }
    print(f"finger, {segments} segments over 6 pieces:")
    for name, ratio in rows.items():
        print(f"  {name:40} {ratio:.2f}")


if __name__ == "__main__":
    tyro.cli(main)
