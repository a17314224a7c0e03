"""Score the engines that this interpreter can import on the tendon suite.

    python scripts/benchmarks/tendon_suite/run.py [--engine NAME] [--task NAME]
        [--tune] [--out FILE.json] [--speed STEPS]

The error is the largest relative one of a task's quantities; speeds are steps per
second of processor time. `--out` adds to results that the file holds, of other
interpreters too, and prints all. `--tune` plays every setting that an engine tries, and
keeps the best. `--speed` only times the first steps of tasks that the file holds.
Another engine is a module in `MODULES` with `ENGINES`, see `Engine` in `tasks.py`.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import json
import statistics
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tendon_suite.tasks import TASKS, Array, Engine, Machine, NotExpressible, Setting

MODULES = ("ours", "plain_mujoco", "newton_tendons")


def engines() -> dict[str, Engine]:
    """Return the engines that can be imported, by name."""
    found: dict[str, Engine] = {}
    for module in MODULES:
        try:
            found |= importlib.import_module(f"tendon_suite.{module}").ENGINES
        except ModuleNotFoundError as error:
            missing = f"{error.name} is not installed; its columns are left out"
            print(missing, file=sys.stderr)
        except ImportError as error:
            print(f"{module}: {error}", file=sys.stderr)
    return found


class Enough(Exception):
    """Exception that ends a task after the number of steps that are timed."""


def score(task: str, engine: Engine, setting: Setting, steps: int) -> dict[str, Any]:
    """Return a task's result with one setting; with `steps`, only their speed."""
    seconds: list[float] = []

    def build(machine: Machine) -> Any:
        sim: Any = engine.build(machine, setting)
        advance = sim.step

        def step(forces: Array) -> None:
            start = time.process_time()
            advance(forces)
            seconds.append(time.process_time() - start)
            if len(seconds) == steps:
                raise Enough

        sim.step = step
        return sim

    result, numbers = {"setting": setting}, {}
    with contextlib.suppress(Enough):
        for q in TASKS[task](build):
            numbers[q.name] = [float(q.found), float(q.right), float(q.error)]
        result["error"] = max(error for _, _, error in numbers.values())
        result["quantities"] = numbers
    return result | {"steps_per_second": 1.0 / statistics.median(seconds)}


def best(task: str, engine: Engine, tune: bool) -> dict[str, Any]:
    """Return the best result of a task, or the reason why there is none."""
    tried = []
    for setting in engine.settings(task, tune):
        try:
            tried.append(score(task, engine, setting, 0))
        except NotExpressible as reason:
            return {"reason": str(reason)}
        print(f"{task}: {tried[-1]['error']:.3g} {setting}", file=sys.stderr)
    return min(tried, key=lambda result: result["error"])


def cell(result: dict[str, Any]) -> str:
    if "error" not in result:
        return "-" if result else ""
    step, speed = 1e3 * result["setting"]["timestep"], result["steps_per_second"]
    return f"{100 * result['error']:.2g} %, {step:g} ms, {speed:.2g}/s"


def table(results: dict[str, Any]) -> str:
    """Return the results as a Markdown table, with reasons for missing ones below."""
    names = list(dict.fromkeys(name for row in results.values() for name in row))
    rows = [["task", *names], ["---"] * (len(names) + 1)]
    reasons = []
    for task, row in results.items():
        rows.append([task, *(cell(row.get(name, {})) for name in names)])
        told = [(name, row[name]["reason"]) for name in row if "reason" in row[name]]
        reasons += [f"{name}, {task}: {reason}" for name, reason in told]
    return "\n".join([f"| {' | '.join(row)} |" for row in rows] + reasons)


def read_results(out: Path) -> dict[str, Any]:
    """Return the results of a file, none if it is new.

    Raises:
        OSError: the file cannot be read or written.
        ValueError: it holds something else.
    """
    is_new = not out.exists()
    with out.open("a+", encoding="utf-8") as file:
        file.seek(0)
        kept = {} if is_new else json.load(file)
    if is_new:
        out.unlink()
    if not isinstance(kept, dict):
        raise ValueError("a list or a number")
    for task, row in kept.items():
        if task not in TASKS or not isinstance(row, dict):
            raise ValueError(f"no results of a task under {task!r}")
    return kept


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--engine", action="append")
    parser.add_argument("--task", action="append", choices=TASKS)
    parser.add_argument("--tune", action="store_true")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--speed", type=int, default=0)
    options = parser.parse_args()
    out, found, kept = options.out, engines(), {}
    for name in options.engine or ():
        if name not in found:
            names = ", ".join(found)
            parser.error(f"--engine {name}: it is none of those found here: {names}")
    if options.speed < 0:
        parser.error(f"--speed {options.speed}: give a number of steps, 1 or more")
    if options.speed and not (out and out.exists()):
        parser.error("--speed needs --out with a file of results, whose tasks it times")
    try:
        kept = read_results(out) if out else {}
    except OSError as error:
        parser.error(f"--out {out}: {error.strerror}")
    except ValueError as error:
        parser.error(f"--out {out} has no results of this script: {error}")
    results = {task: kept.get(task, {}) for task in TASKS}
    for name, engine in found.items():
        if options.engine and name not in options.engine:
            continue
        for task in options.task or TASKS:
            if not options.speed:
                results[task][name] = best(task, engine, options.tune)
            elif "setting" in (held := results[task].get(name, {})):
                held |= score(task, engine, held["setting"], options.speed)
            if out:
                out.write_text(json.dumps(results, indent=1), "utf-8")
    print(table({task: row for task, row in results.items() if row}))


if __name__ == "__main__":
    main()
