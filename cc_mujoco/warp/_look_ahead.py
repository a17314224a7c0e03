"""Ends that look ahead in a long step, see `plugin/_implicit_ends.py`.

Constraints are taken to act as in the step before.
"""

from __future__ import annotations

from copy import copy
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp
from numpy.typing import NDArray

from cc_mujoco.warp._implicit_kernels import add_forces, moment_row
from cc_mujoco.warp._paths import LedCables


class LookAhead:
    """Arrays with which the ends of cables look ahead."""

    def __init__(
        self,
        d: mjw.Data,
        rows: Any,
        fresh: Any,
        ends: NDArray[np.int32],
        kernel: Any,
        led: LedCables | None,
    ) -> None:
        """Make the arrays.

        `fresh` is not 0 where a cable has not taken a step yet (rows,), `ends` is what
        each actuator holds, see `add_forces`, and `led` are those that a tendon leads.
        """
        self._rows, self._fresh, self._led = rows, fresh, led
        self.kernels = {
            "add_forces": add_forces, "moment_row": moment_row, "look_ahead": kernel
        }  # fmt: skip
        self._count, worlds = rows.segments.shape[0], int(d.nworld)
        nv, device = d.qfrc_passive.shape[1], d.time.device
        self._right = wp.zeros((worlds, nv), dtype=float, device=device)
        self._found = wp.zeros_like(self._right)
        self._answers = wp.zeros(
            (2 * self._count, worlds, nv), dtype=float, device=device
        )
        self._ends = wp.array(ends, dtype=int, device=device)
        # Inertia with the damping that the integrator takes implicitly, factors.
        self._inertia = [wp.zeros_like(a) for a in (d.M, d.qLD, d.qLDiagInv)]

    def aim(self, m: mjw.Model, d: mjw.Data) -> None:
        damped, rows, worlds = copy(d), self._rows, int(d.nworld)
        damped.M, damped.qLD, damped.qLDiagInv = self._inertia
        if int(m.opt.integrator) == mujoco.mjtIntegrator.mjINT_EULER:
            wp.copy(damped.M, d.M)
        else:
            mjw.deriv_smooth_vel(m, d, damped.M)
        mjw.factor_m(m, damped)
        moments = moments_of(d)
        given = [
            rows, self._ends, self._fresh, *moments, d.qfrc_passive, d.qfrc_bias,
            d.qfrc_applied, d.qfrc_constraint, d.actuator_force, self._right,
        ]  # fmt: skip
        wp.launch(add_forces, worlds, given, device=d.time.device)
        if self._led is not None:
            self._led.pull(rows, False, m, d, self._right)
        mjw.xfrc_accumulate(m, d, self._right)
        mjw.solve_m(m, damped, self._found, self._right)
        for cable in range(self._count):
            for end in range(2):
                given = [rows, cable, end, *moments, self._right]
                wp.launch(moment_row, worlds, given, device=d.time.device)
                mjw.solve_m(m, damped, self._answers[2 * cable + end], self._right)
        given = [rows, m.opt.timestep, *moments, self._answers, self._found]
        given.append(d.actuator_velocity)
        kernel, size = self.kernels["look_ahead"], (self._count, worlds)
        wp.launch(kernel, size, given, device=d.time.device)


def moments_of(d: mjw.Data) -> list[Any]:
    return [d.moment_rownnz, d.moment_rowadr, d.moment_colind, d.actuator_moment]
