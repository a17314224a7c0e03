"""Coefficients of the harmonic gait profiles; written by `scripts/fit_gait.py`.

Angles and the moment of the ankle by inverse dynamics: right leg of one walking
subject, OpenSim Gait2354 example (subject01), one gait cycle, as repackaged in the
public repository nickbianco/soft-exosuit-design (MIT licence). Assistance: shape of the
ankle assistance of Quinlivan et al. 2017 (Science Robotics 2(2), eaah4416), digitised
by the same repository; the series is that of its square root.

RMS errors of the fit: ankle 0.22, knee 0.12, hip 0.12 degrees;
moment of the ankle 0.90 N m; assistance 0.0051 of its peak.
"""

from __future__ import annotations

# Pairs (a_k, b_k) of cos(2 pi k p) and sin(2 pi k p) over the gait cycle p, from k = 0.
PERIOD = 1.23  # s
ANKLE = (  # rad
    (0.074081, 0.0),
    (-0.088666, 0.050426),
    (0.052878, -0.036282),
    (-0.041953, -0.040335),
    (0.008472, 0.032982),
    (0.02895, -0.013086),
    (-0.009671, -0.004752),
    (0.003962, 0.013812),
    (0.008763, -0.003192),
)
KNEE = (  # rad
    (-0.443022, 0.0),
    (-0.038492, 0.36827),
    (0.353834, -0.039756),
    (0.071606, -0.099353),
    (0.035042, -0.00227),
    (0.02417, -0.013158),
    (0.002224, -0.008005),
    (0.004335, -0.000708),
    (0.002087, -0.002986),
)
HIP = (  # rad
    (0.073217, 0.0),
    (0.369667, 0.00877),
    (-0.067886, -0.031749),
    (-0.024873, 0.033821),
    (-0.009319, -0.002457),
    (-0.009278, 0.002889),
    (-0.000798, 0.003812),
    (-0.000256, -6.1e-05),
    (-0.003751, 0.000734),
)
ANKLE_MOMENT = (  # N m
    (-35.659764, 0.0),
    (55.697461, -20.030938),
    (-21.740388, 12.625651),
    (9.967561, 6.599723),
    (-6.943081, -6.693223),
    (-0.741619, 6.376877),
    (0.225069, -3.328161),
    (-1.762794, -0.163654),
    (1.042547, 0.508513),
)
ASSISTANCE_ROOT = (  # 1
    (0.235132, 0.0),
    (-0.40149, 0.037191),
    (0.245929, -0.02348),
    (-0.102018, -0.027248),
    (0.02209, 0.054967),
    (0.009768, -0.035845),
    (-0.027935, -0.000612),
    (-0.005073, 0.007981),
    (0.005992, -0.005475),
)
