"""Fit the harmonic gait profiles and rewrite `cc_mujoco/human/gait.csv`.

    python scripts/fit_gait.py FOLDER

FOLDER holds two tables. `ankle_walk_tidy.csv`: columns t_s, and JOINT_r_deg and
JOINT_r_moment_Nm of ankle, knee and hip, at equal steps, over more than one gait cycle.
`ankle_assistance_shape.csv`: columns gait_cycle_fraction (0 to 1),
assistance_normalised. The period is the one that leaves the least error of the angles
over the whole recording; the coefficients are least squares over the one cycle that
starts at heel strike. Prints the period (`GAIT_PERIOD`), coefficients and RMS errors.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from cc_mujoco.native import FloatArray as Array

HARMONICS = 8
HEEL_STRIKE = 0.60
"""Time of the right heel strike in the recording [s]: there the moment of the right
ankle turns from about zero, in swing, to the dorsiflexion moment of loading."""
JOINTS = ("ankle", "knee", "hip")
TABLE = Path(__file__).parents[1] / "cc_mujoco" / "human" / "gait.csv"
DECIMALS = 6
HEAD = """\
# Coefficients of the harmonic gait profiles; written by `scripts/fit_gait.py`.
#
# Angles [rad] and moments [N m] by inverse dynamics: right leg of one walking
# subject, OpenSim Gait2354 example (subject01), one gait cycle, as repackaged in the
# public repository nickbianco/soft-exosuit-design (MIT licence). Assistance [1]: shape
# of the ankle assistance of Quinlivan et al. 2017 (Science Robotics 2(2), eaah4416),
# digitised by the same repository; the series is that of its square root.
#
# RMS errors of the fit: {errors}.
#
# Factors of cos(2 pi k p) and sin(2 pi k p) over the gait cycle p, from k = 0.
profile,cosine,sine
"""


def design(phase: Array) -> Array:
    """Return the columns cos and sin of each harmonic, (m, 2 HARMONICS + 2)."""
    turn = 2 * np.pi * np.outer(phase, np.arange(HARMONICS + 1))
    return np.stack([np.cos(turn), np.sin(turn)], axis=2).reshape(phase.size, -1)


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def solve(matrix: Array, values: Array) -> Array:
    return np.asarray(np.linalg.lstsq(matrix, values, rcond=None)[0])


def fit_period(time: Array, angles: list[Array]) -> float:
    """Return the period of least summed RMS error on a grid of 5 ms [s]."""

    def error(period: float) -> float:
        matrix = design((time - HEEL_STRIKE) / period)
        return sum(rms(matrix @ solve(matrix, angle) - angle) for angle in angles)

    return float(min(np.arange(1.0, 1.5, 0.005).round(3), key=error))


def fit_assistance(phase: Array, shape: Array) -> Array:
    """Return the series whose square is closest to `shape`, scaled to a peak of 1."""
    matrix = design(phase)
    start = solve(matrix, np.sqrt(shape))
    # The series of the square root is the start; what is fitted is the square.
    found = least_squares(lambda x: (matrix @ x) ** 2 - shape, start).x
    peak = np.abs(design(np.linspace(0.0, 1.0, 20_001)) @ found).max()
    found[1] = 0.0  # the sine of harmonic 0: any value fits, so none is found
    return np.asarray(found / peak)


def read(path: Path) -> Any:
    return np.genfromtxt(path, delimiter=",", names=True)


def fit(folder: Path) -> tuple[float, dict[str, Array], dict[str, float]]:
    """Return the period [s], coefficients and RMS errors of all profiles by name.

    Coefficients (HARMONICS + 1, 2) are rounded as they are written, in rad and N m;
    errors of angles are in degrees.
    """
    walk = read(folder / "ankle_walk_tidy.csv")
    time, angles = walk["t_s"], [walk[f"{joint}_r_deg"] for joint in JOINTS]
    period = fit_period(time, angles)
    cycle = (time > HEEL_STRIKE - 1e-3) & (time < HEEL_STRIKE + period - 1e-3)
    matrix = design((time[cycle] - HEEL_STRIKE) / period)
    table, errors = {}, {}
    for joint, angle in zip(JOINTS, angles, strict=True):
        fitted = solve(matrix, np.deg2rad(angle[cycle])).round(DECIMALS)
        errors[joint] = rms(np.rad2deg(matrix @ fitted) - angle[cycle])
        table[joint] = fitted.reshape(-1, 2)
    for joint in JOINTS:
        moment = walk[f"{joint}_r_moment_Nm"][cycle]
        fitted = solve(matrix, moment).round(DECIMALS)
        errors[f"{joint}_moment"] = rms(matrix @ fitted - moment)
        table[f"{joint}_moment"] = fitted.reshape(-1, 2)
    shape = read(folder / "ankle_assistance_shape.csv")
    # The last point repeats the first of the next cycle.
    phase = shape["gait_cycle_fraction"][:-1]
    normalised = shape["assistance_normalised"][:-1]
    fitted = fit_assistance(phase, normalised).round(DECIMALS)
    errors["assistance"] = rms((design(phase) @ fitted) ** 2 - normalised)
    table["assistance_root"] = fitted.reshape(-1, 2)
    return period, table, errors


def summary(errors: dict[str, float]) -> str:
    """Return the errors as one line."""
    angles = ", ".join(f"{joint} {errors[joint]:.2f}" for joint in JOINTS)
    each = ", ".join(f"{joint} {errors[f'{joint}_moment']:.2f}" for joint in JOINTS)
    moment = f"moments {each} N m"
    assistance = f"assistance {errors['assistance']:.4f} of its peak"
    return f"{angles} degrees;\n{moment}; {assistance}"


def render(table: dict[str, Array], errors: dict[str, float]) -> str:
    text = HEAD.format(errors=summary(errors).replace("\n", "\n# "))
    for name, coefficients in table.items():
        # Adding 0.0 turns -0.0 into 0.0.
        for a, b in coefficients.tolist():
            text += f"{name},{a + 0.0!r},{b + 0.0!r}\n"
    return text


def is_table(path: Path) -> bool:
    """Return whether this script wrote a file."""
    return path.is_file() and path.read_bytes().startswith(HEAD[:50].encode())


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="folder with the two CSV tables")
    parser.add_argument("--table", type=Path, default=TABLE, help="file to rewrite")
    options = parser.parse_args(arguments)
    if options.table.exists() and not is_table(options.table):
        parser.error(f"{options.table} was not written by this script; name another.")
    period, table, errors = fit(options.folder)
    print(f"period {period:g} s, {HARMONICS} harmonics")
    for name, coefficients in table.items():
        print(name)
        for k, (a, b) in enumerate(coefficients.tolist()):
            print(f"  {k}  cos {a:+.6f}  sin {b:+.6f}")
    print("RMS errors: " + summary(errors).replace("\n", " "))
    options.table.write_text(render(table, errors), encoding="utf-8")


if __name__ == "__main__":
    main()
