"""Episodes of n devices driven by actions, the basis of all environments.

    episodes = Episodes(exo, worlds, count)
    episodes.begin([0, 1], generators, options)
    terms = episodes.step(actions, going)              # (4, n), see `REWARD_TERMS`
    episodes.observation()                             # (n, size)

A single environment has n = 1, a vector environment any n.
"""

import copy
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.device import Plant
from cc_mujoco.device import _observation as observation
from cc_mujoco.device._observation import ObservationHistory, Past
from cc_mujoco.device._sensors import BIAS, REFERENCE_COLUMN
from cc_mujoco.errors import CableError
from cc_mujoco.native import (
    BoolArray,
    FloatArray,
    FloatCube,
    FloatMatrix,
    IntArray,
    compiled,
)
from cc_mujoco.simulation._batch import Worlds
from cc_mujoco.simulation._wiring import Wiring
from cc_mujoco.simulation._worn_device import WornDevice

Mask = NDArray[np.bool_]

REWARD_TERMS = ("reward_tracking", "reward_effort", "reward_smoothness")
"""Keys of the terms of the reward in `info`."""

_TRACKING, _EFFORT, _SMOOTHNESS, REWARD = range(4)
"""Places of the terms of a reward, and of their sum."""


class AxisSensors(NamedTuple):
    """Sensors of an axis in n environments, and the cost of its tracking error."""

    places: IntArray  # rows of the table that are measured (k,)
    actual: int  # row of the table that should be as `wanted`
    wanted: int
    scale: float  # error that costs 1 per second
    delays: IntArray  # samples by which measurements are late (n,)
    late: FloatCube  # past measurements (n, delay + 1, k), each at sample % (delay + 1)
    errors: FloatMatrix  # of the torque sensor (n, samples), or (n, 0) for none [N m]


