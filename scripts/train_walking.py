"""Train the walking policy of `cc_mujoco/Walking-v0` by evolution.

    python scripts/train_walking.py --out runs/walking.safetensors

The search is CMA-ES (N. Hansen, "The CMA evolution strategy: a tutorial",
arXiv:1604.00772) over the numbers of a `WalkingPolicy`, from the joint angles and
torques of a measured walk. At first a harness holds the trunk, by springs that yield
as soon as the median candidate stays on its feet, and are gone before the end. Then
pushes at the trunk begin. Reward per second is 1 less the costs of joint angles other
than the measured ones, of speed, of the trunk's pitch, of torque and of the metabolic
power that the joints' work takes; a fall ends it.
Progress is printed, and the mean of the search is written as a policy, every ten
generations. The policy that ships
was found in 160 generations: 40 with 24 candidates each, and not before the hundredth
with the cost of metabolic power, which this script has from the first.
"""

from __future__ import annotations

import argparse
import copy
import time
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from cc_mujoco.human import WalkingController, WalkingPolicy
from cc_mujoco.human._gait import GAIT_ANGLES, GAIT_MOMENTS
from cc_mujoco.human._walking_body import SCENE, WalkingBody, metabolic_energy
from cc_mujoco.human._walking_policy import MUSCLE_PERIOD, WALKING_JOINTS
from cc_mujoco.native import FloatArray as Array

POPULATION = 16
EPISODE = 5.0  # time for which a candidate walks [s]
HARNESS = (300.0, 1500.0, 150.0)
"""Damping of the speed [N s/m], stiffness [N m/rad] and damping of the pitch."""
YIELD, GONE = 0.85, 0.02
"""Factor by which the harness yields, and share of it that is no more."""
PUSH, PUSH_TIME = 120.0, 0.15  # force at the trunk [N], and its duration [s]
STARTING = WalkingPolicy(
    stiffness=np.array([250.0, 200.0, 150.0]),
    damping=np.array([10.0, 8.0, 5.0]),
    angles=np.array([GAIT_ANGLES[name].coefficients for name in WALKING_JOINTS]),
    torques=np.array([0.5, 0.6, 0.9])[:, None, None]
    * np.array([GAIT_MOMENTS[name].coefficients for name in WALKING_JOINTS]),
    stride_time=1.15,
    trunk_stiffness=500.0,
    trunk_damping=60.0,
    trunk_pitch=0.05,
    speed=1.25,
    speed_gain=0.25,
    foot_gain=0.3,
    push_gain=0.5,
)
"""First policy; its gains are guesses."""
FACTORS = {
    "stiffness": 0.5,
    "damping": 0.5,
    "torques": 0.3,
    "stride_time": 0.1,
    "trunk_stiffness": 0.5,
    "trunk_damping": 0.5,
}
"""Numbers that the search multiplies by an exponential, with the size of a step."""
TERMS = {"trunk_pitch": 0.1, "speed_gain": 0.15, "foot_gain": 0.3, "push_gain": 0.5}
"""Numbers to which it adds, likewise."""
SERIES = {"angles": 0.06, "torques": 10.0}
"""Series to whose first terms it adds, likewise [rad], [N m]."""
HARMONICS = 3


def policy_at(point: Array) -> WalkingPolicy:
    """Return the policy whose numbers are a point of the search space."""
    left = list(point)

    def take(count: int) -> Array:
        taken, left[:count] = np.array(left[:count]), []
        return taken

    numbers: dict[str, Any] = {
        field.name: getattr(STARTING, field.name) for field in fields(WalkingPolicy)
    }
    for name, size in FACTORS.items():
        own = np.asarray(numbers[name])
        factor = np.exp(size * take(len(own) if own.ndim else 1))
        factor = factor.reshape((-1,) + (1,) * max(own.ndim - 1, 0))
        numbers[name] = own * factor if own.ndim else float(own * factor[0])
    for name, size in TERMS.items():
        numbers[name] = float(numbers[name] + size * take(1)[0])
    for name, size in SERIES.items():
        added = size * take(3 * (2 * HARMONICS + 1)).reshape(3, -1)
        series = numbers[name].copy()
        series[:, 0, 0] += added[:, 0]
        series[:, 1 : HARMONICS + 1] += added[:, 1:].reshape(3, HARMONICS, 2)
        numbers[name] = series
    return replace(STARTING, **numbers)


def dimensions() -> int:
    single = [np.asarray(getattr(STARTING, name)) for name in FACTORS]
    factors = sum(len(own) if own.ndim else 1 for own in single)
    return factors + len(TERMS) + len(SERIES) * 3 * (2 * HARMONICS + 1)


