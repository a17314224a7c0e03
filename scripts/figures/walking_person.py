"""Changes of a walking person by an ankle exoskeleton and by its cable's losses.

    python scripts/figures/walking_person.py
    MUJOCO_GL=egl python scripts/figures/walking_person.py --picture envs/walking.png

prints a table of `cc_mujoco/Walking-v0`: without help, with ropes that lose nothing,
and through conduits without and with friction; means over the strides of 30 s but the
first ten, in which the person learns what to expect. The picture shows a stride.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import gymnasium
import numpy as np
from matplotlib.image import imsave
from numpy.typing import NDArray

from cc_mujoco.envs._strides import Stride, mean_stride
from cc_mujoco.human._walking_body import CABLE
from cc_mujoco.report import _markdown as markdown

DURATION, LEARNT = 30.0, 10
CONDITIONS = {
    "ropes unhooked": {"transmission": "none"},
    "lossless": {"transmission": "ideal"},
    "conduit without friction": {"cable": CABLE.replace(friction=0.0)},
    "conduit, friction 0.1": {},
    "conduit, friction 0.2": {"cable": CABLE.replace(friction=0.2)},
}
ROWS = (
    ("step length [m]", lambda s: s.step_length.mean()),
    ("step time [s]", lambda s: s.step_time.mean()),
    ("positive work of the ankles [J]", lambda s: s.positive_work[:, 2].sum()),
    ("... of hips and knees", lambda s: s.positive_work[:, :2].sum()),
    (
        "estimated metabolic energy [J/m]",
        lambda s: s.metabolic_power * s.time / s.length,
    ),
    ("work of the ropes on the ankles [J]", lambda s: s.assistance.sum()),
    ("positive work of the motors [J]", lambda s: s.motors.sum()),
)


def walked(**arguments: object) -> Stride:
    env = gymnasium.make(
        "cc_mujoco/Walking-v0", duration=DURATION, disable_env_checker=True, **arguments
    ).unwrapped
    env.reset(seed=0)
    over = fallen = False
    while not (over or fallen):
        _, _, fallen, over, _ = env.step(env.assistance())
    if fallen:
        raise SystemExit(f"the person fell with {arguments}")
    return mean_stride(env.strides[LEARNT:])


def picture(count: int = 6) -> NDArray[np.uint8]:
    env = gymnasium.make(
        "cc_mujoco/Walking-v0", render_mode="rgb_array", disable_env_checker=True
    ).unwrapped
    env.reset(seed=0)
    found: list[NDArray[np.uint8]] = []
    while len(found) < count:
        *_, info = env.step(env.assistance())
        if info["strides"] >= 5 and info["phase"][0] >= len(found) / count:
            found.append(env.render()[72:446, 280:580])
    env.close()
    return np.concatenate(found, axis=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()
    if options.picture:
        imsave(options.picture, picture())
        return
    strides = {name: walked(**given) for name, given in CONDITIONS.items()}
    rows = [
        [name, *(f"{measure(stride):.2f}" for stride in strides.values())]
        for name, measure in ROWS
    ]
    print(markdown.table(["per stride, both legs", *strides], rows))


if __name__ == "__main__":
    main()
