"""Occasions on which one rig was recorded, by folder or by `dataset.toml`."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from cc_mujoco.datasets._data_findings import DataFinding, error
from cc_mujoco.datasets._folders import trial_names
from cc_mujoco.datasets._trials import Dataset, Trial
from cc_mujoco.errors import CableError


def occasion_folders(paths: Sequence[str | os.PathLike[str]]) -> dict[str, Path]:
    """Return the folders by the name of their occasion; {} unless several were given.

    Files, or files beside folders, are trials of one occasion.
    """
    folders = list(dict.fromkeys(Path(path) for path in paths))
    if len(folders) < 2 or not all(folder.is_dir() for folder in folders):
        return {}
    resolved = {folder.resolve(): folder for folder in folders}
    return {name: resolved[path] for path, name in trial_names(resolved).items()}


def occasion_of(path: Path, folders: Mapping[str, Path]) -> str:
    """Return the occasion of a file in one of the folders, "" without folders."""
    here = path.resolve()
    inside = [
        n for n, folder in folders.items() if here.is_relative_to(folder.resolve())
    ]
    return inside[-1] if inside else ""


def check_occasions(trials: Sequence[Trial]) -> list[DataFinding]:
    """Return an error if the occasion of some trials only is known."""
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
    """Return the trials of all occasions as one dataset, that of the last one's rig.

    Trials are called by occasion and name where several have one name. Noise of a
    channel is the largest.
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
    trials = [
        _called(trial, occasion) if clash else trial
        for occasion, part in parts.items()
        for trial in part.trials
    ]
    noise = dict(last.noise)
    for part in parts.values():
        for channel, own in part.noise.items():
            noise[channel] = max(noise.get(channel, own), own)
    return replace(last, trials=tuple(trials), noise=noise)


def _called(trial: Trial, occasion: str) -> Trial:
    repeated = trial.facts.repeat_of
    facts = replace(
        trial.facts, repeat_of=f"{occasion}/{repeated}" if repeated else None
    )
    return replace(trial, name=f"{occasion}/{trial.name}", facts=facts)
