"""Task of mjlab: a cable-driven exoskeleton at both ankles of a walking person.

    train CcMujoco-Ankle-Walk --agent.logger tensorboard
    play CcMujoco-Ankle-Walk --checkpoint-file logs/.../model_300.pt

mjlab imports this module where the package is installed. Legs, walking policy, motors
and cables are those of `cc_mujoco/Walking-v0`, see `cc_mujoco.envs.WalkingEnv`; the
person is planar and adapts to the assistance of earlier strides. A policy commands the
torques of the motors and is rewarded for the metabolic power that it saves the person.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import torch
from mjlab.actuator import IdealPdActuatorCfg
from mjlab.entity import EntityArticulationInfoCfg, EntityCfg
from mjlab.envs import ManagerBasedRlEnvCfg, mdp
from mjlab.envs.mdp.actions import JointEffortActionCfg
from mjlab.managers import (
    EventTermCfg,
    ObservationGroupCfg,
    ObservationTermCfg,
    RewardTermCfg,
    SceneEntityCfg,
    TerminationTermCfg,
)
from mjlab.managers.action_manager import ActionTerm, ActionTermCfg
from mjlab.rl import RslRlModelCfg, RslRlOnPolicyRunnerCfg, RslRlPpoAlgorithmCfg
from mjlab.scene import SceneCfg
from mjlab.sim import MujocoCfg, SimulationCfg
from mjlab.tasks.registry import register_mjlab_task
from mjlab.terrains import TerrainEntityCfg

from cc_mujoco.errors import CableError
from cc_mujoco.human._walking_body import (
    CABLE,
    DRUM,
    LEGS,
    MOTOR_TORQUE,
    POLICY,
    SCENE,
    WalkingBody,
    metabolic_energy,
)
from cc_mujoco.human._walking_policy import (
    MUSCLE_PERIOD,
    WALKING_JOINTS,
    WALKING_SIDES,
    ExpectedHelp,
    Senses,
    WalkingController,
    WalkingPolicy,
)
from cc_mujoco.warp.mjlab._actuator import CableActuatorCfg, DrivenCable
from cc_mujoco.warp.mjlab._terms import cable_tension, capture_cables, randomize_cables

JOINTS = tuple(f"{side}_{part}" for side in WALKING_SIDES for part in WALKING_JOINTS)
_STARTS = np.linspace(0.1, 0.4, 31)
"""Phases of a step of the right leg at which worlds start."""


@dataclass(kw_only=True)
class WalkCfg(ActionTermCfg):
    """Walking policy of the person: an action term without actions.

    The entity's joints need actuators with the stiffness and damping of the policy.
    Their targets of angle and rate stay 0, and the policy commands their effort.
    """

    policy: WalkingPolicy | None = None
    """Policy; by default the one that ships."""
    adaptation: float = 1.0
    """Fraction of the expected assistance by which the person's ankles push less."""

    def build(self, env: Any) -> Walker:
        """Return the action term of this configuration."""
        return Walker(self, env)


