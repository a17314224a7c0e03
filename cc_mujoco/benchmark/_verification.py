"""Replay of random rows of a results file, compared bit for bit.

    verify("runs/benchmark/results.parquet", 5)

The operating system's random numbers select the rows, which the writer of the file
cannot predict.
"""

import dataclasses
import os
import random
from typing import Any

import numpy as np
import pyarrow as pa

from cc_mujoco._utils import user_code
from cc_mujoco._utils.provenance import provenance_differences
from cc_mujoco.benchmark._cell import Cell, play
from cc_mujoco.benchmark._conditions import REFERENCES, SCALE_CONTROLLER, Condition
from cc_mujoco.benchmark._ranking import normalise_errors
from cc_mujoco.benchmark._results import read_results, read_rows
from cc_mujoco.benchmark._runner import BenchmarkPlan
from cc_mujoco.benchmark._suites import SUITES
from cc_mujoco.errors import CableError, look_up


def verify(path: str | os.PathLike[str], count: int) -> str:
    """Simulate `count` random rows of a results file again, and compare all bits.

    Each is simulated with the others of its cell; computing times are not compared. The
    normalised error of every row is recomputed from the RMS errors. Returns a sentence
    with the number of compared rows; a difference is an error.
    """
    table, about = read_rows(path)
    if not 1 <= count <= len(table):
        raise CableError(
            f"--rows must be 1 to {len(table):,}, the rows of {path}, not {count:,}."
        )
    rows = table.to_pylist()
    laws = dict.fromkeys(
        user_code.named_in_file(law, os.fspath(path), "column controller")
        for law in dict.fromkeys(row["controller"] for row in rows)
    )
    conditions = _conditions(path, about)
    plan = BenchmarkPlan(
        tuple(law for law in laws if law not in REFERENCES),
        about["suite"],
        tuple(dict.fromkeys(about["devices"][row["scene"]] for row in rows)),
    )
    plan.rehearse()
    if other := provenance_differences(about["made_by"], plan.made_by()):
        raise CableError(
            f"{path} was made by other code, which differs in {', '.join(other)}; "
            "verify it with the code that made it."
        )
    _require_normalised(path, table)
    drawn = random.SystemRandom().sample(range(len(rows)), count)
    cells = dict.fromkeys(_cell_of_row(rows[number]) for number in drawn)
    compared = 0
    for scene, condition, law in cells:
        own = [row for row in rows if _cell_of_row(row) == (scene, condition, law)]
        seeds = tuple(row["seed"] for row in own)
        at = conditions[f"{scene} {condition}"]
        found = play(Cell(at, law, seeds, key=about.get("key", "")))
        columns: dict[str, Any] = {**found.scores, **found.plants}
        for place, row in enumerate(own):
            for name, values in columns.items():
                if not _entries_equal(row[name], values[place]):
                    raise CableError(
                        f"{path} is not what a replay gives: {name} of {law} in "
                        f"{scene} {condition}, seed {row['seed']}, is {row[name]} in "
                        f"the file and {values[place]} now."
                    )
        compared += len(own)
    return (
        f"{count} random rows of {len(rows)}, and with them all {compared} rows of "
        f"{len(cells)} cells, are what a replay gives, bit for bit."
    )


def _cell_of_row(row: dict[str, Any]) -> tuple[str, str, str]:
    return row["scene"], row["condition"], row["controller"]


def _entries_equal(one: Any, other: Any) -> bool:
    if isinstance(one, float) and np.isnan(one):
        return bool(np.isnan(other))
    return bool(np.all(np.asarray(one) == np.asarray(other)))


def _conditions(
    path: str | os.PathLike[str], about: dict[str, Any]
) -> dict[str, Condition]:
    suite = look_up("suite", about["suite"], SUITES)
    found = {}
    for name, text in about["conditions"].items():
        scene, _, condition = name.rpartition(" ")
        there = {one.name: one for one in suite.conditions(about["devices"][scene])}
        at = look_up("condition", condition, there)
        found[name] = dataclasses.replace(at, duration=about["durations"][name])
        if found[name].text != text:
            raise CableError(
                f"{path} was played in a condition {name!r} that this version of "
                "cc_mujoco has otherwise; verify it with the version that made it."
            )
    return found


def _require_normalised(path: str | os.PathLike[str], table: pa.Table) -> None:
    errors, about = read_results(path)
    scaled = {scene: normalise_errors(own) for scene, own in errors.items()}
    for row in table.to_pylist():
        scene, condition, law = _cell_of_row(row)
        place = list(errors[scene][SCALE_CONTROLLER]).index(condition)
        rank = about["seeds"][f"{scene} {condition}"].index(row["seed"])
        own = scaled[scene][law][place, rank]
        if not _entries_equal(row["error"], float(own)):
            raise CableError(
                f"{path}: the normalised error of {law} in {scene} {condition}, seed "
                f"{row['seed']}, is {row['error']}; its RMS errors make it {own}."
            )
