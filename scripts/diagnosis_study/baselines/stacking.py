"""Samples of all records that count, side by side, each over its noise floor.

Residual and features are weighted like the errors of every fit, so that the naive ways
differ from the diagnosis in how they name and in nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from baselines.features import Signal
from baselines.signals import Signals
from cc_mujoco.diagnosis import huber_residual, low_pass
from cc_mujoco.native import FloatArray


def gathered(
    records: Sequence[Signals], of: Callable[[Signals], FloatArray]
) -> FloatArray:
    """Return a signal where samples count, one record after the other (samples,)."""
    return np.concatenate([of(s)[s.counts] for s in records])


def weights(records: Sequence[Signals], channel: int) -> FloatArray:
    """Return one over the noise floor of a channel (samples,) [1/N m]."""
    return 1.0 / gathered(records, lambda s: s.floor[channel])


def errors(records: Sequence[Signals], channel: int) -> FloatArray:
    """Return a channel's residual over its floor, without offset (samples,)."""
    residual = gathered(records, lambda s: s.residual[channel] / s.floor[channel])
    return _levelled(huber_residual(residual), weights(records, channel))


def column(records: Sequence[Signals], of: Signal, channel: int) -> FloatArray:
    """Return a feature over the floor, low-passed like torques, levelled (samples,)."""

    def passed(s: Signals) -> FloatArray:
        signal = low_pass(of(s, channel), s.band, 1.0 / s.dt)
        return signal / s.floor[channel]

    return _levelled(gathered(records, passed), weights(records, channel))


def _levelled(values: FloatArray, weight: FloatArray) -> FloatArray:
    """Remove the effect of a torque offset, which the baseline has tuned."""
    unit = weight / np.linalg.norm(weight)
    return values - unit * (unit @ values)
