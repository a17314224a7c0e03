"""Does a controlled joint stay quiet in the hands of any passive wearer?

    python scripts/benchmarks/check_passivity.py --wearers 6

The wearer is a spring and a damper of random size to a reference, with a random inertia
at the joint; he moves to one side and then holds still. From then on nobody does work
on the joint but the device. What the device puts into it, less what a virtual spring
still holds, is energy that a passive device does not have; and a loop that is unstable
with this wearer, or has a limit cycle, moves the joint on and on. The sensors are those
of the benchmark, noise and delay included. Prints for every controller the largest
energy and the largest velocity that is left, over all wearers.
"""

from __future__ import annotations

import argparse
from typing import Any

import gymnasium
import mujoco
import numpy as np

import cc_mujoco  # noqa: F401, registers the environments
from cc_mujoco.assets import scene_path
from cc_mujoco.control import CONTROLLERS, controller
from cc_mujoco.devices import DEVICES
from cc_mujoco.episode import Single, Trace, run
from cc_mujoco.human import Wearer
from cc_mujoco.human.moves import Sweep
from cc_mujoco.sensing import Measuring

MOVE, SETTLE, HOLD = 0.4, 0.4, 0.8
"""Time of the move, for what it stirred up to die away, and of what is judged [s]."""


def coupled(scene: str, law: str, task: str, seed: int) -> tuple[float, float]:
    """One wearer, drawn with the seed, who moves and then holds still.

    Args:
        scene: Name of the device's scene.
        law: Name of the controller.
        task: Name of the virtual environment.
        seed: Of wearer and noise.

    Returns:
        Energy that the device put into the joint while it was held, beyond what the
        virtual environment gave back [J]; RMS of the joint's velocity then [rad/s].
    """
    device = DEVICES[scene]
    random = np.random.default_rng([seed, 3])
    model = mujoco.MjModel.from_xml_path(str(scene_path(device.scene)))
    place = model.joint(device.joint)
    inertia = float(model.dof_M0[place.dofadr[0]])
    model.dof_armature[place.dofadr[0]] += inertia * random.uniform(0.0, 2.0)
    stiffness = float(model.actuator("wearer").gainprm[0])
    stiffness *= float(np.exp(random.uniform(np.log(0.1), np.log(3.0))))
    ratio = float(np.exp(random.uniform(np.log(0.1), np.log(1.0))))
    damping = ratio * 2.0 * float(np.sqrt(stiffness * 2.0 * inertia))
    env: Any = gymnasium.make(
        device.environment,
        disable_env_checker=True,
        trajectory=Sweep(0.5 * device.reach, MOVE, 10.0),
        task=task,
        duration=MOVE + SETTLE + HOLD,
        wearer=Wearer(stiffness, damping),
        model=model,
    )
    drive = env.unwrapped.drive
    plant = Single(env, seed)
    names = (
        "joint_velocity_rad_s",
        "joint_torque_nm",
        "desired_torque_nm",
    )
    trace = Trace(names, plant.steps)
    driven = env.unwrapped.exo.device.driven
    measuring = Measuring(device.sensing, drive, driven, seed, plant.steps)
    run(plant, controller(law, drive), trace.keep, measure=measuring.measure)
    env.close()
    first = round((MOVE + SETTLE) / drive.period)
    velocity, torque, desired = (trace.columns[name][first:] for name in names)
    power = (torque - desired) * velocity
    return float(np.sum(power) * drive.period), float(np.sqrt(np.mean(velocity**2)))


def main() -> None:
    """Try all controllers with all wearers."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", default="wrist", choices=sorted(DEVICES))
    parser.add_argument("--task", default="spring")
    parser.add_argument("--wearers", type=int, default=6)
    parser.add_argument("--controllers", nargs="+", default=list(CONTROLLERS))
    arguments = parser.parse_args()
    print("controller    largest energy [mJ]    largest velocity [rad/s]")
    for law in arguments.controllers:
        found = [
            coupled(arguments.scene, law, arguments.task, seed)
            for seed in range(arguments.wearers)
        ]
        energy, velocity = np.max(found, axis=0)
        print(f"{law:12}  {1e3 * energy:19.3f}    {velocity:24.4f}", flush=True)


if __name__ == "__main__":
    main()
