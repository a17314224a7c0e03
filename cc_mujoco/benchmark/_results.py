"""The results file of a benchmark, and the comparison of two.

A row is an episode: scene, condition, controller, seed, normalised error, scores, true
and assumed parameters. The metadata are the provenance: code, conditions, machine.
"""

import contextlib
import hashlib
import json
import math
import os
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from cc_mujoco._utils import provenance as origins
from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco.benchmark._cell import Cell, CellResult, axis_errors, ranked_score
from cc_mujoco.benchmark._conditions import REFERENCES, SCALE_CONTROLLER
from cc_mujoco.benchmark._ranking import normalise_errors
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray as Array

Results = Sequence[tuple[Cell, CellResult]]
# RMS errors by scene, controller and condition, (seeds, axes)
Errors = dict[str, dict[str, dict[str, Array]]]


def rms_errors(results: Results) -> Errors:
    found: Errors = {}
    for cell, played in results:
        own = found.setdefault(cell.condition.label, {})
        errors = axis_errors(played.scores)
        own.setdefault(cell.controller, {})[cell.condition.name] = errors
    return found


class DeviceResults:
    def __init__(self, label: str, played: Results) -> None:
        self.label, self.played = label, played
        # By controller and condition (seeds, axes), by controller (conditions, seeds).
        self.rms = rms_errors(played)[label]
        self.errors = normalise_errors(self.rms)

    def finite_scores(self, law: str, name: str) -> Array:
        values = [r.scores[name] for c, r in self.played if c.controller == law]
        known = np.concatenate(values)
        return known[np.isfinite(known)]

    def mean_score(self, law: str, name: str) -> float:
        """Return a controller's mean of a score over its episodes, NaN without any."""
        known = self.finite_scores(law, name)
        return float(np.mean(known)) if known.size else math.nan


def by_device(results: Results) -> list[DeviceResults]:
    found: dict[str, list[tuple[Cell, CellResult]]] = {}
    for cell, played in results:
        found.setdefault(cell.condition.label, []).append((cell, played))
    return [DeviceResults(label, own) for label, own in found.items()]


def describe_machine() -> dict[str, str | int]:
    lines: list[str] = []
    with contextlib.suppress(OSError):  # not on Linux
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    names = [line.partition(":")[2].strip() for line in lines if "model name" in line]
    return {
        "system": platform.platform(),
        "processor": names[0] if names else platform.processor(),
        "processors": os.cpu_count() or 1,
        "python": platform.python_version(),
    }


def write_results(
    path: str | os.PathLike[str],
    results: Results,
    suite: str,
    makers: Mapping[str, Any],
) -> None:
    """Write the results file; `makers` is from `_utils.provenance.code_provenance`."""
    devices = {own.label: own for own in by_device(results)}
    entries: list[dict[str, Any]] = []
    for cell, played in results:
        at, own = cell.condition, devices[cell.condition.label]
        place = list(own.rms[SCALE_CONTROLLER]).index(at.name)
        errors = own.errors[cell.controller][place]
        about_cell: dict[str, Any] = {
            "scene": at.label,
            "condition": at.name,
            "transmission": at.transmission,
            "model_error": at.error,
            "controller": cell.controller,
        }
        for row, seed in enumerate(cell.seeds):
            entry = {**about_cell, "seed": seed, "error": float(errors[row])}
            entry |= {name: float(v[row]) for name, v in played.scores.items()}
            entry |= {name: v[row] for name, v in played.plants.items()}
            entries.append(entry)
    used = {f"{c.condition.label} {c.condition.name}": c.condition for c, _ in results}
    # A device of one axis lacks the columns of another's.
    names = dict.fromkeys(name for entry in entries for name in entry)
    table = pa.table({name: [e.get(name) for e in entries] for name in names})
    about = {
        "suite": suite,
        "conditions": {name: condition.text for name, condition in used.items()},
        "devices": {one.label: one.scene for one in used.values()},
        "durations": {name: condition.duration for name, condition in used.items()},
        "key": results[0][0].key,
        "made_by": dict(makers),
        "machine": describe_machine(),
    }
    about["digest"] = _digest(table, about)
    with replacing(path) as partial:
        pq.write_table(origins.with_provenance(table, about), partial)


def _digest(table: pa.Table, about: Mapping[str, Any]) -> str:
    digest = hashlib.sha256()
    made = {name: value for name, value in about.items() if name != "digest"}
    digest.update(json.dumps(made, sort_keys=True).encode())
    for name in table.column_names:
        digest.update(json.dumps([name, table[name].to_pylist()]).encode())
    return digest.hexdigest()


