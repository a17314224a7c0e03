"""A film of a device: one motion, three laws, cables coloured by the tension inside.

    python scripts/figures/demo_film.py cc_mujoco/control/controllers.webp
    python scripts/figures/demo_film.py --scene ankle film-ankle.webp
    python scripts/figures/demo_film.py --scene knee.xml --axis knee knee.webp

Without --scene it is the demo. A device plays its own trajectory and task; the plots
show its first axis, or that of --axis. Frames are drawn as `cc-mujoco play --video`
draws them, and kept as an animated WebP, which pages show without a player. Needs
OpenGL; see `cc_mujoco/viz`.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
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
from PIL.ExifTags import Base

from cc_mujoco import report, simulate
from cc_mujoco._utils.atomic_io import replacing, require_own_file
from cc_mujoco.device import find_device
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.simulation import EpisodeLog
from cc_mujoco.viz import OffscreenRenderer, highest_tension

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

DURATION, RATE = 5.0, 15  # duration of the demo [s], frames per second of it
OF_A_DEVICE = 3.0  # duration of the motion of a device [s]
OF_TORQUE = "none", "lqg", "predictive"
OF_POSITION = "none", "backlash_inverse", "cable_inverse"
"""Controllers of a film, by the task of the axis."""
REST = 1500  # time for which the last frame stands [ms]
SIZE = (480, 800)  # height and width [pixels]
SCENE = (214, 244)  # height and width of the device with one controller [pixels]
TOP = 34  # rows above the devices [pixels]
LEFTS = (40, 296, 552)  # first columns of the devices, and of the plots below [pixels]
PLOTS = (38, 130)  # height above the lower edge and height of the plots [pixels]
SCALE = 216  # height of the scale of tension above the lower edge [pixels]
DPI = 100


class Course(NamedTuple):
    """Desired and reached torque or angle of an axis, (samples,) each."""

    quantity: str
    time: Array
    desired: Array
    reached: Array

    @classmethod
    def of(cls, log: EpisodeLog, prefix: str = "", position: bool = False) -> Course:
        """Return the torque of an axis, or its angle where that is the task."""
        names = "desired_torque_nm", "joint_torque_nm"
        if position:
            names = "reference_angle_rad", "joint_angle_rad"
        quantity = "joint angle [rad]" if position else "joint torque [N m]"
        desired, reached = (log[prefix + name] for name in names)
        return cls(quantity, log["time_s"], desired, reached)


class Take(NamedTuple):
    log: EpisodeLog
    model: mujoco.MjModel
    course: Course


def devices(take: Take, samples: NDArray[np.intp], highest: float) -> list[Picture]:
    """Return pictures of the device at these samples, coloured up to `highest` [N]."""
    log = take.log
    qpos = log["qpos"]
    poses = qpos[np.linspace(0, len(log) - 1, 40).astype(int)]  # of the camera
    with OffscreenRenderer(take.model, log.cables, highest, poses, SCENE) as stage:
        return [
            stage.picture(
                qpos[sample],
                {name: log[f"tension_{name}_nodes_n"][sample] for name in log.cables},
            )
            for sample in samples.tolist()
        ]


def frames(takes: dict[str, Take]) -> Iterator[Picture]:
    """Yield all frames, (480, 800, 3) each."""
    highest = max(highest_tension(take.log) for take in takes.values())
    time = next(iter(takes.values())).course.time
    count = round((time[-1] - time[0]) * RATE)
    wanted = time[0] + (np.arange(count) + 1) / RATE
    samples = np.searchsorted(time, wanted).clip(max=len(time) - 1)
    shown = [devices(take, samples, highest) for take in takes.values()]
    with report.style():
        drawing, moving = drawn(takes, highest)
        canvas = FigureCanvasAgg(drawing)
        for number, sample in enumerate(samples.tolist()):
            for lines, take in zip(moving, takes.values(), strict=True):
                advance(lines, take.course, sample)
            canvas.draw()
            frame = np.array(canvas.buffer_rgba())[..., :3]
            for left, pictures in zip(LEFTS, shown, strict=True):
                height, width = SCENE
                frame[TOP : TOP + height, left : left + width] = pictures[number]
            yield frame


def drawn(takes: dict[str, Take], highest: float) -> tuple[Figure, list[Any]]:
    """Draw all but the devices; return the figure and the parts that a frame moves."""
    height, width = SIZE
    drawing = Figure(figsize=(width / DPI, height / DPI), dpi=DPI)
    low, tall = PLOTS
    moving = []
    first = None
    for (law, take), left in zip(takes.items(), LEFTS, strict=True):
        one, place = take.course, (left / width, low / height)
        middle = 1.0 - 0.5 * TOP / height
        error = relative_error(one.time, one.desired, one.reached)
        title = f"{law}: error {error:.0%}"
        drawing.text(place[0], middle, title, fontsize=11, weight="bold", va="center")
        axes = drawing.add_axes(
            (*place, SCENE[1] / width, tall / height), sharex=first, sharey=first
        )
        axes.plot(one.time, one.reached, color=report.BLUE, alpha=0.25)  # still to come
        axes.plot(
            one.time,
            one.desired,
            color=report.GREY,
            dashes=report.DASH_PATTERN,
            label="desired",
        )
        (line,) = axes.plot([], [], color=report.BLUE, label="reached")
        moving.append((line, axes.axvline(0.0, color="black", linewidth=1.0)))
        axes.tick_params(labelleft=first is None, labelsize=8)
        axes.tick_params(axis="y", labelsize=7)
        axes.set(xlim=(one.time[0], one.time[-1]), xticks=range(1, round(one.time[-1])))
        axes.set_xlabel("time [s]", fontsize=8, labelpad=0)
        if first is None:
            first = axes
            axes.set_title(one.quantity, fontsize=9, weight="normal")
        elif len(moving) == len(takes):
            axes.legend(ncols=2, loc="lower right", bbox_to_anchor=(1.0, 0.97))
    bar = drawing.add_axes((0.5, SCALE / height, 0.36, 8 / height))
    colors = ScalarMappable(Normalize(0.0, highest), report.TENSION_COLORS)
    drawing.colorbar(colors, cax=bar, orientation="horizontal")
    bar.tick_params(length=2, pad=1, labelsize=8)
    left, level = LEFTS[0] / width, (SCALE + 4) / height
    drawing.text(left, level, "tension inside the cables [N]", fontsize=9, va="center")
    return drawing, moving


def advance(lines: Any, course: Course, sample: int) -> None:
    reached, moment = lines
    reached.set_data(course.time[: sample + 1], course.reached[: sample + 1])
    moment.set_xdata([course.time[sample]] * 2)


def save(path: Path, film: list[Picture]) -> None:
    """Write the film as an animated WebP, which appears when complete."""
    first, *others = (Image.fromarray(frame) for frame in film)
    mark = Image.Exif()
    mark[Base.Software] = report.SOFTWARE_TAG
    with replacing(path) as partial:
        first.save(
            partial,
            format="WEBP",
            save_all=True,
            append_images=others,
            duration=[round(1e3 / RATE)] * len(others) + [REST],
            loop=0,
            quality=72,  # of 100
            method=6,
            exif=mark,
        )


def is_ours(path: Path) -> bool:
    try:
        with Image.open(path) as image:
            return image.getexif().get(Base.Software) == report.SOFTWARE_TAG
    except OSError:
        return False


def film_path(text: str) -> Path:
    """Return the path of a `.webp` file; a `type` for `argparse`."""
    path = Path(text)
    try:
        require_own_file(path, is_ours)
    except CableError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return path


def takes_of(options: argparse.Namespace) -> dict[str, Take]:
    """Play the device of `--scene` with each controller."""
    device = find_device(options.scene)
    axes = {axis.name: axis for axis in device.description.axes}
    axis = look_up("axis", options.axis or next(iter(axes)), axes)
    prefix = f"{axis.name}." if len(axes) > 1 else ""
    position = axis.task == "position"
    laws = options.controllers or (OF_POSITION if position else OF_TORQUE)
    env: Any = gymnasium.make("cc_mujoco/Device-v1", device=options.scene)
    model, takes = env.unwrapped.model, {}
    for law in laws:
        log = simulate(options.scene, law, duration=options.duration or OF_A_DEVICE)
        takes[law] = Take(log, model, Course.of(log, prefix, position))
    return takes


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=film_path)
    parser.add_argument("--scene", help="name or file of a device")
    parser.add_argument("--controllers", nargs=3, metavar="CONTROLLER")
    parser.add_argument("--axis", help="name of the axis that the plots show")
    parser.add_argument("--duration", type=float, help=f"[s], by default {OF_A_DEVICE}")
    options = parser.parse_args()
    others = options.controllers, options.axis, options.duration
    if options.scene is None and any(one is not None for one in others):
        parser.error("--controllers, --axis and --duration are for a --scene")
    if options.scene:
        try:
            takes = takes_of(options)
        except CableError as error:
            parser.error(str(error))
    else:
        takes = {}
        for law in LAWS:
            log, model = episode(law, DURATION)
            takes[law] = Take(log, model, Course.of(log))
    save(options.out, list(frames(takes)))


if __name__ == "__main__":
    main()
