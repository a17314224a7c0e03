"""Cables in an environment of mjlab, which `scripts/test_peers mjlab` has."""

from __future__ import annotations

import os
import subprocess
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

pytest.importorskip("mjlab")

import torch
from mjlab.entity import Entity, EntityArticulationInfoCfg, EntityCfg
from mjlab.envs import ManagerBasedRlEnv, ManagerBasedRlEnvCfg, mdp
from mjlab.envs.mdp.actions import JointEffortActionCfg
from mjlab.managers import (
    EventTermCfg,
    ObservationGroupCfg,
    ObservationTermCfg,
    TerminationTermCfg,
)
from mjlab.scene import SceneCfg
from mjlab.sim import MujocoCfg, SimulationCfg

from cc_mujoco.cable import PARAMETERS
from cc_mujoco.cable import _layout as at
from cc_mujoco.errors import CableError
from cc_mujoco.warp.mjlab import (
    CableActuatorCfg,
    DrivenCable,
    cable_tension,
    capture_cables,
    randomize_cables,
)
from warp_mjlab import rig

RIG = Path(rig.__file__)
WORLDS = 3


def drives() -> dict[str, DrivenCable]:
    return {
        "flexor": DrivenCable(
            cable=rig.CABLES["flexor"],
            motor="motor",
            drum=0.02,
            joint="wrist",
            pulley=0.06,
        ),
        "puller": DrivenCable(
            cable=rig.CABLES["puller"], motor="second", drum=0.02, tendon="rope"
        ),
    }


def configuration(events=None, episode=1e3, **actuator) -> ManagerBasedRlEnvCfg:
    cables = CableActuatorCfg(
        target_names_expr=("motor", "second"),
        cables=drives(),
        effort_limit=5.0,
        **{"rest_in_pose": False, **actuator},
    )
    return ManagerBasedRlEnvCfg(
        scene=SceneCfg(
            entities={
                "robot": EntityCfg(
                    spec_fn=lambda: mujoco.MjSpec.from_string(rig.MJCF),
                    articulation=EntityArticulationInfoCfg(actuators=(cables,)),
                )
            },
            num_envs=WORLDS,
        ),
        observations={
            "actor": ObservationGroupCfg(
                {
                    "tension": ObservationTermCfg(
                        func=cable_tension, params={"end": "proximal"}
                    )
                }
            )
        },
        actions={
            "motors": JointEffortActionCfg(entity_name="robot", actuator_names=(".*",))
        },
        events={"capture": EventTermCfg(func=capture_cables, mode="startup")}
        if events is None
        else events,
        rewards={},
        terminations={"time_out": TerminationTermCfg(func=mdp.time_out, time_out=True)},
        sim=SimulationCfg(mujoco=MujocoCfg(timestep=rig.STEP)),
        decimation=rig.DECIMATION,
        episode_length_s=episode,
    )


@pytest.fixture(scope="module")
def env():
    return ManagerBasedRlEnv(configuration(), device="cpu")


def cables_of(env):
    return env.scene["robot"].actuators[0]


def play(env, actions, efforts=rig.efforts):
    """Return the tensions (actions, worlds, cables, 2) after each action [N]."""
    found = []
    for action in range(actions):
        env.step(torch.tensor([efforts(action)] * WORLDS, dtype=torch.float))
        found.append(cables_of(env).tension.numpy().copy())
    return np.array(found)


def test_the_tensions_are_those_of_the_plugin(env, tmp_path):
    python = os.environ.get("CC_MUJOCO_PYTHON")
    if python is None:
        pytest.skip(
            "scripts/test_peers mjlab names a Python whose MuJoCo runs the plugin"
        )
    out = tmp_path / "plugin.npy"
    subprocess.run([python, "-P", str(RIG), str(out)], check=True)
    right = np.load(out)
    env.reset()
    found = play(env, rig.ACTIONS)
    assert right.max() > 15.0
    for world in range(WORLDS):
        error = np.abs(found[:, world] - right).max() / right.max()
        print(f"largest difference over the largest tension: {error:.1e}")
        assert error < 1e-4


def test_the_observation_is_the_tension(env):
    env.reset()
    play(env, 3)
    seen = env.observation_manager.compute()["actor"]
    np.testing.assert_array_equal(seen, cables_of(env).tension[..., 0])


def test_the_reset_of_one_world_leaves_the_others(env):
    env.reset()
    whole = play(env, 12)
    env.reset()
    play(env, 6)
    env.reset(env_ids=torch.tensor([1]))
    rest = cables_of(env).tension[1].numpy()
    pretension = [cable.pretension for cable in rig.CABLES.values()]
    np.testing.assert_allclose(rest, np.repeat(pretension, 2).reshape(2, 2), rtol=5e-4)
    for action in range(6, 12):
        found = play(env, 1, lambda _, now=action: rig.efforts(now))[0]
        np.testing.assert_array_equal(found[[0, 2]], whole[action][[0, 2]])
        assert (found[1] != whole[action][1]).any()


