"""Check whether a controller judges designs, or itself: ranks of designs with several.

    python scripts/benchmarks/check_ranks.py --scene ankle

Plays a Latin hypercube of designs with controllers of fixed gains and with controllers
that follow from each design, and prints how far they agree on which design is better
(Spearman's rank correlation).
"""

from __future__ import annotations

import itertools
from typing import Literal

import numpy as np
import tyro
from scipy.stats import spearmanr
from tqdm import tqdm

from cc_mujoco._utils.command_options import progress_options
from cc_mujoco.design import study

VARY = {
    "ankle": {
        "friction": "0.03:0.2",
        "wrap": "0.8:6",
        "motor_radius": "0.01:0.05",
        "joint_radius": "0.06:0.18",
        "pretension": "5:40",
        "axial_stiffness": "30000:300000:log",
    },
    "wrist": {
        "friction": "0.02:0.2",
        "loops": "0.25:2.5",
        "motor_radius": "0.01:0.03",
        "pretension": "3:50",
        "axial_stiffness": "2000:20000:log",
        "rotor_inertia": "1e-5:2e-4:log",
    },
}
DURATION = {"ankle": 5.0, "wrist": 6.0}  # length of an episode [s]
LAWS = ("pi", "pi_tuned", "model")
METRICS = ("rms_torque_error", "peak_motor_power")


def main(
    scene: Literal["ankle", "wrist"] = "ankle",
    designs: int = 60,
    duration: float | None = None,
    threads: int = 0,
) -> None:
    """Print a table per metric.

    Args:
        scene: name of the device.
        designs: of the Latin hypercube.
        duration: of an episode; default 5 s, wrist 6 s.
        threads: 0 is one per processor.
    """
    with tqdm(total=designs, **progress_options()) as bar:
        table = study(
            scene, VARY[scene], sampling="lhs", samples=designs, controllers=LAWS,
            duration=duration or DURATION[scene], metrics=METRICS, threads=threads,
            progress=lambda done: bar.update(done - bar.n),
        )  # fmt: skip

    for name in METRICS:
        found = {
            law: np.array(table[f"{name}@{law}"].to_pylist(), float) for law in LAWS
        }
        for one, other in itertools.combinations(LAWS, 2):
            both = np.isfinite(found[one]) & np.isfinite(found[other])
            rank = spearmanr(found[one][both], found[other][both]).statistic
            print(f"{scene}, {name}, {one} and {other}: {rank:.2f} of {both.sum()}")


if __name__ == "__main__":
    tyro.cli(main)
