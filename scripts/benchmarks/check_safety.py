"""Peak torque over the safe one when a sensor or a strap fails: the suite `safety`.

python scripts/benchmarks/check_safety.py --scenes ankle wrist --seeds 10
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np

from cc_mujoco.benchmark import SUITES, Cell, play
from cc_mujoco.export import EXPORTED


def peaks(scene: str, law: str, seeds: tuple[int, ...]) -> Iterator[tuple[str, float]]:
    """Yield every condition and the largest peak of all seeds over the safe torque.

    It is infinite where an episode diverged.
    """
    for condition in SUITES["safety"].conditions(scene):
        scores = play(Cell(condition, law, seeds)).scores["peak_over_safe"]
        whole = bool(np.isfinite(scores).all())
        yield condition.structure, float(np.max(scores)) if whole else np.inf


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", nargs="+", default=list(SUITES["safety"].scenes))
    parser.add_argument("--controllers", nargs="+", default=EXPORTED)
    parser.add_argument("--seeds", type=int, default=10)
    given = parser.parse_args()
    for scene in given.scenes:
        print(f"\n{scene}, peak over safe torque, worst of {given.seeds} seeds")
        for law in given.controllers:
            found = dict(peaks(scene, law, tuple(range(given.seeds))))
            each = "  ".join(f"{name} {peak:.2f}" for name, peak in found.items())
            print(f"{law:12} {max(found.values()):5.2f}   {each}", flush=True)


if __name__ == "__main__":
    main()
