"""Designs of a finished study, simulated again by `show` and `write_comparison`."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import mujoco

from cc_mujoco._utils import atomic_io, provenance, user_code
from cc_mujoco._utils.tables import is_table
from cc_mujoco.control import axes_controller
from cc_mujoco.design._protocol import device_digests, split_axes, tasks_of_axes
from cc_mujoco.design._report_text import column_title, format_cell
from cc_mujoco.design._results_store import (
    CONTROLLER_COLUMN,
    read_protocol,
    read_study,
    read_table,
)
from cc_mujoco.design._scenarios import WORST_CASE_SUFFIX, Across, Case
from cc_mujoco.device import Plant, load_device
from cc_mujoco.device._sensors import PERFECT_SENSING
from cc_mujoco.device._wearer_scaling import tasks_of, trajectory_of
from cc_mujoco.errors import CableError
from cc_mujoco.human import TASKS, TRAJECTORIES
from cc_mujoco.human._by_text import is_user_object
from cc_mujoco.metrics import find_metric
from cc_mujoco.report import _figures as figures
from cc_mujoco.report import _markdown as markdown
from cc_mujoco.simulation._episode_log import EpisodeLog
from cc_mujoco.simulation._simulate import simulate
from cc_mujoco.simulation._worn_device import WornDevice

TABLE, PICTURE, RECORDING = "comparison.md", "comparison.png", "comparison.rrd"
FILES = (TABLE, PICTURE, RECORDING)


class FinishedStudy:
    """Finished study in a folder: its protocol and table."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.about, self.protocol = read_study(self.folder), read_protocol(self.folder)
        self.table = read_table(self.folder)
        levels = self.protocol.get("across", {})
        self._across = Across(tuple((n, tuple(each)) for n, each in levels.items()))

    def row(self, number: int) -> dict[str, Any]:
        if not 0 <= number < len(self.table):
            raise CableError(
                f"the study in {self.folder} has designs 0 to {len(self.table) - 1}, "
                f"not {number}."
            )
        found: dict[str, Any] = self.table.slice(number, 1).to_pylist()[0]
        return found

    def case(self, row: int, case: int | None = None) -> Case:
        """Return the case in which `show` simulates a design; {} without cases."""
        cases = self._across.cases
        if case is None:
            column = f"{self.protocol['metrics'][0]}@{WORST_CASE_SUFFIX}"
            worst = self.row(row).get(column)
            return next((c for c in cases if self._across.label(c) == worst), cases[0])
        if not self._across.several:
            raise CableError(
                f"the study in {self.folder} has no cases, so none can be chosen."
            )
        if not 0 <= case < len(cases):
            raise CableError(
                f"the study in {self.folder} has cases 0 to {len(cases) - 1}, not "
                f"{case}."
            )
        return cases[case]

    def find_user_metrics(self) -> None:
        for name, known in self.protocol["own"].items():
            if not provenance.is_user_controller(known):
                raise CableError(
                    f"the study in {self.folder} measures metric {name!r}, which was "
                    "given as a Python object; its designs can be shown only where "
                    "metrics are MODULE:NAME."
                )
            find_metric(known)


def show(
    folder: str | Path,
    row: int,
    progress: Callable[[float], object] | None = None,
    case: int | None = None,
    allow: str | Iterable[str] = (),
) -> tuple[EpisodeLog, mujoco.MjModel]:
    """Simulate a design of a study in the complete scene; return log and model.

    The log equals the one that the study measured bit for bit. `row` is the number of
    the design, column `design` of the table. `case` is the index of a case, from 0; by
    default that in which the first metric is worst, or the first if the design failed.
    `progress` is called with the simulated time [s]. `allow` has `MODULE:NAME` of user
    code that the files of the study may name.
    """
    user_code.allow(allow)
    study = FinishedStudy(folder)
    found, protocol = study.row(row), study.protocol
    design = {name: found[name] for name in study.about["variables"]}
    device = load_device(protocol["scene"], protocol["timestep"])
    axes = [axis.name for axis in device.description.axes]
    for kind, registry in (("trajectory", TRAJECTORIES), ("task", TASKS)):
        for text in split_axes([protocol[kind]], axes):
            name = text.partition(":")[0]
            if name in registry or is_table(text) or is_user_object(text, registry):
                continue
            raise CableError(
                f"the study in {folder} plays a {kind} that was given as a Python "
                f"object, {text}; its designs can be shown only where it plays a name, "
                "a table or MODULE:NAME."
            )
    study.find_user_metrics()
    plant = Plant(device, {**design, **study.case(row, case)})
    task: Any = protocol["task"]
    if len(axes) > 1:
        task = tasks_of_axes(task, device.description)
    played: dict[str, Any] = {
        "trajectory": trajectory_of(plant.values, protocol["trajectory"]),
        "task": tasks_of([plant.values], task, device.description),
        "duration": protocol["duration"],
    }
    exo = WornDevice(device.description, plant.model(), **played)
    drives = [PERFECT_SENSING.equip(drive) for drive in exo.drives]
    laws, prefixes = protocol["controllers"], exo.device.prefixes
    made_laws = {name: axes_controller(name, drives, prefixes) for name in laws}
    chosen = found.get(CONTROLLER_COLUMN) or laws[0]
    names: dict[str, Any] = {key: protocol[key] for key in ("trajectory", "task")}
    made = split_axes([*laws, *names.values()], axes)
    makers = provenance.code_provenance(
        *made, *protocol["own"].values(), files=device_digests(device)
    )
    if changed := provenance.provenance_differences(
        provenance.read_provenance(study.table), makers
    ):
        raise CableError(
            f"design {row} would not be the one in the table of {folder}, which was "
            f"made otherwise: it differs in {', '.join(changed)}; `cc-mujoco whatif` "
            "with --again makes it anew."
        )
    about = names | {"controller": chosen, "design": row, "variables": plant.values}
    log = simulate(
        plant,
        made_laws[chosen],
        **played,
        seed=protocol["seed"],
        sensing=PERFECT_SENSING,
        about=about,
        progress=progress,
    )
    return log, plant.model(whole=True)


