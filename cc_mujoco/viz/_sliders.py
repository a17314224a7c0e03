"""Sliders in MuJoCo's viewer: actuators of the shown scene that exert no force.

    sliders = Sliders(knobs, MjSpec.from_file("scene.xml"))
    data = MjData(sliders.model)

The viewer has a slider for the control of every actuator of a visible group. The shown
scene is not simulated, so its controls can represent the knobs.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco.viz._live_controls import Knobs

HIDDEN_ACTUATOR_GROUP = 5
"""Group of the actuators that the scene itself has."""


class Sliders:
    """Knobs as the last controls of a model that is shown."""

    def __init__(self, knobs: Knobs, spec: mujoco.MjSpec, own: bool = False) -> None:
        """Add them to a scene with a joint; `own` keeps those of its actuators."""
        self.controls: NDArray[np.float64] | None = None
        """Positions of the sliders of the scene's own actuators, once seen."""
        self._knobs = knobs
        self._wanted: tuple[float, ...] | None = None
        self._seen = np.empty(0)
        for actuator in spec.actuators:
            if not own or actuator.plugin.active:
                actuator.group = HIDDEN_ACTUATOR_GROUP
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
        """The scene with a slider for each knob in place of its own."""

    def write(self, data: mujoco.MjData) -> None:
        """Put the sliders where keys have turned the knobs to."""
        wanted = self._knobs.slides
        if wanted != self._wanted:
            self._wanted, self._seen = wanted, np.array(wanted)
            data.ctrl[-self._seen.size :] = self._seen

    def read(self, data: mujoco.MjData) -> None:
        """Turn the knobs to where the sliders are, where those were moved."""
        now = np.array(data.ctrl[-self._seen.size :])
        self.controls = np.array(data.ctrl[: -self._seen.size])
        moved = np.flatnonzero(now != self._seen)
        for which in moved:
            self._knobs.slide(int(which), float(now[which]))
        if moved.size:
            # The sliders stay under the mouse, also between two controllers.
            self._seen, self._wanted = now, self._knobs.slides


def _free(name: str, taken: set[str]) -> str:
    """Return a name that no actuator of the scene has."""
    return _free(f"{name} of cables", taken) if name in taken else name
