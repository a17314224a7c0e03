"""Films of devices at work, cables coloured by the tension inside.

    python scripts/figures/demo_film.py cc_mujoco/control/controllers.webp
    python scripts/figures/demo_film.py --gallery envs
    python scripts/figures/demo_film.py --scene ankle --controllers none,pi,lqg a.webp

The first is the demo: one motion of the wrist handle with three controllers. --gallery
writes a film of every built-in device, each with a controller of `GALLERY`, into a
folder; --scene one of any device, with one controller or three side by side. A device
plays its own trajectory and task; the plots show its first axis, or that of --axis.
Frames are drawn as `cc-mujoco play --video` draws them, and kept as an animated WebP,
which pages show without a player. Needs OpenGL; see `cc_mujoco/viz`.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import mujoco
import numpy as np
from demo import LAWS, episode, relative_error
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from cc_mujoco import report, simulate
from cc_mujoco.device import find_device
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.simulation import EpisodeLog
from cc_mujoco.viz import OffscreenRenderer, highest_tension

Picture = NDArray[np.uint8]

DURATION, RATE = 5.0, 15  # duration of the demo [s], frames per second of it
OF_A_DEVICE = 3.0  # duration of the motion of a device [s]
GALLERY: dict[str, tuple[str, str | None, str | None]] = {
    "wrist": ("predictive", None, "spring:2.5"),
    "ankle": ("predictive", None, None),
    "bench": ("lqg", None, None),
    "finger": ("predictive", None, None),
    "exosuit": ("predictive", "ankle", None),
    "bilateral": ("predictive", "left_ankle", None),
    "hand": ("lqg", "index_flexor", None),
    "endoscope": ("cable_inverse", None, None),
}
"""Controller of every built-in device in its film, axis in the plot, and task if it is
not the device's own."""
REST = 1500  # time for which the last frame stands [ms]
DPI = 100


class Layout(NamedTuple):
    """Positions in a frame [pixels]."""

    size: tuple[int, int] = (480, 800)  # height and width
    scene: tuple[int, int] = (214, 244)  # height and width of one device
    top: int = 34  # rows above the devices
    lefts: tuple[int, ...] = (40, 296, 552)  # first columns of devices and plots
    plots: tuple[int, int] = (38, 130)  # height above the lower edge, and height
    scale: int = 216  # height of the scale of tension above the lower edge


LAYOUTS = {
    1: Layout((480, 480), (300, 428), 30, (44,), (34, 62), 136),
    3: Layout(),
}
"""Layout by the number of controllers."""


class Take(NamedTuple):
    """An episode, and the columns of torque or angle that its plot shows."""

    log: EpisodeLog
    model: mujoco.MjModel
    desired: str = "desired_torque_nm"
    reached: str = "joint_torque_nm"
    quantity: str = "joint torque [N m]"


def devices(
    take: Take, samples: NDArray[np.intp], highest: float, size: tuple[int, int]
) -> list[Picture]:
    """Return pictures of the device at these samples, coloured up to `highest` [N]."""
    log, qpos = take.log, take.log["qpos"]
    poses = qpos[np.linspace(0, len(log) - 1, 40).astype(int)]  # of the camera
    with OffscreenRenderer(take.model, log.cables, highest, poses, size) as stage:
        return [
            stage.picture(
                qpos[sample],
                {name: log[f"tension_{name}_nodes_n"][sample] for name in log.cables},
            )
            for sample in samples.tolist()
        ]


def frames(takes: dict[str, Take]) -> Iterator[Picture]:
    """Yield all frames, (height, width, 3) each."""
    layout = LAYOUTS[len(takes)]
    height, width = layout.scene
    highest = max(highest_tension(take.log) for take in takes.values())
    time = next(iter(takes.values())).log["time_s"]
    count = round((time[-1] - time[0]) * RATE)
    wanted = time[0] + (np.arange(count) + 1) / RATE
    samples = np.searchsorted(time, wanted).clip(max=len(time) - 1)
    shown = [devices(take, samples, highest, layout.scene) for take in takes.values()]
    with report.style():
        drawing, moving = drawn(takes, layout, highest)
        canvas = FigureCanvasAgg(drawing)
        for number, sample in enumerate(samples.tolist()):
            for (line, moment), take in zip(moving, takes.values(), strict=True):
                line.set_data(time[: sample + 1], take.log[take.reached][: sample + 1])
                moment.set_xdata([time[sample]] * 2)
            canvas.draw()
            frame = np.array(canvas.buffer_rgba())[..., :3]
            rows = slice(layout.top, layout.top + height)
            for left, pictures in zip(layout.lefts, shown, strict=True):
                frame[rows, left : left + width] = pictures[number]
            yield frame


