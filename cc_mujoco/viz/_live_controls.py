"""Settings that can change during a live episode, texts on its screen, and its pace.

    knobs = Knobs(env.exo.device.cables, "pi")
    knobs.press(UP)                    # or knobs.slide(0, 1.25)
    knobs.options()                    # {"flexor.friction": 0.2625, ...}

Friction changes at once, pretension at the next start. Controllers are not informed of
either: their model keeps the values of the scene.
"""

import math
import os
import sys
import textwrap
import time as wall
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco.cable import Cable
from cc_mujoco.control import CONTROLLERS

SPACE, ESCAPE, ENTER = 32, 256, 257
RIGHT, LEFT, DOWN, UP, HOME, END = 262, 263, 264, 265, 268, 269  # keys of GLFW

STEP_FACTOR = 1.25  # factor of friction or pretension from one key to the next
MAX_STEPS = 10  # steps from the scene's value, either way


def has_display() -> bool:
    """Return False where the system names no display, as on a server."""
    displays = map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY"))
    return sys.platform != "linux" or any(displays)


class Slider(NamedTuple):
    name: str
    low: float
    high: float


class Knobs:
    """Requested friction, pretension and controller.

    Keys are pressed in the window's thread, and settings read in that of the
    simulation.
    """

    def __init__(
        self,
        cables: Mapping[str, Cable],
        controller: str = "",
        names: Iterable[str] = CONTROLLERS,
    ) -> None:
        """Start with the scene's cables; with controller "" none can be selected."""
        self._cables = cables
        known = tuple(names)
        own = () if controller in known else (controller,)
        self._laws: tuple[str, ...] = (*own, *known) if controller else ()
        self._law = self._laws.index(controller) if controller else 0
        self._steps = [0.0, 0.0]  # of friction and pretension from the scene's
        self.paused = False  # true while the episode stands still
        self.restart = False  # true if the episode is to begin anew
        self.quit = False  # true if the episode is to end

    def press(self, key: int) -> None:
        """Handle a GLFW key code; keys without a meaning are ignored."""
        step = 1 if key in (UP, HOME, RIGHT) else -1
        if key in (UP, DOWN, HOME, END):
            which = 0 if key in (UP, DOWN) else 1
            steps = max(self._steps[which] + step, float(-MAX_STEPS))
            self._steps[which] = min(steps, float(MAX_STEPS))
        elif key in (RIGHT, LEFT) and self._laws:
            self._law = (self._law + step) % len(self._laws)
        elif key == SPACE:
            self.paused = not self.paused
        elif key == ENTER:
            self.restart, self.paused = True, False
        elif key == ESCAPE:
            self.quit = True

    @property
    def sliders(self) -> tuple[Slider, ...]:
        """Sliders of the friction and pretension factors, and of the controller."""
        ends = STEP_FACTOR**-MAX_STEPS, STEP_FACTOR**MAX_STEPS
        factors = Slider("friction", *ends), Slider("pretension", *ends)
        if not self._laws:
            return factors
        return (*factors, Slider("controller", 0.0, len(self._laws) - 1.0))

    @property
    def slides(self) -> tuple[float, ...]:
        places = self.friction, self.pretension, float(self._law)
        return places[: len(self.sliders)]

    @property
    def help(self) -> tuple[tuple[str, str], ...]:
        rows = [("up, down", "friction")]
        rows.append(("home, end", "pretension, from the next start on"))
        if self._laws:
            rows.append(("right, left", "controller"))
        rows += [("space", "pause"), ("enter", "restart"), ("escape", "quit")]
        return (*rows, ("panel Control", "sliders of these"))

    def slide(self, which: int, value: float) -> None:
        """Set slider number `which` to a value, clipped to its range."""
        _, low, high = self.sliders[which]
        value = min(max(value, low), high)
        if which < 2:
            self._steps[which] = math.log(value, STEP_FACTOR)
        else:
            self._law = round(value)

    @property
    def controller(self) -> str:
        return self._laws[self._law]

    @property
    def friction(self) -> float:
        """Factor on the friction of all cables, 1 for that of the scene."""
        return float(STEP_FACTOR ** self._steps[0])

    @property
    def pretension(self) -> float:
        """Factor on the pretension of all cables, 1 for that of the scene."""
        return float(STEP_FACTOR ** self._steps[1])

    def options(self, pretension: float | None = None) -> dict[str, float]:
        """Return `options` for a reset of the environment, under `CABLE.NAME`.

        They are friction, static friction and pretension of every cable, also those
        that equal the scene's, so that a reset undoes earlier changes. `pretension`
        replaces the requested factor.
        """
        scale = self.pretension if pretension is None else pretension
        found = {}
        for name, cable in self._cables.items():
            found[f"{name}.friction"] = self.friction * cable.friction
            if cable.static_friction:
                still = self.friction * cable.static_friction
                found[f"{name}.static_friction"] = still
            found[f"{name}.pretension"] = scale * cable.pretension
        return found


