"""`cc-mujoco device`: report on a device, and a description file to complete it."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cc_mujoco._utils.command_options import Scene, option_help

if TYPE_CHECKING:
    from cc_mujoco.device import Device


@dataclass(frozen=True)
class ShowDevice:
    """Show what is derived and assumed about a device; write its description.

    An existing description is read and never overwritten.
    """

    scene: Scene
    """An MJCF file with a motor and a cable, its description, or a built-in device."""
    out: Annotated[Path | None, option_help("FILE")] = None
    """Description to write; by default SCENE.device.toml, if that is not there."""

    def run(self) -> None:
        from cc_mujoco.device._device_files import locate

        locate(self.scene)
        from cc_mujoco.assets import SCENES
        from cc_mujoco.device import _report as report
        from cc_mujoco.device import find_device
        from cc_mujoco.device._description import ENDING

        device = find_device(self.scene)
        beside, out = Path(self.scene), self.out
        if out is None and self.scene not in SCENES and beside.suffix != ".toml":
            out = beside.with_suffix(ENDING)
        was_read = self.out is None and out is not None and out.exists()
        if out is not None and not was_read:
            report.require_new_file(out)
        print(report.account(device))
        if was_read:
            print(f"\n{out} is there and was read; edit it.")
        if out is None or was_read:
            return
        report.write_description(device, out)
        print(f"\nwrote {out}: edit it, {_use(device, out)}.")


def _use(device: "Device", out: Path) -> str:
    from cc_mujoco.device._description import ENDING

    if device.path is None:
        return f"and give {out} in place of {device.name}"
    beside = device.path.with_suffix(ENDING)
    if out.resolve() == beside.resolve():
        return f"the commands read it with {device.path}"
    if out.resolve().parent != beside.resolve().parent:
        return f"and put a copy of {device.path} beside it; then give {out} to commands"
    return (
        f"and give {out} to the commands in place of {device.path}, or rename it to "
        f"{beside}, which they read with {device.path}"
    )
