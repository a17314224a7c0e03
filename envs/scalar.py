"""One device as a Gymnasium environment."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import mujoco
import numpy as np
from gymnasium.utils import EzPickle
from numpy.typing import NDArray

from cc_mujoco.control import Drive
from cc_mujoco.devices import Setup
from cc_mujoco.human import Task, Trajectory, Wearer

from .device import Array, physics_of
from .exo import REWARDS, Exo, check_options
from .picture import Camera, Film, check_mode
from .script import Script


class ExoEnv(gymnasium.Env[Array, NDArray[np.float32]], EzPickle):
    r"""Base of the environments of one device; subclasses say which and document it.

    ## Reward

    `reward = reward_tracking + reward_effort`, both in `info`, at most 0:

    - `reward_tracking` = \(-((\tau_j - \tau_d) / \tau_1)^2\) with the torque of the
      cables on the joint \(\tau_j\), the desired torque \(\tau_d\) and the error that
      costs 1, \(\tau_1\), which the device sets;
    - `reward_effort` = \(-0.001\,a^2\) with the clipped action \(a\).

    ## Info

    After every reset and step a fresh dictionary with the columns of an episode log
    (`cc_mujoco.recording.columns`): time, angles, velocities, torques, the wearer's
    reference; for each cable the true tensions at both ends and at the nodes, the part
    that slips and the direction of slip of every segment, slack, dissipated energy; and
    `qpos`. Angles and velocities are those at that time, torques and tensions those
    that acted in the physics step before it (0.5 ms).

    ## Start and end

    An episode starts at rest at the first pose of the trajectory, all cables at
    pretension. Random trajectories are drawn from `np_random`, so a seed determines an
    episode. It is truncated after `duration`, and terminated only if MuJoCo warns that
    the simulation has become unstable. Actions of another shape or not finite are a
    `CableError`.

    ## Arguments

    | argument | default | meaning |
    |----------|---------|---------|
    | `trajectory` | device | the wearer's motion: a name, CSV file or `Trajectory` |
    | `task` | device | what the wearer should feel: a name or a `Task` |
    | `duration` | 10 | length of an episode [s] |
    | `frame_skip` | 2 | physics steps of 0.5 ms in a control step: control at 1 kHz |
    | `wearer` | `None` | a `Wearer`; by default that of the scene |
    | `render_mode` | `None` | `None` or `"rgb_array"` |
    | `model` | `None` | a variant of the scene, compiled |

    Names are those of `cc_mujoco.human`: `TRAJECTORIES`, scaled down where they go
    further than the device lets them, and `TASKS`. The wearer's command changes with
    every physics step.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"]}  # noqa: RUF012
    SETUP: ClassVar[Setup]

    def __init__(
        self,
        trajectory: str | Path | Trajectory | None = None,
        task: str | Task | None = None,
        duration: float = 10.0,
        frame_skip: int = 2,
        wearer: Wearer | None = None,
        render_mode: str | None = None,
        model: mujoco.MjModel | None = None,
    ) -> None:
        """Load the scene; arguments as the subclasses document them."""
        EzPickle.__init__(
            self, trajectory, task, duration, frame_skip, wearer, render_mode, model
        )
        check_mode(render_mode, self.metadata["render_modes"])
        self.exo = Exo(
            self.SETUP, trajectory, task, duration, frame_skip, wearer, model
        )
        self.metadata = {**self.metadata, "render_fps": round(1 / self.exo.period)}
        self.render_mode = render_mode
        self.observation_space = self.exo.observation_space
        self.action_space = self.exo.action_space
        self.model: mujoco.MjModel = self.exo.device.model
        self.data = mujoco.MjData(self.model)
        self._physics = physics_of(self.data)
        self._step = 0
        self._script: Script | None = None
        self._camera: Camera | None = None
        self._film = Film(self.exo.period)

    @property
    def drive(self) -> Drive:
        """What a controller may know of the device."""
        return self.exo.drive

    def action(self, torque: float) -> NDArray[np.float32]:
        """The action that makes the motor give a torque [Nm]."""
        return self.exo.action(torque)

    def beyond(self) -> str:
        """What the task asks for beyond the motor in this episode; see `Exo.beyond`."""
        if self._script is None:
            raise gymnasium.error.ResetNeeded("call reset() before beyond().")
        return self.exo.beyond(self._script.marks)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Start an episode.

        Raises:
            CableError: If there are `options`; there are none.
        """
        check_options(options)
        super().reset(seed=seed)
        self._script = self.exo.author.write(self.np_random)
        self._step = 0
        self._film.cut()
        commands = self._script.commands[0]
        self.exo.device.start(self.data, self._script.angles, commands)
        observation, columns = self.exo.sample(self._physics, 0, self._script.marks[0])
        return observation, _numbers(columns, (0.0, 0.0))

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Advance one control step with a motor torque.

        Raises:
            CableError: If the action is not of shape (1,) and finite.
        """
        exo, script, data = self.exo, self._script, self.data
        if script is None:
            raise gymnasium.error.ResetNeeded("call reset() before the first step().")
        normalised = exo.normalised(action)
        data.ctrl[exo.device.motor_control] = normalised * exo.device.motor_scale
        first = self._step * exo.frame_skip
        for command in script.commands[first : first + exo.frame_skip]:
            data.ctrl[exo.device.script_controls] = command
            mujoco.mj_step(self.model, data)
            diverged = bool(data.warning.number.any())
            if diverged:
                break
        self._step += 1
        observation, columns = exo.sample(
            self._physics, self._step, script.marks[self._step]
        )
        terms = exo.rewards(columns, normalised)
        return (
            observation,
            float(terms[0] + terms[1]),
            diverged,
            self._step >= exo.steps,
            _numbers(columns, terms),
        )

    def render(self) -> NDArray[np.uint8] | None:
        """Picture of the device, (height, width, 3), in mode `rgb_array`.

        Drawn 30 times per simulated second; in between it is the last one again.
        """
        if self.render_mode is None:
            gymnasium.logger.warn("render() needs render_mode='rgb_array' at make().")
            return None
        if self._camera is None:
            self._camera = Camera(self.model)
        return self._film.picture(self._camera, self.data.qpos, self._step)

    def close(self) -> None:
        """Free the renderer."""
        if self._camera is not None:
            self._camera.close()
            self._camera = None


def _numbers(columns: dict[str, Any], terms: tuple[Any, Any]) -> dict[str, Any]:
    """A fresh `info`: floats, and arrays that nobody else holds."""
    columns |= zip(REWARDS, terms, strict=True)
    return {
        name: value if isinstance(value, np.ndarray) and value.ndim else float(value)
        for name, value in columns.items()
    }
