"""Design what-ifs: many transmissions simulated, measured, ranked.

    from cc_mujoco.whatif import study
    table = study("wrist", {"friction": "0.05:0.3:10", "loops": [1, 2, 3]})

`VARIABLES` says what can be varied, `MATERIALS` of what a cable may be,
`cc_mujoco.metrics.METRICS` what is measured.
"""

from __future__ import annotations

from cc_mujoco.whatif.materials import MATERIALS
from cc_mujoco.whatif.motors import MOTORS
from cc_mujoco.whatif.plan import Plan, make_plan
from cc_mujoco.whatif.search import optimise
from cc_mujoco.whatif.study import carry_out, study
from cc_mujoco.whatif.variables import VARIABLES

__all__ = [
    "MATERIALS",
    "MOTORS",
    "VARIABLES",
    "Plan",
    "carry_out",
    "make_plan",
    "optimise",
    "study",
]
