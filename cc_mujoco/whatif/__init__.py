"""Design what-ifs: many transmissions simulated, measured, ranked.

    from cc_mujoco.whatif import study
    table = study("wrist", {"friction": "0.05:0.3:10", "loops": [1, 2, 3]})

`cc_mujoco.plant.VARIABLES` says what can be varied, `cc_mujoco.metrics.METRICS` what is
measured.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cc_mujoco.whatif.execution import carry_out, optimise, study
    from cc_mujoco.whatif.plan import Plan, make_plan
    from cc_mujoco.whatif.study_spec import Execution, StudySpec

__all__ = [
    "Execution",
    "Plan",
    "StudySpec",
    "carry_out",
    "make_plan",
    "optimise",
    "study",
]

_MODULES = {
    "Execution": "study_spec",
    "Plan": "plan",
    "StudySpec": "study_spec",
    "carry_out": "execution",
    "make_plan": "plan",
    "optimise": "execution",
    "study": "execution",
}


def __getattr__(name: str) -> Any:
    if name in _MODULES:  # loaded when first used, as help needs `study_spec` alone
        return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
