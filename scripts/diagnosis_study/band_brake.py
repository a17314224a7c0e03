"""A band brake with a force at both ends of the band, as a rig to diagnose.

    python scripts/diagnosis_study/band_brake.py DATA --out runs/band
    cc-mujoco diagnose runs/band/band.xml runs/band/data --out runs/band/diagnosis

DATA holds recordings of the public repository ARTS-Laboratory/
Dataset-Friction-Damper-with-Backlash (D. Coble, P. Huggins, L. Cao, J. Ricles,
A. Downey, 2022; CC BY-SA 4.0) as `.npz` with an array `data` (samples, 6): time [s],
displacement at the rim [m], friction force [N], speed [m/s], force at either end of
the band [N].

Both ends of the band are held and the drum turns. Seen from the drum, the band is a
cable in a conduit whose two ends move alike, so the drum's angle is the angle of both
ends. Every preload is an occasion of its own.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import tyro
from tyro.conf import Positional

RADIUS = 0.15  # radius of the drum [m]; only the displacement at its rim is measured
SCENE, DATASET = (
    Path(__file__).with_suffix(end).read_text(encoding="utf-8")
    for end in (".xml", ".toml")
)
"""The scene, whose band covers 4.7 rad, and what is known of the trials."""
HEAD = "time_s,drum_angle_rad,tension_proximal_n,tension_distal_n"


def main(
    folder: Positional[Path],
    out: Path = Path("runs/band"),
    only: str = ".",
    seconds: float = 1e9,
) -> None:
    """Write scene and trials.

    Args:
        only: pattern of the recordings.
        seconds: of each, at most.
    """
    (out / "data").mkdir(parents=True, exist_ok=True)
    (out / "band.xml").write_text(SCENE, encoding="utf-8")
    facts = [DATASET]
    for path in sorted(folder.glob("*.npz")):
        if not re.search(only, path.name):
            continue
        time, place, _, _, end_1, end_2 = np.load(path)["data"].T.astype(float)
        keep = time - time[0] <= seconds
        rows = np.array([time - time[0], place / RADIUS, end_2, end_1]).T[keep]
        name = path.stem.replace("characterization_datasets__", "").replace(".", "p")
        file = out / "data" / f"{name}.csv"
        form = ["%.5f", "%.7f", "%.2f", "%.2f"]
        np.savetxt(file, rows, form, ",", header=HEAD, comments="")
        load = re.search(r"(\d+)lb", path.name)
        if load:
            facts.append(f'[trials."{name}"]\noccasion = "{load[1]} lb"\n')
    text = "\n".join(facts)
    (out / "data" / "dataset.toml").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    tyro.cli(main)
