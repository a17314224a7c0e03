"""Task of mjlab: a cable-driven exoskeleton at both ankles of a walking person.

    train CcMujoco-Ankle-Walk --agent.logger tensorboard
    play CcMujoco-Ankle-Walk --checkpoint-file logs/.../model_300.pt

mjlab imports this module where the package is installed. Legs, walking policy, motors
and cables are those of `cc_mujoco/Walking-v0`, see `cc_mujoco.envs.WalkingEnv`; the
person is planar and expects the help of earlier strides. A policy commands the torques
of the motors and is rewarded for the metabolic power that the joints of the person need
not give.
"""

from __future__ import annotations

import mujoco
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
from mjlab.rl import RslRlModelCfg, RslRlOnPolicyRunnerCfg, RslRlPpoAlgorithmCfg
from mjlab.scene import SceneCfg
from mjlab.sim import MujocoCfg, SimulationCfg
from mjlab.tasks.registry import register_mjlab_task
from mjlab.terrains import TerrainEntityCfg

from cc_mujoco.human._walking_body import LEGS, POLICY
from cc_mujoco.human._walking_policy import (
    WALKING_JOINTS,
    WALKING_SIDES,
    WalkingPolicy,
)
from cc_mujoco.human._walking_rig import CABLE, DRUM, MOTOR_TORQUE
from cc_mujoco.warp.mjlab._actuator import CableActuatorCfg, DrivenCable
from cc_mujoco.warp.mjlab._terms import (
    cable_tension,
    capture_cables,
    randomize_cables,
)
from cc_mujoco.warp.mjlab._walker import (
    WalkCfg,
    foot_load,
    gait_phase,
    has_fallen,
    person_power,
)

TASK = "CcMujoco-Ankle-Walk"
"""Name of the task in mjlab's registry."""
MOTORS = tuple(f"{side}_motor" for side in WALKING_SIDES)
_TIMESTEP, _DECIMATION = 2e-3, 5


def walking_legs() -> mujoco.MjSpec:
    """Return the person and the motors, without muscles, ground and cables."""
    return mujoco.MjSpec.from_file(str(LEGS))


def _robot() -> EntityCfg:
    """Return the person with muscles and exoskeleton."""
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
    """Return the configuration of the environment; in play a person walks on."""
    ankles = SceneEntityCfg("robot", joint_names=(".*_ankle",))
    drums = SceneEntityCfg("robot", joint_names=MOTORS)
    terms = {
        "phase": ObservationTermCfg(func=gait_phase),
        "load": ObservationTermCfg(func=foot_load),
        "ankle": ObservationTermCfg(
            func=mdp.joint_pos_rel, params={"asset_cfg": ankles}, scale=5.0
        ),
        "ankle_rate": ObservationTermCfg(
            func=mdp.joint_vel_rel, params={"asset_cfg": ankles}, scale=0.5
        ),
        "motor": ObservationTermCfg(
            func=mdp.joint_pos_rel, params={"asset_cfg": drums}, scale=1.0
        ),
        "motor_rate": ObservationTermCfg(
            func=mdp.joint_vel_rel, params={"asset_cfg": drums}, scale=0.05
        ),
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
        sim=SimulationCfg(mujoco=MujocoCfg(timestep=_TIMESTEP)),
        decimation=_DECIMATION,
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
