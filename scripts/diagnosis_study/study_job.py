"""Cases of a study as work for the library's executor: processes, or a Dask cluster.

A worker of a cluster needs this folder in its PYTHONPATH, beside the package, and the
same files in it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from diagnose_benchmark import run

from cc_mujoco._utils.provenance import code_provenance
from cc_mujoco._workers import Tick, run_here, run_on_cluster

HOME = Path(__file__).parent


@dataclass(frozen=True)
class Study:
    """Cases as a `_workers.Job`; a piece is a case, its result a record."""

    with_bic: bool = False  # whether every case is named by BIC, too

    def rehearse(self) -> None:
        """See `Job.rehearse`; what is imported is all there is to make."""

    def made_by(self) -> dict[str, Any]:
        """See `Job.made_by`: the library, and the files of this folder."""
        files = {
            path.relative_to(HOME).as_posix(): hashlib.sha256(
                path.read_bytes()
            ).hexdigest()
            for path in sorted(HOME.rglob("*.py"))
        }
        return {**code_provenance(), "files": files}

    def size(self, piece: Mapping[str, Any]) -> int:
        """Return the size of one case, 1."""
        return 1

    def do(self, piece: Mapping[str, Any], tick: Tick) -> dict[str, Any]:
        """Generate, diagnose and record a case; see `diagnose_benchmark.run`."""
        return run(dict(piece), self.with_bic)


def records(
    cases: Sequence[dict[str, Any]],
    with_bic: bool = False,
    jobs: int = 2,
    scheduler: str | None = None,
) -> Generator[dict[str, Any], None, None]:
    """Run cases, and yield their records as they are done, in no particular order.

    Args:
        cases: of `diagnose_benchmark.cases`.
        scheduler: address of a Dask scheduler whose workers run them instead.
    """
    job, pieces = Study(with_bic), dict(enumerate(cases))
    if scheduler is None:
        done = run_here(job, pieces, count=jobs, processes=True)
    else:
        done = run_on_cluster(job, pieces, scheduler)
    for _, record in done:
        yield record
