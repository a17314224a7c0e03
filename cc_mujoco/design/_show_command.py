"""`cc-mujoco whatif-show`: simulate a design of a study again, with a recording."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from cc_mujoco._utils import command_options as options


@dataclass(frozen=True)
class WhatIfShow:
    """Play one design of a study; write its recording, log, metrics and figure.

    With --against, play two and write a table, a figure and a recording of both.
    """

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="STUDY")]
    """Folder of the study, as `cc-mujoco whatif` wrote it."""
    row: Annotated[int, tyro.conf.Positional, tyro.conf.arg(metavar="ROW")]
    """Number of the design, column `design` of the table."""
    case: Annotated[int | None, options.option_help("INT")] = None
    """Case of a study across several, from 0; the worst by its first metric unless
    given."""
    against: Annotated[int | None, options.option_help("ROW")] = None
    """Another design, to set the one beside."""
    out: Annotated[Path | None, options.option_help("DIR")] = None
    """Folder for the results; STUDY/design-ROW, or STUDY/design-ROW-against-ROW, unless
    given."""

    video: options.Flag = False
    """Write video.mp4, too: the scene beside torques and tensions."""
    html: options.Flag = False
    """Write episode.html, too: a page that plays the episode in any browser."""
    allow: options.Allowed = ()
    """Code that files may name, once each; code that only a file names is refused."""

    def run(self) -> None:
        if self.against is None:
            self._show()
        else:
            self._compare(self.against)

    def _compare(self, against: int) -> None:
        from cc_mujoco.design import _show as show
        from cc_mujoco.errors import CableError

        if self.video or self.html:
            raise CableError(
                "--video and --html show one design; leave them out with --against."
            )
        row = self.row
        out = self.out or self.folder / f"design-{row}-against-{against}"
        study, case = self.folder, self.case
        duration = float(show.FinishedStudy(study).protocol["duration"])
        with options.progress_bar(2.0 * duration) as progress:
            pairs = show.write_comparison(out, study, row, against, case, progress)
        lines = [("", *show.head(row, against)), *((p.name, *p.cells) for p in pairs)]
        for name, *cells in lines:
            print(f"{name:36}", *(f"{each:>12}" for each in cells))
        print(f"\nopen with:  rerun {out / show.RECORDING}\nsee also:   {out}")

    def _show(self) -> None:
        from cc_mujoco.design._protocol import metric_of
        from cc_mujoco.design._show import FinishedStudy, show
        from cc_mujoco.device._variables import describe
        from cc_mujoco.viz import write_episode
        from cc_mujoco.viz._episode_files import require_ours

        out = self.out or self.folder / f"design-{self.row}"
        study = FinishedStudy(self.folder)
        duration, row = float(study.protocol["duration"]), study.row(self.row)
        played = study.case(self.row, self.case)
        require_ours(out, self.video, self.html)
        with options.progress_bar(duration) as progress:
            log, model = show(self.folder, self.row, progress, self.case)
        messages: list[str] = []
        with options.video_progress_bar(duration if self.video else 0.0) as progress:
            write_episode(
                out,
                log,
                model,
                video=self.video,
                html=self.html,
                progress=progress,
                say=messages.append,
            )
        for name in study.about["variables"]:
            print(_line(name, row[name], describe(name).unit))
        for name, value in played.items():
            print(_line(f"case: {name}", value, describe(name).unit))
        # Those of the table: the episode's own have some names in common with them.
        for name in study.protocol["metrics"]:
            own = [column for column in row if column.endswith(f".{name}")]
            for column in (name, *own):
                print(_line(column, row[column], metric_of(name).unit))
        print(f"\nopen with:  rerun {out / 'recording.rrd'}\nsee also:   {out}")
        for sentence in messages:
            print(sentence)


def _line(name: str, value: object, unit: str) -> str:
    number = f"{value:.4g}" if isinstance(value, float) else str(value)
    return f"{name:32} {'-' if value is None else number:>10} {unit}"
