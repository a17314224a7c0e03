"""The command `cc-mujoco benchmark`, which compares controllers."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from cc_mujoco._utils import command_options as options
from cc_mujoco.errors import CableError, look_up


@dataclass(frozen=True)
class Benchmark:
    """Simulate controllers and references in a suite; write results and a report."""

    interrupted: ClassVar[str] = (
        "cells that were finished, if any, are kept; the same command goes on, but "
        "with a controller of yours begins anew, with another key"
    )

    scene: Annotated[
        tuple[str, ...], tyro.conf.Positional, options.option_help("[SCENE ...]")
    ] = ()
    """Devices: names, or files of your own such as knee.xml; all of the suite unless
    given."""
    suite: Annotated[str | None, options.option_help("NAME")] = None
    """Suite to play: v1, which never changes, generic, which any device can play, v2,
    v3, safety or position; v1 unless given, and generic or position for a device of
    your own."""
    controllers: options.Names = ()
    """Names, MODULE:FUNCTION or POLICY.safetensors; every name unless given."""
    conditions: options.Names = ()
    """Some of the suite's conditions by name, as in its tables; all unless given."""
    seeds: Annotated[int | None, options.option_help("INT")] = None
    """Number of seeds: plants, noise, motions; as many as the suite has unless given,
    which is ten in v1."""
    first_seed: int = 0
    """The first of them; to judge, one that the entrant did not know."""
    key: str = ""
    """Secret key that results with a controller of yours were played with, to play the
    same plants; a new one unless given."""
    duration: Annotated[float | None, options.option_help("FLOAT")] = None
    """Length of an episode in seconds, more than 1; that of the suite unless given."""
    baseline: Annotated[str | None, options.option_help("NAME")] = None
    """Controller that the others are compared with, seed by seed; pi if it plays, else
    none."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("runs", "benchmark")
    """Folder for the results."""
    workers: Annotated[int, options.option_help()] = 0
    """Processes that play; one per processor unless given. They change no result."""
    scheduler: Annotated[str | None, options.option_help("ADDRESS")] = None
    """tcp://HOST:PORT of a Dask scheduler, whose workers play instead."""
    worker_timeout: float = 60.0
    """Seconds after which that is given up if the scheduler has no workers."""
    again: options.Flag = False
    """Play also what an earlier run of the same code has finished."""
    compare: Annotated[
        tuple[Path, Path] | None, options.option_help("A.parquet B.parquet")
    ] = None
    """Two files of results to rank together, instead of playing."""
    verify: Annotated[Path | None, options.option_help("FILE.parquet")] = None
    """A file of results of which random rows are played again, instead of playing."""
    rows: int = 5
    """Number of rows that --verify draws; all of their cells are compared."""
    allow: options.Allowed = ()
    """Code that files may name, once each; code that only a file names is refused."""

    def run(self) -> None:
        """Simulate the cells not yet finished, write the report, print the best."""
        if self.workers < 0:
            raise CableError(f"--workers must be 0 or greater, not {self.workers}.")
        if self.compare is not None:
            from cc_mujoco.benchmark._report import comparison
            from cc_mujoco.benchmark._results import join_results, read_results

            one, other = map(read_results, self.compare)
            print(comparison(*join_results(one, other)))
            return

        if self.verify is not None:
            from cc_mujoco.benchmark._verification import verify

            print(verify(self.verify, self.rows))
            return

        from cc_mujoco.device._device_files import locate

        for scene in self.scene:
            locate(scene)
        from tqdm import tqdm

        from cc_mujoco._utils.provenance import is_user_controller
        from cc_mujoco.benchmark import BenchmarkPlan, run
        from cc_mujoco.benchmark._conditions import SCALE_CONTROLLER
        from cc_mujoco.benchmark._page import write
        from cc_mujoco.benchmark._plant import new_key
        from cc_mujoco.benchmark._report import DEFAULT_BASELINE
        from cc_mujoco.benchmark._runner import REPORT_FILE, RESULTS_FILE
        from cc_mujoco.benchmark._suites import SUITES, default_suite
        from cc_mujoco.benchmark._user_entry import blank_command_line

        suite = self.suite or default_suite(self.scene)
        laws = self.controllers or look_up("suite", suite, SUITES).controllers
        key = self.key
        if any(map(is_user_controller, laws)):
            blank_command_line("--key", "--seeds", "--first-seed")
            key = key or new_key()
        about = {f: getattr(self, f) for f in ("conditions", "seeds", "first_seed")}
        plan = BenchmarkPlan(
            laws, suite, self.scene, **about, duration=self.duration, key=key
        )
        players = plan.players()
        usual = DEFAULT_BASELINE if DEFAULT_BASELINE in players else SCALE_CONTROLLER
        baseline = self.baseline or usual
        if baseline not in players:
            raise CableError(
                f"--baseline {baseline!r} is none of the controllers, which are "
                f"{', '.join(players)}."
            )
        count = len(plan.cells())
        with tqdm(
            total=count,
            unit="cell",
            bar_format="{l_bar}{bar}| {n:.0f} of {total} cells  {elapsed}<{remaining}",
            **options.progress_options(),
        ) as bar:

            def progress(done: float) -> None:
                if done == 0.0:
                    first = "each a controller in a condition on every plant; the first"
                    note = f"{count} cells, {first} ones may take a minute"
                    print(note, file=sys.stderr, flush=True)
                bar.update(done - bar.n)

            results = run(
                plan,
                self.out,
                workers=self.workers,
                scheduler=self.scheduler,
                worker_timeout=self.worker_timeout,
                again=self.again,
                progress=progress,
                say=tqdm.write,
            )
        print(write(self.out, plan, results, baseline))
        print(f"results:    {self.out / RESULTS_FILE}")
        print(f"report:     {self.out / REPORT_FILE}")
        if key:
            print(f"key:        {key}, secret until now; --key plays the same plants")
