"""`cc-mujoco export`: a controller as C99."""

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from cc_mujoco._utils.command_options import Allowed, Flag, option_help, progress_bar
from cc_mujoco.errors import CableError, look_up

if TYPE_CHECKING:
    from cc_mujoco.device import Device


@dataclass(frozen=True)
class Export:
    """Write a controller as C99, with header, parameters and example."""

    scene: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SCENE")]
    """Device whose cables the controller knows: a name, or an MJCF file."""
    controller: Annotated[str, tyro.conf.arg(metavar="NAME")]
    """Controller: none, feedback, pi, pi_tuned, pi_feed_forward, inverse, lqg, model,
    stiction, disturbance, predictive, adaptive or a policy."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Folder to write to."""
    target: Annotated[str, tyro.conf.arg(metavar="KIND")] = "c"
    """Kind of file: c, or onnx for a policy without its observation."""
    axis: Annotated[str | None, option_help("NAME")] = None
    """The only axis that the controller drives, of a device with several."""
    model: Annotated[Path | None, option_help("FILE.xml")] = None
    """A variant of the scene, as a diagnosis writes it, to take parameters from."""
    ros2_control: Flag = False
    """Write a package of ROS 2 with a plugin of ros2_control around it."""
    iterations: Annotated[float, option_help("N")] = math.inf
    """Steps of a planner's model in a control step; then the last plan goes on."""
    no_check: Flag = False
    """Write it without finding out whether it gives passive wearers energy."""
    allow: Allowed = ()
    """Code that files may name, once each; code that only a file names is refused."""

    def run(self) -> None:
        """Write the controller; print the files and how to build them.

        A controller that puts energy into a passive wearer in simulation is refused.
        """
        from cc_mujoco.device._device_files import locate

        locate(self.scene)
        from cc_mujoco import export
        from cc_mujoco.device import DeviceModel, find_device

        if look_up("target", self.target, {"c": False, "onnx": True}):
            self._write_onnx()
            return
        device = find_device(self.scene)
        if self.model is not None:
            try:
                device = device.variant(self.model)
            except CableError as error:
                raise CableError(
                    f"{self.model} is no variant of the scene {self.scene!r}: {error}"
                ) from None
        description = device.description
        axes = description.axes
        if self.axis is not None:
            axes = (description.axis(self.axis),)
        places = [description.axes.index(axis) for axis in axes]
        export.require_ours(self.out)
        made = DeviceModel.of(device)
        drives = made.drives(description.period)
        plan = export.ExportPlan.of(
            self.controller,
            [drives[k] for k in places],
            [made.driven[k] for k in places],
            [""] if self.axis else made.prefixes,
            self.iterations,
        )
        if self.ros2_control:
            export.require_ros2_states(plan)
        text = f"exporting {self.controller} for {self.scene}"
        print(text, file=sys.stderr, flush=True)
        notes = ["passivity: NOT CHECKED"]
        if not self.no_check:
            notes = self._require_passive(device, places)
        if self.iterations < math.inf:
            notes.append(
                f"iterations: {self.iterations:g} for the plans of a step, then the "
                "last plan goes on; passivity is that without a limit"
            )
        for axis in axes:
            if axis.safe_is_assumed:
                notes.append(
                    f"safe torque at joint {axis.limb!r}: {axis.safe_torque:g} N m, "
                    "ASSUMED; give `safe_torque` in [axis] of the description"
                )
        notes += export.measure(plan).lines()
        scene = f"axis {self.axis} of the scene" if self.axis else "the scene"
        what = f"{self.controller} for {scene} {self.scene}"
        export.write(self.out, plan, what, notes, ros2_control=self.ros2_control)
        build = f"cmake -B build {self.out} && cmake --build build"
        if self.ros2_control:
            build = f"colcon build --base-paths {self.out}"
        size = f"{8 * plan.memory_size} bytes of memory"
        print(f"{len(plan.fields)} parameters, {size}", *notes, sep="\n")
        print(f"build with:  {build}")

    def _write_onnx(self) -> None:
        from cc_mujoco._utils.atomic_io import require_ours
        from cc_mujoco._utils.provenance import POLICY_ENDING
        from cc_mujoco.control import write_onnx
        from cc_mujoco.control._policy import is_onnx_policy

        if not self.controller.endswith(POLICY_ENDING):
            raise CableError(
                f"--target onnx is for policies, files that end in {POLICY_ENDING}, "
                f"not for controller {self.controller!r}."
            )
        path = self.out / "policy.onnx"
        require_ours(self.out, lambda _: is_onnx_policy(path))
        self.out.mkdir(parents=True, exist_ok=True)
        write_onnx(self.controller, path)
        print(path)

    def _require_passive(self, device: "Device", places: list[int]) -> list[str]:
        print(
            "simulating 24 passive wearers of each axis once, for minutes where the "
            "controller plans; --no-check leaves that out",
            file=sys.stderr,
            flush=True,
        )
        from cc_mujoco.control._registry import by_axis, is_decoupled
        from cc_mujoco.export._passivity import EPISODE_TIME, activity

        about = device.description
        laws = [self.controller] * len(places)
        if len(places) > 1 and not is_decoupled(self.controller):
            laws = list(map(str, by_axis(self.controller, about.prefixes)))
        notes = []
        for place, law in zip(places, laws, strict=True):
            axis = about.axes[place].name if len(about.axes) > 1 else None
            with progress_bar(EPISODE_TIME, axis or "") as progress:
                found = activity(device, law, axis=axis, progress=progress)
            limb, where = found.limb, f" at axis {axis}" if axis else ""
            if found.energy <= found.allowed:
                notes.append(
                    f"passivity{where}: {1e3 * found.energy:.3g} mJ into the worst of "
                    f"24 wearers in simulation, of {1e3 * found.allowed:.3g} allowed"
                )
                continue
            raise CableError(
                f"controller {law!r} is not passive on {self.scene!r}{where}: in "
                f"simulation it puts {1e3 * found.energy:.3g} mJ into a wearer who "
                f"holds still ({limb.stiffness:.3g} N m/rad, {limb.damping:.3g} "
                f"N m s/rad), more than the {1e3 * found.allowed:.3g} mJ allowed; "
                "--no-check writes it nevertheless."
            )
        return notes