class Walker(ActionTerm):
    """Action term that runs the walking policy of a `WalkCfg`."""

    def __init__(self, cfg: WalkCfg, env: Any) -> None:
        """Find joints and sensors, and tabulate the poses to start from."""
        super().__init__(cfg=cfg, env=env)
        model = env.sim.mj_model
        self._every = round(MUSCLE_PERIOD / model.opt.timestep)
        if not math.isclose(self._every * model.opt.timestep, MUSCLE_PERIOD):
            raise CableError(
                f"the time step is {model.opt.timestep:g} s; the walking person needs "
                f"one that divides {MUSCLE_PERIOD:g} s."
            )
        ids, _ = self._entity.find_joints(JOINTS, preserve_order=True)
        self._joints = torch.tensor(ids, device=self.device)
        names = list(self._entity.joint_names)
        self._root = [names.index(name) for name in ("forward", "height", "pitch")]
        loads = [
            model.sensor(f"{cfg.entity_name}/{side}_{part}_load")
            for side in WALKING_SIDES
            for part in ("heel", "ball")
        ]
        places = [int(sensor.adr[0]) for sensor in loads]
        self._loads = torch.tensor(places, device=self.device)
        joints = [model.joint(f"{cfg.entity_name}/{name}") for name in JOINTS]
        self._dof = torch.tensor(
            [int(joint.dofadr[0]) for joint in joints], device=self.device
        )
        policy = WalkingPolicy.read(POLICY) if cfg.policy is None else cfg.policy
        where: dict[str, Any] = {"dtype": torch.float32, "device": self.device}
        self.person = WalkingController(policy, self.num_envs, torch, **where)
        self.expected = ExpectedHelp(self.num_envs, torch, **where)
        self._control = torch.zeros((self.num_envs, len(JOINTS)), **where)
        self._none = torch.zeros((self.num_envs, 0), **where)
        self._substep = 0
        self._weight, poses = _starting_poses(policy)
        self._poses = torch.asarray(poses, **where)
        self._starts = torch.asarray(_STARTS, **where)

    @property
    def action_dim(self) -> int:
        """Number of actions: none."""
        return 0

    @property
    def raw_action(self) -> torch.Tensor:
        """Actions (worlds, 0)."""
        return self._none

    def process_actions(self, actions: torch.Tensor) -> None:
        """Take no action."""

    @property
    def torque(self) -> torch.Tensor:
        """Torques of the person's joints (worlds, legs, joints) [N m]."""
        parts = {}
        control = self._env.sim.data.ctrl[:]
        for actuator in self._entity.actuators:
            for name, place in zip(
                actuator.target_names, actuator.global_ctrl_ids, strict=True
            ):
                parts[name] = control[:, int(place)]
        return torch.stack([parts[name] for name in JOINTS], dim=1).view(-1, 2, 3)

    @property
    def rates(self) -> torch.Tensor:
        """Velocities of the person's joints (worlds, legs, joints) [rad/s]."""
        rates: torch.Tensor = self._entity.data.joint_vel[:, self._joints]
        return rates.view(-1, 2, 3)

    @property
    def load(self) -> torch.Tensor:
        """Ground force on the feet over the body weight (worlds, legs) [-]."""
        loads = self._env.sim.data.sensordata[:][:, self._loads]
        return loads.view(-1, 2, 2).sum(dim=2) / self._weight

    @property
    def help(self) -> torch.Tensor:
        """Torques of the exoskeleton's ropes on the ankles (worlds, legs) [N m]."""
        every = self._env.sim.data.qfrc_actuator[:][:, self._dof[[2, 5]]]
        help_: torch.Tensor = every - self.torque[:, :, 2]
        return help_

    @property
    def fallen(self) -> torch.Tensor:
        """Flags of the worlds in which the person has fallen (worlds,)."""
        position = self._entity.data.joint_pos
        _, height, pitch = self._root
        stands = (position[:, height].abs() < WalkingBody.MAX_DROP) & (
            position[:, pitch].abs() < WalkingBody.MAX_PITCH
        )
        return ~stands

    def apply_actions(self) -> None:
        """Update the person's joint torques, every `MUSCLE_PERIOD` [s]."""
        if self._substep % self._every == 0:
            data, (forward, _, pitch) = self._entity.data, self._root
            self.expected.observe(self.person.phase, self.help)
            control = self.person.act(
                Senses(
                    data.joint_pos[:, self._joints].view(-1, 2, 3),
                    data.joint_pos[:, pitch],
                    data.joint_vel[:, pitch],
                    data.joint_vel[:, forward],
                    self.load,
                ),
                MUSCLE_PERIOD,
            )
            self.expected.learn(self.person.ended)
            left_out = self.cfg.adaptation * self.expected.at(self.person.phase)
            control[:, :, 2] -= left_out
            self._control = control.view(-1, len(JOINTS))
        self._substep += 1
        self._entity.set_joint_effort_target(self._control, joint_ids=self._joints)

    def reset(self, env_ids: torch.Tensor | slice | None = None) -> None:
        """Start the person of some worlds at a random phase of a step."""
        worlds = torch.arange(self.num_envs, device=self.device)
        worlds = worlds if env_ids is None else worlds[env_ids]
        chosen = torch.randint(len(_STARTS), (len(worlds),), device=self.device)
        self.person.step[worlds] = self._starts[chosen]
        self.person.lead[worlds] = 0.0
        self.expected.forget(worlds)
        pose = self._poses[chosen]
        data = self._entity.data
        position = data.default_joint_pos[worlds].clone()
        velocity = data.default_joint_vel[worlds].clone()
        position[:, self._joints] = pose[:, :6]
        velocity[:, self._joints] = pose[:, 6:12]
        position[:, self._root[1:]] = pose[:, 12:14]
        velocity[:, self._root[0]] = pose[:, 14]
        self._entity.write_joint_state_to_sim(position, velocity, env_ids=worlds)


