"""Two designs of a finished study beside each other: numbers, figure and recording."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from cc_mujoco import figures, files, markdown
from cc_mujoco.errors import CableError
from cc_mujoco.whatif.show import case_of, find_own, read_row, show
from cc_mujoco.whatif.store import CONTROLLER, read_study
from cc_mujoco.whatif.wording import cell, headed

TABLE, PICTURE, RECORDING = "comparison.md", "comparison.png", "comparison.rrd"
FILES = (TABLE, PICTURE, RECORDING)
"""Files that `write_comparison` leaves in its folder."""


class Pair(NamedTuple):
    """A variable or a metric of two designs."""

    name: str
    """With its unit, if it has one."""
    one: object
    other: object

    @property
    def difference(self) -> float | None:
        """The one less the other; None where they are no numbers."""
        both = self.one, self.other
        if not all(isinstance(v, int | float) and type(v) is not bool for v in both):
            return None
        return float(self.one) - float(self.other)  # type: ignore[arg-type]

    @property
    def cells(self) -> tuple[str, str, str]:
        """Both values and their difference, in words."""
        return cell(self.one), cell(self.other), cell(self.difference)


def compare(
    folder: str | Path, row: int, against: int, case: int | None = None
) -> list[Pair]:
    """Variables, cases and metrics of two designs, as the table of the study has them.

    Args:
        folder: of the study.
        row: number of the one design, column `design` of its table.
        against: number of the other.
        case: in which they are shown, see `show.show`.

    Raises:
        CableError: there is no finished study, no such row or case, or both designs
            are the same.
    """
    if row == against:
        raise CableError(f"design {row} is compared with itself; name another one.")
    find_own(folder)
    about = read_study(Path(folder))
    protocol = about["protocol"]
    rows = [read_row(folder, number) for number in (row, against)]
    cases = [case_of(folder, number, case) for number in (row, against)]
    names = [*about["variables"]]
    if len(protocol["controllers"]) > 1:
        names.append(CONTROLLER)
    pairs = [Pair(headed(name), *(each[name] for each in rows)) for name in names]
    pairs += [
        Pair(f"case: {headed(name)}", *(each[name] for each in cases))
        for name in cases[0]
    ]
    metrics = protocol["metrics"]
    return pairs + [Pair(headed(n), *(each[n] for each in rows)) for n in metrics]


def require_ours(out: str | Path) -> None:
    """Find out, before designs are played, whether `FILES` may be written there.

    Raises:
        CableError: If not; see `files.require_ours`.
    """
    files.require_ours(out, FILES, lambda place: figures.is_ours(place / PICTURE))


def write_comparison(
    out: str | Path,
    folder: str | Path,
    row: int,
    against: int,
    case: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> list[Pair]:
    """Play two designs of a study and write table, figure and recording of both.

    Args:
        out: folder for `FILES`; made if need be.
        folder: of the study.
        row: number of the one design.
        against: number of the other, which differences are taken from.
        case: of a study over several, see `show.show`.
        progress: called with the simulated time [s] of both together.

    Returns:
        What the table holds.

    Raises:
        CableError: see `compare`, `show.show` and `require_ours`.
    """
    from cc_mujoco.recording.side_by_side import (
        LabelledEpisode,
        draw_side_by_side,
        write_side_by_side,
    )

    pairs = compare(folder, row, against, case)
    require_ours(out)
    duration = float(read_study(Path(folder))["protocol"]["duration"])
    episodes = []
    for number, design in enumerate((row, against)):

        def passed(time: float, before: float = number * duration) -> None:
            if progress is not None:
                progress(before + time)

        log, model = show(folder, design, passed, case)
        episodes.append(LabelledEpisode(f"design {design}", log, model))
    text = _text(folder, row, against, pairs)
    with files.replacing_folder(out) as partial:
        figures.save(partial / PICTURE, draw_side_by_side(episodes))
        write_side_by_side(partial / RECORDING, episodes, text)
        picture = f"![Torque-angle loops, and tension at both ends]({PICTURE})"
        page = f"{text}\n\n{picture}\n"
        (partial / TABLE).write_text(page, encoding="utf-8")
    return pairs


def head(row: int, against: int) -> tuple[str, str, str]:
    """Titles of `Pair.cells`."""
    return f"design {row}", f"design {against}", "difference"


def _text(folder: str | Path, row: int, against: int, pairs: list[Pair]) -> str:
    protocol = read_study(Path(folder))["protocol"]
    scene, trajectory, task = (protocol[k] for k in ("scene", "trajectory", "task"))
    body = markdown.table(
        ("", *head(row, against)),
        [(pair.name, *pair.cells) for pair in pairs],
        numbers=(1, 2, 3),
    )
    return (
        f"# Design {row} against design {against}\n\n"
        f"Scene {scene}, trajectory {trajectory}, task {task}, "
        f"{protocol['duration']:g} s.\n\n{body}"
    )
