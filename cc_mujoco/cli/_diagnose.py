"""`cc-mujoco diagnose`: which effect is missing in a scene, by measured trials."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from cc_mujoco.cli._options import Flag, option_help, progress_options
from cc_mujoco.errors import CableError


@dataclass(frozen=True)
class Diagnose:
    """Find the effect that a scene lacks, by measured trials, and add it."""

    interrupted: ClassVar[str] = "nothing was written"

    data: Annotated[tuple[Path, ...], tyro.conf.Positional, option_help("[DATA ...]")]
    """Trials: files (CSV, Parquet, MATLAB, HDF5) or folders; none with --plan."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Folder for report.html, verdict.json, scene.xml, evidence.rrd and figures."""
    scene: Annotated[Path | None, option_help("SCENE.xml")] = None
    """MJCF scene of the rig: one cable or a pull-pull pair, or the name of a scene."""
    dataset: Annotated[Path | None, option_help("FILE.toml")] = None
    """Meaning of the columns and facts of the rig; DATA/dataset.toml if any."""
    earlier: Annotated[
        Path | None, option_help("DIR"), tyro.conf.arg(name="continue")
    ] = None
    """Folder of an earlier diagnosis: its data, scene and TOML are taken with DATA."""
    seed: int = 0
    """Seed of bootstraps and noise draws."""
    plan: Flag = False
    """Write the trials to record, before there are data, as plan.md, CSV and TOML."""
    reach: Annotated[float | None, option_help("RAD")] = None
    """Motor's largest angle to either side with --plan; default by the joint."""
    speed: Annotated[float | None, option_help("RAD/S")] = None
    """Motor's largest speed with --plan; default 3."""

    def run(self) -> None:
        """Diagnose, write, and print the verdict.

        Raises:
            CableError: nothing can be diagnosed; where that is the fault of the data or
                of the numerics, it is the verdict and is written before.
        """
        if self.seed < 0:
            raise CableError(f"--seed is {self.seed}; it must be 0 or more.")
        if self.plan:
            self._plan()
            return
        for name, value in (("--reach", self.reach), ("--speed", self.speed)):
            if value is not None:
                raise CableError(f"{name} belongs to --plan, which is not given.")
        if not self.data:
            raise CableError("no data given; name files of trials, or folders.")
        scene, dataset, data = self.scene, self.dataset, self.data
        if self.earlier is not None:
            from cc_mujoco.diagnosis._resume import Earlier

            earlier = Earlier.of(self.earlier)
            scene = earlier.scene if scene is None else scene
            dataset = earlier.with_more(data) if dataset is None else dataset
            data = (*earlier.data, *data)

        from tqdm import tqdm

        from cc_mujoco.diagnosis._diagnose import diagnose
        from cc_mujoco.diagnosis._phrases import NO_SCENE_PREFIX, NOT_IN_SCENE_PREFIX

        with tqdm(
            total=1.0,
            bar_format="{bar}| {percentage:3.0f} %  {elapsed}  {desc}",
            **progress_options(),
        ) as bar:

            def told(share: float, doing: str) -> None:
                bar.set_description_str(doing, refresh=False)
                bar.update(max(share - bar.n, 0.0))

            found = diagnose(
                data,
                _scene_file(scene),
                self.out,
                dataset_toml=dataset,
                command=shlex.join(["cc-mujoco", *sys.argv[1:]]),
                seed=self.seed,
                progress=told,
            )
            bar.update(1.0 - bar.n)
        report = self.out / "report.html"
        if found.verdict in ("fix-data", "fix-numerics"):
            raise CableError(f"{found.verdict}: {found.statement} See {report}.")
        print(f"{found.verdict}: {found.statement}")
        if found.question:
            print(f"  {found.question}")
        if found.verdict == "unknown":
            for place in found.where[:1]:
                print(f"  {place.statement}")
        for problem in found.problems:
            lacking = problem.startswith((NO_SCENE_PREFIX, NOT_IN_SCENE_PREFIX))
            if found.verdict == "unknown" or lacking:
                print(f"  noticed: {problem}")
        for tie in found.ties:
            print(f"  cannot tell apart: {', '.join(tie)}")
        if found.next_experiment is not None:
            print(f"  to separate them: {found.next_experiment.description}")
        print(f"report:   {report}")

    def _plan(self) -> None:
        """Write what to record, and print what stays doubtful."""
        if self.data:
            raise CableError("--plan is for before there are data; give none with it.")

        from cc_mujoco.diagnosis._inference.identifiability import MIN_CLARITY
        from cc_mujoco.diagnosis._next_experiment import DEFAULT_SPEED, PLAN_PAGE, plan

        found = plan(
            _scene_file(self.scene),
            self.out,
            reach=self.reach,
            speed=DEFAULT_SPEED if self.speed is None else self.speed,
            dataset_toml=self.dataset,
        )
        for motion in found.trials:
            print(f"  {motion.description}")
        weak = [each for each in found.resolved if each.apart < MIN_CLARITY]
        ties = ", ".join(f"{each.id} (like {each.likest})" for each in weak)
        print(f"not told apart: {ties or 'none'}")
        print(f"plan:     {self.out / PLAN_PAGE}")


def _scene_file(scene: Path | None) -> Path:
    """Return the file, or that of a scene of the package.

    Raises:
        CableError: none was given.
    """
    from cc_mujoco.assets import SCENES, scene_path

    if scene is None:
        raise CableError("no scene given; name one by --scene.")
    if not scene.exists() and str(scene) in SCENES:
        return scene_path(str(scene))
    return scene
