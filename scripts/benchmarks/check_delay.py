"""Does a model still pay where sensors are late and its friction is believed wrong?

    python scripts/benchmarks/check_delay.py --scenes wrist ankle --seeds 4

The ordinary condition of the benchmark, its plants drawn anew, with one delay for all
and the same error of what the model believes of friction. RMS error of the joint torque
as mean over the seeds, that in swing beside it (where no torque is asked for), and how
many times less it is than that of `pi`.
"""

from __future__ import annotations

import argparse
import dataclasses

import numpy as np

from cc_mujoco.benchmark import SUITES, Belief, Cell, play
from cc_mujoco.report import table

DELAYS = (0, 5, 10)
"""Delays of all sensors [control steps, of 1 ms]."""
WRONG = (-0.5, 0.0, 0.5)
"""Relative error of the friction that is believed."""
MODELS = ("stiction", "predictive", "adaptive")
NOTHING, LEAST = 1e-3, 0.2
"""Share of the greatest torque that is none, and of the time to speak of a swing."""
SPREAD = 0.1
"""Relative error of all else that is believed."""


def errors(
    scene: str, law: str, delay: int, wrong: float, seeds: int
) -> tuple[float, float, float]:
    """Return the RMS error, that in swing [N m] and share of episodes that failed."""
    condition = next(
        c for c in SUITES["v1"].conditions(scene) if c.name == "ordinary-rough"
    )
    late = dataclasses.replace(condition, delay=(delay, delay))
    belief = Belief(SPREAD, wrong)
    played = play(Cell(late, law, tuple(range(seeds)), belief=belief))
    desired = played.trace["desired_torque_nm"]
    missed = played.trace["joint_torque_nm"] - desired
    swing = np.abs(desired) < NOTHING * np.abs(desired).max()
    rests = swing.mean() > LEAST
    return (
        float(np.mean(played.scores["rms_torque_error"])),
        float(np.sqrt(np.mean(missed[swing] ** 2))) if rests else np.nan,
        float(np.mean(played.scores["failed"])),
    )


def main() -> None:
    """Play all and print a table per scene."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", nargs="+", default=["wrist", "ankle"])
    parser.add_argument("--seeds", type=int, default=4)
    given = parser.parse_args()
    for scene in given.scenes:
        rows = []
        for delay in DELAYS:
            usual, swing, failed = errors(scene, "pi", delay, 0.0, given.seeds)
            rows.append(_row("pi", delay, 0.0, usual, swing, failed, usual))
            for law in MODELS:
                for wrong in WRONG:
                    found = errors(scene, law, delay, wrong, given.seeds)
                    rows.append(_row(law, delay, wrong, *found, usual))
                    print(*rows[-1], flush=True)
        head = (
            "controller",
            "delay [steps]",
            "friction believed",
            "RMS error [N m]",
            "in swing [N m]",
            "failed",
            "less than `pi`",
        )
        print(f"\n**{scene}**, {given.seeds} seeds\n\n{table(head, rows)}")


def _row(
    law: str,
    delay: int,
    wrong: float,
    rms: float,
    swing: float,
    failed: float,
    usual: float,
) -> tuple[str, ...]:
    return (
        f"`{law}`", f"{delay}", f"{1.0 + wrong:g}", f"{rms:.3g}",
        "-" if np.isnan(swing) else f"{swing:.3g}", f"{failed:.0%}",
        f"{usual / rms:.1f} x",
    )  # fmt: skip


if __name__ == "__main__":
    main()
