"""Generate measured trials of a rig that hides something.

    python scripts/diagnosis_study/rig/generate.py --out DIR --effect viscous_friction \
        --strength 2 --trials rich --seed 1

Writes DIR/data, which an experimenter would have (trial_00.csv and so on, and
dataset.toml with what is known of each trial), and DIR/sealed/label.json with what is
hidden. `--effect none` hides nothing; several ids, joined by commas, are each given
the strength.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import sys
from dataclasses import asdict
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np

from cc_mujoco.native import FloatArray as Array

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from rig.dataset import make_dataset, make_trials, truth_of
from rig.makes import MAKES, Truth
from rig.nominal import NOMINAL, Rig, make_rig
from rig.strength import calibrate, measure
from rig.trials import SETS

FORMATS = {"time_s": "%.5f", "rad": "%.6f", "nm": "%.3f", "n": "%.1f", "a": "%.4f"}


def write_data(
    folder: Path, data: list[dict[str, Array]], facts: str, form: str = ""
) -> None:
    """Write an experimenter's files; `form` formats numbers, by default per column."""
    folder.mkdir(parents=True)
    for k, columns in enumerate(data):
        ends = ((name, name.rsplit("_", 1)[-1]) for name in columns)
        forms = [form or FORMATS.get(name) or FORMATS[end] for name, end in ends]
        np.savetxt(
            folder / f"trial_{k:02d}.csv", np.stack(list(columns.values()), axis=1),
            fmt=forms, delimiter=",",
            header=",".join(columns), comments="",
        )  # fmt: skip
    (folder / "dataset.toml").write_text(facts, encoding="utf-8")


def facts_of(trials: str, seed: int) -> str:
    """Return the `dataset.toml` of an experimenter: known facts of each trial."""
    lines = []
    for k, trial in enumerate(make_trials(trials, seed)):
        tension = NOMINAL.pretension * trial.tightness
        lines += [
            f"[trials.trial_{k:02d}]",
            "unhooked = true" if trial.unhooked else f"pretension = {tension:g}",
            f'notes = "{trial.motion}, {trial.load}"',
        ]
        if trial.tilt:
            lines.append(f"tilt = {trial.tilt:g}")
        if any(trial.known_torques):
            motor, joint = trial.known_torques
            lines.append(f"known_motor_torque = {motor:g}")
            lines.append(f"known_joint_torque = {joint:g}")
        if trial.repeat_of is not None:
            lines.append(f'repeat_of = "trial_{trial.repeat_of:02d}"')
        lines.append("")
    return "\n".join(lines)


def _differences(truth: Truth, plain: Truth) -> dict[str, Any]:
    """Return the fields of the truth that are not those of a rig that hides nothing."""
    usual = plain.values()
    return {
        name: np.asarray(value).tolist()
        for name, value in truth.values().items()
        if name != "bench" and not np.array_equal(value, usual[name])
    }


def label_of(
    rig: Rig, amounts: dict[str, float], asked: float, trials: str, seed: int
) -> dict[str, Any]:
    """Return the label of a data set: hidden effects, their amounts, and the rig."""
    effects, plain = MAKES[rig.make].effects, truth_of(rig, {}, seed)
    hidden = [
        {
            "id": name,
            "parameter": effects[name].parameter,
            "amount": amount,
            "unit": effects[name].unit,
            "strength": measure(rig, {name: amount}, trials, seed)._asdict(),
            "details": _differences(truth_of(rig, {name: amount}, seed), plain),
        }
        for name, amount in amounts.items()
    ]
    return {
        "schema": 1,
        "effects": hidden,
        "strength_asked": asked,
        "trials": trials,
        "seed": seed,
        "rig": asdict(rig),
    }


def generate(
    out: Path,
    effects: list[str],
    strength: float,
    trials: str,
    seed: int,
    make: str = "bristles",
) -> None:
    """Write one sealed data set; `out` appears when it is complete."""
    rig = make_rig(seed, make=make)
    amounts = {name: calibrate(rig, name, strength, trials, seed) for name in effects}
    data = make_dataset(rig, amounts, trials, seed)
    out.parent.mkdir(parents=True, exist_ok=True)
    draft = Path(mkdtemp(prefix=f".{out.name}", dir=out.parent))
    try:
        write_data(draft / "data", data, facts_of(trials, seed))
        (draft / "sealed").mkdir()
        label = label_of(rig, amounts, strength, trials, seed)
        text = json.dumps(label, indent=2)
        (draft / "sealed" / "label.json").write_text(text, encoding="utf-8")
        draft.chmod(0o755)
        draft.rename(out)
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="folder to create")
    parser.add_argument("--effect", default="none", help="ids, by commas")
    parser.add_argument("--make", choices=MAKES, default="bristles", help="of the rig")
    parser.add_argument("--strength", type=float, default=2.0, help="R of each effect")
    parser.add_argument("--trials", choices=list(SETS), default="rich")
    parser.add_argument("--seed", type=int, default=0, help="of rig, motions, noise")
    given = parser.parse_args(argv)
    if not 0 <= given.strength < math.inf or given.seed < 0:
        parser.error("--strength and --seed must be finite and not negative")
    names = [] if given.effect == "none" else given.effect.split(",")
    for name in names:
        if name not in MAKES[given.make].effects:
            known = ", ".join(["none", *MAKES[given.make].effects])
            parser.error(f"argument --effect: no effect {name!r}; there are {known}")
    if given.out.exists():
        parser.error(f"{given.out} is there already; name a new folder")
    generate(given.out, names, given.strength, given.trials, given.seed, given.make)


if __name__ == "__main__":
    main()
