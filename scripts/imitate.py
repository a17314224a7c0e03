"""Train policies by imitation of a controller that knows every plant.

    python scripts/imitate.py --scene ankle --out runs/ankle
    cc-mujoco benchmark ankle --controllers pi_tuned runs/ankle/0.safetensors

The teacher, `predictive` by default, has the true parameters and exact, prompt
measurements of each plant. The policy sees the sensors of the device, late and noisy,
over its last actions. It plays more and more itself, while the teacher gives at every
step the action that it would take, and is fitted to all of these: S. Ross, G. Gordon,
D. Bagnell, "A reduction of imitation learning and structured prediction to no-regret
online learning", AISTATS 2011. A torque depends on more than the sensors show; the
policy learns a mean of what is possible.

Each effect that cables have in suite `v2` is in some of the sampled plants, the liner
is an ordinary one, and the wearer moves as the device says, a third with a tremor;
`--without` leaves effects out. An episode should be as long as the motion, or a part of
it is never seen. RMS torque errors of each round are printed, for each motion and axis;
the policy of the round with the least is written to `--out`, with its effects.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import train_policy
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from cc_mujoco import control
from cc_mujoco.benchmark import (
    STRUCTURES,
    SUITES,
    declare_training,
    effect_values,
)
from cc_mujoco.device import IN_EPISODES, CableDrive, Device
from cc_mujoco.envs import DeviceVectorEnv
from cc_mujoco.errors import CableError

Array = NDArray[np.float64]
Singles = NDArray[np.float32]
Lesson = tuple[Singles, Singles, Array]
"""Observations, actions of the teacher, errors; see `Classroom.play`."""

HOLD, HISTORY = 1, 10
"""Default samples for which an action is held; earlier frames that are seen. Held for
2 ms, actions shake a wrist whose cables slide before they slip."""
RANGES: dict[str, tuple[float, float]] = {"delay": (0, 3), "noise": (0.0, 2.0)}
"""Ranges in place of those of `train_policy.py`. Measurements that are later or noisier
show less of what the teacher knows, and its mean becomes a cautious one."""
LINER = {"friction": (0.07, 0.14), "break_away": (1.2, 1.9)}
"""Ranges beside the effects of `structure`: those of an ordinary liner."""
BENCH_LINER = {"friction": (0.08, 0.18), "break_away": (1.0, 1.6)}
"""Ranges of the bench, around its scene."""
AMOUNTS, PROBABILITY = (0.2, 1.0), 0.15
"""Amounts of an effect over those of suite `v2`; probability that a plant has it. The
teacher swings a finger with more of `viscous`."""
BANDWIDTH = 400.0
"""Bandwidth of the plans of `predictive` [rad/s]. The policy learns what a
slower plan leaves of a tremor, too."""
TREMOR = "tremor"  # effect that is in the motion
WIDTHS = 128, 128  # units of the hidden layers
BEND = np.float32(0.3)  # error above which a loss is linear, in deviations
BATCH, FINAL = 512, 6  # samples of an update, rounds of updates after the last round
RATE, LAST_RATE = 1e-3, 3e-4  # rate of the optimiser in the first round and in the last


def observation(hold: int) -> dict[str, Any]:
    return {"hold": hold, "history": HISTORY, "memory": True}


def structure(
    device: Device, without: Sequence[str] = ()
) -> dict[str, dict[str, tuple[float, float, float]]]:
    """Return the ranges of parameters by effect that the cables of a plant may have."""
    low, high = AMOUNTS
    found = {
        effect: {
            name: (low * amount, high * amount, PROBABILITY)
            for name, amount in effect_values(device, effect).items()
            if isinstance(amount, float) and name.rpartition(".")[2] in IN_EPISODES
        }
        for effect in STRUCTURES
        if effect not in without
    }
    return {effect: ranges for effect, ranges in found.items() if ranges}


MOTIONS = "own motion", TREMOR
"""Names of the parts that `motions` returns."""


def motions(scene: str, without: Sequence[str] = ()) -> tuple[train_policy.Part, ...]:
    """Return the device's own motion, and one with a wearer's tremor, as parts.

    The bench has no task of its own; its motions are those of `train_policy.py`.
    """
    if scene == train_policy.BENCH:
        return train_policy.PLAYED[scene]
    if TREMOR in without:
        return ((None, None, 1),)
    found = {one.name: one.trajectory for one in SUITES["v2"].conditions(scene)}
    tremor = found.get("structure-tremor")
    return (None, None, 2), *(((tremor, None, 1),) if tremor else ())


def teacher(env: DeviceVectorEnv) -> control.Controller:
    """Return a `predictive` that knows the present plants of an environment."""
    exo = env.exo
    drives = [
        [
            dataclasses.replace(
                drive,
                torque_noise=exo.description.sensing.torque_noise,
                cables=tuple(
                    CableDrive(plant.cables[cable], one.proximal, one.distal)
                    for cable, one in zip(names, drive.cables, strict=True)
                ),
            )
            for drive, names in zip(exo.drives, exo.device.driven, strict=True)
        ]
        for plant in env.plants
    ]
    given = functools.partial(control.PredictiveCompensation, bandwidth=BANDWIDTH)
    made = control.PlantsController(
        [control.axes_controller(given, own, exo.device.prefixes) for own in drives]
    )
    made.reset()
    return made


class Classroom:
    """A vector environment in which the teacher and the student act."""

    def __init__(self, env: DeviceVectorEnv, seed: int) -> None:
        """Reset the environment, made with `observation(hold)`."""
        self.env = env
        self._random = np.random.default_rng(seed)
        self._seen, self._info = env.reset(seed=seed)

    def play(self, student: Callable[[Singles], Singles] | None = None) -> Lesson:
        """Play an episode; return a `Lesson`.

        The student alone acts in half of the environments. In the others it has a share
        of the action. Without a student the teacher acts. A lesson
        has the student's observations (samples, size), the teacher's actions (samples,
        axes), and RMS torque errors [N m] by axis where one of them acts alone, over
        the second half of the episode.
        """
        env, limits = self.env, self.env.exo.device.torque_limits
        count, law = env.num_envs, teacher(env)
        order = self._random.permutation(count)
        share = np.minimum((2.0 * order + 1.0) / count, 1.0)
        alone, going = share == 1.0, np.ones(count, dtype=np.bool_)
        seen, taught, errors = [], [], []
        for step in range(env.episode_steps):
            played = right = env.action(law.torque(self._info))
            if student:
                own = np.clip(student(self._seen), -1.0, 1.0)
                played = (right + share[:, None] * (own - right)).astype(np.float32)
            sound = going & np.isfinite(right).all(axis=1)
            seen.append(self._seen[sound])
            taught.append(right[sound])
            given = played * limits
            law.given(given if len(limits) > 1 else given[:, 0])
            self._seen, _, terminated, _, self._info = env.step(played)
            going &= ~terminated
            if 2 * step >= env.episode_steps:
                errors.append(self._errors()[:, alone & going])
        rms = np.sqrt(np.mean(np.square(np.concatenate(errors, axis=1)), axis=1))
        return np.concatenate(seen), np.concatenate(taught), rms

    def _errors(self) -> Array:
        """Return the torque errors of now (axes, environments) [N m]."""
        exo = self.env.exo
        columns = [
            exo.axis_columns(self._info, axis) for axis in range(len(exo.observed))
        ]
        return np.array(
            [own["joint_torque_nm"] - own["desired_torque_nm"] for own in columns]
        )


class Student:
    """A neural network that is fitted to a teacher's actions."""

    def __init__(self, seen: Singles, taught: Singles, seed: int) -> None:
        """Make a network for numbers of the size of these samples."""
        self._random = np.random.default_rng(seed)
        self._mean, self._deviation = seen.mean(axis=0), seen.std(axis=0) + 1e-3
        self._middle, self._unit = taught.mean(axis=0), taught.std(axis=0) + 1e-6
        widths = seen.shape[1], *WIDTHS, taught.shape[1]
        shapes = [(own + 1, after) for own, after in itertools.pairwise(widths)]
        drawn = [
            self._random.uniform(-1.0, 1.0, shape) / np.sqrt(shape[0] - 1)
            for shape in shapes
        ]
        self._values = np.concatenate([own.ravel() for own in drawn]).astype(np.float32)
        ends = np.cumsum([own.size for own in drawn])[:-1]
        self._layers = [
            part.reshape(shape)
            for part, shape in zip(np.split(self._values, ends), shapes, strict=True)
        ]
        """Weights of each layer and, in the last row, biases; views of `_values`."""
        self._moments = np.zeros((2, self._values.size), np.float32)
        self._steps = 0

    def __call__(self, seen: Singles) -> Singles:
        """Return the actions after observations (n, size)."""
        return self._outputs(self._scaled(seen))[-1] * self._unit + self._middle

    def _scaled(self, seen: Singles) -> Singles:
        return (seen - self._mean) / self._deviation

    def _outputs(self, given: Singles) -> list[Singles]:
        """Return the input and the outputs of all layers."""
        found = [given]
        for layer in self._layers:
            if len(found) > 1:
                np.tanh(found[-1], out=found[-1])
            found.append(found[-1] @ layer[:-1] + layer[-1])
        return found

    def fit(
        self,
        seen: Singles,
        taught: Singles,
        steps: int,
        rates: tuple[float, float],
        batch: int,
    ) -> float:
        """Fit the network to observations (samples, size) and actions (samples, axes).

        Steps are those of D. Kingma, J. Ba, "Adam", ICLR 2015, on a Huber loss. The
        rates are those of the optimiser at the first step and at the last. Returns the
        mean loss.
        """
        right = (taught - self._middle) / self._unit
        given, losses = self._scaled(seen), 0.0
        for rate in np.linspace(*rates, steps, dtype=np.float32):
            rows = self._random.integers(len(given), size=batch)
            outputs = self._outputs(given[rows])
            error = outputs[-1] - right[rows]
            inner = np.clip(error, -BEND, BEND)
            losses += float(np.mean(inner * (error - 0.5 * inner))) / BEND
            self._step(self._slope(outputs, inner / (BEND * error.size)), rate)
        return losses / steps

    def _slope(self, outputs: list[Singles], back: Singles) -> Singles:
        """Return the derivatives of a loss with respect to `_values`.

        `back` are those with respect to the outputs of the last layer.
        """
        found = []
        for layer, given in zip(self._layers[::-1], outputs[-2::-1], strict=True):
            found.append(np.vstack((given.T @ back, back.sum(axis=0))).ravel())
            back = (back @ layer[:-1].T) * (1.0 - given * given)
        return np.concatenate(found[::-1])

    def _step(self, slope: Singles, rate: np.float32) -> None:
        self._steps += 1
        first, second = self._moments
        first += np.float32(0.1) * (slope - first)
        second += np.float32(1e-3) * (slope * slope - second)
        mean = first / np.float32(1.0 - 0.9**self._steps)
        spread = np.sqrt(second / np.float32(1.0 - 0.999**self._steps))
        self._values -= rate * mean / (spread + np.float32(1e-8))

    def network(self) -> control.Network:
        each = [layer.astype(float) for layer in self._layers]
        each[-1] *= self._unit
        each[-1][-1] += self._middle
        return control.Network(
            tuple(layer[:-1].T.copy() for layer in each),
            tuple(layer[-1] for layer in each),
            "tanh",
            False,
            self._mean.astype(float),
            self._deviation.astype(float),
        )


