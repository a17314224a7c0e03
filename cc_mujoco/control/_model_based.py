"""Friction compensation by a model of the cables, with feedback (thesis 4.2, Fig. 4.3).

>>> from cc_mujoco.device._drive import Drive, CableDrive
>>> from cc_mujoco.control import ModelBased
>>> from cc_mujoco.cable import Cable, Section
>>> cable = Cable(friction=0.1, conduit=(Section(2.0, 0.5),))
>>> pair = (CableDrive(cable, -0.02, -0.1), CableDrive(cable, 0.02, 0.1))
>>> law = ModelBased(Drive(5.0, -1.0, 1.0, 0.001, cables=pair))
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from cc_mujoco._validation import require_number
from cc_mujoco.control import _law_steps as law_steps
from cc_mujoco.control._cable_model import pack, require_known_cables
from cc_mujoco.control._controller import LawTables, SteppedLaw, cable_shape
from cc_mujoco.control._feedback import ProportionalIntegral, stable_settling_time
from cc_mujoco.device._drive import Drive
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray

Mismatch = float | Callable[[Any], Any]


class ModelBased(ProportionalIntegral):
    r"""Model-based: friction of the moving cables is fed forward; with PI feedback.

    \[ \tau_m = -\sum_i r_i\, C_i T_i + \frac{1}{\rho}
       \Bigl( K_p e + K_i \int e \, dt \Bigr) \]

    with the distal tensions \(T_i\) that make the desired torque, the signed arms
    \(r_i\) of the proximal ends [m/rad], and the ratio \(C_i\) of proximal to distal
    tension when cable i last slipped as a whole. All are those of the model that
    follows the device (`CableModel`). Friction is in proportion to tension, so it
    multiplies instead of being added (thesis 4.2). After a reversal \(C_i\) keeps its
    value until the whole cable moves; until then feedback has to correct the error.

    A step of the desired torque would drive a motor with inertia through the backlash
    and beyond. So its speed relative to the joint is damped, by the stiffness of the
    cables at the motor times T, so that it settles in about that time. The thesis has
    no inertia and needs none of this.
    """

    unread_gains = frozenset({"feed_forward", *law_steps.SPRING_GAINS})
    """Gains that no law with a model reads."""
    stepped = SteppedLaw(
        law_steps.step_model_based,
        law_steps.store_model,
        has_model=True,
        unread=unread_gains | {"preview", "tolerance"},
        gains=law_steps.FEEDBACK,
    )
    kind = law_steps.MODEL  # law in `_law_steps.model_torque`

    def __init__(
        self,
        drive: Drive,
        proportional: float = 1.0,
        integral: float = 2.0,
        mismatch: Mismatch = 0.0,
        settling: float = 0.03,
    ) -> None:
        """Prepare for the first episode.

        Args:
            drive: The device to be driven; its `cables` must be known.
            proportional: Gain of the torque error, Kp [-].
            integral: Gain of its integral, Ki [1/s].
            mismatch: Deliberate relative error of the model's friction, above -1; or a
                function of the time since the reset [s] that gives it.
            settling: Time T in which a damper settles the motor [s]; 0 where it has no
                inertia. It is less where the damping, times period and motor lag, would
                exceed 0.8 of a known inertia: with a delay of one period, 1 is the edge
                of stability. It is 0 where the motor swings so fast that damping would
                drive the swing.

        Raises:
            CableError: If the cables are not known, a gain is negative, or a constant
                mismatch makes friction negative.
        """
        super().__init__(drive, proportional, integral)
        if not (callable(mismatch) or (np.isfinite(mismatch) and mismatch > -1.0)):
            raise CableError(
                f"mismatch is {mismatch!r}; it must be a number above -1 or a function "
                "of time"
            )
        require_number("settling", settling, 0.0, 10.0, "s")
        require_known_cables(drive)
        self.mismatch = mismatch
        self._played: list[tuple[int, float]] = []
        """Steps since the reset and factor on the model's friction, by environment."""
        self.settling = stable_settling_time(drive, self.spring, settling)

    def law_tables(self) -> LawTables:
        shape = cable_shape(self.drive.cables)
        states, size = law_steps.places(np.array(shape))
        return LawTables(shape, (), size, (law_steps.LAST_COMMAND,), states)

    def answer(self, seen: FloatArray) -> FloatArray:
        if not (self.mismatch or self._played):
            return super().answer(seen)
        memory, found = self.memory(len(seen)), np.empty(len(seen))
        if len(self._played) != len(seen):
            self._played = [(0, 1.0)] * len(seen)
        for row, (own, read) in enumerate(zip(memory, seen, strict=True)):
            if own[law_steps.FIRST_STEP] != 0.0:
                self._scale_friction(row, 1.0)
                self._played[row] = 0, 1.0
            data = law_steps.LawData(own, self._shape, self._numbers, read)
            law_steps.follow_model(data)
            error: Any = self.mismatch
            if callable(error):
                error = error(self._played[row][0] * self.drive.period)
            self._scale_friction(row, 1.0 + error)
            self._played[row] = self._played[row][0] + 1, 1.0 + error
            found[row] = law_steps.model_torque(data, self.kind)
        return found

    def _scale_friction(self, row: int, factor: float) -> None:
        if self._played and factor == self._played[row][1]:
            return
        own = law_steps.model_memory(self._memory[row], self._shape)
        cables = [one.cable for one in self.drive.cables]
        for prm, cable in zip(own.cables.prm, cables, strict=True):
            values, sections = np.array(cable.scalars), np.array(cable.conduit, float)
            changed = np.empty_like(values)
            pack(values, sections, cable.segments, factor, True, changed, prm)


