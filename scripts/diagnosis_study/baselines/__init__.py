"""Naive ways to name a missing effect, to compare `cc-mujoco diagnose` with.

Every way starts from the same tuned baseline and differs only in how it names:

    from baselines import METHODS

    for method, guess in METHODS.items():
        print(method, guess(result.baseline_fit).named)

`binned` regresses the binned residual on what an effect would look like, `sparse` does
a sparse regression of the residual on all of them at once, `bic` refits every effect to
all data. None holds data out.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec

from baselines.methods import Guess, bic, binned, sparse
from cc_mujoco.diagnosis import BaselineFit

METHODS: dict[str, Callable[[BaselineFit], Guess]] = {
    "binned": binned,
    "sparse": sparse,
    "bic": bic,
}


def installed() -> dict[str, Callable[[BaselineFit], Guess]]:
    """Return the methods that can run: `sparse` needs pysindy."""
    there = find_spec("pysindy") is not None
    return {name: way for name, way in METHODS.items() if name != "sparse" or there}
