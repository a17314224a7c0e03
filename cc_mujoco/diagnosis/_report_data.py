"""Contents of the report: measured and simulated signals, and maps of the error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from cc_mujoco.native import FloatArray

Model = Literal["before", "after"]
PREDICTED_CHANNELS = ("motor_torque_nm", "joint_torque_nm")
"""Channels that the model predicts, from both angles."""


@dataclass(frozen=True, eq=False)  # arrays have no truth to compare by
class TrialTrace:
    """One trial; arrays have one entry per compared sample.

    Attributes:
        trial: its name.
        time: (samples,) [s].
        motor_angle: as given to the model [rad].
        joint_angle: as given to the model [rad].
        measured: channel to readings, low-passed as the model's inputs are [N m].
        before: channel to the baseline's prediction by parameters that were fitted to
            other data [N m].
        after: the same of the model with the named effects [N m].
        counts: 1 where a sample counts; 0 in the run-in after the start.
    """

    trial: str
    time: FloatArray
    motor_angle: FloatArray
    joint_angle: FloatArray
    measured: Mapping[str, FloatArray]
    before: Mapping[str, FloatArray]
    after: Mapping[str, FloatArray]
    counts: FloatArray

    def error(self, channel: str, model: Model = "before") -> FloatArray:
        """Return the errors, measured minus simulated (samples,) [N m]."""
        played = self.before if model == "before" else self.after
        return self.measured[channel] - played[channel]


@dataclass(frozen=True)
class Map:
    """Mean error of a channel over one axis.

    Attributes:
        channel: `motor_torque_nm` or `joint_torque_nm`.
        axis: name of the quantity.
        unit: its unit.
        centre: (bins,) of the bins.
        before: (bins,) mean error of the baseline [N m], NaN where there are no data.
        after: (bins,) the same with the named effects.
        band: (bins,) half width within which chance keeps it in 95 % of cases [N m].
        share: of the variance of the baseline's error that the axis explains.
        chance: share that chance reaches in 5 % of cases.
    """

    channel: str
    axis: str
    unit: str
    centre: FloatArray
    before: FloatArray
    after: FloatArray
    band: FloatArray
    share: float
    chance: float


@dataclass(frozen=True)
class Isolability:
    """Similarity of two effects once the baseline is retuned.

    Attributes:
        ids: of the effects.
        cosines: (ids, ids) largest cosine between their signatures, 0 to 1.
        visible: (ids,) size of a plausible effect over the noise.
    """

    ids: tuple[str, ...]
    cosines: FloatArray
    visible: FloatArray


@dataclass(frozen=True)
class Evidence:
    """Everything that is drawn."""

    traces: tuple[TrialTrace, ...]
    maps: tuple[Map, ...]
    isolability: Isolability