class StictionCompensation(ModelBased):
    r"""Model-based with stiction compensation: partial motion is crossed at once.

    As long as part of a cable sticks, the motor gives the torque at which equation 2.7
    fails at every sticking node, so that the whole cable follows at once (thesis,
    listing 4.1). The thesis does not say in which direction. Here it is the sign of

    \[ \tau_d - \tau_j + \kappa\, h\, \dot\theta_j \]

    the torque that is missing, plus that by which the motion of the joint, within the
    time h, would change the torque of the cables, with their stiffness \(\kappa\) at
    the joint. The direction reverses only when this exceeds the tolerance the other
    way. Otherwise the motor would chatter, crossing the whole backlash with the noise.
    """

    stepped = dataclasses.replace(
        ModelBased.stepped, step=law_steps.step_stiction, unread=ModelBased.unread_gains
    )
    kind = law_steps.STICTION

    def __init__(
        self,
        drive: Drive,
        *given: Any,
        preview: float = 0.02,
        tolerance: float | None = None,
        **settings: Any,
    ) -> None:
        """Prepare for the first episode.

        `preview` is the time h over which the motion of the joint is extrapolated [s],
        `tolerance` the torque at the joint below which the direction does not reverse
        [N m], by default 1 % of the greatest; others are those of `ModelBased`.

        Raises:
            CableError: As `ModelBased`, or a preview or tolerance that is negative.
        """
        super().__init__(drive, *given, **settings)
        most = abs(drive.ratio) * max(abs(drive.low), abs(drive.high))
        self.preview = preview
        self.tolerance = 0.01 * most if tolerance is None else tolerance
        require_number("preview", self.preview, 0.0, 10.0, "s")
        require_number("tolerance", self.tolerance, 0.0, 1e6, "N m")


class DisturbanceObserver(ModelBased):
    r"""Model-based with a disturbance observer of what the model does not explain.

    \[ \tau_m = u_r + \frac{\omega_c}{s + \omega_c}
       \bigl( \tau_m - \hat\tau_m \bigr) \]

    with the torque \(u_r\) of `ModelBased`, the torque \(\tau_m\) applied before and
    the torque \(\hat\tau_m\) that the model needs to explain motor angle and joint
    torque. Their difference is the friction beyond the model, and the torque that
    accelerates the rotor; the low-pass suppresses sensor noise (thesis 4.2, Fig. 4.2).
    """

    stepped = dataclasses.replace(ModelBased.stepped, step=law_steps.step_disturbance)
    kind = law_steps.DISTURBANCE

    def __init__(
        self, drive: Drive, *given: Any, cutoff: float = 3.0, **settings: Any
    ) -> None:
        """Prepare for the first episode.

        `cutoff` is that of the low-pass [Hz]; others are those of `ModelBased`.

        Raises:
            CableError: As `ModelBased`, or a cut-off that is not positive.
        """
        super().__init__(drive, *given, **settings)
        require_number("cutoff", cutoff, 1e-6, 0.5 / drive.period, "Hz")
        self.share = -math.expm1(-2.0 * math.pi * cutoff * drive.period)
        """Share of a new value in the disturbance."""

    def law_tables(self) -> LawTables:
        own = super().law_tables()
        size = own.size + law_steps.LACK_SIZE
        return own._replace(numbers=(self.share,), size=size)
