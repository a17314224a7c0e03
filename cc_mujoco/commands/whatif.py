"""`cc-mujoco whatif`: many designs of a transmission, measured and ranked."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import tyro

from cc_mujoco.commands.options import Flag, Name, in_words, shown_by
from cc_mujoco.errors import CableError

if TYPE_CHECKING:
    import pyarrow as pa

    from cc_mujoco.whatif.pareto import Limit, Objective
    from cc_mujoco.whatif.plan import Plan
    from cc_mujoco.workers import Progress

Names = tyro.conf.UseAppendAction[tuple[str, ...]]


@dataclass(frozen=True)
class WhatIf:
    """Simulate many designs; write their table, ranking, effects and figures."""

    interrupted: ClassVar[str] = (
        "designs that were finished, if any, are kept; the same command goes on"
    )

    scene: Annotated[str, tyro.conf.arg(metavar="SCENE")] = "wrist"
    """A device; `cc-mujoco list` shows every name that can be given."""
    vary: Annotated[Names, tyro.conf.arg(metavar="VARIABLE=VALUES")] = ()
    """VALUES are low:high:count, low:high:count:log or a,b,c; once per variable."""
    designs: Annotated[Path | None, in_words("FILE")] = None
    """CSV or TOML file of designs, instead of --vary."""
    sampling: Annotated[str, tyro.conf.arg(metavar="NAME")] = "grid"
    """Sampling: grid, or lhs for a Latin hypercube of --samples designs."""
    samples: Annotated[int | None, in_words("INT")] = None
    """Number of designs of the Latin hypercube."""
    trajectory: Name = None
    """Motion of the wearer: a name or FILE.csv; the default depends on the scene."""
    task: Name = None
    """Feel that the device should give the wearer; the default depends on the scene."""
    controllers: Annotated[tuple[str, ...], in_words("NAME [NAME ...]")] = ("model",)
    """Controllers of the motor: names, MODULE:FUNCTION or POLICY.safetensors; of
    several, each design is judged with the one that tracks best."""
    duration: float = 10.0
    """Length of an episode in seconds."""
    seed: int = 0
    """Seed of everything random, sampling included."""
    timestep: Annotated[float | None, in_words("FLOAT")] = None
    """Time step in seconds, a divisor of 0.001; that of the scene unless given."""
    metric: Annotated[Names, tyro.conf.arg(metavar="NAME")] = ()
    """Metrics to measure, once each; all that designs have unless given."""
    objective: Annotated[Names, tyro.conf.arg(metavar="METRIC")] = ()
    """Metrics that make a design good, once each, also min:METRIC or max:METRIC."""
    subject_to: Annotated[Names, tyro.conf.arg(metavar="METRIC>=NUMBER")] = ()
    """A limit that a good design keeps, also METRIC<=NUMBER; once each."""
    across: Annotated[Names, tyro.conf.arg(metavar="NAME=VALUES")] = ()
    """Judge designs over cases: values of a variable, or of wearer, the wearer's
    impedance times the scene's; once per name, every combination is a case."""
    rank: Name = None
    """Statistic of a metric over the cases: worst, p90 or mean; worst unless given.
    Limits hold in every case."""
    costs: Annotated[Path | None, in_words("FILE")] = None
    """CSV file part,per,cost of what parts cost; round figures as an example if not
    given."""
    optimise: Annotated[int | None, in_words("INT")] = None
    """Search for the best with so many designs; VALUES may then be low:high[:log]."""
    around: Flag = False
    """Simulate around the best design, too: what variables and limits are worth."""
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

        from cc_mujoco.files import require_signed
        from cc_mujoco.whatif.around import around
        from cc_mujoco.whatif.halved import halved
        from cc_mujoco.whatif.pareto import within
        from cc_mujoco.whatif.report import FILES, goals_of, write_report
        from cc_mujoco.whatif.sections import controllers_out, settled
        from cc_mujoco.whatif.store import require_ours
        from cc_mujoco.whatif.study import carry_out

        if self.threads < 0:
            raise CableError(f"--threads must be 0 or greater, not {self.threads}.")
        folder = self.out or Path("runs", f"whatif-{self.scene}")
        plan, objectives, limits = self._asked()
        require_ours(folder, FILES)
        require_signed(folder, FILES)
        if self.around and not objectives:
            raise CableError("--around goes by an --objective, which is not given.")
        with tqdm(
            total=self.optimise or len(plan.designs),
            unit="design",
            bar_format="{l_bar}{bar}| {n:.0f} of {total} designs  {elapsed}<{remaining}"
            "  {rate_fmt}",
            **shown_by(),
        ) as bar:

            def progress(done: float) -> None:
                bar.total = max(bar.total, done)  # an earlier search may have more
                bar.update(done - bar.n)

            plan, table = self._carried_out(plan, objectives, limits, folder, progress)
        command = shlex.join(["cc-mujoco", *sys.argv[1:]])
        run = partial(
            carry_out,
            threads=self.threads,
            scheduler=self.scheduler,
            worker_timeout=self.worker_timeout,
        )
        nearby = None
        if self.around:
            nearby = around(plan, table, objectives, limits, run)
        with tqdm(
            desc="some designs at half the time step",
            bar_format="{desc}  {elapsed}",
            leave=False,
            **shown_by(),
        ):
            half = halved(plan, table, goals_of(plan, table, objectives), limits, run)
        files = write_report(
            folder, plan, table, objectives, limits, command, nearby, half
        )
        if self.around and nearby is None:
            print("around:   nothing, as no design is good enough or none can move")
        failed = len(table) - table["failed"].null_count
        designs = "1 design" if len(table) == 1 else f"{len(table)} designs"
        print(f"{designs}, {failed} of which failed in simulation")
        for sentence in controllers_out(plan, table.to_pylist()):
            print(sentence)
        if limits:
            kept = int(within(table, limits).sum())
            print(f"{kept} keep the limits{'' if kept else ': NONE IS GOOD ENOUGH'}")
        if half is not None and half.unsettled:
            print(f"WARNING: {settled(half)}")
        print(f"table:    {folder / 'table.parquet'}")
        for path in files:
            print(f"          {path}")
        print(f"one row:  cc-mujoco whatif-show {folder} ROW")

    def _asked(self) -> tuple[Plan, tuple[Objective, ...], tuple[Limit, ...]]:
        """Return the plan, objectives and limits."""
        from cc_mujoco.whatif.pareto import read_limits, read_objectives
        from cc_mujoco.whatif.plan import make_plan
        from cc_mujoco.whatif.search import make_search

        trial: dict[str, Any] = {
            "trajectory": self.trajectory,
            "task": self.task,
            "controllers": self.controllers,
            "duration": self.duration,
            "seed": self.seed,
            "timestep": self.timestep,
            "metrics": self.metric,
            "across": _pairs("across", "NAME", self.across),
            "rank": self.rank,
            "costs": self.costs,
        }
        vary = _pairs("vary", "VARIABLE", self.vary)
        if self.optimise is not None:
            if self.designs is not None or self.sampling != "grid" or self.samples:
                raise CableError(
                    "--optimise chooses the designs itself: give --vary, and neither "
                    "--designs nor --sampling nor --samples."
                )
            return make_search(
                self.scene, vary, self.objective, self.subject_to, **trial
            )
        plan = make_plan(
            self.scene,
            vary,
            self.designs,
            sampling=self.sampling,
            samples=self.samples,
            goals=read_objectives(self.objective),
            **trial,
        )
        measured = plan.protocol.metrics
        return (
            plan,
            read_objectives(self.objective, measured),
            read_limits(self.subject_to, measured, plan.protocol.across.several),
        )

    def _carried_out(
        self,
        plan: Plan,
        objectives: tuple[Objective, ...],
        limits: tuple[Limit, ...],
        folder: Path,
        progress: Progress,
    ) -> tuple[Plan, pa.Table]:
        """Return the plan with all designs, and their table."""
        from tqdm import tqdm

        from cc_mujoco.whatif.search import search
        from cc_mujoco.whatif.study import carry_out

        where = (folder, self.threads, self.scheduler, progress)
        how: dict[str, Any] = {
            "worker_timeout": self.worker_timeout,
            "again": self.again,
            "say": tqdm.write,
        }
        if self.optimise is None:
            return plan, carry_out(plan, *where, **how)
        return search(plan, objectives, limits, self.optimise, *where, **how)


def _pairs(option: str, what: str, texts: Iterable[str]) -> dict[str, str]:
    """Names and their values, as an option gives them."""
    found: dict[str, str] = {}
    for text in texts:
        name, equals, values = text.partition("=")
        if not equals or not name or not values:
            raise CableError(f"--{option} {text!r} must be {what}=VALUES.")
        if name in found:
            raise CableError(f"--{option} gives {name!r} twice.")
        found[name] = values
    return found