def train(options: argparse.Namespace) -> None:
    device = train_policy.device_of(options.scene)
    liner = BENCH_LINER if options.scene == train_policy.BENCH else LINER
    effects = structure(device, options.without)
    played = motions(options.scene, options.without)
    ranges = {**RANGES, **liner}
    for own in effects.values():
        ranges |= own
    envs = train_policy.make(options, ranges, observation(options.hold), played)
    rooms = [
        Classroom(env, 1000 * options.seed + place) for place, env in enumerate(envs)
    ]
    kinds = MOTIONS if len(envs) <= len(MOTIONS) else map("motion {}".format, range(9))
    axes = device.description.axes
    names = [
        kind if len(axes) == 1 else f"{kind} at {axis.name}"
        for kind, _ in zip(kinds, envs, strict=False)
        for axis in axes
    ]
    lessons = [room.play() for room in rooms]
    reachable = printed_errors("teacher", names, lessons)
    seen = np.concatenate([own[0] for own in lessons])
    taught = np.concatenate([own[1] for own in lessons])
    student = Student(seen, taught, options.seed)
    rates = np.linspace(RATE, LAST_RATE, options.rounds)
    best, least, network = 0, np.inf, student.network()
    for number, rate in enumerate(rates, start=1):
        last = number == options.rounds
        steps, end = (FINAL * options.updates, 0.0) if last else (options.updates, rate)
        student.fit(seen, taught, steps, (rate, end), BATCH)
        lessons = [room.play(student) for room in rooms]
        label = f"round {number} of {options.rounds}"
        errors = printed_errors(label, names, lessons)
        if (found := float(np.mean(errors / reachable))) < least or not best:
            least, best, network = found, number, student.network()
        seen = np.concatenate([seen, *(own[0] for own in lessons)])
        taught = np.concatenate([taught, *(own[1] for own in lessons)])
    print(f"round {best} is kept: {least:.2f} times the teacher's error, on average")
    path = options.out / f"{options.seed}.safetensors"
    control.write_policy(path, network, envs[0].exo.observed)
    shakes = options.scene != train_policy.BENCH and len(played) > 1
    declare_training(path, [*effects, *([TREMOR] if shakes else [])])


