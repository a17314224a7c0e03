"""A bench on paper: an elastic drive with dry friction that turns a handle on a spring.

The handle follows the motor with play: it moves when the torque across the drive
differs from that of its spring by the friction. All works are known in closed form.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from cc_mujoco.datasets import Dataset, Trial
from cc_mujoco.datasets._data_findings import DataFinding, errors
from cc_mujoco.diagnosis import load

Columns = dict[str, NDArray[np.float64]]

RATIO = 4.0
"""Motor angle per joint angle."""
DRIVE, SPRING, FRICTION = 5.0, 2.0, 0.15


def recording(
    seconds: float = 20.0, rate: float = 500.0, seed: int = 0, noise: float = 1.0
) -> Columns:
    """Return a trial with sensor noise and quantised angles."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * rate)) / rate
    angle = np.zeros_like(time)
    for frequency in rng.uniform(0.2, 1.2, 4):
        angle += 0.35 * np.sin(2.0 * np.pi * frequency * time + rng.uniform(0, 6))
    pull = DRIVE * angle
    reach = FRICTION / (DRIVE + SPRING)
    joint = np.empty_like(angle)
    here = 0.0
    for k, wanted in enumerate(pull / (DRIVE + SPRING)):
        here = min(max(here, wanted - reach), wanted + reach)
        joint[k] = here
    torque = pull - DRIVE * joint
    scatter = noise * rng.standard_normal((4, len(time)))
    return {
        "time_s": time,
        "motor_angle_rad": quantised(RATIO * angle + 1e-4 * scatter[0], noise * 3e-4),
        "motor_torque_nm": torque / RATIO + 1e-3 * scatter[1],
        "joint_angle_rad": quantised(joint + 1e-4 * scatter[2], noise * 2e-4),
        "joint_torque_nm": SPRING * joint + 2e-3 * scatter[3],
    }


def quantised(values: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Values on multiples of a step; as they are if it is 0."""
    return np.round(values / step) * step if step else values


def write(path: Path, columns: Mapping[str, object]) -> Path:
    """Write columns as CSV, the cells of text columns as they are."""
    cells = [
        [cell if isinstance(cell, str) else f"{cell:.9g}" for cell in column]  # type: ignore[attr-defined]
        for column in columns.values()
    ]
    lines = [",".join(columns), *(",".join(row) for row in zip(*cells, strict=True))]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def loaded(
    folder: Path, columns: Columns, toml: str = ""
) -> tuple[Dataset, list[DataFinding]]:
    """Load columns as the trial `run`; every sentence must be one that names it."""
    path = folder / "run.parquet"
    pq.write_table(pa.table(columns), path)
    (folder / "dataset.toml").write_text(toml)
    dataset, findings = load(path, folder / "dataset.toml")
    for finding in findings:
        assert finding.statement.endswith(".") and "\n" not in finding.statement
        assert "run" in finding.statement
    return dataset, findings


def only_fix(findings: list[DataFinding]) -> DataFinding:
    """Return the only finding that must be corrected."""
    (found,) = errors(findings)
    return found


def one(folder: Path, columns: Columns, toml: str = "") -> Trial:
    """Return the trial of columns in which nothing needs repair."""
    dataset, findings = loaded(folder, columns, toml)
    assert errors(findings) == []
    (trial,) = dataset.trials
    return trial
