"""A cable on a dynamometer by equations of its own: capstan, Dahl, Coulomb.

A drive turns the joint to and fro while a current-controlled motor pulls the other end
of the cable. Friction turns round within a travel after each reversal (Dahl 1976) and
may exceed that of sliding until a little later. There is no mass and no motor angle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cc_mujoco.native import FloatArray

STEP = 0.002
CURRENT_STEP, CURRENT_NOISE, TORQUE_NOISE = 0.02, 0.03, 0.02
"""Digit and noise of the current, as torque at the joint, and noise there [N m]."""
ENCODER = 2.0 * math.pi / 2**14
_TURNED_WITHIN, _BREAKAWAY_TRAVEL = 0.015, (0.06, 0.16)


@dataclass(frozen=True)
class Dynamometer:
    """Hidden exponent, loss and drag at the joint, break-away and sensor faults."""

    exponent: float = 0.35
    loss: float = 0.15
    drag: float = 0.0
    breakaway: float = 0.0
    gain: float = 1.0
    zero: float = 0.0

    def record(
        self,
        seed: int,
        seconds: float = 30.0,
        stroke: float = 1.0,
        one_way: bool = False,
        constant_load: bool = False,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return joint angle, torque without loss and measured torque (samples,)."""
        random = np.random.default_rng(seed)
        time = np.arange(0.0, seconds, STEP)
        a, b, c, d = random.uniform(0.0, 6.0, 4)
        angle = 0.5 * np.sin(1.6 * time + a) + 0.25 * np.sin(0.7 * time + b)
        angle *= stroke
        load = 2.0 + 1.2 * np.sin(0.27 * time + c) + 0.5 * np.sin(0.11 * time + d)
        if one_way:
            angle = 0.2 * time + 0.02 * np.sin(time)
        if constant_load:
            load = 2.0 + 0.01 * np.sin(time)
        state, sign, travel = 0.0, 0.0, math.inf
        turned, more = np.zeros((2, time.size))
        for place, way in enumerate(np.diff(angle, prepend=angle[0])):
            if way != 0.0:
                travel = 0.0 if np.sign(way) == -sign else travel + abs(way)
                sign = np.sign(way)
                state += (sign - state) * (1.0 - math.exp(-abs(way) / _TURNED_WITHIN))
            turned[place] = state
            more[place] = _BREAKAWAY_TRAVEL[0] <= travel < _BREAKAWAY_TRAVEL[1]
        lost = load * (1.0 - np.exp(-self.exponent * turned)) + self.loss * turned
        lost *= 1.0 + self.breakaway * more
        torque = load - lost - self.drag * np.gradient(angle, STEP) + self.zero
        seen = load / self.gain + CURRENT_NOISE * random.normal(size=time.size)
        return (
            ENCODER * np.round(angle / ENCODER),
            CURRENT_STEP * np.round(seen / CURRENT_STEP),
            torque + TORQUE_NOISE * random.normal(size=time.size),
        )
