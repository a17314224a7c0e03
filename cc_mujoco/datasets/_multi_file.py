"""Trials in several files: which belong together by `[files]` of `dataset.toml`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from cc_mujoco.datasets._dataset_file import DatasetFile, PartFile
from cc_mujoco.errors import CableError


@dataclass(frozen=True)
class TrialFile:
    """One of the files of a trial.

    Attributes:
        key: what `dataset.toml` calls it; empty if the trial is this file.
        path: the file.
        times: where its times stand.
    """

    key: str
    path: Path
    times: PartFile


def group_files(
    files: Iterable[Path], file: DatasetFile
) -> tuple[list[Path], dict[str, tuple[TrialFile, ...]]]:
    """Return the single-file trials, and the trials in several files by name."""
    alone: list[Path] = []
    found: dict[tuple[str, Path, str], dict[str, TrialFile]] = {}
    for path in files:
        meant = [
            ((pattern, *place), TrialFile(key, path, part))
            for pattern, parts in file.files.items()
            for key, part in parts.items()
            if (place := part.match_wildcard(path)) is not None
        ]
        if len(meant) > 1:
            owners = " and ".join(f"{of[0]!r}, {part.key}" for of, part in meant)
            raise CableError(
                f"{file.path}, [files]: {path} is {owners}; a file is of one trial, "
                "once."
            )
        if not meant:
            alone.append(path)
        for of, part in meant:
            found.setdefault(of, {})[part.key] = part
    trials: dict[str, tuple[TrialFile, ...]] = {}
    for (pattern, folder, star), given in found.items():
        name, where = pattern.replace("*", star), f"{file.path}, [files.{pattern!r}]"
        for key, wanted in file.files[pattern].items():
            if key not in given:
                absent = folder / wanted.file.replace("*", star)
                raise CableError(
                    f"{where}: {absent}, the {key} of {name!r}, was not given or does "
                    "not exist."
                )
        if name in trials:
            raise CableError(
                f"{where}: {trials[name][0].path} and {next(iter(given.values())).path}"
                f" are both of trial {name!r}; give one of them, or other names."
            )
        trials[name] = tuple(given[key] for key in file.files[pattern])
    return alone, trials
