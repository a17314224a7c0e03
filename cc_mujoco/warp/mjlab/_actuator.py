"""Motors of mjlab that pull joints through Bowden cables."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import mujoco
import torch
import warp as wp
from mjlab.actuator.actuator import Actuator, ActuatorCfg, ActuatorCmd, TransmissionType
from mjlab.utils.spec import create_motor_actuator

from cc_mujoco.cable import Cable
from cc_mujoco.errors import CableError
from cc_mujoco.warp import AttachedCables, HeldCable, add_end, attach


@dataclass(frozen=True, kw_only=True)
class DrivenCable:
    """Cable from the drum of a motor to a joint."""

    cable: Cable
    """Conduit, friction and stiffness; its bends stay (`bend="fixed"`)."""
    motor: str
    """Joint of the motor, in the specification of the entity."""
    drum: float
    """Radius on which a positive turn of the motor winds the cable up [m]; negative if
    a negative turn does."""
    joint: str | None = None
    """Joint with a round pulley that the cable drives."""
    pulley: float | None = None
    """Radius of that pulley [m]; the cable pulls `joint` in the positive sense, or in
    the negative sense if it is negative."""
    tendon: str | None = None
    """Spatial tendon instead of a pulley: the free rope from the conduit to a lever."""

    def __post_init__(self) -> None:
        """Require exactly one kind of distal end."""
        if (self.joint is None) == (self.tendon is None):
            raise CableError("a DrivenCable needs either a joint or a tendon")
        if (self.joint is None) != (self.pulley is None):
            raise CableError(
                "a DrivenCable needs the radius `pulley` with `joint`, and only then"
            )


@dataclass(kw_only=True)
class CableActuatorCfg(ActuatorCfg):
    """Motors that drive joints through cables, commanded by effort.

    The targets are the joints of the motors. Delays are those of mjlab's `ActuatorCfg`
    and act on the command, before `motor_lag`; cable forces have no delay.
    """

    cables: dict[str, DrivenCable]
    """Cables by name."""
    effort_limit: float
    """Largest torque of a motor, at its drum [N m]."""
    motor_lag: float = 0.0
    """Time constant of the motor's torque behind its command [s]."""
    terms: tuple[str, ...] = ()
    """Parameters of `Cable` that are 0 and that an event may raise."""
    rest_in_pose: bool = True
    """True if a reset lays the cables at their pretension in the pose of the world;
    else in the pose `qpos0`, and the world starts with what that pose makes of it."""

    def __post_init__(self) -> None:
        """Require joints as targets, a cable, and a `motor_lag` of 0 or more [s]."""
        super().__post_init__()
        if self.transmission_type != TransmissionType.JOINT:
            raise CableError("the targets of CableActuatorCfg are joints of motors")
        if not self.cables:
            raise CableError("CableActuatorCfg has no cables")
        if not 0.0 <= self.motor_lag < math.inf:
            raise CableError(f"motor_lag is {self.motor_lag!r}; it must be at least 0")

    def build(
        self, entity: Any, target_ids: list[int], target_names: list[str]
    ) -> CableActuator:
        """Return the actuator that mjlab makes of this configuration."""
        return CableActuator(self, entity, target_ids, target_names)


class CableActuator(Actuator):
    """Actuator of a `CableActuatorCfg`.

    Attributes:
        cables: the cables in all worlds, once mjlab has initialised the actuator.
        names: names of the cables, in the order of `tension`.
        tension: tension at the proximal and distal ends (worlds, cables, 2) [N], not
            copied.
        values: parameters (cables, worlds, parameters), see `AttachedCables.values`.
    """

    cfg: CableActuatorCfg

    def __init__(
        self,
        cfg: CableActuatorCfg,
        entity: Any,
        target_ids: list[int],
        target_names: list[str],
    ) -> None:
        """Take over the configuration."""
        super().__init__(cfg, entity, target_ids, target_names)
        self._ends: dict[str, tuple[Any, Any]] = {}
        self._computed = 0
        self._has_missed_graph = False

    def edit_spec(self, spec: mujoco.MjSpec, target_names: list[str]) -> None:
        """Add the named motors, and the ends of the cables that they wind, to `spec`.

        Raises:
            CableError: a cable names no target as its motor, or no joint or tendon.
        """
        for drive in self.cfg.cables.values():
            if drive.motor.split("/")[-1] not in self.target_names:
                raise CableError.unknown("motor", drive.motor, self.target_names)
        keys = "effort_limit", "armature", "frictionloss", "viscous_damping"
        given = {key: getattr(self.cfg, key) for key in keys}
        for motor in target_names:
            self._mjs_actuators.append(create_motor_actuator(spec, motor, **given))
            for name, drive in self.cfg.cables.items():
                if drive.motor == motor:
                    self._ends[name] = _add_ends(spec, name, drive)

    def initialize(
        self, mj_model: mujoco.MjModel, model: Any, data: Any, device: str
    ) -> None:
        """Attach the cables; graphs captured before do not include them."""
        super().initialize(mj_model, model, data, device)
        held = {
            name: HeldCable(drive.cable, *(int(end.id) for end in self._ends[name]))
            for name, drive in self.cfg.cables.items()
        }
        self.names = tuple(held)
        # mjlab passes views of the structures of mujoco_warp.
        self.cables: AttachedCables = attach(
            model.struct,
            data.struct,
            mj_model,
            cables=held,
            terms=self.cfg.terms,
            rest_in_pose=self.cfg.rest_in_pose,
        )
        self.tension = wp.to_torch(self.cables.tensions)
        self.values = wp.to_torch(self.cables.values)
        shape = (data.nworld, len(self._mjs_actuators))
        self._target = torch.zeros(shape, device=device)
        self._effort = torch.zeros(shape, device=device)

    def compute(self, cmd: ActuatorCmd) -> torch.Tensor:
        """Return the torques of the motors (worlds, motors) [N m].

        Raises:
            CableError: the steps that mjlab captured do not include the cables.
        """
        self._computed += 1
        if self._computed > 1 and not self.cables.is_evaluated:
            raise CableError(
                "mjlab captured its graph before the cables were attached; add an "
                "event EventTermCfg(func=capture_cables, mode='startup')"
            )
        limit = self.cfg.effort_limit
        self._target = cmd.effort_target.clamp(-limit, limit)
        return self._effort if self.cfg.motor_lag > 0.0 else self._target

    def update(self, dt: float) -> None:
        """Advance the lag of the motors' torques behind their commands by `dt` [s]."""
        if self.cfg.motor_lag > 0.0:
            share = -math.expm1(-dt / self.cfg.motor_lag)
            self._effort += share * (self._target - self._effort)

    def reset(self, env_ids: torch.Tensor | slice | None = None) -> None:
        """Set the cables of some worlds to rest, and their motors to zero torque."""
        super().reset(env_ids)
        worlds = slice(None) if env_ids is None else env_ids
        self._effort[worlds] = 0.0
        self._target[worlds] = 0.0
        flags = torch.zeros(
            len(self._effort), dtype=torch.bool, device=self._effort.device
        )
        flags[worlds] = True
        self.cables.reset(wp.from_torch(flags))


def _add_ends(spec: mujoco.MjSpec, name: str, drive: DrivenCable) -> tuple[Any, Any]:
    proximal = add_end(spec, f"{name}_proximal", -drive.drum, joint=drive.motor)
    if drive.pulley is None:
        distal = add_end(spec, f"{name}_distal", 1.0, tendon=drive.tendon)
    else:
        distal = add_end(spec, f"{name}_distal", -drive.pulley, joint=drive.joint)
    return proximal, distal
