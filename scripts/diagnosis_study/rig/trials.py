"""Trials of a session: commands of the motor and loads of the handle.

Motions of either are angles [rad] at 1 kHz over `DURATION`. Corners are rounded over
20 ms, as the motion profile of any drive does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator

from cc_mujoco.native import FloatArray as Array

RATE = 1000
LEAD = 0.6
"""Unrecorded time before each trial [s], in which the drive approaches its start."""
DURATION = 8.0  # recorded length of a trial [s]

TIME: Array = np.arange(int(RATE * DURATION) + 1) / RATE


def rounded(path: Array, width: float = 0.02) -> Array:
    """Return the path with its corners rounded over `width` seconds."""
    size = int(width * RATE) // 2 * 2 + 1
    window = np.hanning(size + 2)[1:-1]
    padded = np.pad(path, size // 2, mode="edge")
    return np.convolve(padded, window / window.sum(), mode="valid")


def via(times: Array, angles: Array) -> Array:
    """Return straight lines through (time [s], angle [rad]) points, corners rounded."""
    return rounded(np.interp(TIME, times, angles))


def speed_ladder(speeds: Array, reach: float) -> Array:
    """Return moves to and fro at each constant speed [rad/s], as many as time allows.

    Each speed lasts equally long; slow ones turn short of `reach` [rad].
    """
    rung = DURATION / len(speeds)
    angle = np.zeros_like(TIME)
    for k, speed in enumerate(speeds):
        inside = TIME >= k * rung
        # A triangle that starts and, as rungs hold whole periods, ends at zero.
        periods = max(1, round(rung * speed / (4 * reach)))
        height = min(reach, speed * rung / (4 * periods))
        phase = (TIME[inside] - k * rung) / rung * periods
        triangle = 1 - 4 * np.abs((phase + 0.25) % 1 - 0.5)
        angle[inside] = height * triangle
    return rounded(angle)


def multisine(rng: Generator, low: float, high: float, rms: float) -> Array:
    """Return a multisine (samples,) [rad] of random phases at multiples of 1/8 Hz.

    Its band is `low` to `high` [Hz], its RMS `rms` [rad]. Amplitudes fall as 1 /
    frequency, so that every line adds the same speed.
    """
    lines = np.unique(np.round(np.geomspace(low, high, 9) * DURATION)) / DURATION
    phases = rng.uniform(0, 2 * np.pi, lines.size)
    wave = np.sin(2 * np.pi * np.outer(TIME, lines) + phases) / lines
    path = wave.sum(axis=1)
    return np.asarray(path * rms / np.std(path))


def minimum_jerk(rng: Generator, reach: float, dwells: Array) -> Array:
    """Return minimum-jerk moves within `reach` [rad] with a rest [s] after each."""
    moves = len(dwells)
    weights = rng.uniform(0.7, 1.3, moves)
    lengths = weights / weights.sum() * (DURATION - float(np.sum(dwells)))
    ends = reach * rng.uniform(0.4, 1.0, moves) * np.where(np.arange(moves) % 2, -1, 1)
    angle = np.zeros_like(TIME)
    start, clock = 0.0, 0.0
    for length, end, dwell in zip(lengths, ends, dwells, strict=True):
        s = np.clip((TIME - clock) / length, 0, 1)
        share = s**3 * (10 - 15 * s + 6 * s**2)
        angle = np.where(clock <= TIME, start + (end - start) * share, angle)
        start, clock = end, clock + length + dwell
    return angle


def chirp(low: float, high: float, reach: float) -> Array:
    """Return a sine of rising frequency and constant peak speed."""
    growth = np.log(high / low) / DURATION
    phase = 2 * np.pi * low * (np.exp(growth * TIME) - 1) / growth
    return np.asarray(reach * np.exp(-0.75 * growth * TIME) * np.sin(phase))


def micro_reversals(rng: Generator, reach: float, speed: float) -> Array:
    """Return a slow triangle, each flank broken by backward steps of many sizes."""
    times, angles, direction = [0.0], [0.0], 1.0
    sizes = np.geomspace(0.004, 0.12, 12)
    rng.shuffle(sizes)
    k = 0
    while times[-1] < DURATION:
        for change in (0.28 * reach, -sizes[k % sizes.size]):
            angles.append(angles[-1] + direction * change)
            times.append(times[-1] + abs(change) / speed)
        if abs(angles[-1]) > reach:
            direction = -np.sign(angles[-1])
        k += 1
    return via(np.array(times), np.array(angles))


STIFF = (500.0, 0.55)
"""Position loop of the motor: stiffness [N m/rad], damping [N m s/rad]."""
COMPLIANT = (5.0, 0.25)

HUMAN = (4.0, 0.12)
FIRM = (25.0, 0.5)
SPRING = (6.0, 0.03)
FREE = (0.0, 0.0)
LOCKED = (3000.0, 2.0)
"""Impedances at the handle: stiffness [N m/rad] and damping [N m s/rad] to a target.
A loose or a firm human hand, a spring, no load, a clamp."""


WEIGHTS = (2.0, 2.0)  # torques of the known weights at motor and joint [N m]


@dataclass(frozen=True)
class Trial:
    motion: str  # description of the motor's motion; public
    load: str  # `human`, `spring`, `free` or `locked`; public
    command: Array  # (m, 2) angle [rad] and speed [rad/s] of the motor at 1 kHz
    target: Array  # (m, 2) angle [rad] and speed [rad/s] of the environment
    servo: tuple[float, float]  # stiffness and damping of the motor's position loop
    # stiffness and damping that tie the handle to `target`
    environment: tuple[float, float]
    tightness: float = 1.0  # pretension over the rig's usual one; public
    # index of the trial of which this is a repetition, or None
    repeat_of: int | None = None
    tilt: float = 0.0  # angle by which the rig is turned about the joint's axis; public
    unhooked: bool = False  # whether the cables are off both pulleys; public
    # of weights in place of the cables, at motor and joint [N m]; public
    known_torques: tuple[float, float] = (0.0, 0.0)
    swapped: bool = False  # whether the torque sensors have changed places; public


def _led(path: Array, approach: float) -> Array:
    """Return the path after a lead-in that starts `approach` away from it."""
    s = np.arange(round(LEAD * RATE)) / (0.8 * LEAD * RATE)
    s = np.minimum(s, 1.0)
    lead = path[0] - approach * (1 - s**3 * (10 - 15 * s + 6 * s**2))
    angle = np.concatenate([lead, path])
    return np.stack([angle, np.gradient(angle, 1 / RATE)], axis=1)


def _trial(
    rng: Generator,
    motion: str,
    load: str,
    command: Array,
    target: Array,
    environment: tuple[float, float],
    *,
    servo: tuple[float, float] = STIFF,
    tightness: float = 1.0,
    repeat_of: int | None = None,
) -> Trial:
    approach = rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 0.12)
    return Trial(
        motion, load, _led(command, approach), _led(target, 0.0), servo, environment,
        tightness, repeat_of,
    )  # fmt: skip


def asked(motor: Array, joint: Array, load: str) -> Trial:
    """Return a trial that commands motor and joint motions at 1 kHz [rad]."""
    held = {"free": FREE, "locked": LOCKED, "human": FIRM}[load]
    command, target = _led(rounded(motor), 0.08), _led(rounded(joint), 0.0)
    return Trial("asked for", load, command, target, STIFF, held)


def standard(trials: list[Trial]) -> list[Trial]:
    """Return the trials, one more with the rig turned, and two with the cables off.

    The second of these has known weights in place of the cables.
    """
    sweep = speed_ladder(np.full(2, 0.4), 0.8)
    turned = replace(asked(sweep, sweep, "free"), tilt=0.5 * np.pi, motion="turned")
    off = replace(asked(sweep, -sweep, "human"), unhooked=True, motion="cables off")
    weights = replace(off, known_torques=WEIGHTS, motion="cables off, weights")
    return [*trials, turned, off, weights]


def rich(rng: Generator) -> list[Trial]:
    """Return eight trials with varied motions, in which both ends move."""
    zero = np.zeros_like(TIME)
    speeds = np.array([0.06, 0.15, 0.4, 1.0, 2.5]) * rng.uniform(0.9, 1.1)
    dwells = np.array([0.1, 0.3, 1.0, 0.2, 1.8])
    reach = minimum_jerk(rng, 1.1, dwells)
    reach_hand = multisine(rng, 0.25, 1.0, 0.35)
    walk = multisine(rng, 0.125, 3.0, 0.5)
    walk_hand = 0.5 * walk + multisine(rng, 0.25, 2.0, 0.3)
    loose = multisine(rng, 0.125, 2.0, 0.5)
    loose_hand = multisine(rng, 0.25, 1.5, 0.5)
    pushed = multisine(rng, 0.25, 2.0, 0.55)
    return [
        _trial(rng, "speed ladder", "spring", speed_ladder(speeds, 0.9), zero,
               SPRING),
        _trial(rng, "multisine", "human", walk, walk_hand, HUMAN),
        _trial(rng, "minimum jerk with dwells", "human", reach, reach_hand, HUMAN),
        _trial(rng, "chirp", "free", chirp(0.25, 5.0, 0.8), zero, FREE),
        _trial(rng, "triangle with micro-reversals", "spring",
               micro_reversals(rng, 0.8, 0.5), zero, SPRING),
        _trial(rng, "multisine", "human", loose, loose_hand, HUMAN, tightness=0.65),
        _trial(rng, "compliant motor, handle driven", "human", 0.3 * walk, pushed,
               FIRM, servo=COMPLIANT),
        _trial(rng, "minimum jerk with dwells", "human", reach, reach_hand, HUMAN,
               repeat_of=2),
    ]  # fmt: skip


def ramps(rng: Generator) -> list[Trial]:
    """Return eight trials of constant speeds only."""
    zero = np.zeros_like(TIME)
    out = []
    for k, speed in enumerate([0.1, 0.2, 0.4, 0.6, 0.8, 1.0, 0.03]):
        reach = 0.04 if speed < 0.1 else 0.9
        path = speed_ladder(np.full(2, speed * rng.uniform(0.9, 1.1)), reach)
        load, held = (("spring", SPRING), ("human", HUMAN))[k % 2]
        if speed < 0.1:
            load, held = "locked", LOCKED
        out.append(_trial(rng, "triangle", load, path, zero, held))
    first = out[2]
    path = first.command[-TIME.size :, 0]
    again = _trial(rng, first.motion, first.load, path, zero, first.environment,
                   repeat_of=2)  # fmt: skip
    return [*out, again]


def human(rng: Generator) -> list[Trial]:
    """Return eight trials of reaching: a hand moves, and a compliant motor follows."""
    out = []
    for k in range(7):
        dwells = rng.uniform(0.1, 0.9, 5)
        hand = minimum_jerk(rng, 1.0, dwells)
        help_along = np.roll(hand, 60) * rng.uniform(0.7, 1.0)
        help_along[:60] = 0.0
        servo = STIFF if k % 2 else COMPLIANT
        held = HUMAN if k % 2 else FIRM
        out.append(
            _trial(rng, "reaching", "human", help_along, hand, held, servo=servo)
        )
    first = out[1]
    size = TIME.size
    again = _trial(rng, first.motion, first.load, first.command[-size:, 0],
                   first.target[-size:, 0], first.environment, servo=first.servo,
                   repeat_of=1)  # fmt: skip
    return [*out, again]


def restful(rng: Generator) -> list[Trial]:
    """Return the rich trials with long rests and slow creep instead of quick moves.

    The hand is still during the rests. In the trial of creep the motor alternates
    between fast moves and about 0.01 rad/s, close to the resolution of the encoders.
    """
    trials = rich(rng)
    zero = np.zeros_like(TIME)
    rests = np.array([1.6, 0.4, 2.6, 0.8])
    reach = minimum_jerk(rng, 1.0, rests)
    corners = np.array([0.0, 0.3, 2.3, 2.6, 4.6, 5.0, 7.0, 7.4, 8.0])
    way = rng.uniform(0.7, 1.3, 8) * [0.3, 0.02, 0.25, 0.04, -0.6, -0.01, -0.3, -0.08]
    creeping = via(corners, np.concatenate([[0.0], np.cumsum(way)]))
    moved = {
        2: _trial(rng, "minimum jerk with long rests", "human", reach, zero, HUMAN),
        4: _trial(rng, "slow creep", "spring", creeping, zero, SPRING),
        7: _trial(rng, "minimum jerk with long rests", "human", reach, zero, HUMAN,
                  repeat_of=2),
    }  # fmt: skip
    return [moved.get(k, trial) for k, trial in enumerate(trials)]


SETS = {
    "rich": rich,
    "restful": restful,
    "ramps": ramps,
    "human": human,
    "rich_standard": lambda rng: standard(rich(rng)),
    "restful_standard": lambda rng: standard(restful(rng)),
}
"""Sets of trials by name: functions of a generator of random numbers."""
