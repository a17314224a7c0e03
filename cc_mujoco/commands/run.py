"""`cc-mujoco run`: a controller on a real rig."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro


@dataclass(frozen=True)
class Run:
    """Drive a real rig with a controller, within limits, and record it."""

    interrupted: ClassVar[str] = "the rig was not touched"

    rig: Annotated[Path, tyro.conf.arg(metavar="FILE.toml")]
    """Address, limits and task of the rig."""
    controller: Annotated[str, tyro.conf.arg(metavar="NAME")]
    """What drives the motor: a name, MODULE:FUNCTION or POLICY.safetensors."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Folder for log.csv and run.json; must not hold a run."""
    duration: float = 10.0
    """Length of the run in seconds."""

    def run(self) -> None:
        """Run; print why it ended and how punctual it was.

        Raises:
            CableError: Something is wrong before the rig is touched.
            SystemExit: The run ended before its time, see the exit codes.
        """
        from cc_mujoco.checks import LONGEST, number
        from cc_mujoco.hardware.log import require_free
        from cc_mujoco.hardware.settings import read_settings

        number("--duration", self.duration, 0.01, LONGEST, "s")
        settings = read_settings(self.rig)
        require_free(self.out)
        desired = settings.desired(self.duration)

        from cc_mujoco.control import controller
        from cc_mujoco.hardware import Log, Loop, SystemClock, drive_of, listening
        from cc_mujoco.hardware.log import BLOCK
        from cc_mujoco.identity import versions

        limits, period = settings.limits, settings.period
        drive = drive_of(settings.scene, self.rig.parent, period, limits.torque)
        law = controller(self.controller, drive)
        about = {
            "cc_mujoco": "run",
            "controller": self.controller,
            "duration_s": self.duration,
            "period_s": period,
            "rig": self.rig.read_text(encoding="utf-8-sig"),
            "versions": versions(),
        }
        with listening() as stop:
            rig = settings.connect()
            log = Log(self.out, about, max(1, round(BLOCK / period)))
            loop = Loop(
                rig,
                law,
                desired,
                limits,
                settings.watchdog,
                clock=SystemClock(),
                log=log,
                stop=stop,
            )
            try:
                found = loop.run(self.duration)
            finally:
                log.close(loop.outcome.to_json())
        late, work = found.late.told(), found.work.told()
        print(
            f"{found.cycles} cycles of {period * 1e3:g} ms, {found.missed} missed, "
            f"{found.without_reading} without a new reading\n"
            f"late by {late['p50_us']:g} us (median), {late['p99_us']:g} (99 %), "
            f"{late['longest_us']:g} (longest); at work for {work['p50_us']:g} us, "
            f"{work['p99_us']:g}, {work['longest_us']:g}"
        )
        for why, count in sorted(found.ignored.items()):
            print(f"{count} packets ignored: {why}")
        print(f"see also:   {self.out}")
        if found.code:
            print(f"cc-mujoco: {found.sentence}", file=sys.stderr)
            raise SystemExit(found.code)
        print(found.sentence)
