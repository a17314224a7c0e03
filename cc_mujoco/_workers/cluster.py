"""Running the pieces of a job on the workers of a Dask cluster, with the same code.

Every task first compares the code of its worker with that of the client, so workers
that join later are checked too. Those present are checked before the first piece.
"""

import asyncio
import pickle
import time
from collections.abc import Callable, Generator, Mapping
from concurrent.futures import CancelledError, ThreadPoolExecutor
from functools import lru_cache
from typing import Any

from cc_mujoco._utils import user_code
from cc_mujoco._utils.provenance import code_provenance, provenance_differences
from cc_mujoco._workers.local_executor import Job, Progress
from cc_mujoco.errors import CableError, import_extra

CONNECT_TIMEOUT = 5.0  # time that a scheduler has to answer [s]
WORKER_TIMEOUT = 60.0  # time without any worker after which a study gives up [s]
Answer = tuple[Any, str]  # answer of a worker: a result, and why it has none


def run_on_cluster(
    job: Job,
    pieces: Mapping[int, Any],
    scheduler: str,
    progress: Progress = lambda done: None,
    worker_timeout: float = WORKER_TIMEOUT,
) -> Generator[tuple[int, Any], None, None]:
    """Yield (number, result) of each piece as workers finish them, in any order.

    Pieces of a worker that dies are given to others by Dask. `scheduler` is
    `tcp://HOST:PORT`. Raises `CableError` after `worker_timeout` [s] without any
    worker, or if a worker has other code.
    """
    if not worker_timeout > 0.0:
        raise CableError(f"worker timeout must be above 0 s, not {worker_timeout!r} s.")
    distributed = import_extra("distributed", "--scheduler needs Dask", "dask")
    _require_scheduler(distributed, scheduler)
    makers = pickle.dumps(job.made_by())
    pickled_job = pickle.dumps((user_code.allowed(), job))
    ask = _portable()
    lost = (distributed.KilledWorker, CancelledError, asyncio.CancelledError, OSError)
    done = 0
    try:
        own = {"timeout": CONNECT_TIMEOUT, "set_as_default": False}
        with distributed.Client(scheduler, **own) as client:
            look = _watchdog(client, scheduler, worker_timeout)
            while not client.nthreads():
                look()
            found = client.run(ask, makers, pickled_job, None, on_error="return")
            for worker, answer in found.items():
                if not isinstance(answer, OSError):  # it has left
                    _result_of(answer, worker)
            numbers = {}
            for number, piece in pieces.items():
                # Not pure: Dask must not take it for a piece of an earlier run.
                question = makers, pickled_job, pickle.dumps(piece)
                future = client.submit(ask, *question, pure=False)
                numbers[future] = number
            completed = distributed.as_completed(list(numbers), loop=client.loop)
            while numbers:
                if not completed.has_ready():
                    look()
                    continue
                for future in completed.next_batch(block=False):
                    result, number = _result_of(future.result()), numbers.pop(future)
                    done += job.size(pieces[number])
                    progress(float(done))
                    yield number, result
    except lost as error:
        # Dask writes more, in lines of its own, where it lost its scheduler.
        why = (str(error) or type(error).__name__).splitlines()[0].rstrip(".")
        raise CableError(
            f"the cluster at {scheduler} gave up a piece of the work: {why}; the "
            "others are kept, and the same command goes on."
        ) from None


def answer_piece(makers: bytes, job: bytes, piece: bytes | None) -> Answer:
    """Return the result of a piece on this worker, or None and the reason for refusal.

    All arguments are pickled: `makers` is the client's provenance, `job` the names of
    allowed user code and the `Job`; without a `piece` the worker is only checked.
    """
    if why := _refusal_reason(makers, job):
        return None, why
    if piece is None:
        return None, ""
    return pickle.loads(job)[1].do(pickle.loads(piece), lambda share: None), ""


@lru_cache(maxsize=8)
def _refusal_reason(makers: bytes, job: bytes) -> str:
    theirs = pickle.loads(makers)
    other = provenance_differences({**theirs, "files": {}}, code_provenance())
    if not other:
        names, found = pickle.loads(job)
        user_code.allow(names)
        try:
            found.rehearse()
        except CableError as error:
            return f"cannot do its part: {error}"
        other = provenance_differences(theirs, found.made_by())
    return f"has other code, which differs in {', '.join(other)}" if other else ""


def _portable() -> Callable[..., tuple[str, Answer]]:
    """Return a function for `answer_piece` that pickles without this package."""

    # Nested, so that it is sent as it is and not by the name of its module.
    def ask(*question: Any) -> Any:
        try:
            from distributed import get_worker

            name = get_worker().address
        except (ImportError, ValueError):
            name = "of the cluster"
        try:
            from cc_mujoco._workers.cluster import answer_piece
        except Exception as error:
            return name, (None, f"cannot import this version of cc_mujoco ({error})")
        return name, answer_piece(*question)

    return ask


def _result_of(answer: Any, worker: str = "") -> Any:
    if isinstance(answer, BaseException):
        raise CableError(f"worker {worker} cannot take part: {answer}.")
    name, (result, why) = answer
    if why:
        raise CableError(
            f"worker {name} {why.rstrip('.')}; give every worker the same code and "
            "versions and start it anew."
        )
    return result


def _watchdog(client: Any, scheduler: str, patience: float) -> Callable[[], None]:
    """Return a 50 ms sleep that raises after `patience` [s] without any worker."""
    seen = next_poll = time.monotonic()

    def look() -> None:
        nonlocal seen, next_poll
        time.sleep(0.05)
        if (now := time.monotonic()) < next_poll:
            return
        next_poll = now + 1.0  # between two looks at whether there are workers [s]
        if client.nthreads():
            seen = time.monotonic()
        elif time.monotonic() - seen > patience:
            raise CableError(
                f"the cluster at {scheduler} has had no worker for {patience:g} s; "
                f"start one with `dask worker {scheduler}`, or give --worker-timeout "
                "more seconds."
            )

    return look


def _require_scheduler(distributed: Any, address: str) -> None:
    """Raise `CableError` soon if no scheduler answers; Dask's client waits long."""

    async def ask() -> Any:
        server = distributed.rpc(address, timeout=CONNECT_TIMEOUT)
        try:
            return await asyncio.wait_for(server.identity(), CONNECT_TIMEOUT)
        finally:
            await server.close_rpc()

    # In a thread, as this one may have a loop, in a notebook for example.
    with ThreadPoolExecutor(1) as pool:
        try:
            who = pool.submit(asyncio.run, ask()).result()
        except Exception as error:  # whatever a stranger's bytes make Dask raise
            silent = isinstance(error, (TimeoutError, OSError))
            why = "" if silent or isinstance(error, MemoryError) else f" ({error})"
            raise CableError(
                f"no Dask scheduler answers at {address}{why}; give the "
                "tcp://HOST:PORT that `dask scheduler` prints."
            ) from None
    kind = who.get("type") if isinstance(who, dict) else None
    if kind != "Scheduler":
        raise CableError(
            f"what answers at {address} is no Dask scheduler but a "
            f"{kind or 'stranger'}; give the tcp://HOST:PORT that `dask scheduler` "
            "prints."
        )
