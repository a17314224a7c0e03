"""Designs per second of `cc-mujoco whatif` against a loop of single environments.

    python scripts/benchmarks/bench_whatif.py
    python scripts/benchmarks/bench_whatif.py --designs 10000 --duration 2 --threads 2

The batch and the loop play the same designs by turns in one process, so that what else
the machine does falls on both, and MuJoCo's own `Batch` steps the same bare models with
the torques that the controllers gave, in one call on as many threads. Prints designs
per second and ratios of speeds; bare times are of this machine only. At last it prints
where the processor time of a batch of designs goes, on one thread.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from typing import Any
from unittest import mock

import gymnasium
import mujoco
import numpy as np
import tyro
from mujoco.batch import Batch
from turns import by_turns

from cc_mujoco.control import controller
from cc_mujoco.design import Execution, Plan, StudySpec, carry_out, episodes, make_plan
from cc_mujoco.design import _evaluation as evaluation
from cc_mujoco.design._results_store import Store
from cc_mujoco.device import PERFECT_SENSING, Measuring, Plant
from cc_mujoco.plugin import untimed
from cc_mujoco.simulation import Single, attended, run
from cc_mujoco.simulation._batch import Simulations
from cc_mujoco.simulation._rollout import play

EPISODE = (
    "efficiency", "rms_torque_error", "peak_motor_torque", "peak_motor_power",
    "slack_margin", "slack_share", "peak_tension", "strength_used",
)  # fmt: skip
"""Metrics that need the episode alone."""

LOOPED = 2  # designs of a turn of the loop


def main(
    scene: str = "wrist",
    designs: int = 768,
    duration: float = 10.0,
    threads: tuple[int, ...] = (1, 2),
    rounds: int = 3,
    law: str = "pi",
) -> None:
    """Print the speeds, for episodes of length `duration` [s]."""
    ranges = {"friction": "0.05:0.2", "loops": "0.5:3", "pretension": "5:40"}
    if scene != "wrist":
        del ranges["loops"]
    spec = StudySpec(
        scene, ranges, sampling="lhs", samples=designs, controllers=[law],
        duration=duration, metrics=EPISODE,
    )  # fmt: skip
    plan = make_plan(spec)
    count, sample = len(plan.designs), min(64, len(plan.designs))
    turns = {"loop": partial(rates, LOOPED, partial(loop, plan))}
    for n in threads:
        turns[f"Batch {n}"] = partial(rates, sample, physics(plan, sample, n))
        turns[f"study {n}"] = partial(rates, count, partial(whole_study, spec, n))
    found = by_turns(turns, rounds)
    for name, measured in found.items():
        kind, _, many = name.partition(" ")
        wall = np.median(measured[:, 0])
        ratio = np.median(measured[:, 0] / found["loop"][:, 0])
        text = f"{name:10} {wall:7.2f} designs/s, {ratio:5.1f} times the loop"
        if kind == "study":
            shares = np.median(measured / found[f"Batch {many}"], axis=0)
            text += "; {:.2f} of Batch, of the processor time {:.2f}".format(*shares)
        print(text, flush=True)
    for name, spent in stages(plan).most_common():
        print(f"{name:20} {1e3 * spent:7.3f} ms of processor time per design")


def whole_study(spec: StudySpec, threads: int) -> None:
    """Plan and carry out a study in memory."""
    carry_out(make_plan(spec), execution=Execution(threads=threads))


def stages(plan: Plan) -> Counter[str]:
    """Return the processor time per design of each stage of a plan's first batch [s].

    That of a stage excludes the stages inside it.
    """
    spent: Counter[str] = Counter()
    inner = [0.0]

    def timed(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*given: Any, **named: Any) -> Any:
            start = time.process_time()
            inner.append(0.0)
            try:
                return function(*given, **named)
            finally:
                took = time.process_time() - start
                spent[name] += (took - inner.pop()) / len(designs)
                inner[-1] += took

        return call

    designs = [plan.designs[row] for row in plan.batches[0]]
    evaluate = timed("rest", evaluation.evaluate)
    with ExitStack() as patches:
        for owner, attribute, name in (
            (evaluation, "Plant", "plants"),
            (evaluation, "attended_together", "models"),
            (evaluation, "play", "preparation"),
            (Simulations, "roll", "steps"),
            (evaluation, "measure", "metrics"),
        ):
            own = timed(name, getattr(owner, attribute))
            patches.enter_context(mock.patch.object(owner, attribute, own))
        results = evaluate(plan.protocol, designs)
    timed("plan", check_designs)(plan)
    timed("rows", Store(plan, None).keep)(0, results)
    return spent


def check_designs(plan: Plan) -> None:
    """Check the designs of a plan's first batch, as `make_plan` does."""
    across, device = plan.protocol.across, plan.protocol.device
    for row in plan.batches[0]:
        across.check(device, plan.designs[row])
        across.layout(device, plan.designs[row])


def physics(plan: Plan, count: int, threads: int) -> Callable[[], object]:
    """Return a function that only steps a plan's first designs, driven as recorded."""
    protocol = plan.protocol
    device = protocol.device
    models = [attended(Plant(device, design)) for design in plan.designs[:count]]
    _, _, episode = episodes(protocol)[0]
    exo = episode.exo(models[0])
    script = exo.author.write(np.random.default_rng(0))
    torque = play(episode, models).columns["motor_torque_nm"][:, 1:]
    batch = Batch(models[0], count, threads, persistent=True)
    batch.set_models(models)
    integration = int(mujoco.mjtState.mjSTATE_INTEGRATION)
    for row, model in enumerate(models):
        device, data = episode.device(model), mujoco.MjData(model)
        device.start(data, script.angles, script.commands[0])
        mujoco.mj_getState(model, data, batch.state[row], integration)
    start, steps = batch.state.copy(), exo.steps * exo.frame_skip
    control = np.zeros((count, steps, models[0].nu))
    (axis,) = exo.device.axes
    driven = np.repeat(torque / axis.motor_gear, exo.frame_skip, axis=1)
    control[:, :, axis.motor_control] = driven
    control[:, :, exo.device.script_controls] = script.commands[:steps]

    def step() -> None:
        batch.state[:] = start
        with untimed():
            batch.rollout(steps, control, record=())

    return step


def rates(count: int, play: Callable[[], object]) -> tuple[float, float]:
    """Return designs per second of real time, and of processor time of all threads."""
    start = time.perf_counter(), time.process_time()
    play()
    taken = time.perf_counter() - start[0], time.process_time() - start[1]
    return count / taken[0], count / taken[1]


def loop(plan: Plan) -> None:
    """Simulate the designs of a plan in single environments, one after another."""
    protocol = plan.protocol
    device = protocol.device
    for design in plan.designs[:LOOPED]:
        model = Plant(device, design).model(whole=True)
        env: Any = gymnasium.make(
            "cc_mujoco/Device-v1",
            disable_env_checker=True,
            device=device,
            model=model,
            trajectory=protocol.trajectory,
            task=protocol.task,
            duration=protocol.duration,
            frame_skip=protocol.device.frame_skip,
        ).unwrapped
        law = controller(protocol.controllers[0], env.exo.drive)
        (driven,) = env.exo.device.driven
        measuring = Measuring(
            PERFECT_SENSING, law.drive, driven, protocol.seed, env.exo.steps
        )
        run(Single(env, protocol.seed), law, measure=measuring.measure)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__.splitlines()[0])
