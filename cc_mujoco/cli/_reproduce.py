"""`cc-mujoco reproduce`: the experiments of the thesis, beside what is printed."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import tyro

from cc_mujoco.cli._options import Flag, Names, progress_options

if TYPE_CHECKING:
    from cc_mujoco.thesis import FinishedExperiment


@dataclass(frozen=True)
class Reproduce:
    """Run the experiments of the thesis again; write figures, data, a summary table."""

    interrupted: ClassVar[str] = "experiments that were finished, if any, are kept"

    names: tyro.conf.Positional[Names] = ()
    """Experiments, as `cc-mujoco list` shows them; all unless given."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("runs", "reproduce")
    """Folder for the results."""
    again: Flag = False
    """Run also what an earlier run of the same code has finished."""

    def run(self) -> None:
        """Run what is not done yet; print a line for every claim."""
        from tqdm import tqdm

        from cc_mujoco.thesis import EXPERIMENTS, reproduce

        number = len(set(self.names)) or len(EXPERIMENTS)
        began: dict[str, float] = {}
        with tqdm(
            total=float(number),
            bar_format="{desc:12} {bar}| {percentage:3.0f} %  {elapsed}",
            **progress_options(),
        ) as bar:

            def told(name: str, share: float) -> None:
                began[name] = share
                bar.set_description_str(name, refresh=False)
                bar.update(sum(began.values()) - bar.n)

            reproduce(
                self.names,
                self.out,
                again=self.again,
                progress=told,
                finished=_show,
                say=tqdm.write,
            )
        print(f"\nsummary:  {self.out / 'summary.md'}")


def _show(record: FinishedExperiment) -> None:
    """Print a finished experiment, above the progress bar."""
    from tqdm import tqdm

    tqdm.write(f"{record.name}{'' if record.fresh else '  (done before)'}")
    for claim in record.claims:
        tqdm.write(f"  {claim.verdict:9}  {claim.where}: {claim.ours}")
    sys.stdout.flush()