def printed_errors(who: str, names: list[str], lessons: list[Lesson]) -> Array:
    """Print RMS torque errors [N m] by motion and axis; return them."""
    errors = np.concatenate([own for *_, own in lessons])
    each = ", ".join(
        f"{name} {rms:.3g} N m" for name, rms in zip(names, errors, strict=True)
    )
    print(f"{who}, RMS torque error: {each}", flush=True)
    return errors


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scene", default="wrist", help="name or file of a device")
    parser.add_argument("--rounds", type=int, default=8, help="fits, each then played")
    parser.add_argument(
        "--updates", type=int, default=1500, help=f"of a fit; {FINAL} times in the last"
    )
    parser.add_argument(
        "--hold", type=int, default=HOLD, help="samples for which an action is held"
    )
    parser.add_argument("--envs", type=int, default=24, help="that play together")
    parser.add_argument(
        "--seconds", type=float, default=4.0, help="of an episode, as in the benchmark"
    )
    parser.add_argument("--seed", type=int, default=0, help="also the file's name")
    parser.add_argument(
        "--without", nargs="*", default=[], choices=STRUCTURES, metavar="EFFECT",
        help="effects of suite v2 that are left out of the training",
    )  # fmt: skip
    parser.add_argument(
        "--out", type=Path, default=Path("runs", "imitation"), help="folder of the file"
    )
    # `train_policy.make` reads them, too.
    parser.set_defaults(fixed=False, smoothness=0.0)
    options = parser.parse_args()
    try:
        train_policy.device_of(options.scene)
    except CableError as error:
        parser.error(str(error))
    for name in ("rounds", "updates", "hold", "envs", "seconds"):
        if getattr(options, name) <= 0:
            parser.error(f"--{name} must be above 0.")
    if options.seed < 0:
        parser.error("--seed must be 0 or greater.")
    if (there := options.out / f"{options.seed}.safetensors").exists():
        parser.error(f"{there} is there already; name another --out or --seed.")
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        # Sums of a thread each depend on how many there are; one gives one policy.
        with threadpool_limits(1, user_api="blas"):
            train(options)
    except (CableError, OSError) as error:
        parser.error(str(error))
    except KeyboardInterrupt:
        parser.exit(130, "interrupted, no policy is written.\n")
    print(f"{there} is written: cc-mujoco play {options.scene} --controller {there}")


if __name__ == "__main__":
    main()
