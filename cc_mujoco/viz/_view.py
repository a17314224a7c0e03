"""A user's scene in MuJoCo's viewer, simulated in real time, with sliders.

    view("knee.xml")

The viewer's panel *Control* has the actuators of the scene, and factors on friction and
pretension of its cables; cables are coloured by tension.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from cc_mujoco import plugin
from cc_mujoco.device._device_files import locate
from cc_mujoco.device._model import cable_columns
from cc_mujoco.errors import CableError
from cc_mujoco.plugin._mjcf import make_room, write_cable
from cc_mujoco.plugin._spec import compile_spec, read_spec
from cc_mujoco.viz import _live_controls as live_controls
from cc_mujoco.viz._viewer import MIN_FRAME_TIME, Frame, Screen, round_up_tension


def read_scene(scene: str) -> tuple[Path, mujoco.MjSpec, mujoco.MjModel]:
    """Return the file of a scene (see `locate`), its specification and its model.

    The model has room for other parameters of its cables, so that they can change.
    """
    path = locate(scene)[1]
    spec = read_spec(path)
    try:
        make_room(spec)
        plugin.from_mjcf(spec)  # refuses empty keys, which MuJoCo takes for none
    except CableError as error:
        raise CableError(f"{path}: {error}") from None
    return path, spec, compile_spec(spec, path)


def view(scene: str, *, screen: Callable[..., Any] = Screen) -> None:
    """Simulate a scene in a window, made by `screen`, until it is closed."""
    path, spec, model = read_scene(scene)
    if model.ntendon:
        print(plugin.tendon_report(model).overview())
    if not model.njnt:
        raise CableError(f"{path} has no joint; there is nothing to simulate.")
    Viewing(path, spec, model).run(screen)


class Viewing:
    def __init__(self, path: Path, spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
        self._name, self._model = path.name, model
        self._data = mujoco.MjData(model)
        self._cables = plugin.from_mjcf(model)
        self._readers = {name: plugin.Reader(model, name) for name in self._cables}
        self._knobs = live_controls.Knobs(self._cables)
        self._sliders = live_controls.Sliders(self._knobs, spec, own=True)
        self._pace = live_controls.RealTimePacer()
        self._friction, self._laid = 1.0, 1.0

    def run(self, screen: Callable[..., Any]) -> None:
        pretensions = [cable.pretension for cable in self._cables.values()]
        highest = round_up_tension(max(pretensions, default=1.0))
        knobs, names = self._knobs, tuple(self._cables)
        shown = -MIN_FRAME_TIME
        with screen(self._model, names, highest, knobs.press, self._sliders) as window:
            self._start()
            while window.open and not knobs.quit:
                if knobs.restart:
                    self._start()
                if knobs.friction != self._friction:
                    self._write_cables()
                if knobs.paused:
                    time.sleep(MIN_FRAME_TIME)
                    self._pace.begin(self._data.time)
                else:
                    self._step(window)
                if time.perf_counter() - shown >= MIN_FRAME_TIME:
                    shown = time.perf_counter()
                    self._show(window)

    def _start(self) -> None:
        knobs = self._knobs
        knobs.restart = False
        self._laid = knobs.pretension
        self._write_cables()
        mujoco.mj_resetData(self._model, self._data)
        plugin.settle(self._model, self._data)
        self._pace.begin(self._data.time)
        self._note = ""

    def _write_cables(self) -> None:
        self._friction = self._knobs.friction
        options = self._knobs.options(self._laid)
        for name, cable in self._cables.items():
            keys = ("friction", "static_friction", "pretension")
            own = [key for key in keys if f"{name}.{key}" in options]
            values = {key: options[f"{name}.{key}"] for key in own}
            write_cable(self._model, name, cable.replace(**values))

    def _step(self, window: Any) -> None:
        controls = self._sliders.controls
        if controls is not None:
            self._data.ctrl[:] = controls
        window.push(self._data)
        mujoco.mj_step(self._model, self._data)
        if not np.isfinite(self._data.qpos).all() or self._data.time == 0.0:
            self._note = "the simulation diverged, and begins anew"
            self._knobs.restart = True
        self._pace.keep(self._data.time)

    def _show(self, window: Any) -> None:
        columns: dict[str, Any] = {"time_s": self._data.time}
        for name, reader in self._readers.items():
            columns |= cable_columns(name, reader.read(self._data.plugin_state))
        how = {"factor": self._pace.factor, "highest": window.highest}
        rows = live_controls.state_rows(
            self._knobs, columns, self._readers, pretension=self._laid, **how
        )
        texts = ("scene", self._name), *rows, *live_controls.wrap_sentence(self._note)
        tensions = {name: columns[f"tension_{name}_nodes_n"] for name in self._readers}
        frame = Frame(self._data.qpos.copy(), tensions, (texts, self._knobs.help))
        window.show(frame)
