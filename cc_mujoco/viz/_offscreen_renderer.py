"""Pictures of a device at work, its cables coloured by the tension inside.

    with OffscreenRenderer(model, log.cables, 80.0, log["qpos"][::100]) as stage:
        picture = stage.picture(qpos, tensions)

OpenGL without a graphics card is slow, above all in shadows. So static geoms are
rendered once and kept with their depth. For each picture only moving geoms and cables
are rendered, and both are merged by depth. Pictures are rendered at twice their size
and averaged. Moving parts cast no shadow.
"""

import copy
import ctypes.util
import importlib
import math
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.viz._cable_lines import Capsules

Picture = NDArray[np.uint8]


class Exposure(NamedTuple):
    """Rendered moving parts, not yet merged with the background; bottom row first."""

    rows: slice  # drawn rows that hold moving parts
    tiles: list[tuple[slice, slice]]  # of the picture, which moving parts may cover
    colors: Picture  # of these rows [drawn pixels]
    depth: NDArray[np.float32]  # of these rows [drawn pixels]


SUPERSAMPLING = 2  # pixels drawn per pixel, along either side; see `_downsample`
MAX_GROWTH = 1.3  # of a picture for what stands still: a trunk takes 1.2, a bench 2


def require_opengl() -> None:
    """Raise `CableError` if an `OffscreenRenderer` cannot be opened."""
    _context(8, 8).free()


def _context(width: int, height: int) -> Any:
    """Open an OpenGL context: by MUJOCO_GL, or headless on Linux without it."""
    try:
        maker: Any = mujoco.GLContext
        if sys.platform == "linux" and not os.environ.get("MUJOCO_GL"):
            # The faster first
            backends = {"EGL": "mujoco.egl", "OSMesa": "mujoco.osmesa"}
            library = next(filter(ctypes.util.find_library, backends), None)
            if library is None:
                raise ImportError("no such library is installed")
            maker = importlib.import_module(backends[library]).GLContext
        return maker(width, height)
    except Exception as error:  # PyOpenGL and the drivers raise what they like
        reason = " ".join(str(error).split()) or type(error).__name__
        raise CableError(
            "a video needs OpenGL by EGL or OSMesa, and what is here does not work "
            f"({reason.rstrip('.')}); install one (libegl1 or libosmesa6 on Debian) "
            "or set MUJOCO_GL to what works."
        ) from None