def test_worlds_get_parameters_of_their_own_at_a_reset():
    ranges = {"friction": (0.05, 0.2), "pretension": (5.0, 15.0)}
    vary = EventTermCfg(
        func=randomize_cables, mode="reset", params={"ranges": ranges, "cables": "fl.*"}
    )
    env = ManagerBasedRlEnv(configuration({"vary": vary}), device="cpu")
    env.reset()
    values = cables_of(env).values.numpy()
    names = [parameter.name for parameter in PARAMETERS]
    for name, (low, high) in ranges.items():
        drawn = values[0, :, names.index(name)]
        assert (
            len(set(drawn)) == WORLDS and (low <= drawn).all() and (drawn <= high).all()
        )
        assert len(set(values[1, :, names.index(name)])) == 1
    laid = cables_of(env).tension[:, 0, 0].numpy()
    np.testing.assert_allclose(laid, values[0, :, names.index("pretension")], rtol=1e-4)


@pytest.mark.parametrize(
    ("ranges", "what"),
    [
        ({"frictoin": (0.1, 0.2)}, "friction"),
        ({"friction": (0.1, 9.0)}, r"friction.* 9.0"),
        ({"friction": (0.2, 0.1)}, "empty"),
        ({"viscous_friction": (0.0, 5.0), "grease": (0.0, 1.0)}, "parameter 'grease'"),
        ({"grease_drag": (0.0, 1.0)}, r"terms=\('grease_drag',\)"),
        ({"static_friction": (0.1, 0.3), "friction": (0.05, 0.2)}, "at least"),
    ],
)
def test_ranges_that_cannot_be_are_refused(ranges, what):
    vary = EventTermCfg(func=randomize_cables, mode="reset", params={"ranges": ranges})
    made = configuration({"vary": vary}, terms=("static_friction",))
    with pytest.raises(CableError, match=what):
        ManagerBasedRlEnv(made, device="cpu")


def test_a_motor_follows_its_command_with_delay_and_lag():
    lag, delay = 4e-3, 3
    env = ManagerBasedRlEnv(
        configuration(motor_lag=lag, delay_min_lag=delay, delay_max_lag=delay),
        device="cpu",
    )
    env.reset()
    efforts, motors = [], cables_of(env).global_ctrl_ids
    for _ in range(4):
        env.action_manager.process_action(torch.full((WORLDS, 2), 2.0))
        for _ in range(rig.DECIMATION):
            env.action_manager.apply_action()
            env.scene.write_data_to_sim()
            env.sim.step()
            env.scene.update(dt=rig.STEP)
            efforts.append(env.sim.data.ctrl[0, motors].tolist())
    steps = np.arange(len(efforts))
    right = 2.0 * -np.expm1(-np.maximum(steps - delay, 0) * rig.STEP / lag)
    np.testing.assert_allclose(np.array(efforts), np.c_[right, right], atol=1e-5)


def test_a_graph_without_the_cables_is_refused(env, monkeypatch):
    cables = cables_of(env).cables
    monkeypatch.setattr(cables, "is_evaluated", False)
    monkeypatch.setattr(env.sim.wp_model.callback, "act_bias", None)
    with pytest.raises(CableError, match="capture_cables"):
        env.step(torch.zeros(WORLDS, 2))


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"motor": "moto"}, "motor"),
        ({"joint": "wirst"}, "wrist"),
        ({"tendon": "rope"}, "either a joint or a tendon"),
        ({"pulley": None}, "radius `pulley`"),
    ],
)
def test_drives_that_cannot_be_are_refused(change, what):
    with pytest.raises(CableError, match=what):
        cables = {"flexor": replace(drives()["flexor"], **change)}
        actuators = (
            CableActuatorCfg(
                target_names_expr=("motor",), cables=cables, effort_limit=1.0
            ),
        )
        Entity(
            EntityCfg(
                spec_fn=lambda: mujoco.MjSpec.from_string(rig.MJCF),
                articulation=EntityArticulationInfoCfg(actuators=actuators),
            )
        )


def test_layout_of_the_values_is_that_of_the_parameters(env):
    assert cables_of(env).values.shape == (2, WORLDS, at.SCALARS)


def test_the_code_of_the_page_runs():
    page = Path(rig.__file__).parents[2] / "cc_mujoco" / "warp" / "README.md"
    section = page.read_text("utf-8").partition("## mjlab")[2]
    code = section.partition("```python\n")[2].partition("```")[0]
    names = {}
    exec(compile(code, str(page), "exec"), names)
    assert names["actuator"].cables["flexor"].pulley == 0.06
