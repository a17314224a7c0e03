"""A walking policy: muscles of two legs that stand on the ground.

    policy = WalkingPolicy.read(path)
    walker = WalkingController(policy, worlds=1)
    control = walker.act(senses, period=0.005)       # (worlds, legs, joints) [N m]

Legs are right and left, joints hip, knee and ankle. The muscles of a joint act as

    torque = K (angle_d - angle) + D (rate_d - rate) + torque_d

where angle_d, rate_d and the feed-forward torque_d are Fourier series in the phase of
the gait, which start from a measured walk. Feedback keeps the balance: the stance hip
holds the trunk, the swing hip places the foot by speed and position of the body, and
the trailing ankle pushes more below the desired speed. A step ends when the swing foot
strikes the ground, not at a given time. Balance by stance hip and foot placement
is that of K. Yin, K. Loken, M. van de Panne, "SIMBICON: simple biped locomotion
control", ACM Transactions on Graphics 26, 2007.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cc_mujoco._utils import safetensors
from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco.errors import CableError
from cc_mujoco.human._gait import Harmonics
from cc_mujoco.native import FloatArray as Array

WALKING_SIDES = ("right", "left")
WALKING_JOINTS = ("hip", "knee", "ankle")
MUSCLE_PERIOD = 0.004  # time between two commands to the muscles [s]


@dataclass(frozen=True, eq=False)
class WalkingPolicy:
    """Parameters of a walking policy; joints are in the order of `WALKING_JOINTS`."""

    stiffness: Array  # K of the joints (3,) [N m/rad]
    damping: Array  # D of the joints (3,) [N m s/rad]
    angles: Array  # desired ones (3, terms, 2) [rad], see `Harmonics.coefficients`
    torques: Array  # fed forward (3, terms, 2) [N m]
    stride_time: float  # desired duration of a stride [s]
    trunk_stiffness: float  # torque of the hips against the trunk's pitch [N m/rad]
    trunk_damping: float  # torque of the hips against its rate [N m s/rad]
    trunk_pitch: float  # desired pitch [rad]
    speed: float  # desired speed [m/s]
    speed_gain: float  # flexion of the swing hip per speed above the desired [rad s/m]
    foot_gain: float  # hip angle per position of hip ahead of stance ankle [rad/m]
    push_gain: float  # growth of the trailing ankle's torque per lacking speed [s/m]

    @classmethod
    def read(cls, path: str | Path) -> WalkingPolicy:
        """Read a policy from a safetensors file."""
        try:
            tensors, _ = safetensors.from_bytes(Path(path).read_bytes())
            numbers: dict[str, Any] = {f.name: tensors[f.name] for f in fields(cls)}
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise CableError(
                f"{str(path)!r} is no walking policy that `WalkingPolicy.write` wrote: "
                f"{type(error).__name__} {error}."
            ) from None
        for name, each in numbers.items():
            numbers[name] = each if each.ndim else float(each)
        return cls(**numbers)

    def write(self, path: str | Path) -> None:
        """Write the policy to a safetensors file."""
        tensors = {field.name: getattr(self, field.name) for field in fields(self)}
        with replacing(Path(path)) as file:
            file.write_bytes(safetensors.to_bytes(tensors, {"kind": "walking policy"}))

    def desired(self, phase: Array) -> tuple[Array, Array, Array]:
        """Return angles [rad], rates [rad/s], torques [N m] by phase (phases, 3)."""
        angles = [Harmonics(tuple(map(tuple, series))) for series in self.angles]
        torques = [Harmonics(tuple(map(tuple, series))) for series in self.torques]
        rates = [angle.derivative()(phase) / self.stride_time for angle in angles]
        desired = [one(phase) for one in angles], rates, [one(phase) for one in torques]
        angle, rate, torque = (np.array(values).T for values in desired)
        return angle, rate, torque

    def table(self) -> Array:
        """Return torques of hip, knee, ankle, push-off [N m], by phase (512, 4)."""
        angle, rate, torque = self.desired(np.arange(512) / 512)
        control = self.stiffness * angle + self.damping * rate + torque
        return np.column_stack((control, torque[:, 2]))


class Senses(NamedTuple):
    """States of the person that the policy receives: NumPy or PyTorch arrays."""

    angles: Any  # angles of the joints (worlds, legs, joints) [rad]
    pitch: Any  # pitch of the trunk (worlds,), positive forwards [rad]
    pitch_rate: Any  # its rate (worlds,) [rad/s]
    speed: Any  # speed of the trunk (worlds,) [m/s]
    load: Any  # force of the ground on the feet over the weight (worlds, legs) [-]


class WalkingController:
    """Walking policies of people in several worlds.

    Attributes:
        step: fraction of the present step that has passed (worlds,) [-].
        lead: leg whose foot struck last (worlds,), 0 for the right one.
        struck: True for worlds in which a foot struck in the last `act` (worlds,).
    """

    def __init__(
        self,
        policies: WalkingPolicy | Sequence[WalkingPolicy],
        worlds: int,
        arrays: Any = np,
        **placement: Any,
    ) -> None:
        """Tabulate the policies, one for all worlds or one for each.

        `arrays` is the array module, `numpy` or `torch`; `placement` is the `dtype`
        and, with PyTorch, the `device` of all arrays.
        """
        each = [policies] if isinstance(policies, WalkingPolicy) else list(policies)
        own = arrays.arange(worlds) if len(each) > 1 else arrays.zeros(worlds)
        place = {key: placement[key] for key in placement if key == "device"}
        self._arrays = arrays
        self._world = arrays.asarray(own, dtype=arrays.int64, **place)[:, None]

        def numbers(name: str) -> Any:
            return arrays.asarray([getattr(one, name) for one in each], **placement)

        table = np.array([policy.table() for policy in each])
        self._table = arrays.asarray(table, **placement)
        self._policy = {
            field.name: numbers(field.name)
            for field in fields(WalkingPolicy)
            if isinstance(getattr(each[0], field.name), float)
        }
        stiffness = np.array([policy.stiffness[0] for policy in each])
        self._hip = arrays.asarray(stiffness, **placement)
        self._legs = arrays.asarray([[0.0, 1.0]], **placement)
        self.step = arrays.zeros(worlds, **placement)
        self.lead = arrays.zeros(worlds, **placement)
        self.struck = self.lead > 1.0

    @property
    def phase(self) -> Any:
        """Phase of the gait cycle of the legs (worlds, legs), 0 at heel strike."""
        return 0.5 * self.step[:, None] + 0.5 * (1.0 - self._leads())

    @property
    def ended(self) -> Any:
        """True for legs whose stride ended in the last `act` (worlds, legs)."""
        return self.struck[:, None] & (self._leads() > 0.5)

    def _leads(self) -> Any:
        """Return 1 for the leg whose foot struck last, else 0 (worlds, legs)."""
        return 1.0 - abs(self._legs - self.lead[:, None])

    def act(self, senses: Senses, period: float) -> Any:
        """Return the control of the muscles (worlds, legs, joints) [N m].

        The torque of a muscle is its control - K angle - D rate. `senses` are the
        present states, `period` is the time since the last call [s].
        """
        arrays, policy = self._arrays, self._policy
        swinging = 1.0 - self._leads()
        self.step = self.step + 2.0 * period / policy["stride_time"]
        # A foot has struck with 5 % of the body's weight.
        landed = arrays.sum(swinging * senses.load, 1) > 0.05
        # The toes of the swinging foot leave the ground in the first 60 % of a step.
        self.struck = (self.step > 0.6) & landed
        self.step = arrays.where(self.struck, 0.0 * self.step, self.step)
        self.step = arrays.clip(self.step, None, 0.999)
        self.lead = arrays.where(self.struck, 1.0 - self.lead, self.lead)
        leads = self._leads()
        swinging = 1.0 - leads
        rows = arrays.asarray(self.phase * self._table.shape[1], dtype=arrays.int64)
        row = self._table[self._world, rows]
        tilt = senses.pitch - policy["trunk_pitch"]
        righting = policy["trunk_damping"] * senses.pitch_rate
        lean = policy["trunk_stiffness"] * tilt + righting
        thigh = senses.angles[:, :, 0] - senses.pitch[:, None]
        shank = thigh + senses.angles[:, :, 1]
        # 0.429 m and 0.431 m: thigh and shank of the scene
        behind = 0.429 * arrays.sin(thigh) + 0.431 * arrays.sin(shank)
        ahead = -arrays.sum(leads * behind, 1)
        missing = policy["speed"] - senses.speed
        place = policy["foot_gain"] * ahead * self.step - policy["speed_gain"] * missing
        place = self._hip * place * arrays.clip(3.0 * self.step, None, 1.0)
        hip = row[:, :, 0] - arrays.clip(senses.load, None, 1.0) * lean[:, None]
        hip = hip + swinging * place[:, None]
        push = arrays.clip(policy["push_gain"] * missing, -0.5, 1.0)
        ankle = row[:, :, 2] + row[:, :, 3] * push[:, None]
        return arrays.stack((hip, row[:, :, 1], ankle), 2)


class ExpectedHelp:
    """Torques that people expect of an exoskeleton, by phase of the gait cycle.

    With each strike of a foot the expectation of its leg moves by 0.3 of the way
    (assumed) to the mean torque observed in each of 50 parts of the stride.
    """

    def __init__(self, worlds: int, arrays: Any = np, **placement: Any) -> None:
        """Start with no expected torque; see `WalkingController` for the arguments."""
        place = {key: placement[key] for key in placement if key == "device"}
        self._arrays = arrays
        self._world = arrays.arange(worlds, **place)[:, None]
        self._leg = arrays.arange(2, **place)[None, :]
        self._expected, self._felt, self._count = (
            arrays.zeros((worlds, 2, 50), **placement) for _ in range(3)
        )

    def _bins(self, phase: Any) -> Any:
        part = phase * self._count.shape[2]
        part = self._arrays.asarray(part, dtype=self._arrays.int64)
        return self._world, self._leg, part

    def at(self, phase: Any) -> Any:
        """Return the torques expected at phases, both (worlds, legs) [N m]."""
        return self._expected[self._bins(phase)]

    def observe(self, phase: Any, torque: Any) -> None:
        """Record torques at phases, both (worlds, legs) [N m], until `learn`."""
        bins = self._bins(phase)
        self._felt[bins] += torque
        self._count[bins] += 1.0

    def learn(self, ended: Any) -> None:
        """Update expectations of the legs whose stride `ended` (worlds, legs)."""
        arrays = self._arrays
        mean = self._felt / arrays.clip(self._count, 1.0, None)
        news = (self._count > 0.0) & ended[:, :, None]
        moved = self._expected + 0.3 * (mean - self._expected)
        self._expected = arrays.where(news, moved, self._expected)
        going = 1.0 - 1.0 * ended[:, :, None]  # 0 where a stride ended
        self._felt, self._count = self._felt * going, self._count * going

    def forget(self, worlds: Any) -> None:
        """Reset what `worlds`, an index or a mask, have learned or recorded to zero."""
        for table in (self._expected, self._felt, self._count):
            table[worlds] = 0.0
