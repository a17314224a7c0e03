"""Gymnasium environment of one device."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import gymnasium
import mujoco
import numpy as np
from gymnasium.utils import EzPickle
from numpy.typing import NDArray

from cc_mujoco._utils.exclusive import exclusive
from cc_mujoco.device import Device, Plant, find_device
from cc_mujoco.device._model import load
from cc_mujoco.errors import CableError
from cc_mujoco.human import Trajectory, Wearer
from cc_mujoco.simulation import _worn_device as worn_device
from cc_mujoco.simulation._batch import Simulation
from cc_mujoco.simulation._episodes import REWARD, REWARD_TERMS, Episodes
from cc_mujoco.simulation._worn_device import DrivenEnvironment, TaskChoice

from ._info import LazyInfo
from ._render import RENDER_METADATA, SceneRenderer, check_mode, metadata_of


class DeviceEnv(
    DrivenEnvironment, gymnasium.Env[NDArray[np.float32], NDArray[np.float32]], EzPickle
):
    r"""A device that is driven by cables, worn by a person who moves.

    `device` is the name of a built-in device, an MJCF file, the TOML file of a
    description or a `Device`. Ids of built-in devices, such as
    `cc_mujoco/WristHandle-v1`, are this class with a device; `cc_mujoco/Device-v1`
    needs one.

    ## Action space

    `Box(-1, 1, (axes,), float32)`: torque of every motor as a share of its largest.
    Positive winds a cable that only pulls. Values outside are clipped.
    `unwrapped.action(torque)` makes the action of torques in N m.

    ## Observation space

    `Box(-10, 10, (size,), float32)`: scaled numbers of about 1, axis by axis. First
    comes a frame of the measurements of an axis:

    | | observation | divided by |
    |-|-------------|-------------|
    | 0 | twist: angle of the motor / ratio - angle of the joint | device |
    | 1 | velocity of the motor / ratio | device |
    | 2 | angle of the joint | device |
    | 3 | velocity of the joint | device |
    | 4 | desired torque - measured torque of the cables | device |
    | 5 | desired torque | device |
    | 6, 7 | sine and cosine of the phase of the gait, where the device knows it | 1 |

    The ratio is that of motor angle to joint angle, `Drive.ratio`; "device" is a scale
    that the device sets. Friction depends on the past, which is not in a frame. With
    `memory=True` six numbers follow in [-1, 1], the plays of
    `cc_mujoco.device._observation.Observed.memory`; with `history=n` the last n frames,
    each followed by the action that was taken on it, newest first. Frames before an
    episode are its first, with actions of 0.

    ## Reward

    `reward = reward_tracking + reward_effort + reward_smoothness`, all in `info`, at
    most 0, the means over the axes. Per second, whatever the control period:

    - `reward_tracking` is \(-\min(|\tau_j - \tau_d| / \tau_1, 10)\) with the torque of
      the cables on the joint \(\tau_j\), the desired torque \(\tau_d\) and the error
      \(\tau_1\) that costs 1 per second, which the device sets;
    - `reward_effort` is \(-0.05\,a^2\) with the clipped action \(a\);
    - `reward_smoothness` is \(-s\,\sum|a_k - a_{k-1}|\) over the control steps of
      that second, with the argument `smoothness` for \(s\), 0 by default, and
      \(a_{-1} = 0\): the total variation of the action, which is large if it
      chatters and small if it follows a motion.

    By default an episode of T seconds has a return between -10.05 T and 0. The
    controller `none`, which ignores friction, has -0.4 T to -3 T on the built-in
    devices.

    ## Info

    After every reset and step a fresh dictionary, filled when it is first read. It has
    the columns of an episode log (`cc_mujoco.simulation._log_columns`; those of an axis
    begin with its name if there are several): time, angles, velocities, torques, the
    wearer's reference; for each cable the true tensions at both ends and at the nodes,
    the part that slips and the direction of slip of every segment, slack, dissipated
    energy; and `qpos`. Angles and velocities are those at that time, torques and
    tensions those that acted in the physics step before it.

    ## Start and end

    An episode starts at rest at the first pose of the trajectory, all cables at
    pretension. Plant, noise and trajectory are drawn from `np_random`, so that a seed
    determines an episode. It is truncated after `duration`, and terminated
    only if MuJoCo warns that the simulation has become unstable. Actions of another
    shape or not finite are a `CableError`.

    ## Randomisation

    `randomise={"friction": (0.05, 0.2), "wrap": (5, 9), "delay": (0, 3)}` draws a plant
    for every episode; `reset(options={"friction": 0.1, "flexor.wrap": 7})` sets values
    of this episode instead of drawing them. Names are

    - `wearer`: impedance, as a multiple of the scene's or that of `wearer`;
    - `delay`: samples by which observations are late (whole, 0 to 1000);
    - `noise`: of the observed torque, as a multiple of the device's sensor noise; a
      bias, of twice that standard deviation, is drawn with it;
    - a number of a cable as in MJCF (`friction`, `static_friction`, `pretension`, ...),
      `break_away`, static over kinetic friction, or `wrap`, the bend of its whole
      conduit [rad]; of all cables, or of one by `CABLE.NAME`. Every cable draws its
      own. Bends of a route or path that moves with the body follow from the scene.

    Numbers above 0 are drawn with a uniform logarithm, others uniformly. A third number
    is a probability: `"bristle_length": (1e-3, 1e-2, 0.3)` gives all cables presliding
    in 30 % of the episodes, and the scene's value in the others. `drive` describes the
    scene and `info` the true state, both without delay and noise; `plant` has the drawn
    values.

    ## Arguments

    | argument | default | meaning |
    |----------|---------|---------|
    | `device` | id | name, file or `Device` |
    | `trajectory` | device | the wearer's motion: a name, CSV file or `Trajectory` |
    | `task` | device | torque to be rendered: a name, a `Task`, or by axis |
    | `duration` | 10 | length of an episode [s] |
    | `frame_skip` | device | physics steps from sample to sample, by default 1 kHz |
    | `wearer` | `None` | a `Wearer`; by default that of the scene |
    | `render_mode` | `None` | `"rgb_array"`, or `"human"`: a window in real time |
    | `model` | `None` | a variant of the scene, compiled |
    | `hold` | 1 | samples in a control step, for which an action is held |
    | `history` | 0 | earlier frames and actions in an observation |
    | `memory` | `False` | whether plays are observed |
    | `randomise` | `None` | ranges of values that are drawn for each episode |
    | `smoothness` | 0 | reward lost by a change of the action by 1 |

    Names are those of `cc_mujoco.human`: `TRAJECTORIES`, scaled down to the range of
    the device, and `TASKS`. The wearer's command changes with
    every physics step.
    """

    metadata = RENDER_METADATA

    def __init__(
        self,
        device: str | Path | Device,
        trajectory: str | Path | Trajectory | None = None,
        task: TaskChoice = None,
        duration: float = 10.0,
        frame_skip: int | None = None,
        wearer: Wearer | None = None,
        render_mode: str | None = None,
        model: mujoco.MjModel | None = None,
        hold: int = 1,
        history: int = 0,
        memory: bool = False,
        randomise: Mapping[str, Any] | None = None,
        smoothness: float = 0.0,
        **unknown: Any,
    ) -> None:
        """Load the scene; see the class for the arguments."""
        worn_device.refuse_unknown(unknown, DeviceEnv)
        given = trajectory, task, duration, frame_skip, wearer
        more = hold, history, memory, randomise, smoothness
        EzPickle.__init__(self, device, *given, render_mode, model, *more)
        check_mode(render_mode, self.metadata)
        found = find_device(device)
        model = load(found) if model is None else copy.copy(model)
        self.device: Device = found
        self.exo = worn_device.WornDevice(found.description, model, *given, *more)
        self.metadata = metadata_of(round(1 / self.exo.period))
        self.render_mode = render_mode
        self.observation_space: Any = self.exo.observation_space
        self.action_space = self.exo.action_space
        self.model: mujoco.MjModel = self.exo.device.model
        simulation = Simulation(self.exo.device)
        self.data: mujoco.MjData = simulation.data
        self._episodes = Episodes(self.exo, simulation, 1, is_vector=False)
        self._screen = SceneRenderer(self.model, render_mode, self.exo.sampling)

    @property
    def plant(self) -> Plant:
        """Plant of this episode, with the values drawn for it."""
        return self._episodes.plants[0]

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        """Return a copy at the same step of the same episode.

        Raises:
            CableError: If `model` has been written to since it was loaded.
        """
        make: Any = type(self)
        twin: Self = make(*self._ezpickle_args, **self._ezpickle_kwargs)
        if not _models_equal(twin.model, self.model):
            twin.exo.device.apply_plant(self.plant)
        if not _models_equal(twin.model, self.model):
            raise CableError(
                "an environment whose `model` was written to cannot be copied; give "
                "the changed model as the argument `model`."
            )
        mujoco.mj_copyData(twin.data, twin.model, self.data)
        twin._episodes.take(self._episodes)
        twin.spec = self.spec
        twin._screen.films = [copy.copy(self._screen.films[0])]
        twin._np_random = copy.deepcopy(self._np_random, memo)
        twin._np_random_seed = self._np_random_seed
        return twin

    def beyond(self) -> str:
        """Return a sentence if the task exceeds the motor; see `WornDevice.beyond`."""
        script = self._episodes.wiring.scripts[0]
        if script is None:
            raise gymnasium.error.ResetNeeded("call reset() before beyond().")
        return self.exo.beyond(script)

    @exclusive
    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode.

        Args:
            seed: Seed of all random numbers from now on.
            options: Values of the plant, by name; see the class.

        Raises:
            CableError: If an option is unknown or impossible, or the time step of the
                model was changed.
        """
        super().reset(seed=seed)
        self.exo.require_timestep()
        self._screen.films[0].cut()
        self._episodes.begin([0], [self.np_random], options)
        self._screen.follow(self.data)
        return self._episodes.observation()[0], self._info([0.0, 0.0, 0.0])

    @exclusive
    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Advance one control step with an action; see the class.

        Raises:
            CableError: If the action is not of shape (axes,) and finite.
            gymnasium.error.ResetNeeded: Before the first reset, and after the end.
        """
        episodes, last = self._episodes, self.exo.samples
        if episodes.wiring.scripts[0] is None:
            raise gymnasium.error.ResetNeeded("call reset() before the first step().")
        if episodes.samples[0] >= last:
            raise gymnasium.error.ResetNeeded("the episode is over; call reset().")
        terms = episodes.step(action)[:, 0].tolist()
        self._screen.follow(self.data)
        failed, over = episodes.worlds.warned[0], episodes.samples[0] >= last
        ends = bool(failed), bool(over)
        return episodes.observation()[0], terms[REWARD], *ends, self._info(terms)

    def _info(self, terms: list[float]) -> LazyInfo:
        return LazyInfo(self._columns, self._episodes.snapshot(), terms)

    def _columns(self, snapshot: Any, terms: list[float]) -> dict[str, Any]:
        return {
            name: value[0] if value.ndim > 1 else float(value[0])
            for name, value in self._episodes.columns(snapshot).items()
        } | dict(zip(REWARD_TERMS, terms, strict=False))

    def render(self) -> NDArray[np.uint8] | None:
        """Return an image of the device, (height, width, 3), in mode `rgb_array`.

        It is drawn 30 times per simulated second; in between the last is returned. In
        mode `human` the window shows every reset and step, and this returns None.
        """
        drawn = self._screen.render([self.data.qpos], self._episodes.samples)
        return None if drawn is None else drawn[0]

    def close(self) -> None:
        """Free the renderer, and close the window."""
        self._screen.close()


def _models_equal(one: mujoco.MjModel, other: mujoco.MjModel) -> bool:
    if (size := mujoco.mj_sizeModel(one)) != mujoco.mj_sizeModel(other):
        return False
    found = np.zeros((2, size), np.uint8)
    for model, buffer in zip((one, other), found, strict=True):
        mujoco.mj_saveModel(model, buffer=buffer)
    return np.array_equal(*found)
