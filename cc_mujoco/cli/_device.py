"""`cc-mujoco device`: what is known of a device, and the file that says the rest."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from cc_mujoco.cli._options import option_help


@dataclass(frozen=True)
class ShowDevice:
    """Show what a scene tells of a device and what is assumed; write its description.

    A description that is there already is read and never overwritten.
    """

    interrupted: ClassVar[str] = "nothing was written"

    scene: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SCENE")]
    """An MJCF file with a motor and a cable, its description, or a built-in device."""
    out: Annotated[Path | None, option_help("FILE")] = None
    """Description to write; by default SCENE.device.toml, if that is not there."""

    def run(self) -> None:
        """Print what is known and write the description."""
        from cc_mujoco.device._device_files import locate

        locate(self.scene)
        from cc_mujoco.assets import SCENES
        from cc_mujoco.device import find_device
        from cc_mujoco.device._description import ENDING
        from cc_mujoco.device._report import account, write_description

        device = find_device(self.scene)
        print(account(device))
        beside = Path(self.scene)
        out = self.out
        if out is None:
            if self.scene in SCENES or beside.suffix == ".toml":
                return
            out = beside.with_suffix(ENDING)
            if out.exists():
                print(f"\n{out} is there and was read; edit it.")
                return
        write_description(device, out)
        print(f"\nwrote {out}: edit it; the commands read it beside the scene.")
