"""`cc-mujoco whatif`: simulate many designs of a transmission, and rank them."""

import os
import shlex
import sys
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import tyro

from cc_mujoco._utils import command_options as options
from cc_mujoco.design._whatif_options import Execution, StudySpec
from cc_mujoco.errors import CableError

if TYPE_CHECKING:
    from cc_mujoco.design._plan import Plan


@dataclass(frozen=True)
class WhatIf:
    """Simulate many designs; write their table, ranking, effects and figures."""

    interrupted: ClassVar[str] = (
        "finished batches of designs, if any, are kept; the same command goes on"
    )

    study: tyro.conf.OmitArgPrefixes[StudySpec]
    around: options.Flag = False
    """Simulate around the best design, too: what variables and limits are worth."""
    execution: tyro.conf.OmitArgPrefixes[Execution] = field(default_factory=Execution)
    out: Annotated[Path | None, options.option_help("DIR")] = None
    """Folder for the results; runs/whatif-SCENE unless given."""
    allow: options.Allowed = ()
    """Code that files may name, once each; code that only a file names is refused."""

    def run(self) -> None:
        with options.progress_word("checking the device and its designs"):
            plan, folder = self._plan()
        from tqdm import tqdm

        from cc_mujoco._utils.provenance import command_line
        from cc_mujoco.design import _report_text as text
        from cc_mujoco.design import carry_out
        from cc_mujoco.design._evaluation import beyond_motor
        from cc_mujoco.design._execution import search, wait_sentences
        from cc_mujoco.design._follow_up import analyse_best_design, check_timestep
        from cc_mujoco.design._report import write_report

        for row in sorted({0, len(plan.designs) - 1}) if plan.search is None else ():
            if beyond := beyond_motor(plan.protocol, plan.designs[row]):
                print(f"warning: design {row}: {beyond}", file=sys.stderr)
        if uncertain := text.material_sentence(plan):
            print(f"warning: {uncertain}", file=sys.stderr)
        for sentence in wait_sentences(plan, self.execution.threads):
            print(sentence, file=sys.stderr, flush=True)
        with tqdm(
            total=plan.evaluations or len(plan.designs),
            unit="design",
            bar_format="{l_bar}{bar}| {n:.0f} of {total} designs  {elapsed}<{remaining}"
            "  {rate_fmt}",
            **options.progress_options(),
        ) as bar:

            def progress(done: float) -> None:
                bar.total = max(bar.total, done)  # an earlier search may have more
                bar.update(done - bar.n)

            if plan.search is None:
                table = carry_out(plan, folder, self.execution, progress, tqdm.write)
            else:
                plan, table = search(plan, folder, self.execution, progress, tqdm.write)
        command = f"cd {shlex.quote(os.getcwd())} && {command_line()}"
        run = partial(carry_out, execution=replace(self.execution, again=False))
        nearby = None
        if self.around:
            nearby = analyse_best_design(plan, table, run)
        with options.progress_word("some designs at half the time step"):
            half = check_timestep(plan, table, text.goals_of(plan, table), run)
        found = text.RankedStudy(plan, table, nearby, half)
        files = write_report(folder, found, command)
        if self.around and nearby is None:
            print("around:   nothing, as no design is good enough or none can move")
        failed = len(table) - table["failed"].null_count
        designs = "1 design" if len(table) == 1 else f"{len(table)} designs"
        print(f"{designs}, {failed} of which failed in simulation")
        # Reasons of failures that are printed; the report lists all
        for sentence in text.failure_reasons(found)[:3]:
            print(f"          {sentence}")
        for sentence in text.controllers_out(found):
            print(sentence)
        if plan.limits:
            print(f"{int(found.kept.sum())} keep the limits")
        print(text.answer_sentence(found))
        print("sensors:  perfect here; those of `cc-mujoco play` are the device's")
        if half is not None and half.unsettled:
            print(f"WARNING: {text.timestep_sentence(half)}")
        print(f"table:    {folder / 'table.parquet'}")
        for path in files:
            print(f"          {path}")
        print(f"one row:  cc-mujoco whatif-show {folder} ROW")

    def _plan(self) -> "tuple[Plan, Path]":
        """Return the plan, and the folder, checked to accept its results."""
        from cc_mujoco.device._device_files import locate

        locate(self.study.scene)
        if self.execution.threads < 0:
            raise CableError(
                f"--workers must be 0 or greater, not {self.execution.threads}."
            )
        from cc_mujoco._utils.atomic_io import require_unmodified
        from cc_mujoco.design._plan import make_plan
        from cc_mujoco.design._report import REPORT_FILES
        from cc_mujoco.design._results_store import require_ours

        name = Path(self.study.scene).name.partition(".")[0]
        folder = self.out or Path("runs", f"whatif-{name}")
        plan = make_plan(self.study)
        require_ours(folder)
        require_unmodified(folder, REPORT_FILES)
        if self.around and not plan.objectives:
            raise CableError("--around goes by an --objective, which is not given.")
        return plan, folder