def drawn(
    takes: dict[str, Take], layout: Layout, highest: float
) -> tuple[Figure, list[Any]]:
    """Draw all but the devices; return the figure and the parts that a frame moves."""
    height, width = layout.size
    drawing = Figure(figsize=(width / DPI, height / DPI), dpi=DPI)
    low, tall = layout.plots
    moving: list[Any] = []
    first = None
    for (law, take), left in zip(takes.items(), layout.lefts, strict=True):
        time, place = take.log["time_s"], (left / width, low / height)
        desired, reached = take.log[take.desired], take.log[take.reached]
        title = f"{law}: error {relative_error(time, desired, reached):.0%}"
        middle = 1.0 - 0.5 * layout.top / height
        drawing.text(place[0], middle, title, fontsize=11, weight="bold", va="center")
        axes = drawing.add_axes(
            (*place, layout.scene[1] / width, tall / height), sharex=first, sharey=first
        )
        axes.plot(time, reached, color=report.BLUE, alpha=0.25)  # still to come
        looks = {"color": report.GREY, "dashes": report.DASH_PATTERN}
        axes.plot(time, desired, **looks, label="desired")
        (line,) = axes.plot([], [], color=report.BLUE, label="reached")
        moving.append((line, axes.axvline(0.0, color="black", linewidth=1.0)))
        axes.tick_params(labelleft=first is None, labelsize=7)
        axes.set(xlim=(time[0], time[-1]), xticks=range(1, round(time[-1])))
        axes.set_xlabel("time [s]", fontsize=8, labelpad=0)
        if first is None:
            first = axes
            axes.set_title(take.quantity, fontsize=9, weight="normal")
    axes.legend(ncols=2, loc="lower right", bbox_to_anchor=(1.0, 0.97))
    bar = drawing.add_axes((0.5, layout.scale / height, 0.36, 8 / height))
    colors = ScalarMappable(Normalize(0.0, highest), report.TENSION_COLORS)
    drawing.colorbar(colors, cax=bar, orientation="horizontal")
    bar.tick_params(length=2, pad=1, labelsize=8)
    left, level = layout.lefts[0] / width, (layout.scale + 4) / height
    drawing.text(left, level, "tension inside the cables [N]", fontsize=9, va="center")
    return drawing, moving


def takes_of(
    scene: str, laws: Sequence[str], name: str | None, task: str | None = None
) -> dict[str, Take]:
    """Play a device with each controller; show an axis, by default the first one."""
    axes = {axis.name: axis for axis in find_device(scene).description.axes}
    axis = look_up("axis", name or next(iter(axes)), axes)
    prefix = f"{axis.name}." if len(axes) > 1 else ""
    desired, reached, quantity = Take._field_defaults.values()
    if axis.task == "position":
        desired, reached = "reference_angle_rad", "joint_angle_rad"
        quantity = "joint angle [rad]"
    env: Any = gymnasium.make("cc_mujoco/Device-v1", device=scene)
    return {
        law: Take(
            simulate(scene, law, task=task, duration=OF_A_DEVICE),
            env.unwrapped.model, prefix + desired, prefix + reached, quantity,
        )
        for law in laws
    }  # fmt: skip


def write(out: Path, takes: dict[str, Take]) -> None:
    """Write the film of one controller, or of three side by side."""
    first, *others = (Image.fromarray(frame) for frame in frames(takes))
    first.save(
        out, format="WEBP", save_all=True, append_images=others, loop=0,
        duration=[round(1e3 / RATE)] * len(others) + [REST], quality=72, method=6,
    )  # fmt: skip
    print(f"written: {out}")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=Path)
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--gallery", action="store_true", help="every built-in device")
    what.add_argument("--scene", help="name or file of a device")
    parser.add_argument("--controllers", default="predictive", help="one, or A,B,C")
    parser.add_argument("--axis", help="name of the axis that the plots show")
    options = parser.parse_args()
    laws = options.controllers.split(",")
    if len(set(laws)) not in LAYOUTS:
        parser.error(
            "--controllers takes one name or three different ones: none,pi,lqg."
        )
    try:
        if options.gallery:
            for name, (law, *shown) in GALLERY.items():
                write(options.out / f"film-{name}.webp", takes_of(name, [law], *shown))
        elif options.scene:
            write(options.out, takes_of(options.scene, laws, options.axis))
        else:
            demo = {law: Take(*episode(law, DURATION)) for law in LAWS}
            write(options.out, demo)
    except CableError as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