def _starting_poses(policy: WalkingPolicy) -> tuple[float, np.ndarray[Any, Any]]:
    """Return the weight [N], and poses over one step (starts, 15).

    A pose has angles and velocities of the joints, height, pitch and speed.
    """
    model = mujoco.MjModel.from_xml_path(str(SCENE))
    data, body = mujoco.MjData(model), WalkingBody(model)
    forward, height, pitch = (model.joint(n) for n in ("forward", "height", "pitch"))
    poses = []
    for start in _STARTS:
        body.start(data, policy, float(start))
        rest = (
            data.qpos[height.qposadr[0]],
            data.qpos[pitch.qposadr[0]],
            data.qvel[forward.dofadr[0]],
        )
        angles, rates = data.qpos[body.qpos].ravel(), data.qvel[body.dof].ravel()
        poses.append(np.concatenate((angles, rates, rest)))
    return body.weight, np.array(poses)


def walker(env: Any, term: str = "person") -> Walker:
    """Return the `Walker` of an environment."""
    found: Walker = env.action_manager.get_term(term)
    return found


def gait_phase(env: Any, term: str = "person") -> torch.Tensor:
    """Observe sine and cosine of the gait phase of both legs, (worlds, 4)."""
    turn = 2 * math.pi * walker(env, term).person.phase
    return torch.cat((torch.sin(turn), torch.cos(turn)), dim=-1)


def foot_load(env: Any, term: str = "person") -> torch.Tensor:
    """Observe the ground force on each foot over the body weight (worlds, 2)."""
    return walker(env, term).load


def person_power(env: Any, term: str = "person") -> torch.Tensor:
    """Penalise the estimated metabolic power of the person, in 500 W (worlds,)."""
    person = walker(env, term)
    power = person.torque * person.rates
    positive, negative = power.clamp(min=0.0), power.clamp(max=0.0)
    each: torch.Tensor = metabolic_energy(positive, negative)
    return each.sum(dim=(1, 2)) / 500.0


def has_fallen(env: Any, term: str = "person") -> torch.Tensor:
    """Return whether the person has fallen, in every world (worlds,)."""
    return walker(env, term).fallen


TASK = "CcMujoco-Ankle-Walk"
"""Name of the task in mjlab's registry."""
MOTORS = tuple(f"{side}_motor" for side in WALKING_SIDES)


def walking_legs() -> mujoco.MjSpec:
    """Return the person and the motors, without muscles, ground and cables."""
    return mujoco.MjSpec.from_file(str(LEGS))


def _robot() -> EntityCfg:
    """Return the mjlab entity of the person with muscles and exoskeleton."""
    policy = WalkingPolicy.read(POLICY)
    muscles = tuple(
        IdealPdActuatorCfg(
            target_names_expr=(f".*_{part}",),
            stiffness=float(stiffness),
            damping=float(damping),
            effort_limit=250.0,
        )
        for part, stiffness, damping in zip(
            WALKING_JOINTS, policy.stiffness, policy.damping, strict=True
        )
    )
    motors = CableActuatorCfg(
        target_names_expr=MOTORS,
        cables={
            f"{side}_cable": DrivenCable(
                cable=CABLE, motor=f"{side}_motor", drum=DRUM, tendon=f"{side}_rope"
            )
            for side in WALKING_SIDES
        },
        effort_limit=MOTOR_TORQUE,
        motor_lag=5e-3,
        delay_min_lag=0,
        delay_max_lag=2,
        delay_hold_prob=0.9,
    )
    return EntityCfg(
        spec_fn=walking_legs,
        articulation=EntityArticulationInfoCfg(actuators=(*muscles, motors)),
    )


