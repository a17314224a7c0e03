"""`cc-mujoco whatif`: many designs of a transmission, measured and ranked."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from cc_mujoco.commands.options import Flag, Name, in_words
from cc_mujoco.errors import CableError

Names = tyro.conf.UseAppendAction[tuple[str, ...]]


@dataclass(frozen=True)
class WhatIf:
    """Simulate many designs; write their table, ranking, effects and figures."""

    interrupted: ClassVar[str] = (
        "designs that were finished are kept; the same command goes on"
    )

    scene: Annotated[str, tyro.conf.arg(metavar="SCENE")] = "wrist"
    """A device; `cc-mujoco list` shows every name that can be given."""
    vary: Annotated[Names, tyro.conf.arg(metavar="VARIABLE=VALUES")] = ()
    """VALUES are low:high:count, low:high:count:log or a,b,c; once per variable."""
    designs: Annotated[Path | None, in_words("FILE")] = None
    """CSV or TOML file of designs, instead of --vary."""
    sampling: Annotated[str, tyro.conf.arg(metavar="NAME")] = "grid"
    """grid, or lhs for a Latin hypercube of --samples designs."""
    samples: Annotated[int | None, in_words("INT")] = None
    """How many designs the Latin hypercube has."""
    trajectory: Name = None
    """How the wearer moves: a name or FILE.csv; the default depends on the scene."""
    task: Name = None
    """What the device should make the wearer feel; the default depends on the scene."""
    controller: Annotated[str, tyro.conf.arg(metavar="NAME")] = "pi"
    """What drives the motor: a name, MODULE:FUNCTION of yours, or POLICY.zip."""
    duration: float = 10.0
    """Length of an episode in seconds."""
    seed: int = 0
    """Seed of everything random, sampling included."""
    timestep: Annotated[float | None, in_words("FLOAT")] = None
    """Time step in seconds, a divisor of 0.001; that of the scene unless given."""
    metric: Annotated[Names, tyro.conf.arg(metavar="NAME")] = ()
    """What to measure, once each; everything unless given."""
    objective: Annotated[Names, tyro.conf.arg(metavar="METRIC")] = ()
    """What makes a design good, once each, also min:METRIC or max:METRIC."""
    threads: Annotated[int, in_words()] = 0
    """Threads that simulate; one per processor unless given."""
    scheduler: Annotated[str | None, in_words("ADDRESS")] = None
    """tcp://HOST:PORT of a Dask scheduler, whose workers simulate instead."""
    worker_timeout: float = 60.0
    """Seconds after which that is given up if the scheduler has no workers."""
    out: Annotated[Path | None, in_words("DIR")] = None
    """Folder for the results; runs/whatif-SCENE unless given."""
    again: Flag = False
    """Simulate also what an earlier run has finished, and replace its table."""

    def run(self) -> None:
        """Run what is not done yet; print the best designs and where the rest is."""
        from tqdm import tqdm

        from cc_mujoco.whatif.pareto import read_objectives
        from cc_mujoco.whatif.plan import make_plan
        from cc_mujoco.whatif.report import FILES, write_report
        from cc_mujoco.whatif.store import require_ours
        from cc_mujoco.whatif.study import carry_out

        if self.threads < 0:
            raise CableError(f"--threads must be 0 or greater, not {self.threads}.")
        folder = self.out or Path("runs", f"whatif-{self.scene}")
        plan = make_plan(
            self.scene,
            self._vary(),
            self.designs,
            sampling=self.sampling,
            samples=self.samples,
            trajectory=self.trajectory,
            task=self.task,
            controller=self.controller,
            duration=self.duration,
            seed=self.seed,
            timestep=self.timestep,
            metrics=self.metric,
        )
        objectives = read_objectives(self.objective, plan.protocol.metrics)
        require_ours(folder, FILES)
        with tqdm(
            total=len(plan.designs),
            unit="design",
            bar_format="{l_bar}{bar}| {n:.0f} of {total} designs  {elapsed}<{remaining}"
            "  {rate_fmt}",
            disable=not sys.stderr.isatty(),
        ) as bar:
            table = carry_out(
                plan,
                folder,
                self.threads,
                self.scheduler,
                lambda done: bar.update(done - bar.n),
                worker_timeout=self.worker_timeout,
                again=self.again,
                say=tqdm.write,
            )
        files = write_report(folder, plan, table, objectives)
        failed = len(table) - table["failed"].null_count
        print(f"{len(table)} designs, {failed} of which failed in simulation")
        print(f"table:    {folder / 'table.parquet'}")
        for path in files:
            print(f"          {path}")
        print(f"one row:  cc-mujoco whatif-show {folder} ROW")

    def _vary(self) -> dict[str, str]:
        found: dict[str, str] = {}
        for text in self.vary:
            name, equals, values = text.partition("=")
            if not equals or not name or not values:
                raise CableError(f"--vary {text!r} must be VARIABLE=VALUES.")
            if name in found:
                raise CableError(f"--vary gives {name!r} twice.")
            found[name] = values
        return found
