"""A window on a running simulation: MuJoCo's viewer, cables coloured by tension.

    with Screen(model, cables, 10.0, knobs.press) as screen:
        while screen.open:
            screen.push(data)
            mujoco.mj_step(model, data)
            screen.show(Frame(data.qpos.copy(), tensions, texts))

The viewer has its own model and data, and paints in a thread of its own: it shows the
latest frame, and the simulation does not wait for it.
"""

import copy
import re
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np

from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.viz._cable_lines import Capsules
from cc_mujoco.viz._live_controls import Sliders, has_display
from cc_mujoco.viz._scene3d import viewpoint

Rows = tuple[tuple[str, str], ...]  # lines of two columns

MIN_FRAME_TIME = 1.0 / 60.0  # least time from frame to frame [s]


class Frame(NamedTuple):
    qpos: Array  # pose (nq,)
    tensions: Mapping[str, Array]  # at the nodes of each cable (n,) [N]
    texts: tuple[Rows, Rows]  # at the top left and at the bottom left


_WORKS = threading.Event()  # set when a window could be opened
INSTEAD = "--video and --html of `cc-mujoco play` need"


def require_screen(what: str = "--live", instead: str = INSTEAD) -> None:
    """Raise `CableError` if a `Screen`, which `what` needs, cannot be opened.

    `instead` ends the message: options that need none.
    """
    if not has_display():
        raise CableError(
            f"{what} needs a screen, and neither DISPLAY nor WAYLAND_DISPLAY is set; "
            f"{instead} none."
        )
    viewer = _viewer(what, instead)
    if sys.platform == "darwin":
        if viewer._MJPYTHON is None:
            raise CableError(
                f"on macOS {what} needs mjpython, which comes with MuJoCo: "
                "`mjpython -m cc_mujoco.cli` in place of `cc-mujoco`, `mjpython` in "
                "place of `python`."
            )
        return
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        # Once only: the end of GLFW after a try ends every window of the process.
        works = _WORKS.is_set() or _opens_window()
    if works:
        _WORKS.set()
    else:
        reason = " ".join(str(warning.message) for warning in caught)
        raise _no_screen_error(reason, what, instead)


def _viewer(what: str = "--live", instead: str = INSTEAD) -> Any:
    try:
        import mujoco.viewer as viewer
    except Exception as error:  # without GLFW or its library; the type varies
        raise _no_screen_error(str(error), what, instead) from None
    return viewer


def _no_screen_error(reason: str, what: str, instead: str) -> CableError:
    plain = re.sub(r"\(\d+\) b['\"](.*?)['\"]", r"\1", reason)  # GLFW's wording
    text = " ".join(plain.split()).rstrip(".") or "no reason given"
    return CableError(
        f"{what} needs a screen with OpenGL by GLFW, and what is here does not work "
        f"({text}); {instead} none."
    )


def _opens_window() -> bool:
    """Return whether GLFW can open an OpenGL window, by opening a hidden one."""
    import glfw

    if not glfw.init():
        return False
    try:
        glfw.window_hint(glfw.VISIBLE, False)
        window = glfw.create_window(64, 64, "", None, None)
        if window:
            glfw.destroy_window(window)
        return bool(window)
    finally:
        glfw.terminate()


