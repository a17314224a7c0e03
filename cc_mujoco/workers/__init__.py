"""Long work in pieces, on this machine or on the workers of a Dask cluster.

    for number, result in run_here(job, pieces, count=2, processes=True):
        keep(number, result)

A piece's result depends on nothing but the piece, so that the place changes no bit.
"""

from __future__ import annotations

from cc_mujoco.workers.cluster import WORKER_TIMEOUT, run_on_cluster
from cc_mujoco.workers.here import run_here
from cc_mujoco.workers.job import Job, Progress, Tick

__all__ = ["WORKER_TIMEOUT", "Job", "Progress", "Tick", "run_here", "run_on_cluster"]
