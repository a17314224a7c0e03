"""Diagnoses of one rig by `cc-mujoco diagnose`, by what its torques are known from.

    python scripts/diagnosis_study/instruments.py --out runs/instruments

The simulated rig of another make (`rig`) hides an effect, and is recorded with torque
sensors, with load cells on the cables, with the motor's current and its friction, with
one end only, or with a declared spring in place of the joint's sensor. Cases that are
done are kept; the table is printed as Markdown.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from kept_cases import findings, kept, words
from numpy.typing import NDArray

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench, velocity
from cc_mujoco.diagnosis import infer
from cc_mujoco.report import _markdown as markdown
from rig.dataset import make_dataset, make_trials
from rig.generate import facts_of, write_data
from rig.nominal import NOMINAL, make_rig
from rig.strength import calibrate
from rig.trials import SPRING

Columns = dict[str, NDArray[np.float64]]

HIDDEN = ("none", "viscous_friction", "load_independent_friction", "end_compliance")
SEED, STRENGTH = 900, 4.0
CONSTANT, FRICTION, DRAG, WIND_UP = 0.5, 0.15, 0.03, 1e-3
"""Motor: torque constant [N m/A], its own friction [N m], drag [N m s/rad] and
turn before friction slides [rad]."""


def sensors(columns: Columns) -> Columns:
    return {n: v for n, v in columns.items() if not n.startswith("tension")}


def cells(columns: Columns) -> Columns:
    return {
        name.replace("_a_", "_agonist_").replace("_b_", "_antagonist_"): v
        for name, v in columns.items()
        if "torque" not in name
    }


def current(columns: Columns) -> Columns:
    made = sensors(columns)
    angle = made["motor_angle_rad"]
    speed = velocity(angle, 0.002)
    own, bent = DRAG * speed, np.zeros_like(angle)
    for k in range(1, angle.size):  # friction winds up before the motor slides
        wound = bent[k - 1] + (angle[k] - angle[k - 1]) / WIND_UP
        bent[k] = min(max(wound, -1.0), 1.0)
    own = own + FRICTION * bent
    made["motor_current_a"] = (made.pop("motor_torque_nm") + own) / CONSTANT
    return made


def without(torque: str) -> Callable[[Columns], Columns]:
    def made(columns: Columns) -> Columns:
        return {n: v for n, v in sensors(columns).items() if n != torque}

    return made


DAMPING = NOMINAL["joint_damping_nm_s_per_rad"] + SPRING[1]
KINDS: dict[str, tuple[Callable[[Columns], Columns], str, tuple[str, ...]]] = {
    "torque sensors": (sensors, "", ()),
    "load cells": (cells, "", ()),
    "motor current, joint torque": (
        current, f"[rig]\ntorque_constant = {CONSTANT}\n", ()
    ),
    "motor torque only": (
        without("joint_torque_nm"), "[columns.joint_torque_nm]\nmeasured = false\n", ()
    ),
    "joint torque only": (
        without("motor_torque_nm"), "[columns.motor_torque_nm]\nmeasured = false\n", ()
    ),
    "motor torque, known spring": (
        without("joint_torque_nm"),
        f"[rig]\nload_stiffness = {{ value = {SPRING[0]}, uncertainty = 0.1 }}\n"
        f"load_inertia = {{ value = {NOMINAL['joint_inertia_kg_m2']}, "
        "uncertainty = 2e-4 }\n"
        f"load_damping = {{ value = {DAMPING}, uncertainty = 0.02 }}\n",
        ("spring",),
    ),
}  # fmt: skip
"""Columns, beginning of `dataset.toml`, and recorded loads, by name."""


def diagnosed(name: str, kind: str) -> dict[str, Any]:
    change, head, loads = KINDS[kind]
    data, trials = recorded(name), make_trials("rich", SEED)
    chosen = [k for k, trial in enumerate(trials) if not loads or trial.load in loads]
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "data"
        write_data(place, [change(columns) for columns in data], "")
        for k in range(len(data)):
            if k not in chosen:
                (place / f"trial_{k:02d}.csv").unlink()
        facts = facts_of("rich", SEED).split("\n\n")
        known = [head, *(each for k, each in enumerate(facts) if k in chosen)]
        (place / "dataset.toml").write_text("\n\n".join(known), encoding="utf-8")
        result, _ = infer(Bench.of(scene_path("bench")), [place])
    found = result.diagnosis
    return {
        **findings(found),
        "unseen": [each.id for each in found.not_testable],
        "hidden_by": {each.id: each.parameter for each in found.confounded},
    }


@cache
def recorded(name: str) -> list[Columns]:
    """Return the trials of a rig with a hidden effect, read by all its sensors."""
    rig, amounts = make_rig(SEED), {}
    if name != "none":
        amounts[name] = calibrate(rig, name, STRENGTH, "rich", SEED)
    return make_dataset(rig, amounts, "rich", SEED, tensions=True)


def main(out: Path) -> None:
    rows = []
    for name in HIDDEN:
        for kind in KINDS:
            case = kept(out / f"{name}, {kind}.json", partial(diagnosed, name, kind))
            rows.append((name, kind, *words(case), case["hidden_by"].get(name, "-")))
            print(*rows[-1], sep=" | ", flush=True)
    head = ("hidden", "known from", "verdict", "named", "ties", "hidden by tuning")
    print(markdown.table(head, rows))


if __name__ == "__main__":
    tyro.cli(main)
