"""`cc-mujoco benchmark`: controllers against each other."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from cc_mujoco.commands.options import Flag, Names, in_words
from cc_mujoco.errors import CableError


@dataclass(frozen=True)
class Benchmark:
    """Play every controller, trajectory, task and seed; write tables and figures."""

    interrupted: ClassVar[str] = "cells that were finished are kept"

    scene: Annotated[str, tyro.conf.arg(metavar="SCENE")] = "all"
    """A device, or all; `cc-mujoco list` shows every name that can be given."""
    controllers: Names = ()
    """Names, MODULE:FUNCTION of yours or POLICY.zip; every name unless given."""
    trajectories: Names = ()
    """How the wearer moves; the defaults depend on the scene."""
    tasks: Names = ()
    """What the wearer should feel; the defaults depend on the scene."""
    seeds: int = 5
    """Number of seeds: noise, errors of the models, random motions."""
    duration: float = 6.0
    """Length of an episode in seconds."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("runs", "benchmark")
    """Folder for the results."""
    workers: Annotated[int, in_words()] = 0
    """Processes that play; one per processor unless given. They change no result."""
    record: Names = ()
    """Cells whose first seed is recorded too, as SCENE-CONTROLLER-TRAJECTORY-TASK."""
    again: Flag = False
    """Play also what an earlier run of the same code has finished."""

    def run(self) -> None:
        """Play what is not done yet; print the tables."""
        for name, value, least in (
            ("seeds", self.seeds, 1),
            ("workers", self.workers, 0),
        ):
            if value < least:
                raise CableError(f"--{name} must be {least} or greater, not {value}.")

        from tqdm import tqdm

        from cc_mujoco.benchmark import Cell, Plan, run
        from cc_mujoco.benchmark.runner import require_ours
        from cc_mujoco.benchmark.writing import (
            recording_folder,
            write,
            write_recording,
        )
        from cc_mujoco.control import CONTROLLERS
        from cc_mujoco.devices import DEVICES
        from cc_mujoco.recording import episode

        plan = Plan(
            tuple(DEVICES) if self.scene == "all" else (self.scene,),
            self.controllers or tuple(CONTROLLERS),
            self.trajectories,
            self.tasks,
            self.seeds,
            self.duration,
        )
        cells = {cell.name: cell for cell in plan.cells()}
        for name in self.record:
            if name not in cells:
                raise CableError.unknown("cell", name, cells)
        require_ours(plan, self.out)
        for name in self.record:
            episode.require_ours(recording_folder(self.out, cells[name]))
        for warning in plan.check():
            print(f"warning: {warning}", file=sys.stderr)
        with tqdm(
            total=len(cells), unit="cell", disable=not sys.stderr.isatty()
        ) as bar:

            def told(cell: Cell, fresh: bool) -> None:
                bar.update()

            results = run(
                plan,
                self.out,
                workers=self.workers or os.cpu_count() or 1,
                again=self.again,
                finished=told,
                say=tqdm.write,
            )
        print(write(self.out, results))
        for name in self.record:
            print(f"recorded:   {write_recording(self.out, cells[name])}")
        print(f"see also:   {self.out}")
