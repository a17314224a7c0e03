"""Command `cc-mujoco diagnose`: find the effect that a scene lacks, by trials."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import tyro

from cc_mujoco._utils.command_options import (
    Allowed,
    Flag,
    option_help,
    progress_options,
)
from cc_mujoco.errors import CableError

if TYPE_CHECKING:
    from cc_mujoco.diagnosis._verdict import Diagnosis


@dataclass(frozen=True)
class Diagnose:
    """Find the effect that a scene lacks, by measured trials, and add it."""

    interrupted: ClassVar[str] = "nothing was written unless a verdict was reached"

    words: Annotated[
        tuple[Path, ...], tyro.conf.Positional, option_help("[SCENE] [DATA ...]")
    ]
    """Scene of the rig: an MJCF file, a description or a built-in name; then trials:
    files (CSV, Parquet, MATLAB, HDF5) or folders, none with --plan. Several folders
    are several occasions of one rig, the last one last."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Folder for report.html, verdict.json, scene.xml, evidence.rrd and figures."""
    axis: Annotated[str | None, option_help("NAME")] = None
    """Axis that was recorded, of a device with several."""
    dataset: Annotated[Path | None, option_help("FILE.toml")] = None
    """Meaning of the columns and facts of the rig; DATA/dataset.toml if any."""
    earlier: Annotated[
        Path | None, option_help("DIR"), tyro.conf.arg(name="continue")
    ] = None
    """Folder of an earlier diagnosis: its data, scene and TOML are taken with DATA."""
    effects: Annotated[tuple[str, ...], option_help("[FILE.py:CLASS ...]")] = ()
    """Effects of your own to consider besides, or rare ones of the library by name."""
    seed: int = 0
    """Seed of bootstraps and noise draws."""
    plan: Flag = False
    """Write the trials to record, before there are data, as plan.md, CSV and TOML."""
    reach: Annotated[float | None, option_help("RAD")] = None
    """Motor's largest angle to either side with --plan; default by the joint."""
    speed: Annotated[float | None, option_help("RAD/S")] = None
    """Motor's largest speed with --plan; default 3."""
    allow: Allowed = ()
    """Code that files may name, once each; code that only a file names is refused."""

    def run(self) -> None:
        """Diagnose, write the results, and print the verdict.

        Raises:
            CableError: nothing can be diagnosed. If the cause is in the data or in the
                numerics, it is the verdict and is written before.
        """
        if self.seed < 0:
            raise CableError(f"--seed is {self.seed}; it must be 0 or more.")
        if self.plan:
            self._plan()
            return
        for name, value in (("--reach", self.reach), ("--speed", self.speed)):
            if value is not None:
                raise CableError(f"{name} belongs to --plan, which is not given.")
        scene, data = _scene_and_data(self.words)
        if not data:
            raise CableError("no data given; name files of trials, or folders.")
        dataset, axis, effects = self.dataset, self.axis, self.effects
        if self.earlier is not None:
            from cc_mujoco.diagnosis._report.output import Earlier

            earlier = Earlier.of(self.earlier)
            scene = earlier.scene if scene is None else scene
            axis = earlier.axis if axis is None else axis
            dataset = earlier.with_more(data) if dataset is None else dataset
            data = (*earlier.data, *data)
            effects = tuple(dict.fromkeys([*earlier.effects, *effects]))
        scene = _require_scene(scene, data)

        from tqdm import tqdm

        from cc_mujoco._utils.provenance import command_line
        from cc_mujoco.diagnosis._diagnose import diagnose

        with tqdm(
            total=1.0,
            miniters=0,  # also what takes long for a small share of the whole
            bar_format="{bar}| {percentage:3.0f} %  {elapsed}  {desc}",
            **progress_options(),
        ) as bar:

            def show_progress(share: float, doing: str) -> None:
                bar.set_description_str(doing, refresh=False)
                bar.update(max(share - bar.n, 0.0))

            def show(reported: Diagnosis) -> None:
                bar.update(1.0 - bar.n)
                bar.close()
                self._show(reported)

            found = diagnose(
                scene,
                data,
                self.out,
                axis=axis,
                dataset_toml=dataset,
                command=command_line(),
                seed=self.seed,
                effects=effects,
                progress=show_progress,
                reported=show,
            )
        self._show_proposal(found)

    def _show(self, found: Diagnosis) -> None:
        from cc_mujoco.diagnosis._phrases import NO_SCENE_PREFIX, NOT_IN_SCENE_PREFIX

        report = self.out / "report.html"
        if found.verdict in ("fix-data", "fix-numerics"):
            raise CableError(f"{found.verdict}: {found.statement} See {report}.")
        print(f"{found.verdict}: {found.statement}")
        if found.gap:
            print("  The noise floor is the error that the sensors' noise alone makes.")
        unknown = found.verdict == "unknown"
        places = found.where[: int(unknown)]
        stated = found.occasions, found.belief, found.learned, *places
        occasions, belief, *where = (each.statement if each else "" for each in stated)
        happened = [f"{e.statement} {e.advice}" for e in found.events]
        remarks = *happened, occasions, found.instruments, belief, found.question
        for remark in (*remarks, *where):
            if remark:
                print(f"  {remark}")
        for problem in found.problems:
            lacking = problem.startswith((NO_SCENE_PREFIX, NOT_IN_SCENE_PREFIX))
            if lacking or (unknown and problem not in found.question):
                print(f"  noticed: {problem}")
        for tie in found.ties:
            print(f"  cannot distinguish: {', '.join(tie)}")
        print(f"report:   {report}", flush=True)

    def _show_proposal(self, found: Diagnosis) -> None:
        from cc_mujoco.diagnosis._phrases import NO_TRIAL, continue_command

        if found.next_experiment is not None:
            planned = found.next_experiment
            print(f"  to separate them: {planned.description}")
            folder, names = self.out / planned.folder, ", ".join(planned.trials)
            print(f"  record as {names} (`cc-mujoco run --plan {folder}`),")
            if found.occasions:
                beside = f"the trials of {found.occasions.names[-1]}"
                print(f"  put it beside {beside}, replace their dataset.toml")
                print(f"  by that of {folder}, and run this again")
            else:
                trials = " ".join(f"{trial}.csv" for trial in planned.trials)
                again = continue_command(trials, str(self.out), "NEW_FOLDER")
                print(f"  then: {again}")
        elif NO_TRIAL in found.statement:
            print(f"  {NO_TRIAL}{found.statement.partition(NO_TRIAL)[2]}")

    def _plan(self) -> None:
        scene, data = _scene_and_data(self.words)
        if data:
            raise CableError("--plan is for before there are data; give none with it.")
        scene = _require_scene(scene, data)

        from cc_mujoco.diagnosis._propose.planning import PLAN_PAGE, plan
        from cc_mujoco.diagnosis._thresholds import Limit

        speed = Limit.default_speed if self.speed is None else self.speed
        limits: Any = {"axis": self.axis, "reach": self.reach, "speed": speed}

        def begun() -> None:
            print(f"choosing trials for {scene}", file=sys.stderr, flush=True)

        found = plan(scene, self.out, dataset_toml=self.dataset, begun=begun, **limits)
        for motion in found.trials:
            print(f"  {motion.description}")
        weak = [each for each in found.resolved if each.separation < Limit.min_clarity]
        ties = ", ".join(f"{each.id} (like {each.likest})" for each in weak)
        print(f"not distinguished: {ties or 'none'}")
        print(f"plan:     {self.out / PLAN_PAGE}")


def _scene_and_data(words: Sequence[Path]) -> tuple[Path | None, tuple[Path, ...]]:
    from cc_mujoco.assets import SCENES
    from cc_mujoco.device._device_files import is_device_file

    first, rest = (words[0], words[1:]) if words else (None, ())
    named = first is not None and str(first) in SCENES
    if named and first is not None and first.exists():
        print(
            f"{first} is taken for the built-in scene, not for the {first} here; data "
            "follow the scene",
            file=sys.stderr,
        )
    if first is not None and (named or is_device_file(first)):
        return first, tuple(rest)
    return None, tuple(words)


def _require_scene(scene: Path | None, data: Sequence[Path]) -> Path:
    from cc_mujoco.device._device_files import locate

    if scene is not None:
        locate(str(scene))
        return scene
    if data and not data[0].exists() and not data[0].suffix:
        locate(str(data[0]))  # no data either, but perhaps a misspelt name
    raise CableError(
        "no scene given; name it first, an MJCF file such as knee.xml or a name."
    )