class Screen:
    """MuJoCo's passive viewer, with cables coloured by tension; needs a display."""

    def __init__(
        self,
        model: mujoco.MjModel,
        cables: Iterable[str],
        highest: float,
        press: Callable[[int], object],
        sliders: Sliders | None = None,
    ) -> None:
        """Open the window with the view of the model's first camera.

        A copy of the model is shown, or the model of `sliders`, which must be of the
        same scene. `highest` [N] is the initial tension of the brightest colour; it
        rises with the tensions. `press` is called in the window's thread with each GLFW
        key code.
        """
        self._model = shown = copy.copy(model) if sliders is None else sliders.model
        self._sliders = sliders
        self._capsules = Capsules(shown, cables, highest)
        if shown.ncam:
            shown.vis.global_.fovy = shown.cam_fovy[0]
        self._data = mujoco.MjData(shown)
        before = set(threading.enumerate())
        panels = {"show_left_ui": False, "show_right_ui": sliders is not None}
        launch = _viewer().launch_passive
        self._viewer: Any = launch(shown, self._data, key_callback=press, **panels)
        self._windows = set(threading.enumerate()) - before
        with self._viewer.lock():
            # Free to be turned by the mouse
            camera, (position, target) = self._viewer.cam, viewpoint(shown)
            forward = target - position
            camera.type = mujoco.mjtCamera.mjCAMERA_FREE
            if shown.ncam and shown.cam_mode[0] == mujoco.mjtCamLight.mjCAMLIGHT_TRACK:
                camera.type = mujoco.mjtCamera.mjCAMERA_TRACKING
                camera.trackbodyid = shown.cam_bodyid[0]
            camera.lookat[:] = target
            camera.distance = float(np.linalg.norm(forward))
            camera.azimuth = np.degrees(np.arctan2(forward[1], forward[0]))
            camera.elevation = np.degrees(np.arcsin(forward[2] / camera.distance))
        self._simulated = model
        self._mouse = mujoco.MjvPerturb()
        self._mouse_was_active = False
        self._frame: Frame | None = None
        self._left = threading.Event()
        self.painted = 0  # frames so far
        # Not waited for at exit: the viewer never returns from a text once it is shut.
        self._draw_thread = threading.Thread(target=self._draw_frames, daemon=True)
        self._draw_thread.start()

    def __enter__(self) -> "Screen":
        return self

    def __exit__(self, *_: object) -> None:
        self._left.set()
        longest = 2.0  # wait for the last frame [s]
        self._draw_thread.join(longest)
        self._viewer.close()
        # GLFW ends with the program, and must not while a window is drawn to.
        for thread in self._windows:
            thread.join(longest)

    @property
    def open(self) -> bool:
        return bool(self._viewer.is_running())

    @property
    def highest(self) -> float:
        return self._capsules.highest

    def show(self, frame: Frame) -> None:
        """Request the painting of a frame; a later request replaces it."""
        self._frame = frame

    def push(self, data: mujoco.MjData) -> None:
        """Apply the mouse's forces to `data.xfrc_applied`, as MuJoCo's viewer does."""
        mouse = self._mouse
        if mouse.active or self._mouse_was_active:
            data.xfrc_applied[:] = 0.0
            mujoco.mjv_applyPerturbForce(self._simulated, data, mouse)
        self._mouse_was_active = bool(mouse.active)

    def _draw_frames(self) -> None:
        while self.open and not self._left.is_set():
            begun, frame = time.perf_counter(), self._frame
            if frame is not None:
                self._put(frame)
                self.painted += 1
            self._left.wait(max(MIN_FRAME_TIME - (time.perf_counter() - begun), 1e-3))

    def _put(self, frame: Frame) -> None:
        viewer, scene = self._viewer, self._viewer.user_scn
        nodes = [float(tension.max()) for tension in frame.tensions.values()]
        highest = self._capsules.highest
        self._capsules.highest = max(highest, *map(round_up_tension, nodes))
        with viewer.lock():
            self._data.qpos[:] = frame.qpos
            mujoco.mj_fwdPosition(self._model, self._data)
            scene.ngeom = 0
            self._capsules.add(scene, self._data, frame.tensions)
            self._mouse = copy.copy(viewer.perturb)
            if self._sliders is not None:
                self._sliders.write(self._data)
        viewer.sync()
        if self._sliders is not None:
            self._sliders.read(self._data)
        font = mujoco.mjtFont.mjFONT_NORMAL
        places = mujoco.mjtGridPos.mjGRID_TOPLEFT, mujoco.mjtGridPos.mjGRID_BOTTOMLEFT
        texts = []
        for place, rows in zip(places, frame.texts, strict=True):
            texts.append((font, place, *map("\n".join, zip(*rows, strict=True))))
        viewer.set_texts(texts)


def round_up_tension(tension: float) -> float:
    """Return the next of 1, 2, 5, 10, 20, ... N from a tension on, to change rarely."""
    power = 10.0 ** np.floor(np.log10(max(tension, 1e-3)))
    return float(next(n * power for n in (1, 2, 5, 10) if n * power >= tension))
