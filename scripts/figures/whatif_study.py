"""Play the study of a what-if script, with its options and its progress."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from tqdm import tqdm

from cc_mujoco._utils.command_options import progress_options
from cc_mujoco.design import study
from cc_mujoco.report import figure_path


def studied(
    doc: str | None, name: str, number: int, **how: Any
) -> tuple[pa.Table, Path]:
    """Return the table of a study, and where its figure is to go.

    Args:
        name: of the figure, unless another is given.
        how: arguments of `study`.
    """
    parser = argparse.ArgumentParser(description=(doc or "").splitlines()[0])
    parser.add_argument("--out", type=figure_path, default=f"runs/{name}.png")
    parser.add_argument("--threads", type=int, default=0)
    given = parser.parse_args()
    given.out.parent.mkdir(parents=True, exist_ok=True)
    with tqdm(total=number, **progress_options()) as bar:
        table = study(
            controllers=["model"],  # knows the cables of each design
            **how,
            threads=given.threads,
            progress=lambda done: bar.update(done - bar.n),
        )
    return table, given.out


def grid(table: pa.Table, name: str, *shape: int) -> np.ndarray:
    """Return a metric over the variables of a study."""
    return np.array(table[name].to_numpy(zero_copy_only=False)).reshape(shape)
