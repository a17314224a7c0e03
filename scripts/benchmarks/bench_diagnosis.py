"""Time that `cc-mujoco diagnose` takes, stage by stage.

    python scripts/benchmarks/bench_diagnosis.py --out runs/diagnosis_speed
    python scripts/benchmarks/bench_diagnosis.py --cases davinci --davinci DIR \
        --against runs/before
    python scripts/benchmarks/bench_diagnosis.py --cases own --data DIR --dataset TOML

Rigs that hide something are made by `diagnosis_study/rig` and kept in `--out`; DIR are
the trials that `diagnosis_study/davinci.toml` describes. Every case is diagnosed in a
process of its own. Processor time counts, that of all threads: what else the machine
does only adds to the time that passes, which is printed, too. `--against` is the
`--out` of another version: its times over these, and where its verdicts differ.
"""

from __future__ import annotations

import argparse
import importlib
import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

STUDY = Path(__file__).resolve().parents[1] / "diagnosis_study"
SEED = 11
HIDDEN: dict[str, dict[str, float]] = {
    "none": {},
    "viscous": {"viscous_friction": 14.0},
    "viscous_strong": {"viscous_friction": 140.0},
    "play": {"backlash": 1.5e-3},
    "play_strong": {"backlash": 0.03},
    "compliance": {"end_compliance": 1.1e-5},
    "compliance_strong": {"end_compliance": 1e-4},
    "stribeck": {"stribeck_friction": 0.6985},
    "long": {"viscous_friction": 14.0},
}
"""Amounts by case; `long` is 20 trials of 8 s, the others are 8.

`stribeck` has strength 30, see `diagnosis_study/rig`; it takes 4 steps per sample.
"""
DAVINCI = {
    "davinci_short": (("4_load0", "4_load8", "4_load2", "2_load6"), 2000),
    "davinci": (
        ("0_load0", "0_load8", "4_load0", "4_load8", "0_load2", "4_load2", "2_load6"),
        10_000,
    ),
}
"""Trials and most rows of each."""
STAGES = {
    "reading and checks": (
        "_diagnose.load",
        "_diagnose.check_bench",
        "_fit.fit.prepare_start",
    ),
    "baseline": ("_fit.fit.fit_baseline",),
    "noise floor": ("_fit.baseline.noise_floor",),
    "numerics": ("_fit.baseline.refinement_change",),
    "screen": ("_search.rounds.screen",),
    "refits": ("_search.search.search", "_search.search.search_rare"),
    "parts of the data": ("_search.search.check_agreement",),
    "fit to all": ("_search.search.fit_until_settled",),
    "held out": ("_fit.baseline.predicted",),
    "odd trial": ("_locate.location.find_outlier_trial",),
    "intervals": (
        "_search.search.fit_covariance",
        "_search.search.estimates",
        "_diagnose.undetermined",
    ),
    "next experiment": ("_diagnose.propose",),
    "maps": ("_locate.location.error_maps",),
    "report": ("_diagnose.write",),
}
"""Functions of each stage; time in one that another calls is that of the inner one."""