class Pair(NamedTuple):
    """Variable or metric of two designs."""

    name: str  # with its unit, if it has one
    one: object
    other: object

    @property
    def difference(self) -> float | None:
        both = self.one, self.other
        if not all(isinstance(v, int | float) and type(v) is not bool for v in both):
            return None
        return float(self.one) - float(self.other)  # type: ignore[arg-type]

    @property
    def cells(self) -> tuple[str, str, str]:
        one, other = format_cell(self.one), format_cell(self.other)
        return one, other, format_cell(self.difference)


def compare(
    study: FinishedStudy, row: int, against: int, case: int | None = None
) -> list[Pair]:
    """Return variables, cases and metrics of two designs from the table."""
    if row == against:
        raise CableError(f"design {row} is compared with itself; name another one.")
    study.find_user_metrics()
    rows = [study.row(number) for number in (row, against)]
    cases = [study.case(number, case) for number in (row, against)]
    names = [*study.about["variables"]]
    if len(study.protocol["controllers"]) > 1:
        names.append(CONTROLLER_COLUMN)
    columns = [
        *((column_title(name), name, rows) for name in names),
        *((f"case: {column_title(name)}", name, cases) for name in cases[0]),
        *((column_title(name), name, rows) for name in study.protocol["metrics"]),
    ]
    return [Pair(title, one[n], other[n]) for title, n, (one, other) in columns]


def require_ours(out: str | Path) -> None:
    """Refuse a folder in which `FILES` cannot be written; call before simulations."""
    atomic_io.require_ours(out, lambda place: figures.is_ours(place / PICTURE))


def write_comparison(
    out: str | Path,
    folder: str | Path,
    row: int,
    against: int,
    case: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> list[Pair]:
    """Simulate two designs of a study; write table, figure and recording of both.

    `out` is the folder for `FILES`, made if needed; differences are `row` minus
    `against`. `case` and `progress` are as in `show`. Returns the rows of the table.
    """
    from cc_mujoco.viz import _comparison as comparison

    study = FinishedStudy(folder)
    protocol, pairs = study.protocol, compare(study, row, against, case)
    require_ours(out)
    duration = float(protocol["duration"])
    episodes = []
    for number, design in enumerate((row, against)):

        def passed(time: float, before: float = number * duration) -> None:
            if progress is not None:
                progress(before + time)

        log, model = show(folder, design, passed, case)
        episodes.append(comparison.LabelledEpisode(f"design {design}", log, model))
    scene, trajectory, task = (protocol[k] for k in ("scene", "trajectory", "task"))
    rows = [(pair.name, *pair.cells) for pair in pairs]
    body = markdown.table(("", *head(row, against)), rows, numbers=(1, 2, 3))
    text = (
        f"# Design {row} against design {against}\n\n"
        f"Scene {scene}, trajectory {trajectory}, task {task}, {duration:g} s.\n\n"
        f"{body}"
    )
    with atomic_io.replacing_folder(out) as partial:
        figures.save(partial / PICTURE, comparison.draw_side_by_side(episodes))
        comparison.write_side_by_side(partial / RECORDING, episodes, text)
        picture = f"![Torque-angle loops, and tension at both ends]({PICTURE})"
        page = f"{text}\n\n{picture}\n"
        (partial / TABLE).write_text(page, encoding="utf-8")
    return pairs


def head(row: int, against: int) -> tuple[str, str, str]:
    return f"design {row}", f"design {against}", "difference"
