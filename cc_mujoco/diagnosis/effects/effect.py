"""Effect: where it acts, its parameters, how it changes a simulation."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from cc_mujoco.compiled import FloatArray
from cc_mujoco.transmission import PARAMETERS, Cable, Parameter

Values = Mapping[str, float]

_OF_CABLES = {parameter.name: parameter for parameter in PARAMETERS}

ANTAGONIST = "antagonist"
"""In the names of parameters that are the second cable's of a pair."""
PLUGIN = "keys of the cable plugin"
"""How MuJoCo has what acts in the cables."""


class EffectParameter(NamedTuple):
    """One parameter of an effect and what is known of its size; 0 is off.

    Attributes:
        parameter: its descriptor, with the bounds of fits; logarithmic where it cannot
            be 0 and only shapes the effect.
        typical: size that is plausible on a rig; the scale of fits.
        plausible: least and largest value that the effect can stand for; what fits only
            beyond is not named.
        of: what `plausible` is a share of: the joint's range of motion, the motor's
            radius, the largest torque, the elongation of the scene's cable per tension,
            or nothing.
        ordinary: size that any rig may have without being told, a share of
            `ordinary_of`; what is no larger belongs into the model, but is not called
            missing.
        ordinary_of: the elongation of the cable per tension, or the pretension (of
            the friction per length times the length of the conduit).
        beside: whether it may come with the effect, but is no size of it: where that of
            the others is 0 there is no such effect.
    """

    parameter: Parameter
    typical: float
    plausible: tuple[float, float] = (-math.inf, math.inf)
    of: Literal[
        "", "motion", "motor_radius", "motor_torque", "joint_torque", "cable"
    ] = ""
    ordinary: float = 0.0
    ordinary_of: Literal["", "cable", "pretension", "pretension per length"] = ""
    beside: bool = False

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return self.parameter.name

    @property
    def unit(self) -> str:
        """Unit of the parameter."""
        return self.parameter.unit

    @property
    def linear(self) -> bool:
        """Return whether 0 is off; what cannot be 0 only shapes the effect."""
        return self.parameter.scale == "linear"

    @property
    def size(self) -> bool:
        """Return whether it is one of the sizes by which the effect is known."""
        return self.linear and not self.beside


@dataclass(frozen=True)
class Torques:
    """Signals of one record (samples,): motion given, torques simulated [SI].

    Attributes:
        dt: time between samples.
        time: since the start of the trial.
        motor_angle: of the motor.
        joint_angle: of the joint as it is measured; of a lever as the scene has it.
        motor: torque that the motor puts into its pulley.
        joint: torque that the transmission puts into the joint.
        tilt: angle by which the rig was turned about the joint's axis.
    """

    dt: float
    time: FloatArray
    motor_angle: FloatArray
    joint_angle: FloatArray
    motor: FloatArray
    joint: FloatArray
    tilt: float = 0.0

    def added(
        self, motor: FloatArray | float = 0.0, joint: FloatArray | float = 0.0
    ) -> Torques:
        """With something added to the torques [Nm]."""
        return replace(self, motor=self.motor + motor, joint=self.joint + joint)


class RigGeometry(NamedTuple):
    """Properties of the rig that an effect may need."""

    motor_radius: float
    joint_radius: float
    exit_angle: float


@dataclass(frozen=True, kw_only=True)
class Effect:
    """One physical effect.

    Attributes:
        id: its name in `verdict.json`.
        title: what a person calls it.
        equation: what it adds.
        where: the part of the rig it sits in.
        parameters: its parameters.
        starts: values from which it is screened and fitted; several where the answer
            depends on a scale that the data must tell.
        required_excitation: what a recording needs to show it.
        confounded_with: ids that it is easily confused with.
        generalises: ids that are special cases of it; where one of them does as well,
            this one is no rival.
        form_of: ids of effects whose form it has on some rigs, so that they are not
            told apart by how well they fit.
        mujoco: how a scene has it.
        source: publication.
        cables: the cables with the effect, agonist first.
        torques: the signals with the effect, in the order motor, joint, sensors.
        sensor: whether it belongs to a sensor and so comes after the mechanical ones.
    """

    id: str
    title: str
    equation: str
    where: Literal["conduit", "motor", "joint", "sensor"]
    parameters: tuple[EffectParameter, ...]
    starts: tuple[Values, ...]
    required_excitation: str
    confounded_with: tuple[str, ...]
    mujoco: str
    source: str
    cables: (
        Callable[[tuple[Cable, ...], Values, RigGeometry], tuple[Cable, ...]] | None
    ) = None
    torques: Callable[[Torques, Values], Torques] | None = None
    sensor: bool = False
    generalises: tuple[str, ...] = ()
    form_of: tuple[str, ...] = ()

    def confused(self, other: Effect) -> bool:
        """Return whether either is easily confused with the other."""
        return other.id in self.confounded_with or self.id in other.confounded_with


def on_both(*names: str) -> Callable[..., tuple[Cable, ...]]:
    """Return the same parameters on every cable."""

    def cables(
        given: tuple[Cable, ...], values: Values, _: RigGeometry
    ) -> tuple[Cable, ...]:
        changes = {name: values[name] for name in names}
        return tuple(cable.replace(**changes) for cable in given)

    return cables


def of_cable(name: str, low: float, high: float, called: str = "") -> Parameter:
    """Return the descriptor of a parameter of the cable for fits of an effect.

    Args:
        name: of the cable's parameter.
        low: lower bound of fits; above 0, it is fitted as a logarithm.
        high: upper bound of fits.
        called: its name in the effect, if that is another.
    """
    return replace(
        _OF_CABLES[name],
        name=called or name,
        low=low,
        high=high,
        low_open=False,
        scale="log" if low > 0.0 else "linear",
    )


def limited(name: str, value: float) -> float:
    """The value nearest to one that a parameter of a cable can have.

    Args:
        name: of the cable's parameter.
        value: what the sizes of effects and the baseline come to, at bounds of a fit.
    """
    known = _OF_CABLES[name]
    return min(max(value, known.low), known.high)
