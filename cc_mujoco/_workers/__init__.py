"""Parallel work in pieces, on this machine or on the workers of a Dask cluster.

    for number, result in run_here(job, pieces, count=2, processes=True):
        keep(number, result)

A piece's result depends on the piece only, not on where it is computed.
"""