def read_rows(path: str | os.PathLike[str]) -> tuple[pa.Table, dict[str, Any]]:
    """Return the rows and the provenance of a results file, if it is as written."""
    if not Path(path).exists():
        raise CableError(f"there is no file {path} of results.")
    try:
        table = pq.read_table(path)
    except (OSError, pa.ArrowException):
        raise CableError(f"{path} is no Parquet file that can be read.") from None
    about = origins.read_provenance(table)
    if not (isinstance(about, dict) and {"suite", "conditions"} <= about.keys()):
        raise CableError(f"{path} is no file of results of `cc-mujoco benchmark`.")
    if "digest" not in about:
        raise CableError(
            f"{path} has no digest of its rows: an earlier version of cc_mujoco wrote "
            "it; run the benchmark again."
        )
    if about["digest"] != _digest(table, about):
        raise CableError(
            f"{path} was changed after it was written: its rows do not have the digest "
            "that stands in it; run the benchmark again."
        )
    return table, about


def read_results(path: str | os.PathLike[str]) -> tuple[Errors, dict[str, Any]]:
    """Return the RMS errors and the provenance of a results file.

    The provenance is the metadata of `write_results` with the seeds of every condition
    (`seeds`).
    """
    table, about = read_rows(path)
    found: dict[str, dict[str, dict[str, list[tuple[int, list[float]]]]]] = {}
    names = ("scene", "controller", "condition", "seed")
    error = ranked_score(table.column_names)
    of_axes = [name for name in table.column_names if name.endswith(f".{error}")]
    for row in table.select([*names, error, *of_axes]).to_pylist():
        scene, law, condition, seed = (row[name] for name in names)
        own = found.setdefault(scene, {}).setdefault(law, {})
        axes = [row[name] for name in of_axes if row[name] is not None] or [row[error]]
        own.setdefault(condition, []).append((seed, axes))
    about["seeds"] = {}
    for scene, laws in found.items():
        played = {
            law: {c: sorted((s, len(axes)) for s, axes in v) for c, v in own.items()}
            for law, own in laws.items()
        }
        for law, own_seeds in played.items():
            if own_seeds != played.get(SCALE_CONTROLLER):
                raise CableError(
                    f"{path}: {law} has not played the conditions and seeds of {scene} "
                    f"that {SCALE_CONTROLLER} has; run the benchmark again."
                )
        about["seeds"] |= {
            f"{scene} {condition}": [seed for seed, _ in values]
            for condition, values in played[SCALE_CONTROLLER].items()
        }
    return {
        scene: {
            law: {c: np.array([e for _, e in sorted(v)]) for c, v in own.items()}
            for law, own in laws.items()
        }
        for scene, laws in found.items()
    }, about


def join_results(
    one: tuple[Errors, Mapping[str, Any]], other: tuple[Errors, Mapping[str, Any]]
) -> tuple[Errors, list[str]]:
    """Join two results files, and return the differences in their provenance.

    A controller whose errors differ appears twice, as `NAME (a)` and `NAME (b)`. The
    files must have a device in common, with the same conditions and seeds.
    """
    (first, about), (second, of_other) = one, other
    common = [scene for scene in first if scene in second]
    if not common:
        raise CableError(
            f"nothing to compare: one has {', '.join(first)}, the other "
            f"{', '.join(second)}."
        )
    found: Errors = {}
    for scene in common:
        a, b = first[scene], second[scene]
        texts = [
            {
                (kind, n): t
                for kind in ("conditions", "seeds")
                for n, t in provenance[kind].items()
                if n.rpartition(" ")[0] == scene
            }
            for provenance in (about, of_other)
        ]
        if about.get("key", "") != of_other.get("key", ""):
            raise CableError(
                "the plants of both files have different secret keys; run one with "
                "--key of the other."
            )
        if texts[0] != texts[1]:
            raise CableError(
                f"the conditions or the seeds of {scene} are not the same in both "
                "files; run both with the same suite, --conditions, --seeds and "
                "--first-seed."
            )
        own = found.setdefault(scene, {})
        for name in dict.fromkeys((*a, *b)):
            mine, theirs = a.get(name, {}), b.get(name, {})
            pairs = ((values, theirs[at]) for at, values in mine.items() if theirs)
            if all(np.array_equal(*pair, equal_nan=True) for pair in pairs):
                own[name] = mine or theirs
            else:
                own[f"{name} (a)"], own[f"{name} (b)"] = a[name], b[name]
        own.setdefault(SCALE_CONTROLLER, a[SCALE_CONTROLLER])
        for name in (*REFERENCES, f"{SCALE_CONTROLLER} (a)", f"{SCALE_CONTROLLER} (b)"):
            own.pop(name, None)
    return found, origins.provenance_differences(about["made_by"], of_other["made_by"])