class Episodes:
    """Episodes of n devices of equal layout, each started and driven independently."""

    def __init__(
        self, exo: WornDevice, worlds: Worlds, count: int, is_vector: bool = True
    ) -> None:
        """Prepare `count` rows; call `begin` for each before it is stepped.

        Actions are (n, axes) for a vector, and (axes,) for a single environment.
        """
        self.exo, self.worlds = exo, worlds
        nominal = exo.plants.nominal
        self.plants: list[Plant] = [nominal] * count
        """Plant that every device is played on."""
        self._current_plant = nominal
        self.samples = np.zeros(count, np.int64)
        """Samples since the start of each episode (n,)."""
        self.wiring = Wiring(exo, [exo.device], count)
        self._histories = [ObservationHistory(one, count) for one in exo.observed]
        self._sensors = [self._sensors_of(n) for n in range(len(exo.observed))]
        self._has_history = exo.observed[0].history > 0
        self._actions = np.zeros((count, len(exo.observed)))
        self._costs = np.zeros(count)
        self._action_shape = self._actions.shape[0 if is_vector else 1 :]
        self._effort = -0.05 * exo.period  # reward lost by full motor torque
        self._observed = np.zeros((count, sum(one.size for one in self._histories)))
        self._all, self._none = np.ones(count, np.bool_), np.zeros(count, np.bool_)
        self._table = np.zeros((0, 0))

    def _sensors_of(self, n: int) -> AxisSensors:
        exo, count = self.exo, len(self.samples)
        prefix, axis = exo.device.prefixes[n], exo.description.axes[n]
        place = {name: row for row, name in enumerate(self.wiring.names)}
        actual, wanted = "joint_torque_nm", "desired_torque_nm"
        scale = axis.torque_scale
        if exo.tasks[n].commands_angle:
            actual, wanted = "joint_angle_rad", REFERENCE_COLUMN
            scale = axis.units["motor_angle_rad"]
        names = exo.observed[n].columns
        measured = np.array([place[prefix + name] for name in names])
        error = place[prefix + actual], place[prefix + wanted], scale
        late = np.zeros(count, np.int64), np.zeros((count, 1, len(names)))
        return AxisSensors(measured, *error, *late, np.zeros((count, 0)))

    def begin(
        self,
        rows: Sequence[int],
        random: Sequence[np.random.Generator],
        options: Mapping[str, Any] | None,
    ) -> None:
        """Begin an episode in some rows, each with its own random generator.

        `options` are parameters of their plants by name; raises `CableError` for
        impossible ones.
        """
        exo, worlds = self.exo, self.worlds
        worlds.clear(np.array(rows, np.intp))
        fresh = self._none.copy()
        for row, rng in zip(rows, random, strict=True):
            plant = exo.plants.draw(rng, options)
            if plant is not self._current_plant:
                exo.device.apply_plant(plant)
                self._current_plant = plant
            nominal = exo.plants.nominal
            if plant is not nominal or self.plants[row] is not nominal:
                worlds.vary(row, plant)
            self.plants[row] = plant
            script = exo.author.write(rng)
            self._begin_sensors(row, rng)
            worlds.start(row, exo.device, script)
            self.wiring.seat(row, script)
            fresh[row] = True
        self.samples[fresh] = 0
        self._actions[fresh] = 0.0
        self._look(self._none, fresh, np.zeros((4, len(fresh))))

    def _begin_sensors(self, row: int, rng: np.random.Generator) -> None:
        """Reset the sensors of a row; sample their delay and torque noise."""
        exo, values = self.exo, self.plants[row].values
        noise = float(values.get("noise", 0.0))
        delay = int(values.get("delay", 0))
        for n, sensors in enumerate(self._sensors):
            if noise and not sensors.errors.size:
                errors = np.zeros((len(self.samples), exo.samples + 1))
                sensors = sensors._replace(errors=errors)
            if delay >= sensors.late.shape[1]:
                more = ((0, 0), (0, delay + 1 - sensors.late.shape[1]), (0, 0))
                sensors = sensors._replace(late=np.pad(sensors.late, more))
            if sensors.errors.size:
                sensors.errors[row] = 0.0
            if noise:
                scale = noise * exo.description.sensing.torque_noise
                bias = BIAS * rng.normal()
                drawn = rng.normal(size=exo.samples + 1)
                sensors.errors[row] = scale * (bias + drawn)
            sensors.delays[row] = delay
            self._sensors[n] = sensors

    def step(self, action: Any, going: Mask | None = None) -> NDArray[np.float64]:
        """Advance the rows `going` (n,) by a control step; return the rewards (4, n).

        Actions (n, axes), or (axes,) for a single environment, are fractions of each
        motor's largest torque, clipped to [-1, 1]. The result has the `REWARD_TERMS`
        and their sum. Raises `CableError` for actions of wrong shape or not finite.
        """
        exo, worlds = self.exo, self.worlds
        going = self._all if going is None else going
        terms = np.zeros((4, len(going)))
        actions = self._numbers(action)
        costs = self._effort, -exo.smoothness
        if not _charge(actions, self._actions, going, *costs, terms):
            wrong = actions[~np.isfinite(actions) & going[:, None]]
            raise CableError(f"an action must be a finite number, not {wrong[0]}.")
        if self._has_history:
            for n, history in enumerate(self._histories):
                history.act(actions[:, n])
        for sample in range(exo.hold):
            if sample and (warned := worlds.warned).any():
                going = going & ~warned  # diverged simulations take no further sample
            if going is not self._all and not going.any():
                break
            control = self.wiring.controls(actions, self.samples, going)
            worlds.advance(control, going)
            self._look(going, self._none, terms)
        return terms

    def _numbers(self, action: Any) -> NDArray[np.float64]:
        """Return the actions as a new array of numbers (n, axes)."""
        shape = self._action_shape
        try:
            given = np.asarray(action)
        except ValueError:  # rows of unequal lengths
            raise CableError(f"an action must be an array of shape {shape}.") from None
        if given.shape != shape:
            raise CableError(
                f"an action must be of shape {shape}, a share of each motor's torque "
                f"for each environment, not of shape {given.shape}."
            )
        if given.dtype.kind not in "fiu":
            raise CableError(f"an action must be of numbers, not of {given.dtype}.")
        numbers = np.empty(self._actions.shape)
        numbers[...] = given
        return numbers

    def _look(self, going: Mask, fresh: Mask, terms: NDArray[np.float64]) -> None:
        """Sample the sensors of rows `going` or `fresh`; add the tracking reward."""
        self._table = table = self.wiring.read(self.worlds.physics, self.samples)
        first, sampling = 0, self.exo.sampling
        axes = zip(self._sensors, self._histories, strict=True)
        for n, (sensors, history) in enumerate(axes):
            _sense(
                sensors, history.past, table, self.samples, going, fresh, n,
                self._costs, len(self._sensors), sampling, terms, self._observed, first,
            )  # fmt: skip
            first += history.size

    def observation(self) -> NDArray[np.float32]:
        return self._observed.astype(np.float32)

    def snapshot(self) -> tuple[NDArray[Any], ...]:
        physics = self.worlds.physics
        return self._table, physics.qpos.copy(), physics.plugin_state.copy()

    def columns(self, snapshot: Sequence[NDArray[Any]]) -> dict[str, Any]:
        """Return all columns of an episode log, (n, ...), from a `snapshot`."""
        table, qpos, state = snapshot
        return self.wiring.columns(table) | self.exo.device.read_cables(qpos, state)

    def take(self, other: "Episodes") -> None:
        """Continue the episodes of another object, whose state `worlds` already has."""
        self.plants, self._current_plant = list(other.plants), other._current_plant
        self.samples[:], self._actions[:] = other.samples, other._actions
        self._observed[:] = other._observed
        self.wiring.take(other.wiring)
        self._table = other._table
        self._sensors = copy.deepcopy(other._sensors)
        for history, one in zip(self._histories, other._histories, strict=True):
            history.take(one)


