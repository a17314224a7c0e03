"""Search for the files of trials in folders, and names of the trials."""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from cc_mujoco._utils import tables
from cc_mujoco.datasets._columns import DATASET_FILE
from cc_mujoco.datasets._data_findings import DataFinding, error
from cc_mujoco.datasets._trials import Dataset, Trial
from cc_mujoco.errors import CableError
from cc_mujoco.report._html import list_words

MOTION_FILE = "motion_{}.csv"
"""File that holds the motion of a planned trial, by its number of two digits."""


def data_files(paths: Iterable[str | os.PathLike[str]]) -> list[Path]:
    """Return the data files that these paths are or contain, without duplicates."""
    endings = list_words(tables.ENDINGS, "or")
    found: dict[Path, Path] = {}
    given = [Path(path) for path in paths]
    for path in given:
        if path.is_dir():
            files = [file for file in sorted(path.rglob("*")) if _is_data(file, path)]
        elif not path.exists():
            raise CableError(f"{path} does not exist; give data files or folders.")
        elif path.suffix.lower() not in tables.ENDINGS:
            tables.require_no_markers(path)
            raise CableError(f"{path} is no data file; its name must end in {endings}.")
        else:
            files = [path]
        for file in files:
            found.setdefault(file.resolve(), file)
    if not found:
        places = ", ".join(str(path) for path in given) or "nothing"
        raise CableError(
            f"there is no data file in {places}; trials are files whose names end in "
            f"{endings}."
        )
    return list(found.values())


def nearby_data_files(files: Iterable[Path], dataset_file: str) -> Iterator[Path]:
    """Yield all data files in the folders of `files` and of their `dataset.toml`."""
    folders = [path.parent for path in files]
    if dataset_file:
        folders.append(Path(dataset_file).parent)
    for folder in dict.fromkeys(folders):
        yield from (path for path in folder.rglob("*") if _is_data(path, folder))


def trial_names(files: Iterable[Path]) -> dict[Path, str]:
    files = list(files)
    for depth in range(1, 1 + max((len(path.parts) for path in files), default=0)):
        ends = [Path(*path.parts[-depth:]) for path in files]
        for names in ([end.with_suffix("") for end in ends], ends):
            if len(set(names)) == len(files):
                return dict(zip(files, (n.as_posix() for n in names), strict=True))
    return {path: path.as_posix() for path in files}


def find_dataset_file(files: Iterable[Path]) -> Path | None:
    folders = dict.fromkeys(_folder_of(path) for path in files)
    found = [folder / DATASET_FILE for folder in folders]
    found = [path for path in found if path.is_file()]
    if len(found) > 1:
        first, *others = map(str, found)
        more = others[0] if len(others) == 1 else f"{len(others)} more {DATASET_FILE}"
        raise CableError(f"there are {first} and {more}; give the one that counts.")
    return found[0] if found else None


def _folder_of(path: Path) -> Path:
    """Return the folder of a data file; for a file of a ROS 2 bag, the bag's parent."""
    folder = path.parent
    own = folder / DATASET_FILE
    in_bag = (folder / "metadata.yaml").is_file() and not own.is_file()
    return folder.parent if in_bag else folder


def _is_data(path: Path, folder: Path) -> bool:
    hidden = any(part.startswith(".") for part in path.relative_to(folder).parts)
    return not hidden and path.is_file() and path.suffix.lower() in tables.ENDINGS


def occasion_folders(paths: Sequence[str | os.PathLike[str]]) -> dict[str, Path]:
    """Return each folder by the name of its occasion (session), if several were given.

    The result is {} for a single folder, and if any path is a file: all trials then
    belong to one occasion.
    """
    folders = list(dict.fromkeys(Path(path) for path in paths))
    if len(folders) < 2 or not all(folder.is_dir() for folder in folders):
        return {}
    resolved = {folder.resolve(): folder for folder in folders}
    return {name: resolved[path] for path, name in trial_names(resolved).items()}


def occasion_of(path: Path, folders: Mapping[str, Path]) -> str:
    """Return the occasion (key of `folders`) whose folder holds a file, else ""."""
    here, occasion = path.resolve(), ""
    for name, folder in folders.items():
        if here.is_relative_to(folder.resolve()):
            occasion = name
    return occasion


def check_occasions(trials: Sequence[Trial]) -> list[DataFinding]:
    unknown = [trial for trial in trials if not trial.facts.occasion]
    if not unknown or len(unknown) == len(trials):
        return []
    known = next(trial for trial in trials if trial.facts.occasion)
    message = (
        f"{unknown[0].path} has no occasion, and {known.path} is of "
        f"{known.facts.occasion!r}; declare [trials] occasion of all trials."
    )
    return [error(message, unknown[0].name)]


def join_occasions(parts: Mapping[str, Dataset]) -> Dataset:
    """Return the trials of all occasions as one dataset, with the last one's constants.

    If two trials have the same name, all are renamed `OCCASION/NAME`. The noise of a
    channel is the largest of any occasion. Different instruments or `[rig]` are errors.
    """
    *_, (last_name, last) = parts.items()
    for name, part in parts.items():
        if part.instruments != last.instruments:
            raise CableError(
                f"occasion {name!r} was measured with {part.instruments}, and "
                f"{last_name!r} with {last.instruments}; several occasions need the "
                "same instruments."
            )
        for key in {*part.constants, *last.constants}:
            if part.constants.get(key) != last.constants.get(key):
                raise CableError(
                    f"[rig] {key} of occasion {name!r} is not that of {last_name!r}; "
                    "give what changed as a fact of its trials, and [rig] once for all."
                )
    names = [trial.name for part in parts.values() for trial in part.trials]
    clash = len(set(names)) < len(names)
    trials = []
    for occasion, part in parts.items():
        for trial in part.trials:
            if clash:
                repeated, start = trial.facts.repeat_of, f"{occasion}/"
                known = replace(
                    trial.facts, repeat_of=start + repeated if repeated else None
                )
                trial = replace(trial, name=start + trial.name, facts=known)
            trials.append(trial)
    noise = dict(last.noise)
    for part in parts.values():
        for channel, own in part.noise.items():
            noise[channel] = max(noise.get(channel, own), own)
    return replace(last, trials=tuple(trials), noise=noise)
