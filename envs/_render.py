"""Images of a device for `render_mode="rgb_array"`, videos, and a live window."""

from __future__ import annotations

import atexit
import math
import time
from collections.abc import Iterable, Mapping
from typing import Any

import gymnasium
import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco import plugin
from cc_mujoco.errors import CableError

CAMERA = "overview"
"""Camera that a scene may have for pictures; without one its first camera serves."""

MAX_SURROUNDINGS = 3.0
"""Largest ratio of the size of all geoms to that of the moving ones."""


IMAGE_SIZE = (480, 854)  # height and width [pixels]

RENDER_RATE = 30  # images drawn per simulated second; a video needs no more [1/s]

RENDER_METADATA: dict[str, Any] = {"render_modes": ["human", "rgb_array"]}
"""Metadata of single environments, by Gymnasium's names."""


def frame_interval(period: float) -> int:
    """Return the number of control steps of `period` [s] between two images."""
    return max(1, round(1.0 / (RENDER_RATE * period)))


def free_view(model: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjvCamera:
    """Return a free camera on the device, in the direction of MuJoCo's viewer.

    It shows what can move and, unless that is far larger (`MAX_SURROUNDINGS`), all
    other geoms except floors.
    """
    mujoco.mj_kinematics(model, data)
    camera = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, camera)
    flat = mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD
    solid = ~np.isin(model.geom_type, flat)
    moving = solid & (model.body_weldid[model.geom_bodyid] > 0)
    lows = data.geom_xpos - model.geom_rbound[:, None]
    highs = data.geom_xpos + model.geom_rbound[:, None]
    parts = [shown for shown in (moving, solid) if shown.any()]
    boxes = [(lows[shown].min(axis=0), highs[shown].max(axis=0)) for shown in parts]
    if not boxes:
        return camera
    spans = [float(np.linalg.norm(high - low)) for low, high in boxes]
    seen = -1 if spans[-1] <= MAX_SURROUNDINGS * spans[0] else 0
    camera.lookat[:] = 0.5 * (boxes[seen][0] + boxes[seen][1])
    half_view = np.radians(0.5 * model.vis.global_.fovy)
    camera.distance = 0.5 * spans[seen] / np.sin(half_view)
    return camera


