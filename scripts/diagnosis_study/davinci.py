"""One mechanism on several occasions, each diagnosed by itself.

    python scripts/diagnosis_study/davinci.py DIR --out runs/davinci

DIR holds trials of a da Vinci grasper as `davinci.toml` describes them. Errors are
those of trials that no fit has seen.
"""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import Literal

import tyro
from tyro.conf import Positional

from cc_mujoco.assets import scene_path
from cc_mujoco.diagnosis import Diagnosis, diagnose

TOML = Path(__file__).with_suffix(".toml")
OCCASIONS = {
    "L_4": (r"tool4_freq[04]_load[048]\.csv|tool4_freq[04]_load[26]\.csv", "load[26]"),
    "L_2": (r"tool4_L2_.*\.csv", "load1"),
    "R_5": (r"tool4_R5_.*\.csv", "load1"),
}
"""Files of each occasion, and of its trials those that are held out."""


def diagnosed(occasion: str, folder: Path, out: Path) -> Diagnosis:
    pattern, held_out = OCCASIONS[occasion]
    files = sorted(f for f in folder.iterdir() if re.fullmatch(pattern, f.name))
    if not files:
        raise SystemExit(f"{folder} holds no trial of {occasion} ({pattern}).")
    rig = out / f"{occasion}.toml"
    rig.parent.mkdir(parents=True, exist_ok=True)
    # The rig's file, with the tables of other trials than its own.
    head = TOML.read_text(encoding="utf-8").partition("\n[trials")[0]
    tests = [f.stem for f in files if re.search(held_out, f.name)]
    known = [f'\n[trials."{test}"]\nsplit = "test"\n' for test in tests]
    rig.write_text(head + "".join(known), encoding="utf-8")
    return diagnose(scene_path("bench"), files, out / occasion, dataset_toml=rig)


def main(
    folder: Positional[Path],
    out: Path = Path("runs/davinci"),
    only: tuple[Literal[tuple(OCCASIONS)], ...] = tuple(OCCASIONS),
) -> None:
    for occasion in only:
        begin = time.process_time()
        found = diagnosed(occasion, folder, out)
        spent = time.process_time() - begin
        print(f"{occasion}, {spent:.0f} s: {found.statement}", flush=True)
        for channel, gap in found.gap.items():
            error = f"{gap.rmse_before:.3g} to {gap.rmse_after:.3g}"
            print(f"  {channel}: {error}, floor {gap.noise_floor:.3g}", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
