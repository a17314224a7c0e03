"""Check whether a controller judges designs, or itself: ranks of designs with several.

    python scripts/benchmarks/check_ranks.py --scene ankle

Plays a Latin hypercube of designs with controllers of fixed gains and with controllers
that follow from each design, and prints how far they agree on which design is better
(Spearman's rank correlation), and how many designs each makes worse than no controller.
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
LAWS = ("none", "pi", "pi_tuned", "model")
METRICS = (
    "rms_torque_error", "peak_motor_power", "peak_motor_torque", "slack_share",
    "efficiency",
)  # fmt: skip


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

    def column(name: str, law: str) -> np.ndarray:
        return np.array(table[f"{name}@{law}"].to_pylist(), float)

    for name in METRICS:
        found = {law: column(name, law) for law in LAWS}
        print(f"{scene}, {name}")
        for law, values in found.items():
            worse = int(np.sum(values > found["none"] * (1.0 + 1e-6)))
            lacking = int(np.isnan(values).sum())
            print(
                f"  {law:20} median {np.nanmedian(values):8.3g}, greatest "
                f"{np.nanmax(values):8.3g}, above none in {worse}, none in {lacking}"
            )
        for one, other in itertools.combinations(LAWS, 2):
            both = np.isfinite(found[one]) & np.isfinite(found[other])
            rank = spearmanr(found[one][both], found[other][both]).statistic
            print(f"  rank correlation {one}, {other}: {rank:.2f} of {both.sum()}")
    print(f"{scene}, efficiency against tracking error")
    for law in LAWS:
        share, error = column("efficiency", law), column("rms_torque_error", law)
        has = np.isfinite(share)
        rank = spearmanr(share[has], error[has]).statistic
        print(f"  {law:20} rank correlation {rank:.2f} of {has.sum()}")


if __name__ == "__main__":
    tyro.cli(main)
