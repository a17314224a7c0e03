"""`cc-mujoco diagnose`: which effect is missing in a scene, by measured trials."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from cc_mujoco.commands.options import in_words
from cc_mujoco.errors import CableError


@dataclass(frozen=True)
class Diagnose:
    """Find the effect that a scene lacks, by measured trials, and add it."""

    interrupted: ClassVar[str] = "nothing was written"

    data: Annotated[tuple[Path, ...], tyro.conf.Positional, in_words("DATA [DATA ...]")]
    """Trials: CSV or Parquet files, or folders of them."""
    scene: Annotated[Path, tyro.conf.arg(metavar="SCENE.xml")]
    """MJCF scene of the rig: one cable or a pull-pull pair, or the name of a scene."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Folder for report.html, verdict.json, scene.xml, evidence.rrd and figures."""
    dataset: Annotated[Path | None, in_words("FILE.toml")] = None
    """What the columns mean and what is known of the rig; DATA/dataset.toml if any."""
    seed: int = 0
    """Seed of bootstraps and noise draws."""

    def run(self) -> None:
        """Diagnose, write, and print the verdict.

        Raises:
            CableError: nothing can be diagnosed; where that is the fault of the data or
                of the numerics, it is the verdict and is written before.
        """
        if self.seed < 0:
            raise CableError(f"--seed is {self.seed}; it must be 0 or more.")
        if not self.data:
            raise CableError("no data given; name CSV or Parquet files, or folders.")

        from tqdm import tqdm

        from cc_mujoco.assets import SCENES, scene_path
        from cc_mujoco.diagnosis.diagnose import diagnose

        scene = self.scene
        if not scene.exists() and str(scene) in SCENES:
            scene = scene_path(str(scene))
        with tqdm(
            total=1.0,
            bar_format="{bar}| {percentage:3.0f} %  {elapsed}  {desc}",
            disable=not sys.stderr.isatty(),
        ) as bar:

            def told(share: float, doing: str) -> None:
                bar.set_description_str(doing, refresh=False)
                bar.update(max(share - bar.n, 0.0))

            found = diagnose(
                self.data,
                scene,
                self.out,
                dataset_toml=self.dataset,
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
        for tie in found.ties:
            print(f"  cannot tell apart: {', '.join(tie)}")
        if found.next_experiment is not None:
            print(f"  to separate them: {found.next_experiment.description}")
        print(f"report:   {report}")
