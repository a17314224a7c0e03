"""Torque profile that assists the ankle: four numbers that a search can vary.

>>> from cc_mujoco.human._profile import Profile
>>> Profile(peak_time=50.0, peak_torque=20.0).torque(0.0, 0.0, phase=0.5)
-20.0
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._validation import bounded
from cc_mujoco.errors import CableError
from cc_mujoco.human._pace import TOE_OFF, Real
from cc_mujoco.human._tasks import Task


@dataclass(frozen=True)
class Profile(Task):
    """Plantarflexion torque that rises from its onset to a peak and ends by toe-off.

    Two cubics join onset, peak and end, with zero slope at each (assumed). The torque
    is 0 outside, and negative, as the ankle counts dorsiflexion positive. Times are in
    per cent of the stride from heel strike. Peak torque, peak time, rise time (here
    `peak_time` - `onset`) and fall time are the parameters of J. Zhang et al.,
    "Human-in-the-loop optimization of exoskeleton assistance during walking", Science
    356, 2017, pp. 1280-1284. With its defaults the shape is that of `Assist` within 2 %
    of the peak (RMS over the stride).
    """

    of_phase = True
    onset: float = bounded(30.5, 0.0, 100.0, "% of the stride")
    """Time at which the torque begins [% of the stride]."""
    peak_time: float = bounded(53.4, 0.0, 100.0, "% of the stride")
    """Time at which it is largest [% of the stride]."""
    peak_torque: float = bounded(30.0, 0.0, 1e3, "N m")
    """Largest absolute torque [N m]."""
    fall: float = bounded(11.9, 0.1, 100.0, "% of the stride")
    """Time from the peak to where it ends [% of the stride]."""
    toe_off: float = bounded(100.0 * TOE_OFF, 1.0, 100.0, "% of the stride")
    """Time at which the foot leaves the ground, the latest end [% of the stride]."""

    def __post_init__(self) -> None:
        """Refuse parameters that give no profile; the error says what is possible."""
        super().__post_init__()
        if not self.peak_time - self.onset >= 0.1:
            raise CableError(
                f"the torque begins at {self.onset:g} % of the stride and peaks at "
                f"{self.peak_time:g} %; `onset` must be 0.1 % or more before "
                "`peak_time`."
            )
        if not self.end <= self.toe_off:
            left = self.toe_off - self.peak_time
            way = (
                f"`fall` must be at most {left:.3g} %"
                if left >= 0.1
                else f"`peak_time` must be below {self.toe_off - 0.1:.3g} %"
            )
            raise CableError(
                f"the torque ends at {self.end:.4g} % of the stride, after toe-off at "
                f"{self.toe_off:.3g} %; {way}."
            )

    @property
    def end(self) -> float:
        """Time at which the torque is 0 again [% of the stride]."""
        return self.peak_time + self.fall

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        peak, end = self.peak_time, self.end
        found: Real = _profile_torque(phase, self.onset, peak, end, self.peak_torque)
        return found


class Profiles(Task):
    """Profile of each of n devices, with the same bits as one device's `Profile`."""

    of_phase = True

    def __init__(self, profiles: Sequence[Profile]) -> None:
        names = ("onset", "peak_time", "end", "peak_torque")
        self._rows = [np.array([getattr(p, name) for p in profiles]) for name in names]

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        found: Real = _profile_torque(phase, *self._rows)
        return found


def _profile_torque(phase: Any, onset: Any, peak: Any, end: Any, size: Any) -> Any:
    now = 100.0 * phase
    since, left = (now - onset) / (peak - onset), (end - now) / (end - peak)
    near: NDArray[np.float64] = np.minimum(np.minimum(since, left), 1.0)
    x = np.maximum(near, 0.0)
    torque = -size * (x * x * (3.0 - 2.0 * x)) + 0.0
    return torque if isinstance(torque, np.ndarray) else float(torque)
