"""`cc-mujoco run`: run a controller, or the trials of a plan, on a real rig."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import tyro

from cc_mujoco._utils.command_options import Allowed, option_help
from cc_mujoco.errors import CableError

if TYPE_CHECKING:
    from cc_mujoco.control import Controller
    from cc_mujoco.hardware import RunLog, RunOutcome
    from cc_mujoco.hardware._references import Desired, Planned
    from cc_mujoco.hardware._settings import RigAxes


@dataclass(frozen=True)
class RunRig:
    """Drive a real rig with a controller, within limits, and record it."""

    interrupted: ClassVar[str] = "the rig was not touched"

    rig: Annotated[Path, tyro.conf.arg(metavar="FILE.toml")]
    """Address, limits and task of the rig."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Folder for log.csv, run.json and report.html; must not hold a run."""
    controller: Annotated[str | None, option_help("NAME")] = None
    """Controller of the motor: a name, MODULE:FUNCTION or POLICY.safetensors; of
    several axes also AXIS=NAME,AXIS=NAME."""
    duration: Annotated[float | None, option_help("S")] = None
    """Length of the run in seconds; 10 unless given."""
    plan: Annotated[Path | None, option_help("DIR")] = None
    """Instead of a controller: play the trials that `diagnose --plan` wrote there."""
    trial: Annotated[int | None, option_help("NUMBER")] = None
    """Only trial of --plan to play; else all that are not recorded yet, one by one."""
    allow: Allowed = ()
    """Code that files may name, once each; code that only a file names is refused."""

    def run(self) -> int:
        """Run the rig; print why the run ended and how many cycles were late.

        Returns an exit code other than 0 if the run ended before its time.
        """
        if self.plan is not None:
            return self._trials(self.plan)
        if self.trial is not None:
            raise CableError("--trial belongs to --plan, which is not given.")

        from cc_mujoco._validation import MAX_DURATION, require_number
        from cc_mujoco.hardware._run_log import require_free
        from cc_mujoco.hardware._settings import RigAxes, read_axes

        duration = 10.0 if self.duration is None else self.duration
        require_number("--duration", duration, 0.01, MAX_DURATION, "s")
        settings = read_axes(self.rig)
        if self.controller is None:
            raise CableError("name a controller by --controller, or a plan by --plan.")
        require_free(self.out)

        from cc_mujoco.control import PredictiveCompensation

        axes = RigAxes(settings)
        desired = axes.desired(duration)
        law = axes.controller(self.controller)
        laws = getattr(law, "laws", (law,))
        if any(isinstance(one, PredictiveCompensation) for one in laws):
            print(
                "cc-mujoco: warning: this controller takes the joint to be led by a "
                "wearer; one that hangs in a loose hand it may swing up. Begin with a "
                "small torque limit.",
                file=sys.stderr,
            )
        found = self._played(axes, law, desired, duration, self.controller)
        return self._report(found, settings[0].period)

    def _trials(self, folder: Path) -> int:
        """Run the trials of a plan; the user prepares the rig for each."""
        for own in ("controller", "duration"):
            if getattr(self, own) is not None:
                raise CableError(f"--{own} does not go with --plan, which has its own.")

        from cc_mujoco.control import controller
        from cc_mujoco.hardware._references import add_trial_facts, read_plan
        from cc_mujoco.hardware._run_log import require_free
        from cc_mujoco.hardware._settings import RigAxes, read_settings

        settings = read_settings(self.rig)
        limits = settings.limits
        if math.isfinite(limits.tension):
            raise CableError(
                "[limits] tension does not go with --plan, whose trials have "
                "pretensions of their own; leave it out."
            )
        wanted = self._wanted(read_plan(folder))
        for trial in wanted:
            require_free(self.out, trial.name)
        axes = RigAxes([settings])
        (drive,) = axes.drives
        for trial in wanted:
            trial.require_within(limits, drive)
        firm = settings.firm(drive)
        for trial in wanted:
            print(f"{trial.name}: {trial.notes} ({trial.duration:g} s)", flush=True)
            if self.trial is None:
                try:
                    input("make the rig ready, then press the return key: ")
                except EOFError:
                    raise CableError(
                        f"the terminal was closed; {trial.name} and what follows were "
                        "not played."
                    ) from None
            law, servo = controller("none", drive), trial.servo(drive, firm)
            found = self._played(
                axes, law, [servo], trial.duration, str(folder), trial.name
            )
            add_trial_facts(folder, trial.name, self.out, drive.inertia)
            if code := self._report(found, settings.period):
                return code
        return 0

    def _wanted(self, trials: list[Planned]) -> list[Planned]:
        from cc_mujoco.datasets._run_log import truncation_reason

        if self.trial is not None:
            if not 1 <= self.trial <= len(trials):
                raise CableError(
                    f"--trial must be 1 to {len(trials)}, not {self.trial}."
                )
            return [trials[self.trial - 1]]
        left = [t for t in trials if not (self.out / f"{t.name}.csv").exists()]
        for trial in (t for t in trials if t not in left):
            if why := truncation_reason(self.out / f"{trial.name}.csv"):
                print(
                    f"{trial.name} was cut short ({why.rstrip('.')}) and is left as "
                    f"it is; to record it again, move {self.out / trial.name}.csv and "
                    ".json away.",
                    file=sys.stderr,
                )
        if not left:
            raise CableError(f"{self.out} has all {len(trials)} trials of the plan.")
        if not sys.stdin.isatty():
            raise CableError(
                "between trials somebody has to make the rig ready; call it from a "
                "terminal, or for one trial by --trial NUMBER."
            )
        return left

    def _played(
        self,
        axes: RigAxes,
        law: Controller,
        desired: Sequence[Desired],
        duration: float,
        what: str,
        name: str | None = None,
    ) -> RunOutcome:
        from cc_mujoco._utils.provenance import versions
        from cc_mujoco.assets import SCENES
        from cc_mujoco.datasets._run_log import DEFAULT_LOG_NAME
        from cc_mujoco.hardware import Loop, RunLog, SystemClock, watch_for_stop
        from cc_mujoco.hardware._run_report import ReportedRun, write_run_report

        period, stem = law.drive.period, name or DEFAULT_LOG_NAME
        about = {
            "controller" if name is None else "plan": what,
            "duration_s": duration,
            "period_s": period,
            "rig": self.rig.read_text(encoding="utf-8-sig"),
            "versions": versions(),
        }
        with watch_for_stop() as stop:
            driven = axes.driven(axes.connect(), desired)
            rows = max(1, round(0.1 / period))  # of a block: a killed run loses no more
            log = RunLog(self.out, about, rows, stem, axes.log_names)
            clock, windings = SystemClock(), axes.windings
            loop = Loop(driven, law, clock=clock, log=log, stop=stop, windings=windings)
            try:
                loop.run(duration)
            finally:
                _close_log(log, loop.outcome)
        first = axes.settings[0]
        file = first.path.parent / first.scene
        is_own = first.scene not in SCENES and file.is_file()
        scene = str(file) if is_own else first.scene
        limits = [each.limits for each in axes.settings]
        kept = dict(zip(axes.log_names, limits, strict=True))
        about_run = name or what, scene, period, kept, name is not None
        run = ReportedRun(self.out / f"{stem}.csv", loop.outcome, *about_run)
        try:
            print(f"report:     {write_run_report(run)}")
        except (CableError, OSError) as error:  # a run without a page is a run
            print(f"report:     none, {error}")
        return loop.outcome

    def _report(self, found: RunOutcome, period: float) -> int:
        """Print the outcome of a run; return its exit code."""
        from cc_mujoco.hardware._run_report import AT_LIMIT_SHARE

        late, work = found.late.quantiles(), found.work.quantiles()
        print(
            f"{found.cycles} cycles of {period * 1e3:g} ms, {found.missed} missed, "
            f"{found.without_reading} without a new reading"
        )
        if late and work:
            print(
                f"late by {late['p50_us']:g} us (median), {late['p99_us']:g} (99 %), "
                f"{late['longest_us']:g} (longest); at work for {work['p50_us']:g} us, "
                f"{work['p99_us']:g}, {work['longest_us']:g}"
            )
        torque = "a motor got all that [limits] torque", ", or ask for less"
        rate = "a torque changed as fast as [limits] torque_rate", ""
        counts = found.limited, found.rate_limited
        for reached, (what, more) in zip(counts, (torque, rate), strict=True):
            if reached > AT_LIMIT_SHARE * found.cycles:
                print(
                    f"in {reached / found.cycles:.0%} of the cycles {what} allows, and "
                    f"went where that let it; raise it if the rig may{more}"
                )
        for why, count in sorted(found.ignored.items()):
            print(f"{count} packets ignored: {why}")
        print(f"see also:   {self.out}")
        if found.code:
            print(f"cc-mujoco: {found.sentence}", file=sys.stderr)
        else:
            print(found.sentence)
        return found.code


def _close_log(log: RunLog, outcome: RunOutcome) -> None:
    """Complete a log; a run whose log cannot be completed has failed."""
    for write in (log.flush, lambda: log.close(outcome.to_json())):
        try:
            write()
        except CableError as error:
            if not outcome.code:
                outcome.sentence, outcome.code = str(error), 3