class Sliders:
    """Knobs as sliders of the control panel of a MuJoCo viewer.

    Each is the control of an actuator that only the shown model has, which is not
    simulated.
    """

    def __init__(self, knobs: Knobs, spec: mujoco.MjSpec, own: bool = False) -> None:
        """Add actuators for the knobs to `spec`; `own` shows the scene's own too."""
        # Positions of the sliders of the scene's own actuators, once seen
        self.controls: NDArray[np.float64] | None = None
        self._knobs = knobs
        self._wanted: tuple[float, ...] | None = None
        self._seen = np.empty(0)
        for actuator in spec.actuators:
            if not own or actuator.plugin.active:
                actuator.group = 5  # hidden; sliders are of group 0
        target = spec.joints[0]
        target.name = target.name or "cc_mujoco_slider"
        taken = {actuator.name for actuator in spec.actuators}
        for slider in knobs.sliders:
            added = spec.add_actuator(name=_free(slider.name, taken), ctrllimited=True)
            added.trntype = mujoco.mjtTrn.mjTRN_JOINT
            added.target = target.name
            added.ctrlrange = slider.low, slider.high
            added.gainprm[0] = 0.0
        self.model: mujoco.MjModel = spec.compile()

    def write(self, data: mujoco.MjData) -> None:
        """Set the controls of `data` to the knobs that keys have changed."""
        wanted = self._knobs.slides
        if wanted != self._wanted:
            self._wanted, self._seen = wanted, np.array(wanted)
            data.ctrl[-self._seen.size :] = self._seen

    def read(self, data: mujoco.MjData) -> None:
        """Set the knobs to the controls of `data` that the user has moved."""
        now = np.array(data.ctrl[-self._seen.size :])
        self.controls = np.array(data.ctrl[: -self._seen.size])
        moved = np.flatnonzero(now != self._seen)
        for which in moved:
            self._knobs.slide(int(which), float(now[which]))
        if moved.size:
            # The sliders stay under the mouse, also between two controllers.
            self._seen, self._wanted = now, self._knobs.slides


def _free(name: str, taken: set[str]) -> str:
    return _free(f"{name} of cables", taken) if name in taken else name


def state_rows(
    knobs: Knobs,
    columns: Mapping[str, Any],
    cables: Iterable[str],
    *,
    pretension: float,
    factor: float,
    highest: float,
    controller: str = "",
) -> tuple[tuple[str, str], ...]:
    """Return (name, value) texts of the state of a live simulation.

    `columns` are those of an episode log at this time, torques only with a controller.
    `pretension` is a factor on that of the scene, `factor` is simulated time over real
    time (NaN while unknown), and `highest` the tension of the brightest colour [N].
    """
    speed = "" if math.isnan(factor) else f", {factor:.2f} of real time"
    pace = ", paused" if knobs.paused else speed
    rows = [("time", f"{columns['time_s']:.1f} s{pace}")]
    laid = _factor_text(pretension)
    if knobs.pretension != pretension:
        laid += f"; {_factor_text(knobs.pretension)} at the next start"
    if controller:
        rows.append(("controller", controller))
    rows += [("friction", _factor_text(knobs.friction)), ("pretension", laid)]
    if controller:
        torque, desired = columns["joint_torque_nm"], columns["desired_torque_nm"]
        rows.append(("joint torque", f"{torque:.2f} of {desired:.2f} N m"))
    for cable in cables:
        near, far = (
            columns[f"tension_{cable}_{end}_n"] for end in ("proximal", "distal")
        )
        rows.append((cable, f"{near:.1f} N at the motor, {far:.1f} N at the joint"))
    return (*rows, ("brightest", f"{highest:g} N; grey is slack"))


def wrap_sentence(text: str) -> tuple[tuple[str, str], ...]:
    """Return a sentence as rows ("", line) of limited width; () if it is empty."""
    return tuple(("", line) for line in textwrap.wrap(text, 60))


def _factor_text(factor: float) -> str:
    return "as in the scene" if factor == 1.0 else f"{factor:.3g} times the scene's"


class RealTimePacer:
    """Waits so that simulated time does not run ahead of real time."""

    max_lead = 0.004  # simulated time ahead, so that sleeps are worth their while [s]
    max_lag = 0.1  # lag that is not made up for: then time slows down [s]
    window = 0.5  # time over which `factor` is taken [s]

    def __init__(
        self,
        now: Callable[[], float] = wall.perf_counter,
        sleep: Callable[[float], object] = wall.sleep,
    ) -> None:
        """Take a monotonic clock `now` [s] and the function that sleeps for [s]."""
        self._now, self._sleep = now, sleep
        self.factor = math.nan  # simulated over real time of late; NaN at first

    def begin(self, time: float) -> None:
        self._time = self._since = time
        self._wall_time = self._interval_start = self._now()

    def keep(self, time: float) -> None:
        """Wait until real time has reached the simulated `time` [s]."""
        now = self._now()
        ahead = (time - self._time) - (now - self._wall_time)
        if ahead > self.max_lead:
            self._sleep(ahead)
        elif ahead < -self.max_lag:
            self._time, self._wall_time = time, now
        now = self._now()
        if now - self._interval_start >= self.window:
            self.factor = (time - self._since) / (now - self._interval_start)
            self._since, self._interval_start = time, now