class OffscreenRenderer:
    """Renderer of a model as its first camera sees it; needs OpenGL, but no display."""

    def __init__(
        self,
        model: mujoco.MjModel,
        cables: Iterable[str],
        highest: float,
        poses: Array,
        size: tuple[int, int] = (720, 1280),
    ) -> None:
        """Aim the camera at the moving parts, and draw the static ones.

        Args:
            model: Compiled model; MuJoCo's free camera is used if it has none.
            cables: Names of cables to draw; one without a route or length is left out.
            highest: Tension of the brightest colour [N].
            poses: Poses (T, nq) that the picture must show without cropping.
            size: Height and width of the pictures [pixels].
        """
        self._model = model = copy.copy(model)
        self._capsules = Capsules(model, cables, highest)
        height, width = (SUPERSAMPLING * side for side in size)
        self._size = height, width
        model.vis.global_.offheight, model.vis.global_.offwidth = height, width
        model.vis.quality.offsamples = 0
        self._data = mujoco.MjData(model)
        self._camera = mujoco.MjvCamera()
        mujoco.mjv_defaultFreeCamera(model, self._camera)
        if model.ncam:
            self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
            self._camera.fixedcamid = 0
        self._scene = mujoco.MjvScene(model, 10000)  # as in `mujoco.Renderer`
        self._frustum: tuple[float, float, float] | None = None
        self._frustum = self._aim(poses)
        self._gl = _context(width, height)
        self._gl.make_current()
        self._drawing: Any = self._open()
        self._pose(poses[0], mujoco.mjtCatBit.mjCAT_STATIC)
        self._render()
        # Kept, as memory that is new for every picture costs more than what is done.
        colors = [np.empty((height, width, 3), np.uint8) for _ in range(3)]
        depths = [np.empty((height, width), np.float32) for _ in range(3)]
        self._background_pixels, self._depth = colors[0], depths[0]
        self._films = list(zip(colors[1:], depths[1:], strict=True))
        self._read(0, self._background_pixels, self._depth)
        self._still = _downsample(self._background_pixels)
        self._merged_pixels = self._background_pixels.copy()
        for name in ("SHADOW", "REFLECTION", "SKYBOX"):
            self._scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{name}")] = 0
        # The context holds the shapes, and the shadows' map, which has done its work.
        self._drawing.free()
        # Faces around and along what is round and moves; more take longer to draw
        model.vis.quality.numslices, model.vis.quality.numstacks = 18, 5
        model.vis.quality.shadowsize = 0
        self._drawing = self._open()

    def __enter__(self) -> "OffscreenRenderer":
        return self

    def __exit__(self, *_: object) -> None:
        self._drawing.free()
        self._gl.free()

    def picture(self, qpos: Array, tensions: Mapping[str, Array]) -> Picture:
        """Return the picture (height, width, 3) of a pose; node tensions (n,) [N]."""
        return self.compose_picture(self.render_moving(qpos, tensions))

    def render_moving(self, qpos: Array, tensions: Mapping[str, Array]) -> Exposure:
        """Render the moving parts, in the thread that owns the OpenGL context.

        The second call after this one reuses the memory of the exposure.
        """
        self._pose(qpos, mujoco.mjtCatBit.mjCAT_DYNAMIC)
        self._capsules.add(self._scene, self._data, tensions)
        self._render()
        tiles = list(self._tiles())
        low = min((SUPERSAMPLING * rows.start for rows, _ in tiles), default=0)
        high = max((SUPERSAMPLING * rows.stop for rows, _ in tiles), default=0)
        # Whole rows in one go: every read makes the driver wait.
        self._films.reverse()
        colors, depth = self._films[0][0][low:high], self._films[0][1][low:high]
        self._read(low, colors, depth)
        return Exposure(slice(low, high), tiles, colors, depth)

    def compose_picture(self, exposure: Exposure) -> Picture:
        """Merge an exposure with the static parts by depth; one thread at a time."""
        rows, tiles, colors, depth = exposure
        merged = self._merged_pixels
        merged[rows] = self._background_pixels[rows]
        nearer = depth < self._depth[rows]
        # Whole pixels at once, which is many times as fast as three numbers each.
        np.copyto(merged[rows].view("V3"), colors.view("V3"), where=nearer[..., None])
        picture = self._still.copy()
        for tile in tiles:
            ends = (np.array([side.start, side.stop]) for side in tile)
            drawn = tuple(slice(*(SUPERSAMPLING * both)) for both in ends)
            picture[tile] = _downsample(merged[drawn])
        return picture[::-1]

    def _open(self) -> Any:
        scale = mujoco.mjtFontScale.mjFONTSCALE_100
        drawing = mujoco.MjrContext(self._model, scale)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, drawing)
        return drawing

    def _pose(self, qpos: Array, category: mujoco.mjtCatBit) -> None:
        self._data.qpos[:] = qpos
        mujoco.mj_fwdPosition(self._model, self._data)
        shown = None, self._camera, category.value, self._scene
        mujoco.mjv_updateScene(self._model, self._data, mujoco.MjvOption(), *shown)
        if self._frustum is None:
            return
        for eye in self._scene.camera:
            eye.frustum_width = 0.0  # by the shape of the picture
            eye.frustum_center, eye.frustum_bottom, eye.frustum_top = self._frustum

    def _aim(self, poses: Array) -> tuple[float, float, float]:
        """Return centre, bottom and top of a frustum that shows all `poses` (T, nq).

        It shows what stands still, too, if that needs little more room.
        """
        boxes = []
        for qpos in poses:
            self._pose(qpos, mujoco.mjtCatBit.mjCAT_DYNAMIC)
            self._capsules.add(self._scene, self._data)
            boxes.append(_screen_boxes(self._scene))
        self._pose(poses[0], mujoco.mjtCatBit.mjCAT_STATIC)
        flat = mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD
        kinds = [geom.type for geom in self._scene.geoms[: self._scene.ngeom]]
        still = _screen_boxes(self._scene)[~np.isin(kinds, flat)]
        least, ratio = math.inf, self._size[0] / self._size[1]
        for shown in boxes, [*boxes, still]:
            low, high = np.concatenate(shown).T.reshape(2, 2, -1)
            low, high = low.min(axis=1), high.max(axis=1)
            half = 0.5 * (high - low)
            size = max(half[1], half[0] * ratio)
            if size <= MAX_GROWTH * least:
                least, center, tall = size, 0.5 * (low + high), 1.12 * size
        return float(center[0]), float(center[1] - tall), float(center[1] + tall)

    def _tiles(self) -> Iterator[tuple[slice, slice]]:
        """Yield rows and columns of the picture's parts that moving geoms may cover."""
        eye, (height, width) = self._scene.camera[0], self._size
        per_meter = height / (eye.frustum_top - eye.frustum_bottom)
        left = eye.frustum_center - 0.5 * width / per_meter
        boxes = _screen_boxes(self._scene) - [left, eye.frustum_bottom] * 2
        # With a margin for the edges of what is drawn [drawn pixels]
        boxes = boxes * per_meter + 4 * np.array([-1, -1, 1, 1])
        tile = 48  # side of the squares that are read [drawn pixels]
        tall, wide = -(-height // tile), -(-width // tile)
        tiles = np.clip(boxes // tile, -1, (wide, tall) * 2).astype(int)
        held = np.zeros((tall + 2, wide + 2), bool)  # with a rim that is outside
        for x, y, x_end, y_end in (tiles + 1).tolist():
            held[y : y_end + 1, x : x_end + 1] = True
        held[[0, -1]] = held[:, [0, -1]] = False
        side, height, width = (n // SUPERSAMPLING for n in (tile, height, width))
        for row, line in enumerate(held[1:-1]):
            rows = slice(row * side, min((row + 1) * side, height))
            ends = np.flatnonzero(np.diff(line)).reshape(-1, 2) * side
            for start, end in ends.tolist():
                yield rows, slice(start, min(end, width))

    def _render(self) -> None:
        whole = mujoco.MjrRect(0, 0, self._size[1], self._size[0])
        mujoco.mjr_render(whole, self._scene, self._drawing)

    def _read(self, bottom: int, colors: Picture, depth: NDArray[np.float32]) -> None:
        part = mujoco.MjrRect(0, bottom, self._size[1], len(depth))
        if len(depth):
            mujoco.mjr_readPixels(colors, depth, part, self._drawing)


def _screen_boxes(scene: mujoco.MjvScene) -> Array:
    """Return boxes (n, 4) around geoms on the frustum: left, bottom, right, top [m]."""
    geoms = scene.geoms[: scene.ngeom]
    places = np.array([geom.pos for geom in geoms], dtype=np.float64)
    turns = np.array([geom.mat for geom in geoms], dtype=np.float64)
    halves = np.array([geom.size for geom in geoms], dtype=np.float64)
    # Between the two eyes, as MuJoCo draws a picture for one.
    eyes = np.array([[one.pos, one.forward, one.up] for one in scene.camera], float)
    position, forward, up = eyes.mean(axis=0)
    axes = np.stack([np.cross(forward, up), up, forward])
    place = (places - position) @ axes.T
    reach = np.einsum("gij,gj->gi", np.abs(axes @ turns.reshape(-1, 3, 3)), halves)
    near = float(scene.camera[0].frustum_near)
    nearest = np.maximum(place[:, 2] - reach[:, 2], near)[:, None]
    farthest = np.maximum(place[:, 2] + reach[:, 2], near)[:, None]
    low, high = place[:, :2] - reach[:, :2], place[:, :2] + reach[:, :2]
    low = near * np.minimum(low / nearest, low / farthest)
    high = near * np.maximum(high / nearest, high / farthest)
    return np.concatenate([low, high], axis=1)


def _downsample(fine: Picture) -> Picture:
    wide = fine[::2].astype(np.uint16) + fine[1::2]
    return ((wide[:, ::2] + wide[:, 1::2] + 2) >> 2).astype(np.uint8)
