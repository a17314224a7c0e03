"""`cc-mujoco calibrate`: fit the hysteresis parameters of position controllers."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cc_mujoco._utils.command_options import Name, Names, Scene, option_help
from cc_mujoco.errors import CableError

if TYPE_CHECKING:
    from cc_mujoco._utils.array_files import FloatArray


@dataclass(frozen=True)
class Calibrate:
    """Fit hysteresis to a trial; write the parameters of position controllers.

    Other commands read that file beside the scene. It is never overwritten.
    """

    scene: Scene
    """A device: a built-in name (`cc-mujoco list`), or your MJCF file."""
    trial: Annotated[Path | None, option_help("FILE")] = None
    """Measured trial: a table with columns motor_angle_rad, joint_angle_rad and perhaps
    time_s, slow, from rest; one on the simulated device unless given."""
    controllers: Names = ()
    """Controllers whose parameters are fitted; all unless given."""
    axis: Name = None
    """Axis of a device with several."""
    out: Annotated[Path | None, option_help("FILE")] = None
    """File to write; SCENE.hysteresis.toml beside your scene by default."""

    def run(self) -> None:
        from cc_mujoco.device._device_files import is_device_file, locate

        locate(self.scene)
        from cc_mujoco.device import DeviceModel, find_device
        from cc_mujoco.device._device_files import HYSTERESIS_ENDING, write_hysteresis

        device = find_device(self.scene)
        out = self.out
        if out is None and is_device_file(self.scene) and device.path is not None:
            out = device.path.with_suffix(HYSTERESIS_ENDING)
        if out is None:
            raise CableError(
                f"the parameters of the built-in device {self.scene!r} are not "
                "overwritten; name a file by --out."
            )
        if out.exists():
            raise CableError(
                f"{out} is there and is not overwritten; remove it, or name another "
                "file by --out."
            )
        axis = device.description.axis(self.axis)

        from cc_mujoco.control import FITTED, HysteresisTrial, fit_hysteresis
        from cc_mujoco.simulation import calibration_trials

        place = device.description.axes.index(axis)
        drive = DeviceModel.of(device).drives(device.description.period)[place]
        if self.trial is None:
            trial = calibration_trials([device])[0]
        else:
            trial = HysteresisTrial.of(*_measured_angles(self.trial), drive.ratio)
        found = fit_hysteresis(trial, drive, self.controllers or FITTED)
        write_hysteresis(out, axis.name, found)
        print(f"fitted {', '.join(found)} to {trial.joint_angle.size} samples")
        print(f"wrote {out}: commands read it as SCENE{HYSTERESIS_ENDING}.")


def _measured_angles(path: Path) -> "tuple[FloatArray, FloatArray]":
    from cc_mujoco._utils import tables
    from cc_mujoco._utils.units import ANGLE, CLOCK

    names = tables.column_names(path)
    columns = [
        tables.quantity_column(path, names, f"{part}_angle_rad", ANGLE)
        for part in ("motor", "joint")
    ]
    is_timed = any(name.lower().startswith("time") for name in names)
    if is_timed:
        columns.insert(0, tables.quantity_column(path, names, "time_s", CLOCK))
    *_, motor, joint = tables.read_course(path, columns, is_rising=is_timed)
    return motor, joint
