"""Periods in errors: detected in ripples, and not in smooth errors.

Errors without a period combine the components of real errors: noise of every bandwidth,
steps and decays at reversals, smooth functions of angle, speed and torque.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from cc_mujoco.diagnosis._locate import PeriodicError, Samples, strongest_line

DT = 0.016
BAND = 25.0
Signal = np.ndarray


def noise(random: np.random.Generator, count: int, band: float) -> Signal:
    """Return random errors of a bandwidth [Hz] and unit variance."""
    frequency = np.fft.rfftfreq(count, DT)
    size = random.normal(size=(2, frequency.size))
    spectrum = (size[0] + 1j * size[1]) / (1.0 + (frequency / band) ** 4)
    spectrum[0] = 0.0
    found = np.fft.irfft(spectrum, count)
    return found / found.std()


def motion(random: np.random.Generator, count: int) -> Signal:
    """Return a sine, a random motion, a chirp or a triangle [rad]."""
    time = DT * np.arange(count)
    size, kind = random.uniform(0.4, 1.5), random.integers(4)
    if kind == 0:
        return size * np.sin(random.uniform(0.5, 5.0) * time + random.uniform(0.0, 6.0))
    if kind == 1:
        return size * noise(random, count, random.uniform(0.2, 1.0))
    if kind == 2:
        first, last = random.uniform(0.05, 0.3), random.uniform(0.5, 1.5)
        rate = (last - first) / time[-1]
        return size * np.sin(math.tau * (first * time + 0.5 * rate * time**2))
    place = (time / random.uniform(2.0, 6.0) + random.uniform()) % 1.0
    return size * (4.0 * np.abs(place - 0.5) - 1.0)


def travelled(angle: Signal, way: Signal) -> Signal:
    """Return the signed distance since the last reversal [rad]."""
    turned = np.flatnonzero(np.diff(way, prepend=way[0]))
    last = np.zeros(angle.size, dtype=int)
    last[turned] = turned
    return angle - angle[np.maximum.accumulate(last)]


def recorded(
    seed: int, ripple: tuple[float, float, str, bool] | None = None
) -> Samples:
    """Return trials whose error has no period except that of a ripple.

    Args:
        seed: seed of motions and errors.
        ripple: order, size over the other error, angle, and whether its amplitude is
            proportional to the torque.
    """
    random = np.random.default_rng(seed)
    kinds = random.choice(8, random.integers(1, 5), replace=False)
    sizes = random.normal(size=kinds.size)
    rough = 10.0 ** random.uniform(-1.5, 0.3)
    parts, first = [], 0
    for _ in range(random.integers(3, 6)):
        count = int(random.integers(300, 500))
        motor = motion(random, count)
        speed = np.gradient(motor, DT)
        usual = np.quantile(np.abs(speed), 0.95)
        way, travel = np.sign(speed), travelled(motor, np.sign(speed))
        torque = 1.5 * np.tanh(10.0 * speed / usual) * (1.0 + 0.4 * motor) + motor
        torque += random.uniform(-1.0, 1.0)
        joint = 0.9 * motor - 0.05 * np.tanh(10.0 * speed / usual)
        shapes = (
            noise(random, count, 10.0 ** random.uniform(-0.7, 1.2)),
            way * np.exp(-np.abs(travel) / 0.03),
            np.sin(2.0 * motor + 1.0) + motor**3,
            speed * np.abs(speed) / usual**2,
            np.gradient(speed, DT) / (5.0 * usual),
            np.sign(travel) * np.exp(-np.abs(travel) / 0.1),
            torque * way,
            np.sign(speed - 0.3 * usual),
        )
        error = rough * noise(random, count, 15.0)
        for kind, size in zip(kinds, sizes, strict=True):
            error += size * shapes[kind] / (shapes[kind].std() + 1e-9)
        if ripple is not None:
            order, size, name, by_torque = ripple
            angle = motor if name == "motor angle" else joint
            scale = torque / np.sqrt(np.mean(torque**2)) if by_torque else 1.0
            error += size * error.std() * scale * np.cos(order * angle + 0.7)
        block = (DT * np.arange(count)).astype(int) + first
        first = int(block[-1]) + 1
        parts.append((error, motor, joint, torque, speed, block))
    error, motor, joint, torque, speed, block = map(
        np.concatenate, zip(*parts, strict=True)
    )
    angles = {"motor angle": motor, "joint angle": joint}
    return Samples(error, np.ones(error.size), angles, torque, speed, block, BAND)


def drawn_ripple(seed: int) -> tuple[float, float, str, bool]:
    """Return a ripple that the motions of `recorded` can show."""
    random = np.random.default_rng(10_000 + seed)
    name = ("motor angle", "joint angle")[random.integers(2)]
    size = float(random.uniform(1.0, 2.0))
    return float(random.uniform(12.0, 25.0)), size, name, bool(random.integers(2))


def right(
    line: PeriodicError | None, samples: Samples, order: float, name: str
) -> bool:
    """Return whether a line has the order and the angle of a ripple."""
    if line is None or line.angle != name:
        return False
    resolved = math.tau / float(np.ptp(samples.angles[name]))
    return abs(line.order - order) < 0.5 * resolved


@pytest.mark.parametrize("seed", range(10))
def test_errors_without_a_period_show_none(seed: int) -> None:
    assert strongest_line(recorded(seed)) is None


@pytest.mark.parametrize("seed", range(100, 108))
def test_a_ripple_is_found_with_its_order_its_angle_and_its_torque(seed: int) -> None:
    order, size, name, by_torque = drawn_ripple(seed)
    samples = recorded(seed, (order, size, name, by_torque))
    line = strongest_line(samples)
    assert right(line, samples, order, name), (line, order, name)
    assert line is not None and line.by_torque in (by_torque, None)


def test_an_error_that_is_too_short_or_zero_has_no_period() -> None:
    samples = recorded(0)
    assert strongest_line(samples._replace(error=0.0 * samples.error)) is None
    short = [each[:50] for each in (samples.error, samples.weight)]
    angles = {name: angle[:50] for name, angle in samples.angles.items()}
    few = Samples(
        *(*short, angles, samples.torque[:50], samples.speed[:50]),
        *(samples.block[:50], BAND),
    )
    assert strongest_line(few) is None
    held = {**samples.angles, "joint angle": np.zeros(samples.error.size)}
    assert strongest_line(samples._replace(angles=held)) is None


@pytest.mark.study
def test_how_often_a_period_is_found() -> None:
    """No false alarm in 400 sets without a period; 95 % of 200 ripples are found."""
    false = [seed for seed in range(400) if strongest_line(recorded(seed)) is not None]
    missed, turned = [], []
    for seed in range(1000, 1200):
        order, size, name, by_torque = drawn_ripple(seed)
        samples = recorded(seed, (order, size, name, by_torque))
        line = strongest_line(samples)
        if not right(line, samples, order, name):
            missed.append(seed)
        elif line is not None and line.by_torque not in (by_torque, None):
            turned.append(seed)
    print(f"false {false}, missed {missed}, torque wrong {turned}")
    assert not false and len(missed) <= 10 and len(turned) <= 2
