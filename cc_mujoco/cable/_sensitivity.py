"""Derivatives of a recorded motion through cables, by forward mode.

    >>> import numpy as np
    >>> from cc_mujoco.cable import Cable, Section, sensitivity
    >>> cable = Cable(friction=0.2, conduit=(Section(2.0, 0.28),))
    >>> pulled = {"u_proximal": -np.linspace(0, 0.02, 200), "u_distal": np.zeros(200)}
    >>> found = sensitivity(cable, 0.001, of=("friction", "u_proximal"), **pulled)
    >>> bool(found.by["friction"].tension_distal[-1] < 0.0)
    True

The replay is compiled a second time, over dual numbers (`native/_dual.py`). One cable
is a transmission with pulleys of radius 1, whose angles are -u. The angle of a side
driven by torque is that of the plain replay; two more steps give the derivative of the
angle at which the torque stays as given (implicit function theorem).
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco.cable import _eccentric as eccentric
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._cable import PARAMETERS, TERMS, Cable
from cc_mujoco.cable._conduit import Replay, packed_parameters, replay
from cc_mujoco.cable._friction import INDEX
from cc_mujoco.cable._layout import CURVED, tensions
from cc_mujoco.cable._nodes import rest_springs
from cc_mujoco.cable._pulleys import Driven, Transmission
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.native import FloatArray, FloatCube, FloatMatrix, interrupted
from cc_mujoco.native._dual import entries, slope, with_slope


@dataclass(frozen=True)
class Derivatives:
    """A motion through cables and its derivatives.

    Attributes:
        motion: `Replay` of a cable, or `Driven` of a transmission.
        by: its derivatives, an object of the same type for each quantity of `of`; no
            profiles.
    """

    motion: Any
    by: dict[str, Any]


_MOTOR, _JOINT = 1, 2


class _Sides(NamedTuple):
    """Motion of both sides of a transmission."""

    motor: FloatArray  # angle of the motor (samples,) [rad]
    joint: FloatArray  # angle of the joint (samples,) [rad]
    torque: FloatArray  # torque that drives one of the sides (samples,) [N m]
    by_torque: int  # that side, `_MOTOR` or `_JOINT`; 0: none
    dt: float  # time between samples [s]


def _angles(sides: _Sides, row: int, lead: float) -> tuple[float, float]:
    """Return both angles of a sample; that of a side by torque has slope `lead`."""
    motor, joint = sides.motor[row], sides.joint[row]
    if sides.by_torque == _MOTOR:
        motor = with_slope(motor, lead)
    if sides.by_torque == _JOINT:
        joint = with_slope(joint, lead)
    return motor, joint


def _move(
    cables: stepper.Cables, state: FloatMatrix, sides: _Sides, row: int, lead: float,
    new: FloatMatrix, work: FloatArray,
) -> float:  # fmt: skip
    """Step all cables; return the derivative of the torque of a side by torque."""
    motor, joint = _angles(sides, row, lead)
    stepper.move(cables, state, motor, joint, sides.dt, new, work)
    torque, _ = stepper.torque(cables, new, sides.by_torque == _JOINT, motor)
    return slope(torque)


def _follow(
    cables: stepper.Cables, state: FloatMatrix, sides: _Sides, row: int, lead: float,
    new: FloatMatrix, work: FloatArray,
) -> float:  # fmt: skip
    """Step all cables; return the derivative of a side by torque, `lead` before it."""
    is_joint = sides.by_torque == _JOINT
    if sides.by_torque == 0:
        _move(cables, state, sides, row, lead, new, work)
    elif cables.n.size == 1 and (is_joint or eccentric.is_round(cables.prm[0])):
        # The tension of one end, which needs no search.
        load = stepper.Load(sides.torque[row], 0.0, -np.inf, np.inf)
        fixed = sides.motor[row] if is_joint else sides.joint[row]
        angle = stepper.balance(
            cables, state, is_joint, fixed, fixed, load, sides.dt, new, work
        )
        lead = slope(angle)
    else:
        held = _move(cables, state, sides, row, lead, new, work)
        rate = _move(cables, state, sides, row, lead + 1.0, new, work) - held
        if rate != 0.0:  # else no angle matters, as where all cables are slack
            lead += (slope(sides.torque[row]) - held) / rate
        _move(cables, state, sides, row, lead, new, work)
    return lead


def _report(
    cables: stepper.Cables, new: FloatMatrix, sides: _Sides, row: int, lead: float,
    out: FloatMatrix,
) -> None:  # fmt: skip
    """Write angle and torque of both sides, and five numbers of each cable."""
    motor, joint = _angles(sides, row, lead)
    out[0, row], out[2, row], count = motor, joint, cables.n.size
    out[1, row], _ = stepper.torque(cables, new, False, motor)
    out[3, row], _ = stepper.torque(cables, new, True, motor)
    for k in range(count):
        prm, n = cables.prm[k], cables.n[k]
        tension = tensions(new[k], n)
        out[4 + k, row] = max(tension[0], 0.0)
        out[4 + count + k, row] = max(tension[n], 0.0)
        out[4 + 2 * count + k, row] = kernel.slack_length(prm, n, new[k])
        out[4 + 3 * count + k, row] = kernel.stored_energy(prm, n, new[k])
        out[4 + 4 * count + k, row] = new[k, 2]


def _drive(
    cables: stepper.Cables, tension: FloatArray, sides: _Sides, ahead: _Sides,
    each: bool, states: FloatCube, work: FloatArray, out: FloatMatrix,
) -> None:  # fmt: skip
    """Play the motion `sides`, and write each step to `out`.

    With `each`, the step written for a sample ends in that sample of `ahead`, and is
    taken back. `tension` is the initial tension of every node of a single cable [N]; if
    it is empty, all nodes have the pretension.
    """
    motor = 0.0 if sides.by_torque == _MOTOR else sides.motor[0]
    joint = 0.0 if sides.by_torque == _JOINT else sides.joint[0]
    for k in range(3):
        stepper.set_rest(cables, motor, joint, states[k])
        if tension.size > 0:
            prm, n, own = cables.prm[0], cables.n[0], states[k, 0]
            tensions(own, n)[:] = tension
            rest_springs(prm, n, own)
            own[3] = kernel.total_stretch(prm, n, own)
    state, new, lead = states[0], states[1], 0.0
    for row in range(sides.motor.size):
        if interrupted(row):
            return
        if each:
            lead = _follow(cables, state, ahead, row, 0.0, states[2], work)
            _report(cables, states[2], ahead, row, lead, out)
            lead = 0.0
        lead = _follow(cables, state, sides, row, lead, new, work)
        state, new = new, state
        if not each:
            _report(cables, state, sides, row, lead, out)


def sensitivity(
    cable: Cable | Transmission, dt: float, *, of: Iterable[str], **motion: Any
) -> Derivatives:
    """Play a recorded motion, with the derivatives of all that it returns.

    Where friction turns or a cable becomes slack the derivative is one-sided; where an
    end stands still it is towards larger values.

    Args:
        cable: a cable, or a transmission, whose cables then change alike.
        dt: time between samples [s].
        of: quantities to derive by: scalar parameters of the cable; `motor_radius`,
            `joint_radius` and `gear_ratio` of a transmission; and what drives an end
            or a side, in that sample alone: `u_proximal` gives a stiffness.
        motion: arguments of `replay`, or of `Transmission.replay`.

    Raises:
        CableError: as `replay`; an unknown quantity, a term that is off, backlash, or a
            derivative that overflows.
    """
    known = dict.fromkeys(INDEX)
    played: Replay | Driven
    if isinstance(cable, Transmission):
        drive, played = cable, cable.replay(dt, **motion)
        known |= dict.fromkeys(("motor_radius", "joint_radius", "gear_ratio"))
    else:
        played = replay(cable, dt, **motion)
        off = {"eccentricity": 0.0, "ovality": 0.0}
        drive = Transmission.single(cable.replace(**off), 1.0, 1.0)
        known = {name: None for name in INDEX if not name.startswith(tuple(off))}
    if drive.backlash > 0.0:
        raise CableError("a transmission with backlash has no derivatives; set it to 0")
    given = {name: each for name, each in motion.items() if each is not None}
    known |= {name: None for side in _names(cable) for name in side if name in given}
    found: dict[str, Any] = {}
    single = isinstance(of, str) or not isinstance(of, Iterable)
    for name in (str(of),) if single else of:
        look_up("quantity `of`", name, known)
        switches = name in TERMS or name == "critical_slip_distance"
        if switches and any(getattr(each, name) == 0.0 for each in drive.cables):
            raise CableError(
                f"cable parameter `{name}` is 0 (off), where no derivative by it "
                "exists; give it a value"
            )
        rows = _play_dual(cable, drive, dt, name, given, played)
        if not np.isfinite(rows).all():
            raise CableError(f"the derivative by `{name}` overflows")
        first, parts = rows[:4, :, 1], rows[4:, :, 1].reshape(5, len(drive.cables), -1)
        if isinstance(played, Driven):
            found[name] = Driven(*[*first, *parts[[0, 1, 4]]])
        else:
            near, far, *rest = parts[:, 0]
            whole = [-first[0], -first[2], near, far, np.zeros(near.size), *rest]
            found[name] = Replay(*[*whole, None, None])
    return Derivatives(played, found)


def _names(cable: Cable | Transmission) -> tuple[tuple[str, str], ...]:
    """Return the arguments that can drive each side or end, its motion first."""
    if isinstance(cable, Transmission):
        return ("motor_angle", "motor_torque"), ("joint_angle", "joint_torque")
    return ("u_proximal", "tension_proximal"), ("u_distal", "tension_distal")


def _with_slope(values: ArrayLike, slopes: ArrayLike = 0.0) -> FloatArray:
    whole = np.array(values, dtype=np.float64)
    return np.stack([whole, np.broadcast_to(slopes, whole.shape)], axis=-1)


def _nudged(value: FloatArray, drive: Transmission, radius: float) -> FloatArray:
    """Return angles [rad] of a pulley, a little larger where they stand still."""
    # Steps of curved elasticity are solved in rounds, to 1e-5 of the largest tension.
    curved = [c for c in drive.cables if packed_parameters(c)[CURVED] != 0.0]
    stretches = [c.pretension * c.length / c.axial_stiffness for c in curved]
    least = max([1e-12, *(1e-3 * stretch for stretch in stretches)])
    still = np.diff(value, prepend=value[0]) == 0.0
    step = np.maximum(least / radius, 8.0 * np.spacing(np.abs(value)))
    return np.where(still, value + step, value)


def _play_dual(
    cable: Cable | Transmission, drive: Transmission, dt: float, name: str,
    given: dict[str, Any], played: Replay | Driven,
) -> FloatArray:  # fmt: skip
    """Return the rows of `_report` (rows, samples, 2): values and derivatives."""
    n = np.array([each.segments for each in drive.cables])
    count, most = n.size, int(n.max())
    drive_dual, pack = entries(_drive, kernel.pack)
    prm = np.zeros((count, kernel.parameter_size(most), 2))
    for row, each in zip(prm, drive.cables, strict=True):
        values = _with_slope(each.scalars, [p.name == name for p in PARAMETERS])
        own = row[: kernel.parameter_size(each.segments)]
        pack(values, _with_slope(each.conduit), each.segments, own)
    ways, gear = np.array((-1.0, 1.0)[:count]), drive.gear_ratio
    arm = drive.motor_radius / gear
    of_arm = {"motor_radius": 1.0 / gear, "gear_ratio": -arm / gear}.get(name, 0.0)
    near = _with_slope(ways * arm, ways * of_arm)
    wheel = _with_slope(ways * drive.motor_radius, ways * (name == "motor_radius"))
    far = _with_slope(ways * drive.joint_radius, ways * (name == "joint_radius"))
    sign = 1.0 if cable is drive else -1.0
    sides, ahead, by_torque, torque = [], [], 0, np.zeros(len(played.tension_distal.T))
    for k, (angle, load) in enumerate(_names(cable)):
        moved = getattr(played, angle)
        sides.append(_with_slope(sign * moved))
        if load in given:
            by_torque, torque = k + 1, np.array(given[load], dtype=np.float64)
        if name in (angle, load):
            moved = _nudged(moved, drive, (arm, drive.joint_radius)[k])
        ahead.append(_with_slope(sign * moved, sign * (name == angle)))
    wanted = _with_slope(torque, float(name.startswith("tension_") or "torque" in name))
    tension = given.get("initial_tension", ())
    out = np.empty((4 + 5 * count, torque.size, 2))
    drive_dual(
        stepper.Cables(prm, n, near, wheel, far), _with_slope(tension),
        _Sides(sides[0], sides[1], _with_slope(torque), by_torque, float(dt)),
        _Sides(ahead[0], ahead[1], wanted, by_torque, float(dt)), name in given,
        np.zeros((3, count, kernel.state_size(most), 2)),
        np.zeros((kernel.work_size(most), 2)), out,
    )  # fmt: skip
    return out
