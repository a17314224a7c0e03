"""One mechanism on several occasions, each diagnosed by itself.

    python scripts/diagnosis_study/davinci.py DIR --out runs/davinci.json

DIR holds trials of a da Vinci grasper as `davinci.toml` describes them. Errors are
those of trials that no fit has seen.
"""

from __future__ import annotations

import json
import re
import time
from pathlib import Path
from typing import Any, Literal

import tyro
from tyro.conf import Positional

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench
from cc_mujoco.diagnosis import Diagnosis, infer

TOML = Path(__file__).with_suffix(".toml")
OCCASIONS = {
    "L_4": (r"tool4_freq[04]_load[048]\.csv|tool4_freq[04]_load[26]\.csv", "load[26]"),
    "L_2": (r"tool4_L2_.*\.csv", "load1"),
    "R_5": (r"tool4_R5_.*\.csv", "load1"),
}
"""Files of each occasion, and of its trials those that are held out."""


def diagnosed(occasion: str, folder: Path, work: Path) -> tuple[Diagnosis, float]:
    pattern, held_out = OCCASIONS[occasion]
    files = sorted(f for f in folder.iterdir() if re.fullmatch(pattern, f.name))
    if not files:
        raise SystemExit(f"{folder} holds no trial of {occasion} ({pattern}).")
    rig = work / f"{occasion}.toml"
    rig.parent.mkdir(parents=True, exist_ok=True)
    # The rig's file, with the tables of other trials than its own.
    head = TOML.read_text(encoding="utf-8").partition("\n[trials")[0]
    tests = [f.stem for f in files if re.search(held_out, f.name)]
    known = [f'\n[trials."{test}"]\nsplit = "test"\n' for test in tests]
    rig.write_text(head + "".join(known), encoding="utf-8")
    begin = time.process_time()
    result, _ = infer(Bench.of(scene_path("bench")), files, dataset_toml=rig)
    return result.diagnosis, time.process_time() - begin


def main(
    folder: Positional[Path],
    out: Path = Path("runs/davinci.json"),
    only: tuple[Literal[tuple(OCCASIONS)], ...] = tuple(OCCASIONS),
) -> None:
    kept: dict[str, Any] = {}
    for occasion in only:
        found, seconds = diagnosed(occasion, folder, out.parent)
        kept[occasion] = {
            "verdict": found.verdict,
            "ties": [list(group) for group in found.ties],
            "baseline": {k: v.value for k, v in found.baseline.parameters.items()},
            "gap": {
                c: (g.noise_floor, g.rmse_before, g.rmse_after)
                for c, g in found.gap.items()
            },
            "statement": found.statement,
            "seconds": seconds,
            "effects": {
                e.id: {
                    "missing": e.missing,
                    "agreement": e.agreement,
                    "share": e.share,
                    "sizes": {n: [v.value, *v.ci95] for n, v in e.parameters.items()},
                }
                for e in found.effects
            },
        }
        print(occasion, json.dumps(kept[occasion], indent=1), flush=True)
    out.write_text(json.dumps(kept, indent=1), encoding="utf-8")


if __name__ == "__main__":
    tyro.cli(main)