def environment(play: bool = False) -> ManagerBasedRlEnvCfg:
    """Return the configuration of the environment; in play no episode times out."""
    ankles = SceneEntityCfg("robot", joint_names=(".*_ankle",))
    drums = SceneEntityCfg("robot", joint_names=MOTORS)
    joints = (
        ("ankle", mdp.joint_pos_rel, ankles, 5.0),
        ("ankle_rate", mdp.joint_vel_rel, ankles, 0.5),
        ("motor", mdp.joint_pos_rel, drums, 1.0),
        ("motor_rate", mdp.joint_vel_rel, drums, 0.05),
    )
    terms = {
        "phase": ObservationTermCfg(func=gait_phase),
        "load": ObservationTermCfg(func=foot_load),
        **{
            name: ObservationTermCfg(func=f, params={"asset_cfg": of}, scale=scale)
            for name, f, of, scale in joints
        },
        "tension": ObservationTermCfg(
            func=cable_tension, params={"end": "proximal", "scale": 1 / 300}
        ),
        "action": ObservationTermCfg(func=mdp.last_action),
    }
    events = {
        "capture": EventTermCfg(func=capture_cables, mode="startup"),
        "vary": EventTermCfg(
            func=randomize_cables,
            mode="reset",
            params={"ranges": {"friction": (0.05, 0.2), "pretension": (2.0, 10.0)}},
        ),
    }
    return ManagerBasedRlEnvCfg(
        scene=SceneCfg(
            terrain=TerrainEntityCfg(terrain_type="plane"),
            entities={"robot": _robot()},
            num_envs=1 if play else 1024,
            env_spacing=3.0,
        ),
        observations={
            "actor": ObservationGroupCfg(terms, enable_corruption=not play),
            "critic": ObservationGroupCfg({**terms}),
        },
        actions={
            "person": WalkCfg(entity_name="robot"),
            "motors": JointEffortActionCfg(
                entity_name="robot",
                actuator_names=MOTORS,
                scale=5.0,
                clip={".*": (-MOTOR_TORQUE, MOTOR_TORQUE)},
            ),
        },
        events=events,
        rewards={
            "alive": RewardTermCfg(func=mdp.is_alive, weight=1.0),
            "person_power": RewardTermCfg(func=person_power, weight=-1.0),
            "action_rate": RewardTermCfg(func=mdp.action_rate_l2, weight=-0.01),
        },
        terminations={
            "time_out": TerminationTermCfg(func=mdp.time_out, time_out=True),
            "fallen": TerminationTermCfg(func=has_fallen),
            "broken": TerminationTermCfg(func=mdp.nan_detection),
        },
        sim=SimulationCfg(mujoco=MujocoCfg(timestep=2e-3)),
        decimation=5,
        episode_length_s=1e9 if play else 15.0,
    )


def ppo() -> RslRlOnPolicyRunnerCfg:
    """Return the configuration of PPO (rsl_rl)."""
    network = {"hidden_dims": (64, 64), "activation": "elu", "obs_normalization": True}
    noise = {
        "class_name": "GaussianDistribution",
        "init_std": 0.5,
        "std_type": "scalar",
    }
    return RslRlOnPolicyRunnerCfg(
        actor=RslRlModelCfg(**network, distribution_cfg=noise),
        critic=RslRlModelCfg(**network),
        algorithm=RslRlPpoAlgorithmCfg(gamma=0.99, entropy_coef=1e-3),
        experiment_name="cc_mujoco_ankle_walk",
        num_steps_per_env=64,
        max_iterations=300,
    )


register_mjlab_task(TASK, environment(), environment(play=True), ppo())