class Clock:
    """Processor time by stage."""

    def __init__(self) -> None:
        """Start in none."""
        self.spent: dict[str, float] = {}
        self._now = ["rest"]
        self._since = time.process_time()

    def _turn(self) -> None:
        now = time.process_time()
        self.spent[self._now[-1]] = (
            self.spent.get(self._now[-1], 0.0) + now - self._since
        )
        self._since = now

    def timed(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function with its time counted for the stage."""

        def run(*args: Any, **options: Any) -> Any:
            self._turn()
            self._now.append(stage)
            try:
                return function(*args, **options)
            finally:
                self._turn()
                self._now.pop()

        return run

    def watch(self) -> None:
        """Count the time of every stage."""
        for stage, places in STAGES.items():
            for place in places:
                name, _, attribute = place.rpartition(".")
                module = importlib.import_module(f"cc_mujoco.diagnosis.{name}")
                function = getattr(module, attribute)
                setattr(module, attribute, self.timed(stage, function))

    def read(self) -> dict[str, float]:
        """Return the seconds by stage."""
        self._turn()
        return dict(self.spent)


def data_of(case: str, out: Path, davinci: Path | None) -> Path:
    """Return the folder with the trials of a case, made if it is not there."""
    folder = out / "data" / case
    if folder.exists():
        return folder
    if case in DAVINCI:
        if davinci is None:
            raise SystemExit(f"{case} needs --davinci")
        names, most = DAVINCI[case]
        folder.mkdir(parents=True)
        for name in names:
            file = f"tool4_freq{name}.csv"
            lines = (davinci / file).read_text(encoding="utf-8").splitlines(True)
            (folder / file).write_text("".join(lines[: 1 + most]), encoding="utf-8")
        return folder
    sys.path.insert(0, str(STUDY))
    from rig.dataset import make_dataset
    from rig.generate import facts_of, write_data
    from rig.nominal import make_rig

    rig = make_rig(SEED)
    data = make_dataset(rig, HIDDEN[case], "rich", SEED)
    facts = facts_of("rich", SEED)
    if case == "long":
        for seed, count in ((SEED + 1, 8), (SEED + 2, 4)):
            data += make_dataset(rig, HIDDEN[case], "rich", seed)[:count]
        again = facts.replace("trial_05", "trial_13").split("[trials.")
        facts += "[trials.".join(["", *(t for t in again if t.startswith("trial_13"))])
    write_data(folder, data, facts)
    return folder


def run(case: str, data: Path, toml: Path | None, into: Path) -> None:
    """Diagnose one case and note times and what was said."""
    clock, begin = Clock(), time.perf_counter()
    from cc_mujoco.assets import scene_path
    from cc_mujoco.diagnosis import diagnose

    clock.watch()
    out = into / case / "diagnosis"
    found = diagnose(scene_path("bench"), [data], out, dataset_toml=toml)
    note = {
        "case": case,
        "stages": clock.read(),
        "cpu": time.process_time(),
        "wall": time.perf_counter() - begin,
        "verdict": found.verdict,
        "named": [effect.id for effect in found.effects],
        "ties": [list(tie) for tie in found.ties],
        "closed": {name: gap.gap_closed for name, gap in found.gap.items()},
        "values": {
            name: [value.value, *value.ci95]
            for group in (found.baseline, *found.effects)
            for name, value in (group.parameters.items() if group else ())
        },
        "candidates": [
            [[c.id, c.reduction, c.z, c.reason] for c in step]
            for step in found.runner_ups
        ],
    }
    (into / case / "note.json").write_text(json.dumps(note, indent=1), encoding="utf-8")


def differing(now: dict[str, Any], then: dict[str, Any]) -> list[str]:
    """List what another version said otherwise."""
    told = [
        f"{key}: {then[key]} before, {now[key]} now"
        for key in ("verdict", "named", "ties")
        if then[key] != now[key]
    ]
    for name, old in then["closed"].items():
        new = now["closed"].get(name, np.nan)
        if abs(new - old) > 0.02:
            told.append(f"closed of {name}: {old:.3f} before, {new:.3f} now")
    for name, (_, low, high) in then["values"].items():
        new = now["values"].get(name, [np.nan])[0]
        if name in now["values"] and not low <= new <= high:
            told.append(f"{name}: [{low:.4g}, {high:.4g}] before, {new:.4g} now")
    return told


def main() -> None:
    """Run the cases and print their times."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    every = [*HIDDEN, *DAVINCI, "own"]
    parser.add_argument("--cases", nargs="+", choices=every, default=list(HIDDEN))
    parser.add_argument("--davinci", type=Path, help="folder of measured trials")
    parser.add_argument("--data", type=Path, help="folder of trials of `own`")
    parser.add_argument("--dataset", type=Path, help="their dataset.toml")
    parser.add_argument("--out", type=Path, default=Path("runs", "bench_diagnosis"))
    parser.add_argument("--against", type=Path, help="what another version left")
    parser.add_argument("--alone", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.alone:
        (case,) = options.cases
        run(case, options.data, options.dataset, options.out)
        return
    for case in options.cases:
        toml = STUDY / "davinci.toml" if case in DAVINCI else None
        if case == "own":
            if options.data is None:
                parser.error("the case `own` needs --data")
            data, toml = options.data, options.dataset
        else:
            data = data_of(case, options.out, options.davinci)
        (options.out / case).mkdir(parents=True, exist_ok=True)
        command = [sys.executable, __file__, "--alone", "--cases", case]
        command += ["--data", str(data), *(["--dataset", str(toml)] if toml else [])]
        subprocess.run([*command, "--out", str(options.out)], check=True)
        now = json.loads((options.out / case / "note.json").read_text())
        stages = "; ".join(
            f"{stage} {spent:.1f}" for stage, spent in now["stages"].items()
        )
        print(f"{case}: {now['verdict']} {now['named']} {now['ties']}")
        print(
            f"  {now['cpu']:.1f} s of processor, {now['wall']:.1f} s passed: {stages}"
        )
        if options.against:
            then = json.loads((options.against / case / "note.json").read_text())
            print(f"  {then['cpu'] / now['cpu']:.1f} times as fast")
            for told in differing(now, then):
                print(f"  {told}")


if __name__ == "__main__":
    main()
