"""Gymnasium environment of a person who walks with two ankle exoskeletons."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
from gymnasium.utils import EzPickle
from numpy.typing import NDArray

from cc_mujoco._validation import MAX_DURATION, require_number
from cc_mujoco.cable import Cable
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.human import Task, WalkingController, WalkingPolicy
from cc_mujoco.human import _walking_body as walking_body
from cc_mujoco.human._walking_body import DRUM
from cc_mujoco.human._walking_policy import MUSCLE_PERIOD, WALKING_SIDES, ExpectedHelp
from cc_mujoco.plugin import add_cable, settle

from ._render import RENDER_METADATA, SceneRenderer, check_mode, metadata_of
from ._strides import Stride, StrideMeter

Array = NDArray[np.float64]

TRANSMISSIONS = {
    "cable": "through a conduit",
    "ideal": "without friction, stretch or inertia",
    "none": "not at all: the ropes are unhooked",
}
"""Ways in which the motors pull at the heel levers."""


class WalkingEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]], EzPickle):
    """A person who walks on the ground, with an ankle exoskeleton on each leg.

    The person is planar: the trunk cannot roll, yaw or move sideways. Nothing else
    holds it. Feet touch the ground in two contacts each, and a policy that was trained
    by evolution (`WalkingPolicy`, `scripts/train_walking.py`) moves hips, knees and
    ankles and keeps the balance.

    When an exoskeleton assists, people keep the total torque of the ankle much as it
    was, and reduce their own part (P.-C. Kao, C. L. Lewis, D. P. Ferris, "Invariant
    ankle moment patterns when walking with and without a robotic ankle exoskeleton",
    J. Biomechanics 43, 2010). So the person learns, from stride to stride and for
    every part of the gait cycle, the torque of the rope there, and subtracts
    `adaptation` times as much. With `adaptation=0` assistance is added in full.

    ## Actions

    `Box(-1, 1, (2,), float32)`: torque of the right and the left motor over 15 N m.
    Positive winds the rope, which only pulls: 1 is 600 N, about 70 N m at the ankle.
    An action is held for 4 ms. `assistance()` makes the action of a desired torque.

    ## Observations

    `Box(-10, 10, (16,), float32)`, for the right leg and then the left:

    | | observation | divided by |
    |-|-------------|-------------|
    | 0, 1 | sine and cosine of the phase of the gait | 1 |
    | 2 | angle of the ankle | 0.2 rad |
    | 3 | velocity of the ankle | 2 rad/s |
    | 4 | rope wound by the drum minus rope released by the ankle | 20 mm |
    | 5 | velocity of the motor | 5 rad/s |
    | 6 | tension at the motor | 300 N |
    | 7 | force of the ground on the foot | weight of the body |

    ## Reward

    Per second `reward_alive` = 1, `reward_person` = -P / 500 W with the metabolic power
    P estimated from the person's joints (`metabolic_energy`), `reward_effort` =
    -0.05 mean(a^2) with the action a; a fall costs 10.

    ## Info

    `time_s`, `position_m`, `speed_m_s`, `trunk_pitch_rad`; by leg, right first,
    `phase`, `ground_n`, `tension_motor_n`, `tension_heel_n`, `assistance_nm`
    (plantarflexion is negative); by leg and joint `joint_angle_rad`,
    `joint_velocity_rad_s`, `person_torque_nm`; `strides`, the number of complete ones,
    whose measures are in `strides` of the unwrapped environment, see `Stride`. The
    first is complete after about 2.4 s.

    ## Start and end

    The person starts in the swing of the left leg, at a random part of it, at the speed
    of the policy. A fall terminates the episode, `duration` truncates it.

    ## Arguments

    | argument | default | meaning |
    |----------|---------|---------|
    | `transmission` | `"cable"` | a key of `TRANSMISSIONS` |
    | `cable` | `CABLE` | cable of each leg, with fixed bends |
    | `adaptation` | 1 | fraction of the expected torque that the person leaves out |
    | `policy` | ships | a `WalkingPolicy` or its file |
    | `duration` | 20 | length of an episode [s] |
    | `render_mode` | `None` | as of `DeviceEnv` |
    """

    metadata = RENDER_METADATA

    def __init__(
        self,
        transmission: str = "cable",
        cable: Cable = walking_body.CABLE,
        adaptation: float = 1.0,
        policy: str | Path | WalkingPolicy = walking_body.POLICY,
        duration: float = 20.0,
        render_mode: str | None = None,
    ) -> None:
        """Load the scene; see the class for the arguments."""
        given = transmission, cable, adaptation, policy, duration, render_mode
        EzPickle.__init__(self, *given)
        check_mode(render_mode, self.metadata)
        look_up("transmission", transmission, TRANSMISSIONS)
        if not isinstance(cable, Cable):
            raise CableError(f"cable must be a Cable, not {cable!r}.")
        require_number("adaptation", adaptation, 0.0, 1.0, "")
        require_number("duration", duration, MUSCLE_PERIOD, MAX_DURATION, "s")
        self.transmission, self.adaptation = transmission, adaptation
        self.duration, self.render_mode = duration, render_mode
        self.metadata = metadata_of(round(1 / MUSCLE_PERIOD))
        if not isinstance(policy, WalkingPolicy):
            policy = WalkingPolicy.read(policy)
        self.policy = policy
        self.model = _walking_model(transmission, cable)
        self.data = mujoco.MjData(self.model)
        self.body = walking_body.WalkingBody(self.model)
        self.body.set_muscles(self.model, policy)
        self._substeps = round(MUSCLE_PERIOD / self.model.opt.timestep)
        self._ropes = _Ropes(self.model, transmission)
        high = np.float32(10.0)
        self.observation_space = gymnasium.spaces.Box(-high, high, (16,))
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,))
        self._screen = SceneRenderer(self.model, render_mode, MUSCLE_PERIOD)
        self._begin(0.25)

    def _begin(self, step: float) -> None:
        self.body.start(self.data, self.policy, step)
        self._ropes.start(self.data)
        if self.model.nplugin:
            settle(self.model, self.data)
        self.person = WalkingController(self.policy, 1, dtype=np.float64)
        self.person.step[:] = step
        self._meter = StrideMeter()
        self._expected = ExpectedHelp(1, dtype=np.float64)
        self._sample = 0
        self._screen.films[0].cut()

    @property
    def strides(self) -> list[Stride]:
        """Complete strides of this episode."""
        return self._meter.strides

    @property
    def phase(self) -> Array:
        """Phase of the gait cycle of both legs (2,), 0 at heel strike."""
        return np.asarray(self.person.phase[0])

    def assistance(self, task: Task | None = None) -> NDArray[np.float32]:
        """Return the action for a desired torque, without regard to friction.

        In phases without assistance each motor follows its ankle with a slack rope.

        Args:
            task: desired torque of the ankle by phase, `PUSH_OFF` by default.
        """
        task = walking_body.PUSH_OFF if task is None else task
        desired = np.array([task.torque(0.0, 0.0, phase) for phase in self.phase])
        torque = np.maximum(-desired, 0.0) * DRUM / self._ropes.arms(self.data)
        following = self._ropes.follow(self.data)
        # Desired torque below which a motor follows the ankle [N m]
        torque = np.where(-desired > 0.5, torque, following)
        share = np.clip(torque / walking_body.MOTOR_TORQUE, -1.0, 1.0)
        return np.asarray(share, np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode.

        Args:
            seed: seed of the fraction of a step at which the person starts.
            options: must be None.

        Raises:
            CableError: If there are options.
        """
        if options:
            raise CableError(f"a walking person takes no options, not {options!r}.")
        super().reset(seed=seed)
        self._begin(float(self.np_random.uniform(0.1, 0.4)))
        self._screen.follow(self.data)
        return self._observation(), self._info(0.0, 0.0, 0.0)

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Advance 4 ms with motor torques (2,), as shares of 15 N m.

        Raises:
            CableError: If the action is not of shape (2,) and finite.
        """
        given = np.asarray(action, np.float64)
        if given.shape != (2,) or not np.isfinite(given).all():
            raise CableError(f"an action is two finite numbers, not {action!r}.")
        given = np.clip(given, -1.0, 1.0)
        data, body = self.data, self.body
        control = self.person.act(body.senses([data]), MUSCLE_PERIOD)[0]
        if self.person.struck[0]:
            heels = data.geom_xpos[body.heels, 0]
            self._meter.strike(int(self.person.lead[0]), data.time, heels)
            self._expected.learn(self.person.ended)
        phase = self.person.phase
        control[:, 2] -= self.adaptation * self._expected.at(phase)[0]
        data.ctrl[body.muscles] = control
        self._ropes.command(data, given * walking_body.MOTOR_TORQUE)
        energy, period, ankles = 0.0, self.model.opt.timestep, body.dof[:, 2]
        for _ in range(self._substeps):
            mujoco.mj_step(self.model, data)
            power = data.actuator_force[body.muscles] * data.qvel[body.dof]
            help_ = self._help()
            motors = self._ropes.motor_power(data)
            self._meter.add(power, help_ * data.qvel[ankles], motors, period)
            work = np.maximum(power, 0.0).sum(), np.minimum(power, 0.0).sum()
            energy += period * walking_body.metabolic_energy(*work)
        self._expected.observe(phase, self._help()[None])
        self._screen.follow(data)
        self._sample += 1
        fallen = body.has_fallen(data) or bool(data.warning.number.any())
        effort = -0.05 * MUSCLE_PERIOD * float(np.mean(given**2))
        terms = MUSCLE_PERIOD - 10.0 * fallen, -energy / 500.0, effort
        over = self._sample * MUSCLE_PERIOD >= self.duration - 1e-9
        return self._observation(), sum(terms), fallen, over, self._info(*terms)

    def _help(self) -> Array:
        """Return the torques of the ropes on the ankles (2,) [N m]."""
        ankles, data = self.body.dof[:, 2], self.data
        own = data.actuator_force[self.body.muscles[:, 2]]
        return np.asarray(data.qfrc_actuator[ankles] - own)

    def _observation(self) -> NDArray[np.float32]:
        data, body = self.data, self.body
        turn = 2 * np.pi * self.phase
        ropes, load = self._ropes, body.senses([data]).load[0]
        ankle = data.qpos[body.qpos[:, 2]] / 0.2, data.qvel[body.dof[:, 2]] / 2.0
        motor = ropes.wound(data) / 0.02, data.qvel[ropes.dof] / 5.0
        pull = ropes.tensions(data)[0] / 300.0
        columns = np.sin(turn), np.cos(turn), *ankle, *motor, pull, load
        frame = np.stack(columns, axis=1)
        return np.asarray(np.clip(frame.ravel(), -10.0, 10.0), np.float32)

    def _info(self, alive: float, person: float, effort: float) -> dict[str, Any]:
        data, body = self.data, self.body
        senses = body.senses([data])
        motor, heel = self._ropes.tensions(data)
        return {
            "time_s": float(data.time),
            "position_m": body.position(data),
            "speed_m_s": float(senses.speed[0]),
            "trunk_pitch_rad": float(senses.pitch[0]),
            "phase": self.phase.copy(),
            "ground_n": senses.load[0] * body.weight,
            "tension_motor_n": motor,
            "tension_heel_n": heel,
            "assistance_nm": self._help(),
            "joint_angle_rad": senses.angles[0],
            "joint_velocity_rad_s": data.qvel[body.dof],
            "person_torque_nm": data.actuator_force[body.muscles],
            "strides": len(self.strides),
            "reward_alive": alive,
            "reward_person": person,
            "reward_effort": effort,
        }

    def render(self) -> NDArray[np.uint8] | None:
        """Return an image of the person, (height, width, 3), in mode `rgb_array`."""
        drawn = self._screen.render([self.data.qpos], [self._sample])
        return None if drawn is None else drawn[0]

    def close(self) -> None:
        """Free the renderer, and close the window."""
        self._screen.close()


def _walking_model(transmission: str, cable: Cable) -> mujoco.MjModel:
    """Return the scene with its motors, and with a transmission to the heel levers."""
    if cable.path != "guided" or cable.bend != "fixed":
        raise CableError(
            "the cable of a walking person is guided and has fixed bends; leave `path` "
            "and `bend` as they are."
        )
    # Fields of a cable that follow from where it lies in the scene
    placed = "conduit", "route", "path", "mouth", "guides"
    names = [one.name for one in dataclasses.fields(cable) if one.name not in placed]
    numbers = {name: getattr(cable, name) for name in names}
    spec = mujoco.MjSpec.from_file(str(walking_body.SCENE))
    for side in WALKING_SIDES:
        if transmission == "cable":
            conduit = [(one.length, one.radius) for one in cable.conduit]
            where: Any = {"motor": f"{side}_motor", "joint": f"{side}_ankle"}
            where |= {"lever": f"{side}_lever", "route": [f"{side}_conduit_end"]}
            where |= {"drum": DRUM, "conduit": conduit}
            add_cable(spec, f"{side}_cable", **where, **numbers)
            drive = spec.add_actuator(name=f"{side}_drive", target=f"{side}_motor")
            drive.trntype = mujoco.mjtTrn.mjTRN_JOINT
        if transmission == "ideal":
            drive = spec.add_actuator(name=f"{side}_drive", target=f"{side}_rope")
            drive.trntype, drive.gear[0] = mujoco.mjtTrn.mjTRN_TENDON, -1.0
    return spec.compile()


class _Ropes:
    """Ropes and motors of both legs, for each of the `TRANSMISSIONS`.

    Attributes:
        dof: addresses of the motors' velocities (legs,).
    """

    def __init__(self, model: mujoco.MjModel, transmission: str) -> None:
        self._cabled = transmission == "cable"
        self._hooked = transmission != "none"
        self._ropes = np.array([model.tendon(f"{s}_rope").id for s in WALKING_SIDES])
        motors = [model.joint(f"{side}_motor") for side in WALKING_SIDES]
        self._qpos = np.array([joint.qposadr[0] for joint in motors])
        self.dof = np.array([joint.dofadr[0] for joint in motors])
        ends = [model.site(f"{side}_conduit_end").id for side in WALKING_SIDES]
        levers = [model.site(f"{side}_lever").id for side in WALKING_SIDES]
        self._sites = ends, levers
        self._feet = [model.body(f"{side}_foot").id for side in WALKING_SIDES]
        if self._hooked:
            self._drives = [model.actuator(f"{s}_drive").id for s in WALKING_SIDES]
        if self._cabled:
            cables = [f"{side}_cable" for side in WALKING_SIDES]
            near = [model.actuator(f"{cable}_proximal").id for cable in cables]
            self._ends = [near, [model.actuator(f"{c}_distal").id for c in cables]]
        self._length = model.tendon_length0[self._ropes]

    def start(self, data: mujoco.MjData) -> None:
        """Turn the drums so that the ropes are at pretension in the present pose."""
        mujoco.mj_fwdPosition(data.model, data)
        data.qpos[self._qpos] = (self._length - data.ten_length[self._ropes]) / DRUM

    def command(self, data: mujoco.MjData, torque: Array) -> None:
        """Set the controls for motor torques (2,) [N m]."""
        if self._cabled:
            data.ctrl[self._drives] = torque
        elif self._hooked:
            data.ctrl[self._drives] = np.maximum(torque, 0.0) / DRUM

    def tensions(self, data: mujoco.MjData) -> Array:
        """Return tensions at motors and heels (2, legs) [N]."""
        if self._cabled:
            return np.asarray(np.abs(data.actuator_force[self._ends]))
        if self._hooked:
            return np.tile(data.actuator_force[self._drives], (2, 1))
        return np.zeros((2, 2))

    def motor_power(self, data: mujoco.MjData) -> Array:
        """Return the power of the motors (2,) [W]."""
        if not self._hooked:
            return np.zeros(2)
        force = data.actuator_force[self._drives]
        if self._cabled:
            return np.asarray(force * data.qvel[self.dof])
        return np.asarray(-force * data.ten_velocity[self._ropes])

    def wound(self, data: mujoco.MjData) -> Array:
        """Return the length wound by the drums minus that the ankles gave (2,) [m]."""
        left = self._length - data.ten_length[self._ropes]
        wound: Array = DRUM * data.qpos[self._qpos] - left
        return wound if self._cabled else np.zeros(2)

    def follow(self, data: mujoco.MjData) -> Array:
        """Return motor torques that keep the ropes slack by 5 mm (2,) [N m]."""
        if not self._cabled:
            return np.zeros(2)
        spread = data.qvel[self.dof] + data.ten_velocity[self._ropes] / DRUM
        # With 8 N m/rad and 0.3 N m s/rad, and 5 mm of rope that hang.
        return np.asarray(-8.0 * (self.wound(data) + 0.005) / DRUM - 0.3 * spread)

    def arms(self, data: mujoco.MjData) -> Array:
        """Return the moment arms of the ropes at the ankles (2,) [m]."""
        end, lever = (data.site_xpos[sites][:, (0, 2)] for sites in self._sites)
        rope = lever - end
        rope /= np.linalg.norm(rope, axis=1, keepdims=True)
        offset = lever - data.xpos[self._feet][:, (0, 2)]
        arm = rope[:, 1] * offset[:, 0] - rope[:, 0] * offset[:, 1]
        return np.asarray(np.abs(arm))
