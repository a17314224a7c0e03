"""`cc-mujoco tendons`: bends of a model's tendons, and the friction there."""

from dataclasses import dataclass
from typing import Annotated

from cc_mujoco._utils.command_options import Flag, Names, Scene, option_help


@dataclass(frozen=True)
class ShowTendons:
    """Show where the spatial tendons of a scene bend, and the friction there.

    The scene needs no cables, so that friction can be judged before it is added.
    """

    scene: Scene
    """An MJCF file, the description of a device, or the name of a scene."""
    tendon: Names = ()
    """Tendons to show; by default all."""
    friction: Annotated[float | None, option_help("MU")] = None
    """Coefficient of friction; by default that of the cables, 0.1 without."""
    brief: Flag = False
    """Show one line for every tendon."""

    def run(self) -> None:
        from cc_mujoco.plugin import tendon_report
        from cc_mujoco.viz._view import read_scene

        model = read_scene(self.scene)[2]
        report = tendon_report(model, self.tendon or None, friction=self.friction)
        print(report.overview() if self.brief else report)
