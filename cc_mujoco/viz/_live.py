"""An episode in a window, in real time, with keys and sliders for its settings.

    live(env, "pi", seed=0)

It restarts when it ends, until the window is closed; nothing is written. The loop is
`simulation.run`, around a plant that keeps pace with real time and a controller that
can be exchanged.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco import control, plugin
from cc_mujoco.control import Controller
from cc_mujoco.control._registry import controller_errors
from cc_mujoco.device import Plant
from cc_mujoco.device._drive import Drive
from cc_mujoco.errors import CableError
from cc_mujoco.simulation._loop import Columns, Single, run
from cc_mujoco.viz import _live_controls as live_controls
from cc_mujoco.viz._viewer import MIN_FRAME_TIME, Frame, Screen, round_up_tension

if TYPE_CHECKING:
    import gymnasium


class Over(Exception):
    """Exception that ends the running episode, on a restart or a closed window."""


def live(
    env: "gymnasium.Env[Any, Any]",
    name: str,
    *,
    seed: int = 0,
    screen: Callable[..., Any] = Screen,
) -> None:
    """Play in a window until it is closed.

    `env` is an environment without random ranges, `name` the first controller, `seed`
    that of every reset and of the sensors' noise. `screen` is called as `Screen` is.
    """
    inner: Any = env.unwrapped
    law = Exchangeable(inner.drives, inner.exo.device.prefixes, name)
    cables = inner.exo.device.cables
    angles = all(drive.commands_angle for drive in inner.drives)
    laws = control.POSITION_CONTROLLERS if angles else control.CONTROLLERS
    knobs = live_controls.Knobs(cables, name, laws)
    highest = round_up_tension(max(cable.pretension for cable in cables.values()))
    model = inner.model
    sliders = live_controls.Sliders(knobs, inner.device.spec.copy())
    with screen(model, plugin.cables(model), highest, knobs.press, sliders) as window:
        show = Show(env, law, knobs, window, seed)
        while not show.ended:
            show.episode()


class Exchangeable(Controller):
    def __init__(
        self, drives: Sequence[Drive], prefixes: Sequence[str], name: str
    ) -> None:
        super().__init__(drives[0])
        self._drives, self._prefixes = drives, prefixes
        self.switch_controller(name)

    def switch_controller(self, name: str) -> None:
        """Reset and use another controller, or raise and keep the present one."""
        with controller_errors(name):
            law = control.axes_controller(name, self._drives, self._prefixes)
            law.reset()
        self._law, self.name = law, name

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        with controller_errors(self.name):
            self._law.reset(where)

    def torque(self, observation: Mapping[str, Any]) -> Any:
        with controller_errors(self.name):
            return self._law.torque(observation)


class Show:
    """A `DrivenDevice` that shows the environment in a window and reacts to keys."""

    def __init__(
        self,
        env: Any,
        law: Exchangeable,
        knobs: live_controls.Knobs,
        window: Any,
        seed: int,
    ) -> None:
        self._env, self._exo = env, env.unwrapped.exo
        self._law, self._knobs, self._window, self._seed = law, knobs, window, seed
        self.steps: int = self._exo.steps
        self.prefixes: tuple[str, ...] = self._exo.device.prefixes
        self._pace = live_controls.RealTimePacer()
        self._columns: Columns | None = None
        self._note = ""
        self._shown = -MIN_FRAME_TIME
        self._asked, self._friction, self._laid = law.name, 1.0, 1.0

    @property
    def ended(self) -> bool:
        return self._knobs.quit or not self._window.open

    def episode(self) -> None:
        exo = self._exo
        sensing = exo.description.sensing
        measuring = exo.controller_sensors(sensing, exo.drives, self._seed)
        try:
            run(self, self._law, self._observe, measure=measuring.measure)
        except Over:
            return
        except CableError as error:
            self._note = str(error)
            self._knobs.paused = True
            self._hold()

    def start(self) -> Columns:
        """Reset with the requested cable settings; return the columns at the start."""
        knobs = self._knobs
        knobs.restart = False
        self._friction, self._laid = knobs.friction, knobs.pretension
        self._single = Single(self._env, self._seed, knobs.options(self._laid))
        self._columns, self._note = self._single.start(), ""
        self._pace.begin(float(self._columns["time_s"]))
        return self._columns

    def advance(self, torque: NDArray[np.float64]) -> Columns:
        """React to keys, then advance a control step; see `DrivenDevice.advance`."""
        if self._knobs.paused:
            self._hold()
        if self._knobs.restart or self.ended:
            raise Over
        self._change()
        self._window.push(self._env.unwrapped.data)
        self._columns = self._single.advance(torque)
        self._pace.keep(float(self._columns["time_s"]))
        return self._columns

    def _change(self) -> None:
        knobs = self._knobs
        try:
            if knobs.controller != self._asked:
                self._asked = knobs.controller
                self._note = f"making controller {self._asked}"
                self._show()
                self._note = ""
                self._law.switch_controller(self._asked)
                self._continue_episode()
            if knobs.friction != self._friction:
                self._friction, exo = knobs.friction, self._exo
                options = knobs.options(self._laid)
                exo.device.apply_plant(Plant(exo.plants.nominal.device, options))
        except CableError as error:
            self._note = str(error)

    def _hold(self) -> None:
        knobs = self._knobs
        while knobs.paused and not self.ended:
            self._change()
            self._show()
            time.sleep(MIN_FRAME_TIME)
        self._continue_episode()

    def _continue_episode(self) -> None:
        if self._columns is not None:
            self._pace.begin(float(self._columns["time_s"]))

    def _observe(self, *_: object) -> None:
        if time.perf_counter() - self._shown >= MIN_FRAME_TIME:
            self._show()

    def _show(self) -> None:
        self._shown, columns = time.perf_counter(), self._columns
        if columns is None:
            return
        cables = tuple(self._exo.device.cables)
        how: Any = {"factor": self._pace.factor, "highest": self._window.highest}
        how |= {"pretension": self._laid, "controller": self._law.name}
        rows = live_controls.state_rows(self._knobs, columns, cables, **how)
        tensions = {cable: columns[f"tension_{cable}_nodes_n"] for cable in cables}
        texts = (*rows, *live_controls.wrap_sentence(self._note)), self._knobs.help
        self._window.show(Frame(columns["qpos"], tensions, texts))