class Camera:
    """Camera that draws poses by OpenGL (`MUJOCO_GL=egl` without a display)."""

    _refusal = ""  # of the first try: MuJoCo ends the process at a second one

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        # Its own data, so that looking does not touch the simulation.
        self._data = mujoco.MjData(model)
        frame = model.vis.global_
        frame.offheight = max(frame.offheight, IMAGE_SIZE[0])
        frame.offwidth = max(frame.offwidth, IMAGE_SIZE[1])
        if Camera._refusal:
            raise CableError(Camera._refusal)
        try:
            self._renderer = mujoco.Renderer(model, *IMAGE_SIZE)
        except mujoco.FatalError as error:
            Camera._refusal = (
                "a picture needs OpenGL; without a display set MUJOCO_GL=egl (or "
                f"osmesa) before Python starts ({' '.join(str(error).split())})."
            )
            raise CableError(Camera._refusal) from None
        named = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, CAMERA)
        self._view = max(named, 0) if model.ncam else free_view(model, self._data)

    def picture(self, qpos: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Return an image (height, width, 3) of a pose `qpos` (nq,)."""
        self._data.qpos[:] = qpos
        mujoco.mj_fwdPosition(self._model, self._data)
        self._renderer.update_scene(self._data, camera=self._view)
        picture: NDArray[np.uint8] = self._renderer.render()
        return picture.copy()

    def close(self) -> None:
        self._renderer.close()


class Film:
    """Last image of a simulation, which is returned again until the next is due.

    Gymnasium requests an image per control step, more than the eye can see, and drawing
    takes longer than a step. A second request in the same step draws anew, as a user
    may have changed the joints.
    """

    def __init__(self, period: float) -> None:
        self._stride = frame_interval(period)
        self._step = 0
        self._picture: NDArray[np.uint8] | None = None

    def cut(self) -> None:
        """Discard the last image, as at the start of an episode."""
        self._picture = None

    def picture(
        self, camera: Camera, qpos: NDArray[np.float64], step: int
    ) -> NDArray[np.uint8]:
        """Return the image (height, width, 3) of a control step or shortly before."""
        if self._picture is None or not 0 < step - self._step < self._stride:
            self._picture, self._step = camera.picture(qpos), step
        return self._picture


class Window:
    """MuJoCo's viewer on a simulation, which it slows down to real time."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Open the window.

        Raises:
            CableError: If there is no screen.
        """
        from cc_mujoco.viz import _live_controls as live_controls
        from cc_mujoco.viz import _viewer as viewer

        self._viewer, self._pace = viewer, live_controls.RealTimePacer()
        viewer.require_screen('render_mode="human"', 'render_mode="rgb_array" needs')
        cables = plugin.from_mjcf(model)
        self._readers = {name: plugin.Reader(model, name) for name in cables}
        pretensions = [cable.pretension for cable in cables.values()]
        highest = viewer.round_up_tension(max(pretensions, default=1.0))
        self._screen = viewer.Screen(model, cables, highest, lambda _: None)
        # GLFW must not end while a window is drawn to.
        atexit.register(self.close)
        self._time, self._shown = math.inf, -math.inf

    def show(self, data: mujoco.MjData) -> None:
        """Show the present state, at its time, unless the user closed the window."""
        if not self._screen.open:
            return
        if data.time <= self._time:  # an episode begins
            self._pace.begin(data.time)
        self._time = data.time
        self._pace.keep(data.time)
        now = time.perf_counter()
        if now - self._shown < self._viewer.MIN_FRAME_TIME:
            return
        self._shown = now
        tensions = {
            name: reader.read(data.plugin_state).tension
            for name, reader in self._readers.items()
        }
        texts = (
            ("time", f"{data.time:.1f} s"),
            *(
                (name, f"{nodes[0]:.1f} N at the motor, {nodes[-1]:.1f} N at the joint")
                for name, nodes in tensions.items()
            ),
        )
        scale = (("brightest", f"{self._screen.highest:g} N; grey is slack"),)
        frame = self._viewer.Frame(data.qpos.copy(), tensions, (texts, scale))
        self._screen.show(frame)

    def close(self) -> None:
        atexit.unregister(self.close)
        self._screen.__exit__()


class SceneRenderer:
    """Images of an environment's devices, by one renderer that opens on demand.

    They are drawn 30 times per simulated second; in between the last ones are returned.
    """

    def __init__(
        self, model: mujoco.MjModel, mode: str | None, period: float, count: int = 1
    ) -> None:
        """Prepare for `count` devices with one model, in a Gymnasium `render_mode`.

        `period` is the control step [s].
        """
        self._model, self._mode = model, mode
        self._camera: Camera | None = None
        self._window = Window(model) if mode == "human" else None
        self.films = [Film(period) for _ in range(count)]

    def render(
        self, poses: Iterable[NDArray[np.float64]], steps: Iterable[int]
    ) -> tuple[NDArray[np.uint8], ...] | None:
        """Return an image (height, width, 3) of every device; None without a mode.

        `poses` has each device's `qpos` (nq,), `steps` its number of control steps.
        """
        if self._mode is None:
            gymnasium.logger.warn("render() needs a render_mode at make().")
        if self._mode != "rgb_array":
            return None
        camera = self._camera = self._camera or Camera(self._model)
        shots = zip(self.films, poses, steps, strict=True)
        return tuple(film.picture(camera, pose, int(k)) for film, pose, k in shots)

    def follow(self, data: mujoco.MjData) -> None:
        """Show the state after a reset or step, in mode `human`."""
        if self._window is not None:
            self._window.show(data)

    def close(self) -> None:
        if self._window is not None:
            self._window.close()
            self._window = None
        if self._camera is not None:
            self._camera.close()
            self._camera = None


def metadata_of(fps: int) -> dict[str, Any]:
    """Return an environment's metadata; "human" is a mode only with a display."""
    from cc_mujoco.viz._live_controls import has_display

    modes = ["human", "rgb_array"] if has_display() else ["rgb_array"]
    return {**RENDER_METADATA, "render_modes": modes, "render_fps": fps}


def check_mode(mode: str | None, metadata: Mapping[str, Any]) -> None:
    """Refuse a render mode that is neither None nor in an environment's metadata."""
    modes = metadata["render_modes"]
    if mode is not None and mode not in modes:
        raise CableError.unknown("render mode", str(mode), modes)


class RecordVideo(gymnasium.wrappers.RecordVideo[Any, Any]):
    """Gymnasium's `RecordVideo` with 30 frames per second, in real time.

    Gymnasium's own writes a frame per control step, a thousand per second, which takes
    long to encode. Arguments are Gymnasium's; `video_length` counts frames.
    """

    def __init__(
        self, env: gymnasium.Env[Any, Any], video_folder: str, **options: Any
    ) -> None:
        """Wrap an environment of this package, made with `render_mode="rgb_array"`."""
        period = env.get_wrapper_attr("exo").period
        self._stride = frame_interval(period)
        self._asked = 0
        options.setdefault("fps", 1.0 / (self._stride * period))
        super().__init__(env, video_folder, **options)

    def start_recording(self, video_name: str) -> None:
        """Start a recording with a frame of the present state."""
        super().start_recording(video_name)
        self._asked = 0

    def _capture_frame(self) -> None:
        if self._asked % self._stride == 0:
            super()._capture_frame()  # type: ignore[no-untyped-call]
        self._asked += 1
