"""The compiled functions of a cable stay inside what C and Warp have in common."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import numpy as np
import pytest

from cable.terms_on import TERMS_ON
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as at
from cc_mujoco.cable import _moving_path as moving_path
from cc_mujoco.cable import _nodes as nodes
from cc_mujoco.cable import _pack as pack
from cc_mujoco.cable._cable import TERMS
from cc_mujoco.errors import CableError
from cc_mujoco.native import compiled
from cc_mujoco.native._fold import Known
from cc_mujoco.native._warp import translate
from cc_mujoco.warp._build import FUNCTIONS, PATH_FUNCTIONS, Paths, known_values
from study_marks import study_but

OTHERS = (
    kernel.slack_length, kernel.stored_energy, kernel.total_stretch, pack.rebend,
    nodes.rest_stretch, moving_path.set_unstretched_lengths,
)  # fmt: skip


def test_every_function_is_in_the_subset():
    names = translate([*FUNCTIONS, *PATH_FUNCTIONS, *OTHERS], Known()).names
    for needed in (
        "_fronts.march", "_graph.sweep", "_presliding.preslide", "_kernel.step",
        "_nonlinear_elasticity.relinearize", "_pre_step.add_end_springs",
        "_path_geometry.arc", "_open_path.lengthen", "_moving_path.carry",
    ):  # fmt: skip
        assert needed in names


def test_a_tolerance_for_single_precision_is_that_of_one_module():
    """Constants go by name: a namesake elsewhere would get the tolerance too."""
    own = [m for name, m in sys.modules.items() if name.startswith("cc_mujoco.cable.")]
    for name in known_values(frozenset(), False, True).constants:
        values = [getattr(m, name) for m in own if hasattr(m, name)]
        written = [m for m in own if f"\n{name} = " in Path(m.__file__).read_text()]
        assert len(written) == 1, name
        assert set(values) == {getattr(written[0], name)}


ENDS = ("end", "proximal")


@pytest.mark.parametrize("terms", study_but(12, TERMS_ON))
def test_terms_that_are_off_leave_nothing(terms):
    on = {"friction", *TERMS_ON[terms]} & set(TERMS)
    library = translate(FUNCTIONS, known_values(frozenset(on), False, True))
    ast.parse(library.source)
    assert ("_presliding.preslide" in library.names) == ("bristle_length" in on)
    soft = {f"{end}_{kind}" for end in ENDS for kind in ("hardening", "loss")}
    curved = {"bedding_strain", "clearance"} | soft
    assert ("_elasticity.tension_of" in library.names) == bool(curved & on)
    assert ("_pre_step.relax_stress" in library.names) == ("stress_relaxation" in on)
    clamps = {"clamp_creep_proximal", "clamp_creep_distal"}
    assert ("_pre_step.slide_in_clamps" in library.names) == bool(clamps & on)
    assert "_moving_path.apply_material_law" not in library.names
    assert "_pre_step.add_end_springs" not in library.names


def test_what_is_known_of_paths_leaves_nothing_to_ask():
    on, led = frozenset({"friction"}), Paths(1.0, 1.0, False)
    library = translate(FUNCTIONS, known_values(on, False, True, led))
    assert "_moving_path.apply_material_law" in library.names
    assert f"prm[{at.PATH_LENGTHENS}] !=" not in library.source
    assert f"prm[{at.BENDS_CHANGE}] !=" not in library.source


@compiled
def _of_a_list(x: np.ndarray) -> float:
    return sum([abs(value) for value in x])


@compiled
def _by_name(a: float) -> float:
    return max(a, key=a)


@compiled
def _of_a_pair(pair: tuple[float, float]) -> float:
    return pair[0]


@compiled
def _sorted(a: float) -> float:
    return np.sort(a)


@pytest.mark.parametrize(
    ("function", "what"),
    [
        (_of_a_list, r"`\[abs\(value\) for value in x\]` in _of_a_list"),
        (_by_name, "an argument given by name in _by_name"),
        (_of_a_pair, r"an argument of the type `tuple\[float, float\]`"),
        (_sorted, r"a call of `np.sort` in _sorted"),
    ],
)
def test_what_leaves_it_is_refused_with_its_place(function, what):
    with pytest.raises(CableError, match=what) as refusal:
        translate([function], Known())
    line = int(str(refusal.value).split(":")[1])
    start = function.py_func.__code__.co_firstlineno
    assert start <= line <= start + 3
