"""`cc-mujoco view`: a scene in MuJoCo's viewer, with sliders for its controls."""

from dataclasses import dataclass

from cc_mujoco._utils.command_options import Scene


@dataclass(frozen=True)
class View:
    """Simulate a scene of your own in MuJoCo's viewer, in real time, with sliders."""

    scene: Scene
    """An MJCF file with cables, the description of a device, or the name of a scene."""

    def run(self) -> None:
        from cc_mujoco.device._device_files import locate

        locate(self.scene)
        from cc_mujoco.viz._view import view
        from cc_mujoco.viz._viewer import require_screen

        require_screen("view")
        view(self.scene)
