"""Running the pieces of a job on this machine, in threads or processes."""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent import futures
from typing import Any, Protocol

from cc_mujoco._utils import user_code

Tick = Callable[[float], object]  # takes the share of a piece done; may raise to stop
Progress = Callable[[float], None]  # takes how much is done, in units of `Job.size`


class Job(Protocol):
    """Work that consists of independent pieces; jobs and pieces can be pickled."""

    def rehearse(self) -> None:
        """Build everything that the pieces need, so that errors show early."""

    def made_by(self) -> dict[str, Any]:
        """Return the provenance of the results; call it after `rehearse`."""

    def size(self, piece: Any) -> int:
        """Return the amount of work in a piece, in units of the progress."""

    def do(self, piece: Any, tick: Tick) -> Any:
        """Return a piece's result; call `tick` with the fraction done, 0 to 1."""


class _StoppedError(Exception): ...  # ends a piece that is no longer wanted


def run_here(
    job: Job,
    pieces: Mapping[int, Any],
    progress: Progress = lambda done: None,
    *,
    count: int = 0,
    processes: bool = False,
) -> Generator[tuple[int, Any], None, None]:
    """Yield (number, result) of each piece as it is finished, in any order.

    `progress` is called from any thread, one at a time. `count` is the number of
    threads or of `processes`, 0 for one per processor; a single process is this one.
    Processes are for pieces in Python, whose threads would wait for each other.
    """
    count = min(count or os.cpu_count() or 1, max(len(pieces), 1))
    if processes and count == 1:
        done = 0.0
        for number, piece in pieces.items():
            result = job.do(piece, float)
            done += job.size(piece)
            progress(done)
            yield number, result
        return
    waiting = dict(pieces)
    shares = dict.fromkeys(pieces, 0.0)
    stopped, lock = threading.Event(), threading.Lock()

    def report(number: int, share: float) -> None:
        with lock:
            shares[number] = share * job.size(pieces[number])
            progress(sum(shares.values()))

    def work(number: int) -> Any:
        def tick(share: float) -> None:
            if stopped.is_set():
                raise _StoppedError
            report(number, share)

        return job.do(pieces[number], tick)

    pool: futures.Executor
    # By this variable a new interpreter takes no module from the current folder.
    safe_path = "PYTHONSAFEPATH"
    unsafe = safe_path not in os.environ
    others = set(multiprocessing.active_children())
    if processes:
        os.environ[safe_path] = "1"
        # A fresh interpreter each: threads of the parent would not survive a fork.
        spawn, allowed = multiprocessing.get_context("spawn"), user_code.allowed()
        pool = futures.ProcessPoolExecutor(count, spawn, user_code.allow, (allowed,))
    else:
        pool = futures.ThreadPoolExecutor(count)
    # Never more in the queue than is under way, so that an end comes soon.
    queue: dict[futures.Future[Any], int] = {}
    try:
        while waiting or queue:
            with _late_interrupts() as interrupts:
                while waiting and len(queue) < count:
                    number = next(iter(waiting))
                    piece = waiting.pop(number)
                    if processes:
                        with _interrupts_held():  # a process starts with what is held
                            future = pool.submit(job.do, piece, float)
                    else:
                        future = pool.submit(work, number)
                    queue[future] = number
                finished: set[futures.Future[Any]] = set()
                while not (finished or interrupts):
                    finished = futures.wait(queue, 0.2, futures.FIRST_COMPLETED).done
            for future in finished:
                number = queue.pop(future)
                result = future.result()
                if processes:
                    report(number, 1.0)
                yield number, result
    except BaseException:  # what else is under way is not wanted any more
        for worker in set(multiprocessing.active_children()) - others:
            worker.terminate()
        raise
    finally:
        stopped.set()
        pool.shutdown(wait=True, cancel_futures=True)
        if processes and unsafe:
            del os.environ[safe_path]


@contextlib.contextmanager
def _late_interrupts() -> Iterator[list[int]]:
    """Collect SIGINT in the yielded list; raise `KeyboardInterrupt` after the block.

    Raised inside the executor, it could leave a lock held, and a thread would wait for
    it for ever.
    """
    interrupts: list[int] = []
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield interrupts
        return
    signal.signal(signal.SIGINT, lambda number, frame: interrupts.append(number))
    try:
        yield interrupts
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if interrupts:
        raise KeyboardInterrupt


@contextlib.contextmanager
def _interrupts_held() -> Iterator[None]:
    """Block SIGINT in this thread during the block, and for ever in processes started.

    Ctrl-C reaches every process of a terminal; this process ends the others itself.
    """
    if not hasattr(signal, "pthread_sigmask"):  # as on Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