class Search:
    """CMA-ES: a normal distribution that is adapted to the better candidates."""

    def __init__(self, size: int, spread: float, rng: np.random.Generator) -> None:
        parents = POPULATION // 2
        weights = np.log(parents + 0.5) - np.log(np.arange(1, parents + 1))
        self.weights = weights / weights.sum()
        self.mass = 1.0 / float(np.sum(self.weights**2))
        self.mean, self.spread, self.rng = np.zeros(size), spread, rng
        self.covariance = np.eye(size)
        self.path, self.step_path = np.zeros(size), np.zeros(size)
        self.generation = 0

    def ask(self) -> Array:
        """Return new candidates (population, size)."""
        values, self._axes = np.linalg.eigh(self.covariance)
        self._normal = self.rng.standard_normal((POPULATION, self.mean.size))
        scaled = self._normal * np.sqrt(np.maximum(values, 1e-12))
        self._moves = scaled @ self._axes.T
        return self.mean + self.spread * self._moves

    def tell(self, rewards: Array) -> None:
        n, mass = self.mean.size, self.mass
        decay = (4 + mass / n) / (n + 4 + 2 * mass / n)
        step_decay = (mass + 2) / (n + mass + 5)
        rank_one = 2 / ((n + 1.3) ** 2 + mass)
        rank_many = min(1 - rank_one, 2 * (mass - 2 + 1 / mass) / ((n + 2) ** 2 + mass))
        slowness = 1 + 2 * max(0.0, np.sqrt((mass - 1) / (n + 1)) - 1) + step_decay
        expected = np.sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n * n))
        best = np.argsort(-rewards)[: self.weights.size]
        moves = self._moves[best]
        move = self.weights @ moves
        self.mean = self.mean + self.spread * move
        self.generation += 1
        self.step_path = (1 - step_decay) * self.step_path + np.sqrt(
            step_decay * (2 - step_decay) * mass
        ) * (self._axes @ (self.weights @ self._normal[best]))
        length = float(np.linalg.norm(self.step_path))
        settled = np.sqrt(1 - (1 - step_decay) ** (2 * self.generation))
        is_short = length / settled < (1.4 + 2 / (n + 1)) * expected
        self.path = (1 - decay) * self.path + is_short * np.sqrt(
            decay * (2 - decay) * mass
        ) * move
        lost = (1 - is_short) * decay * (2 - decay)
        self.covariance = (
            (1 - rank_one - rank_many) * self.covariance
            + rank_one * (np.outer(self.path, self.path) + lost * self.covariance)
            + rank_many * (moves.T * self.weights) @ moves
        )
        self.spread *= float(np.exp(step_decay / slowness * (length / expected - 1)))


def walk(
    policies: list[WalkingPolicy],
    models: list[mujoco.MjModel],
    start: float,
    harness: float,
    pushes: list[tuple[float, float]],
) -> tuple[Array, Array]:
    """Simulate policies; return their rewards and times on their feet [s]."""
    body = WalkingBody(models[0])
    each = [mujoco.MjData(model) for model in models]
    for policy, model, data in zip(policies, models, each, strict=True):
        body.set_muscles(model, policy)
        body.start(data, policy, start)
        mujoco.mj_forward(model, data)
    person = WalkingController(policies, len(policies), dtype=np.float64)
    person.step[:] = start
    rewards, alive = np.zeros(len(each)), np.ones(len(each), bool)
    lasted = np.zeros(len(each))
    substeps = round(MUSCLE_PERIOD / models[0].opt.timestep)
    trunk = models[0].body("trunk").id
    held = [models[0].joint(name).dofadr[0] for name in ("forward", "pitch")]
    grid = np.arange(512) / 512
    measured = np.stack([GAIT_ANGLES[p](grid) for p in ("hip", "knee", "ankle")], 1)
    for number in range(round(EPISODE / MUSCLE_PERIOD)):
        now = number * MUSCLE_PERIOD
        senses = body.senses(each)
        control = person.act(senses, MUSCLE_PERIOD)
        force = sum(f for begin, f in pushes if begin <= now < begin + PUSH_TIME)
        missing = senses.speed - STARTING.speed
        apart = senses.angles - measured[(person.phase * 512).astype(int)]
        torque, power = np.zeros((2, len(each)))
        for k in np.flatnonzero(alive):
            data = each[k]
            data.ctrl[body.muscles] = control[k]
            data.xfrc_applied[trunk, 0] = force
            if harness:
                speed, stiffness, damping = (harness * value for value in HARNESS)
                lean = stiffness * senses.pitch[k] + damping * senses.pitch_rate[k]
                data.qfrc_applied[held] = -speed * missing[k], -lean
            mujoco.mj_step(models[k], data, substeps)
            given = data.actuator_force[body.muscles]
            torque[k] = np.sum(given**2)
            work = given * data.qvel[body.dof]
            power[k] = metabolic_energy(
                *(np.sum(f(work, 0.0)) for f in (np.maximum, np.minimum))
            )
            alive[k] = not body.has_fallen(data)
        cost = (
            2.5 * np.sum(apart**2, axis=(1, 2))
            + 0.1 * (missing / 0.4) ** 2
            + 0.05 * ((senses.pitch - 0.03) / 0.15) ** 2
            + 0.1 * torque / 2e4
            + 0.15 * power / 500.0
        )
        rewards += MUSCLE_PERIOD * alive * np.maximum(0.1, 1.0 - cost)
        lasted[alive] = now + MUSCLE_PERIOD
        if not alive.any():
            break
    return rewards, lasted


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--generations", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    options.out.parent.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(options.seed)
    search = Search(dimensions(), 0.3, rng)
    model = mujoco.MjModel.from_xml_path(str(SCENE))
    models = [copy.copy(model) for _ in range(POPULATION)]
    harness = 1.0
    while search.generation < options.generations:
        policies = [policy_at(point) for point in search.ask()]
        size = 0.0 if harness else PUSH * rng.uniform(-1.0, 1.0, 2)
        begins = rng.uniform((0.5, 2.5), (2.0, 4.0))
        pushes = list(zip(begins, np.broadcast_to(size, 2), strict=True))
        start = rng.uniform(0.1, 0.4)
        rewards, lasted = walk(policies, models, start, harness, pushes)
        search.tell(rewards)
        if np.median(lasted) > 0.9 * EPISODE:
            harness *= YIELD
            harness = harness if harness > GONE else 0.0
        generation = search.generation
        if generation % 10 == 0 or generation == options.generations:
            policy_at(search.mean).write(options.out)
            print(
                f"{generation:4d}  reward {np.median(rewards):.2f} to "
                f"{rewards.max():.2f}, on its feet {np.median(lasted):.1f} s, harness "
                f"{harness:.3f}, {time.process_time():.0f} s of processor",
                flush=True,
            )


if __name__ == "__main__":
    main()
