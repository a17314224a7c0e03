"""Time that `cc-mujoco diagnose` takes.

    python scripts/benchmarks/bench_diagnosis.py --out runs/diagnosis_speed
    python scripts/benchmarks/bench_diagnosis.py --cases davinci --davinci DIR

Rigs that hide something are made by `diagnosis_study/rig` and kept in `--out`; DIR are
the trials that `diagnosis_study/davinci.toml` describes. Processor time is that of all
threads: what else the machine does only adds to the time that passes.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path

STUDY = Path(__file__).resolve().parents[1] / "diagnosis_study"
SEED = 11
HIDDEN: dict[str, dict[str, float]] = {
    "none": {},
    "viscous": {"viscous_friction": 14.0},
    "play": {"backlash": 1.5e-3},
    "compliance": {"end_compliance": 1.1e-5},
    "stribeck": {"stribeck_friction": 0.6985},
}
"""Amounts by case.

`stribeck` has strength 30, see `diagnosis_study/rig`; it takes 4 steps per sample.
"""
DAVINCI = "4_load0", "4_load8", "4_load2", "2_load6"
"""Trials of the case `davinci`, of which the first 2000 rows are taken."""


def data_of(case: str, out: Path, davinci: Path | None) -> Path:
    """Return the folder with the trials of a case, made if it is not there."""
    folder = out / "data" / case
    if folder.exists():
        return folder
    if case == "davinci":
        if davinci is None:
            raise SystemExit(f"{case} needs --davinci")
        folder.mkdir(parents=True)
        for name in DAVINCI:
            file = f"tool4_freq{name}.csv"
            lines = (davinci / file).read_text(encoding="utf-8").splitlines(True)
            (folder / file).write_text("".join(lines[:2001]), encoding="utf-8")
        return folder
    sys.path.insert(0, str(STUDY))
    from rig.dataset import make_dataset
    from rig.generate import facts_of, write_data
    from rig.nominal import make_rig

    rig = make_rig(SEED)
    facts = facts_of("rich", SEED)
    write_data(folder, make_dataset(rig, HIDDEN[case], "rich", SEED), facts)
    return folder


def run(case: str, data: Path, toml: Path | None, into: Path) -> None:
    begin = time.perf_counter()
    from cc_mujoco.assets import scene_path
    from cc_mujoco.diagnosis import diagnose

    found = diagnose(scene_path("bench"), [data], into, dataset_toml=toml)
    named = [effect.id for effect in found.effects]
    print(
        f"{case}: {found.verdict} {named}; {time.process_time():.1f} s of processor, "
        f"{time.perf_counter() - begin:.1f} s passed"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    every = [*HIDDEN, "davinci"]
    parser.add_argument("--cases", nargs="+", choices=every, default=list(HIDDEN))
    parser.add_argument("--davinci", type=Path, help="folder of measured trials")
    parser.add_argument("--out", type=Path, default=Path("runs", "bench_diagnosis"))
    parser.add_argument("--alone", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.alone:
        (case,) = options.cases
        data = data_of(case, options.out, options.davinci)
        toml = STUDY / "davinci.toml" if case == "davinci" else None
        run(case, data, toml, options.out / case / "diagnosis")
        return
    for case in options.cases:
        data_of(case, options.out, options.davinci)
        command = [sys.executable, __file__, "--alone", "--cases", case]
        subprocess.run([*command, "--out", str(options.out)], check=True)


if __name__ == "__main__":
    main()
