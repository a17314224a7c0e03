"""The wearer's impedance and its limit, the ideal position source."""

from __future__ import annotations

import itertools

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco.errors import CableError
from cc_mujoco.human import TRAJECTORIES, Wearer

INERTIA = 0.01
XML = """
<mujoco>
  <option timestep="{timestep}" integrator="{integrator}"/>
  <worldbody>
    <body>
      <joint name="wrist" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
    </body>
  </worldbody>
  <actuator>
    <general name="wearer" joint="wrist" biastype="affine"/>
  </actuator>
</mujoco>
"""


def follow(
    wearer: Wearer, timestep: float, integrator: str = "Euler", start: float = 0.0
) -> float:
    """Largest error of a joint driven through a sine in MuJoCo, after one second."""
    model = mujoco.MjModel.from_xml_string(
        XML.format(timestep=timestep, integrator=integrator)
    )
    gains = wearer.gains()
    model.actuator_gainprm[0, 0] = gains.gain
    model.actuator_biasprm[0, :3] = gains.bias
    data = mujoco.MjData(model)
    data.qpos[0] = start
    motion = TRAJECTORIES["sine"].sample(3.0, timestep, np.random.default_rng(0))
    worst = 0.0
    for k in range(motion.time.size - 1):
        data.ctrl[0] = wearer.command(float(motion.angle[k]), float(motion.velocity[k]))
        mujoco.mj_step(model, data)
        if motion.time[k] > 1:
            worst = max(worst, abs(float(data.qpos[0] - motion.angle[k + 1])))
    return worst


numbers = st.floats(-10, 10)


@given(st.floats(0.1, 1e4), st.floats(0, 1e3), numbers, numbers, numbers, numbers)
def test_actuator_gives_the_torque(
    stiffness: float,
    damping: float,
    target: float,
    target_velocity: float,
    angle: float,
    velocity: float,
) -> None:
    wearer = Wearer(stiffness, damping)
    gains = wearer.gains()
    ctrl = wearer.command(target, target_velocity)
    force = gains.gain * ctrl + np.dot(gains.bias, [1, angle, velocity])
    torque = wearer.torque(target, target_velocity, angle, velocity)
    assert force == pytest.approx(torque, rel=1e-9, abs=1e-7)


def test_arrays_give_the_same_bits() -> None:
    wearer = Wearer(123.4, 5.6)
    values = np.random.default_rng(0).normal(size=(4, 50))
    arrays = wearer.torque(*values)
    assert arrays.tolist() == [wearer.torque(*column) for column in values.T.tolist()]


@pytest.mark.parametrize("integrator", ["Euler", "implicit", "implicitfast"])
@pytest.mark.parametrize("timestep", [5e-4, 1e-3, 4e-3])
def test_ideal_is_stable_and_exact(timestep: float, integrator: str) -> None:
    ideal = Wearer.ideal(INERTIA, timestep)
    # 0.4 rad at 0.5 Hz accelerates with up to 3.95 rad/s^2; the documented error is
    # h^2 a, and starting elsewhere must have been forgotten.
    assert follow(ideal, timestep, integrator, start=0.3) < 2.5 * timestep**2 * 3.95


def test_ideal_lags_half_a_step_with_rk4() -> None:
    # 0.4 rad at 0.5 Hz moves with up to 1.257 rad/s.
    timestep = 1e-3
    error = follow(Wearer.ideal(INERTIA, timestep), timestep, "RK4", start=0.3)
    assert error == pytest.approx(timestep * 1.257 / 2, rel=0.02)


def test_ideal_forgets_an_error_in_two_steps() -> None:
    timestep = 1e-3
    ideal = Wearer.ideal(INERTIA, timestep)
    angle, velocity = 0.2, -3.0
    for _ in range(2):
        torque = ideal.torque(0.0, 0.0, angle, velocity)
        velocity += timestep * torque / INERTIA
        angle += timestep * velocity
    assert abs(angle) < 1e-12 and abs(velocity) < 1e-12 / timestep


def test_stability_bound_is_where_it_is_said_to_be() -> None:
    timestep = 1e-3
    ideal = Wearer.ideal(INERTIA, timestep)
    # k < 4 - 2 d with d = 1: K may be just below twice the ideal one.
    assert follow(Wearer(1.9 * ideal.stiffness, ideal.damping), timestep) < 1e-4
    with np.errstate(all="ignore"):
        unstable = follow(Wearer(2.1 * ideal.stiffness, ideal.damping), timestep)
    assert not unstable < 1e-2


def test_ideal_source_is_the_limit_of_stiff_wearers() -> None:
    timestep = 1e-3
    ideal = Wearer.ideal(INERTIA, timestep)
    errors = [
        follow(Wearer(ideal.stiffness * f, ideal.damping * f**0.5), timestep)
        for f in (1e-4, 1e-3, 1e-2, 1e-1, 1.0)
    ]
    assert all(b < a / 5 for a, b in itertools.pairwise(errors))
    # And the ideal wearer's own error falls with the square of the step.
    coarse, fine = (follow(Wearer.ideal(INERTIA, h), h) for h in (4e-3, 1e-3))
    assert coarse / fine == pytest.approx(16, rel=0.1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0.0, 1.0), "Wearer.stiffness must be a number in [1e-06, 1e+15] N m/rad"),
        (
            (1.0, -1.0),
            "Wearer.damping must be a number in [0, 1e+15] N m s/rad, not -1",
        ),
        ((float("nan"), 1.0), "Wearer.stiffness must be a number"),
        ((1.0, float("inf")), "Wearer.damping must be a number"),
    ],
)
def test_errors(arguments: tuple[float, float], message: str) -> None:
    with pytest.raises(CableError) as caught:
        Wearer(*arguments)
    assert str(caught.value).startswith(message)


def test_ideal_errors() -> None:
    with pytest.raises(CableError, match="inertia must be a number"):
        Wearer.ideal(0.0, 1e-3)
    with pytest.raises(CableError, match="timestep must be a number"):
        Wearer.ideal(1.0, float("nan"))
