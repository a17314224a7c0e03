"""Running a plan on the threads of this machine.

A batch of designs is one piece of work. Its results do not depend on where it is done
or beside what, so this and a cluster (`cluster`) give the same table.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait

from cc_mujoco.whatif.evaluate import Result, evaluate
from cc_mujoco.whatif.plan import Plan

Progress = Callable[[float], None]
"""Takes the number of designs that are done, a fraction for those under way."""

Finished = tuple[int, list[Result]]
"""Number of a batch, and its results."""


class _StoppedError(Exception):
    """Ends a batch that is no longer wanted."""


def run_here(
    plan: Plan, batches: Iterable[int], threads: int, progress: Progress
) -> Generator[Finished, None, None]:
    """Run batches on threads of this process.

    Args:
        plan: the study.
        batches: numbers of those to run.
        threads: how many; 0 means one per processor.
        progress: called with the designs done, from any thread, one at a time.

    Yields:
        Batches as they are finished, in no particular order.
    """
    waiting = list(batches)
    count = threads or os.cpu_count() or 1
    shares = dict.fromkeys(waiting, 0.0)
    stopped, lock = threading.Event(), threading.Lock()

    def work(number: int) -> list[Result]:
        members = plan.batches[number]

        def tick(share: float) -> None:
            if stopped.is_set():
                raise _StoppedError
            with lock:
                shares[number] = share * len(members)
                progress(sum(shares.values()))

        return evaluate(plan.protocol, [plan.designs[i] for i in members], tick)

    # Never more in the queue than is under way, so that an end comes soon.
    pool = ThreadPoolExecutor(count)
    queue: dict[Future[list[Result]], int] = {}
    try:
        while waiting or queue:
            while waiting and len(queue) < count:
                number = waiting.pop(0)
                queue[pool.submit(work, number)] = number
            for future in wait(queue, return_when=FIRST_COMPLETED).done:
                yield queue.pop(future), future.result()
    finally:
        stopped.set()
        pool.shutdown(wait=True)
