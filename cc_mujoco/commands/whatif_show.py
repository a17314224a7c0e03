"""`cc-mujoco whatif-show`: the recording of one design of a study."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro


@dataclass(frozen=True)
class WhatIfShow:
    """Play one design of a study; write its recording, log, metrics and figure."""

    interrupted: ClassVar[str] = "nothing was written"

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DIR")]
    """Folder of the study."""
    row: Annotated[int, tyro.conf.Positional, tyro.conf.arg(metavar="ROW")]
    """Number of the design, column `design` of the table."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="PATH")] = None
    """Folder for the results; DIR/design-ROW unless given."""

    def run(self) -> None:
        """Play and write; print a table and how to open the recording."""
        from tqdm import tqdm

        from cc_mujoco.files import require_writable
        from cc_mujoco.recording import write_episode
        from cc_mujoco.whatif.show import show
        from cc_mujoco.whatif.store import read_study

        out = self.out or self.folder / f"design-{self.row}"
        duration = float(read_study(self.folder)["trial"]["duration"])
        require_writable(out)
        with tqdm(
            total=duration,
            unit="s",
            bar_format="{l_bar}{bar}| {n:.1f} of {total:.1f} s",
            disable=not sys.stderr.isatty(),
        ) as bar:
            log, model = show(
                self.folder, self.row, lambda time: bar.update(time - bar.n)
            )
        found = write_episode(out, log, model)
        for name, value in log.metadata["variables"].items():
            print(f"{name:32} {value:>10}")
        for metric in found:
            number = f"{metric.value:.4g}" if math.isfinite(metric.value) else "-"
            print(f"{metric.name:32} {number:>10} {metric.unit}")
        print(f"\nopen with:  rerun {out / 'recording.rrd'}\nsee also:   {out}")
