"""Inputs of an earlier diagnosis, to be diagnosed again with more data."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from cc_mujoco._utils.parsing import parse_json
from cc_mujoco._utils.user_code import named_in_file
from cc_mujoco.datasets._columns import DATASET_FILE
from cc_mujoco.datasets._dataset_file import read_dataset_file
from cc_mujoco.datasets._folders import data_files, find_dataset_file
from cc_mujoco.errors import CableError

VERDICT_FILE = "verdict.json"


class Earlier(NamedTuple):
    """Files of an earlier diagnosis."""

    data: tuple[Path, ...]  # its trials
    scene: Path  # MJCF file of the rig
    dataset: Path | None  # file with the meaning of the columns, or None
    axis: str | None = None  # recorded axis; None for a device with one
    effects: tuple[str, ...] = ()  # requested effects, as they were named
    # Facts of these trials and of the proposed one, or None
    proposed: Path | None = None

    @classmethod
    def of(cls, folder: str | os.PathLike[str]) -> Earlier:
        """Read the inputs from the files of a diagnosis.

        A file that has changed since is refused: its verdict would be that of other
        data.
        """
        place = Path(folder) / VERDICT_FILE
        try:
            verdict = parse_json(place.read_text(encoding="utf-8"))
            provenance = verdict["provenance"]
            data = {
                str(path): str(recorded)
                for path, recorded in provenance["data"].items()
            }
            scene, dataset = provenance["scene"], provenance["dataset"]
            several = provenance["several_files"]
            occasions = provenance.get("occasions", ())
            base = os.path.join(os.path.realpath(folder), provenance["folder"])
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as wrong:
            raise CableError(
                f"{folder} holds no diagnosis that can be continued ({place}: {wrong})."
            ) from None
        if several:
            raise CableError(
                f"{folder} is of trials in several files each ({several[0]}); diagnose "
                "the folder of all data anew."
            )
        if occasions:
            raise CableError(
                f"{folder} is of several occasions ({', '.join(occasions)}); diagnose "
                "their folders anew, with the new trials (and, of a proposed one, "
                "its dataset.toml) in the folder of their occasion."
            )
        data[scene["path"]] = scene["sha256"]
        if dataset["path"]:
            data[dataset["path"]] = dataset["sha256"]
        here = {path: _relative_path(base, path) for path in data}
        for path, recorded in data.items():
            _require_unchanged(here[path], recorded, place)
        return cls(
            tuple(here[path] for path in provenance["data"]),
            here[scene["path"]],
            here[dataset["path"]] if dataset["path"] else None,
            scene.get("axis"),
            tuple(
                named_in_file(str(effect), place, "effects")
                for effect in provenance.get("effects", ())
            ),
            _proposed_file(Path(folder), verdict.get("next_experiment")),
        )

    def with_more(self, data: Sequence[str | os.PathLike[str]]) -> Path | None:
        """Return one `dataset.toml` for the earlier and the new trials.

        For the trial that the earlier diagnosis proposed it is the one written with it.
        Another one next to the new trials would be ignored and is refused.
        """
        files = data_files(data)
        own = find_dataset_file(files)
        if self.proposed is not None:
            planned = read_dataset_file(self.proposed)
            recorded = self.proposed.parent.name.removeprefix("next_")
            here = read_dataset_file(own) if own is not None else planned
            same = (here.columns, here.rig, here.facts.get(recorded)) == (
                planned.columns,
                planned.rig,
                planned.facts.get(recorded),
            )
            if same and [file.stem for file in files] == [recorded]:
                return self.proposed
        if own is None or (self.dataset is not None and own.samefile(self.dataset)):
            return self.dataset
        first = f"{self.dataset} of the" if self.dataset else "none of the"
        raise CableError(
            f"there are {own} and {first} earlier trials; write one file that speaks "
            "of all trials and give it with --dataset."
        )


def _proposed_file(folder: Path, planned: Any) -> Path | None:
    if not isinstance(planned, dict) or not planned.get("trial"):
        return None
    path = folder / f"next_{planned['trial']}" / DATASET_FILE
    return path if path.is_file() else None


def _relative_path(base: str, path: str) -> Path:
    whole = os.path.normpath(os.path.join(base, path))
    inside = os.path.relpath(whole)
    outside = os.path.isabs(path) or inside.startswith(os.pardir)
    return Path(whole if outside else inside)


def _require_unchanged(path: Path, digest: Any, place: Path) -> None:
    try:
        now = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        raise CableError(f"{path}, which {place} names, is not there.") from None
    if now != digest:
        raise CableError(
            f"{path} has changed since {place} was written; diagnose all data anew."
        )
