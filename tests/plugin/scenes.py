"""Small models with cables, as MJCF text."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

CONFIG = {
    "axial_stiffness": "4000",
    "pretension": "10",
    "friction": "0.15",
    "conduit": "0.8:0.3 0.4:inf 0.8:0.5",
    "segments": "10",
}
RATES = {
    "viscous_friction": "20",
    "stribeck_friction": "0.05",
    "critical_slip_distance": "1e-4",
}


def instance(name: str, config: Mapping[str, str] = CONFIG) -> str:
    """Return the MJCF of a plugin instance."""
    keys = "".join(f'<config key="{k}" value="{v}"/>' for k, v in config.items())
    return f'<instance name="{name}">{keys}</instance>'


def end(name: str, cable: str, target: str, gear: float) -> str:
    """Return the MJCF of a plugin actuator, with a target such as `joint="motor"`."""
    return f'<plugin name="{name}" instance="{cable}" {target} gear="{gear}"/>'


def model(
    instances: str,
    actuators: str,
    option: str = "",
    extra: str = "",
    timestep: float = 0.0005,
) -> str:
    """Return a scene of motor, wrist, sledge, ball and tendons, as MJCF text."""
    return f"""
<mujoco>
  <option timestep="{timestep}" {option}/>
  <extension><plugin plugin="cc_mujoco.cable">{instances}</plugin></extension>
  <worldbody>
    <site name="anchor" pos="0 0 1"/>
    <body name="motor" pos="0 0 1">
      <joint name="motor" axis="0 0 1" armature="1e-4" damping="1e-3"/>
      <geom size="0.02" mass="0.05"/>
    </body>
    <body name="hand" pos="0.5 0 1">
      <joint name="wrist" axis="0 0 1" damping="0.02" stiffness="0.5"/>
      <geom size="0.05" mass="0.5" pos="0.03 0 0"/>
    </body>
    <body name="sledge" pos="0 0.5 1">
      <joint name="sledge" type="slide" axis="1 0 0" damping="1" stiffness="50"/>
      <geom size="0.05" mass="0.5"/>
      <site name="hook" pos="0.1 0 0"/>
    </body>
    <body name="ball" pos="0 -1 1"><joint name="ball" type="ball"/>
      <geom size="0.05"/></body>
  </worldbody>
  <tendon>
    <spatial name="path"><site site="anchor"/><site site="hook"/></spatial>
    <fixed name="mix"><joint joint="motor" coef="1"/></fixed>
  </tendon>
  <actuator><motor name="drive" joint="motor"/>{actuators}</actuator>
  {extra}
</mujoco>"""


def pull_pull(
    config: Mapping[str, str] = CONFIG,
    option: str = "",
    extra: str = "",
    timestep: float = 0.0005,
) -> str:
    """Two cables from the motor to the wrist."""
    return model(
        instance("flexor", config) + instance("extensor", config),
        end("flexor_proximal", "flexor", 'joint="motor"', -0.02)
        + end("flexor_distal", "flexor", 'joint="wrist"', -0.05)
        + end("extensor_proximal", "extensor", 'joint="motor"', 0.02)
        + end("extensor_distal", "extensor", 'joint="wrist"', 0.05),
        option,
        extra,
        timestep,
    )


def build(xml: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Compile a model and make its data."""
    compiled = mujoco.MjModel.from_xml_string(xml)
    return compiled, mujoco.MjData(compiled)


def excitation(steps: int, seed: int = 0) -> np.ndarray:
    """Motor torque over time: a random walk between -1 and 1 N m."""
    rng = np.random.default_rng(seed)
    return np.sin(np.cumsum(rng.normal(scale=0.05, size=steps)))


def run(
    m: mujoco.MjModel, d: mujoco.MjData, torque: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Step with torques at the motor; positions and plugin states of every step."""
    positions = np.empty((len(torque), m.nq))
    states = np.empty((len(torque), m.npluginstate))
    drive = m.actuator("drive").id
    for i, value in enumerate(torque):
        d.ctrl[drive] = value
        mujoco.mj_step(m, d)
        positions[i], states[i] = d.qpos, d.plugin_state
    return positions, states