@compiled
def _charge(
    actions: FloatMatrix,
    before: FloatMatrix,
    going: BoolArray,
    effort: float,
    smoothness: float,
    terms: FloatMatrix,
) -> bool:
    """Clip actions to [-1, 1], zero where not `going`, and write their reward terms.

    `effort` and `smoothness` are the rewards of full torque and of a change by 1;
    actions are copied to `before`. If a going row's action is not finite, return False
    unchanged.
    """
    axes = actions.shape[1]
    for row in range(actions.shape[0]):
        for n in range(axes):
            if going[row] and not np.isfinite(actions[row, n]):
                return False
    for row in range(actions.shape[0]):
        used, changed = 0.0, 0.0
        for n in range(axes):
            share = min(max(actions[row, n], -1.0), 1.0) if going[row] else 0.0
            used += effort * share * share
            changed += smoothness * abs(share - before[row, n])
            actions[row, n], before[row, n] = share, share
        terms[_EFFORT, row] = used / axes
        terms[_SMOOTHNESS, row] = changed / axes
    return True


@compiled
def _sense(
    sensors: AxisSensors,
    past: Past,
    table: FloatMatrix,
    samples: IntArray,
    going: BoolArray,
    fresh: BoolArray,
    n: int,
    costs: FloatArray,
    axes: int,
    sampling: float,
    terms: FloatMatrix,
    observed: FloatMatrix,
    first: int,
) -> None:
    """Sample the sensors of axis `n`, in rows that are `going` or `fresh` (just begun).

    `costs` (rows,) accumulates tracking costs of the axes per second. The observation
    of the axis is written to `observed` from column `first` on.
    """
    last = sensors.errors.shape[1] - 1
    for row in range(samples.size):
        if not (going[row] or fresh[row]):
            continue
        step, ring = samples[row], sensors.delays[row] + 1
        for i in range(sensors.places.size):
            value = table[sensors.places[i], row]
            if i == observation.JOINT_TORQUE and last >= 0:
                value = value + sensors.errors[row, min(step, last)]
            if ring > 1:
                # Before the first measurement arrives there is the one at rest.
                for age in range(ring if fresh[row] else 1):
                    sensors.late[row, (step + age) % ring, i] = value
                value = sensors.late[row, (step + 1) % ring, i]
            past.measured[row, i] = value
        if fresh[row]:
            observation.begin_past(past, row)
            observation.write_row(past, row, observed, first)
            continue
        observation.follow_past(past, row)
        observation.write_row(past, row, observed, first)
        error = abs(table[sensors.actual, row] - table[sensors.wanted, row])
        cost = min(error / sensors.scale, 10.0)  # [1/s]
        costs[row] = cost if n == 0 else costs[row] + cost
        if n == axes - 1:
            reward = -costs[row] / axes
            tracking = terms[_TRACKING, row] + sampling * reward
            terms[_TRACKING, row] = tracking
            used = tracking + terms[_EFFORT, row]
            terms[REWARD, row] = used + terms[_SMOOTHNESS, row]
