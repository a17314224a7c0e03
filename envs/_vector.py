"""Gymnasium vector environment of many devices, in MuJoCo or mujoco_warp."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
from gymnasium.utils import EzPickle, seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from cc_mujoco._utils.exclusive import exclusive
from cc_mujoco._validation import require_dictionary
from cc_mujoco.device import Device, find_device
from cc_mujoco.device._model import load
from cc_mujoco.errors import CableError, import_extra
from cc_mujoco.human import Trajectory, Wearer
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.simulation import _worn_device as worn_device
from cc_mujoco.simulation._batch import Simulations, Worlds
from cc_mujoco.simulation._episodes import REWARD, REWARD_TERMS, Episodes
from cc_mujoco.simulation._worn_device import DrivenEnvironment, TaskChoice

from ._info import LazyInfo
from ._registration import BACKENDS
from ._render import SceneRenderer, check_mode

Singles = NDArray[np.float32]

VECTOR_METADATA: dict[str, Any] = {
    "render_modes": ["rgb_array"], "autoreset_mode": AutoresetMode.NEXT_STEP,
}  # fmt: skip
"""Metadata by Gymnasium's names, before an environment is made."""


class DeviceVectorEnv(
    DrivenEnvironment, VectorEnv[Singles, NDArray[np.float32], NDArray[Any]], EzPickle
):
    """Many devices of one kind, stepped together by `mujoco.batch.Batch`.

    It equals, bit for bit and for any number of threads, a `SyncVectorEnv` of single
    environments with the same arguments: seeds count up from the first, and Gymnasium's
    `AutoresetMode` determines what happens after the end of an episode. By default the
    next step resets that environment and ignores its action (`NEXT_STEP`).

    With `backend="warp"` mujoco_warp takes the physics steps, in single precision.
    Plants, motions, sensors, rewards and infos are computed as without it.
    `WarpWorlds.data` and `WarpWorlds.cables` have the arrays on Warp's device.
    """

    metadata = VECTOR_METADATA

    def __init__(
        self,
        device: str | Path | Device,
        num_envs: int = 1,
        trajectory: str | Path | Trajectory | None = None,
        task: TaskChoice = None,
        duration: float = 10.0,
        frame_skip: int | None = None,
        wearer: Wearer | None = None,
        render_mode: str | None = None,
        max_episode_steps: int | None = None,
        threads: int = 0,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        hold: int = 1,
        history: int = 0,
        memory: bool = False,
        randomise: Mapping[str, Any] | None = None,
        smoothness: float = 0.0,
        backend: str = "mujoco",
        **unknown: Any,
    ) -> None:
        """Load the scene; arguments not listed are those of `DeviceEnv`.

        - `num_envs`: number of environments;
        - `render_mode`: without one visual elements, which take time, are left out of
          the model;
        - `max_episode_steps`: truncates episodes that are longer;
        - `threads`: threads that simulate; 0 means one per processor;
        - `autoreset_mode`: `NEXT_STEP`; `SAME_STEP`, where a step that ends an episode
          begins the next and `info` has `final_obs` and `final_info`; or `DISABLED`,
          where `reset(options={"reset_mask": over})` does;
        - `backend`: "mujoco", or "warp" on the device that Warp uses,
          `warp.set_device`; needs `pip install 'cc_mujoco[warp]'`.

        Raises:
            CableError: If an argument cannot be used.
        """
        worn_device.refuse_unknown(unknown, DeviceVectorEnv)
        given = trajectory, task, duration, frame_skip, wearer
        more = hold, history, memory, randomise, smoothness
        how = render_mode, max_episode_steps, threads, autoreset_mode
        EzPickle.__init__(self, device, num_envs, *given, *how, *more, backend)
        try:
            self.mode = AutoresetMode(autoreset_mode)
        except ValueError:
            names = ", ".join(mode.value for mode in AutoresetMode)
            raise CableError(
                f"autoreset_mode must be one of {names}, not {autoreset_mode!r}."
            ) from None
        least_values = [("num_envs", num_envs, 1), ("threads", threads, 0)]
        if max_episode_steps is not None:
            least_values.append(("max_episode_steps", max_episode_steps, 1))
        for name, value, least in least_values:
            if not (isinstance(value, int) and value >= least):
                raise CableError(
                    f"{name} must be an integer >= {least}, not {value!r}."
                )
        if backend not in BACKENDS:
            raise CableError.unknown("backend", str(backend), BACKENDS)
        if threads and backend != BACKENDS[0]:
            raise CableError(
                f"threads are of backend={BACKENDS[0]!r}; leave them out with "
                f"backend={backend!r}."
            )
        check_mode(render_mode, self.metadata)
        found = find_device(device)
        model = load(found, drawn=render_mode is not None)
        self.device: Device = found
        self.exo = exo = worn_device.WornDevice(found.description, model, *given, *more)
        rate = {"render_fps": round(1 / self.exo.period)}
        self.metadata = {**self.metadata, **rate, "autoreset_mode": self.mode}
        self.render_mode = render_mode
        self.num_envs = num_envs
        self.single_observation_space = self.exo.observation_space
        self.single_action_space = self.exo.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.model: mujoco.MjModel = self.exo.device.model
        self.simulations: Worlds
        if backend == BACKENDS[0]:
            self.simulations = Simulations(exo, num_envs, threads=threads)
        else:
            import_extra("mujoco_warp", 'backend="warp" needs mujoco_warp', "warp")
            from cc_mujoco.simulation._warp_worlds import WarpWorlds

            self.simulations = WarpWorlds(exo, num_envs, found)
        self._episodes = Episodes(exo, self.simulations, num_envs)
        self.plants = self._episodes.plants
        """Plant of the present episode of every environment."""
        self._last = exo.samples
        if max_episode_steps is not None:
            self._last = min(self._last, hold * max_episode_steps)
        self.episode_steps = self._last // hold
        """Steps of a complete episode."""
        self._random: list[np.random.Generator | None] = [None] * num_envs
        self._over = np.ones(num_envs, dtype=np.bool_)
        self._was_reset = False
        self._screen = SceneRenderer(self.model, render_mode, exo.sampling, num_envs)

    @exclusive
    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Singles, dict[str, Any]]:
        """Start an episode in every environment, or in those of a mask.

        Args:
            seed: Seed of the first environment, from which the others count up; or one
                for each.
            options: As in the single environment, for all that start. May have a
                `reset_mask` (num_envs,) of bool; `info` then describes these
                environments only.

        Raises:
            CableError: If an option is unknown or impossible, or the mask is invalid.
        """
        self.exo.require_timestep()
        options = dict(require_dictionary("options", options))
        masked = self._mask(options.pop("reset_mask", None))
        seeds: Sequence[int | None] = [None] * self.num_envs
        if isinstance(seed, (Sequence, np.ndarray)):
            seeds = seed
        elif seed is not None:
            seeds = [seed + row for row in range(self.num_envs)]
        if len(seeds) != self.num_envs:
            raise CableError(
                f"seed must have one entry for each of the {self.num_envs} "
                f"environments, not {len(seeds)}."
            )
        for row, own in enumerate(seeds):
            if own is not None and masked[row]:
                self._random[row], _ = seeding.np_random(own)
        self._begin(np.flatnonzero(masked), options)
        self._over[masked] = False
        self._was_reset = True
        terms = np.zeros((len(REWARD_TERMS) + 1, self.num_envs))
        return self._episodes.observation(), self._info(terms, masked.copy())

    def _mask(self, given: Any) -> NDArray[np.bool_]:
        if given is None:
            return np.ones(self.num_envs, dtype=np.bool_)
        mask = np.asarray(given)
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise CableError(
                f"options['reset_mask'] must be {self.num_envs} of bool, one of them "
                f"True, not {given!r}."
            )
        if not (self._was_reset or mask.all()):
            raise CableError(
                "options['reset_mask'] leaves out environments that were never reset."
            )
        return mask

    @exclusive
    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[Singles, Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Advance every environment one control step, or reset it if it has ended.

        Raises:
            CableError: If the actions are not of shape (num_envs, axes), or those of an
                environment that is not reset are not finite.
            gymnasium.error.ResetNeeded: Before the first reset, and after the end of an
                episode with `autoreset_mode="Disabled"`.
        """
        if not self._was_reset:
            raise gymnasium.error.ResetNeeded("call reset() before the first step().")
        if self.mode is AutoresetMode.DISABLED and self._over.any():
            rows = ", ".join(map(str, np.flatnonzero(self._over)))
            raise gymnasium.error.ResetNeeded(
                f"environments {rows} are over: reset(options={{'reset_mask': ...}})."
            )
        fresh = self._over
        going = ~fresh if b"\1" in fresh.tobytes() else None
        terms = self._episodes.step(actions, going)
        if going is not None:
            self._begin(np.flatnonzero(fresh), None)
            terms[:, fresh] = 0.0
        observation = self._episodes.observation()
        terminated = self.simulations.warned
        truncated = self._episodes.samples >= self._last
        self._over = terminated | truncated
        reward = terms[REWARD]
        if not (self.mode is AutoresetMode.SAME_STEP and self._over.any()):
            return observation, reward, terminated, truncated, self._info(terms)
        over, self._over = self._over, np.zeros_like(self._over)
        reward = reward.copy()
        final = self._final_info(observation, terms, over)
        self._begin(np.flatnonzero(over), None)
        terms[:, over] = 0.0
        info = self._info(terms)
        info.update(final)
        return self._episodes.observation(), reward, terminated, truncated, info

    def _final_info(
        self, observation: Singles, terms: Array, over: NDArray[np.bool_]
    ) -> dict[str, Any]:
        last = np.full(self.num_envs, None, dtype=object)
        for row in np.flatnonzero(over):
            last[row] = observation[row].copy()
        found = {"final_obs": last, "final_info": self._info(terms.copy(), over)}
        return found | {f"_{name}": over.copy() for name in found}

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return an image of each device, (height, width, 3), in mode `rgb_array`.

        They are drawn 30 times per simulated second; in between the last are returned.
        """
        poses = self.simulations.physics.qpos
        return self._screen.render(poses, self._episodes.samples)

    def close_extras(self, **kwargs: Any) -> None:
        """Free the renderer."""
        self._screen.close()

    def _begin(self, rows: NDArray[np.intp], options: Mapping[str, Any] | None) -> None:
        random = [self._random[row] or seeding.np_random()[0] for row in rows]
        for row, rng in zip(rows, random, strict=True):
            self._random[row] = rng
            self._screen.films[row].cut()
        self._episodes.begin(rows.tolist(), random, options)

    def _info(
        self, terms: Array, described: NDArray[np.bool_] | None = None
    ) -> LazyInfo:
        """Return an `info` of the masked environments, with reward terms (4, n)."""
        return LazyInfo(self._columns, self._episodes.snapshot(), terms, described)

    def _columns(
        self, snapshot: Any, terms: Array, described: NDArray[np.bool_] | None
    ) -> dict[str, Any]:
        columns = self._episodes.columns(snapshot)
        columns |= dict(zip(REWARD_TERMS, terms, strict=False))
        masks = np.ones((len(columns), self.num_envs), dtype=np.bool_)
        if described is not None:
            masks &= described
        info: dict[str, Any] = {}
        numbers = np.empty((len(columns), self.num_envs))
        each = zip(columns.items(), masks, numbers, strict=True)
        for (name, value), mask, row in each:
            if value.ndim == 1:
                row[:] = value
                value = row
            if described is not None:
                value[~described] = 0
            info[name], info[f"_{name}"] = value, mask
        return info
