"""The table of parameters and the cable that reads and writes it."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cable.random_cables import sections
from cc_mujoco.cable import PARAMETERS, TERMS, Cable
from cc_mujoco.cable._cable import KEYS
from cc_mujoco.errors import CableError

BAD_NUMBERS = [
    "abc",
    "4o",
    "nan",
    "inf",
    "-inf",
    "1e400",
    "",
    " ",
    "1_0",
    "0x10",
    "1 2",
]


def cables():
    scalars = {
        p.name: st.floats(p.low, p.high, exclude_min=p.low_open)
        for p in PARAMETERS
        if p.name not in ("static_friction", "pretension")
    }
    scalars["pretension"] = st.floats(1e-9, 1e6)
    for name in "end_compliance", "proximal_compliance":
        scalars[name] = st.floats(1e-9, 1.0)
    return st.builds(
        Cable,
        **scalars,
        segments=st.integers(1, 1000),
        conduit=st.lists(sections(), min_size=1, max_size=5).map(tuple),
        route=st.sampled_from(["", "route"]),
    ).flatmap(_bent)


def _bent(cable):
    return st.sampled_from(["fixed", "route"] if cable.route else ["fixed"]).map(
        lambda bend: cable.replace(bend=bend)
    )


@given(cables())
def test_configuration_text_gives_the_same_cable_back(cable):
    assert Cable.from_config(cable.to_config()) == cable


def test_every_key_is_a_field():
    assert set(KEYS) == set(Cable.__dataclass_fields__)
    assert Cable().scalars == tuple(p.default for p in PARAMETERS)


@pytest.mark.parametrize("parameter", PARAMETERS, ids=lambda p: p.name)
def test_every_parameter_says_what_it_is(parameter):
    assert parameter.unit and parameter.meaning
    assert parameter.admits(parameter.default)
    assert getattr(Cable, parameter.name) == parameter.default


@pytest.mark.parametrize("name", TERMS)
def test_every_term_says_its_law_and_whose_it_is(name):
    term = TERMS[name]
    assert term.equation and term.source
    assert Cable(**{name: 0.0}).terms.keys() <= {"friction"}
    if name != "friction":
        assert getattr(Cable, name) == 0.0


def test_static_friction_is_constant_unless_it_weakens():
    held = Cable(static_friction=0.3)
    assert held.terms["static_friction"].depends_on == ()
    weakening = held.replace(critical_slip_distance=1e-3)
    assert weakening.terms["static_friction"].depends_on == ("history",)


def test_length_and_wrap_are_those_of_the_sections():
    cable = Cable.from_config({"conduit": "0.8:0.15 0.6:inf 0.6:0.4"})
    assert cable.length == pytest.approx(2.0)
    assert cable.wrap == pytest.approx(0.8 / 0.15 + 0.6 / 0.4)


@pytest.mark.parametrize("key", [p.name for p in PARAMETERS] + ["segments", "conduit"])
def test_a_bad_value_is_named_with_its_key_and_what_is_allowed(key):
    for text in BAD_NUMBERS:
        with pytest.raises(ValueError) as caught:
            Cable.from_config({key: text}, where="plugin `c` instance `flexor`")
        message = str(caught.value)
        assert message.startswith("plugin `c` instance `flexor`: ")
        assert f"`{key}` is {text!r}" in message
        assert "must be" in message


@pytest.mark.parametrize("parameter", PARAMETERS, ids=lambda p: p.name)
def test_out_of_range_values_are_refused_with_the_range(parameter):
    low = parameter.low if parameter.low_open else parameter.low - 1.0
    for value in (low, parameter.high * 1.01 + 1.0):
        with pytest.raises(ValueError, match=r"a number in [\[(]"):
            Cable.from_config({parameter.name: repr(value)})


def test_a_conduit_that_is_text_is_pointed_to_where_it_is_read() -> None:
    text: Any = "2:0.28"
    with pytest.raises(CableError, match=r"text as in MJCF is for Cable.from_config"):
        Cable(conduit=text)


@pytest.mark.parametrize("section", [(1, 0.2, "x", 1), (1,), (1, 0.2, 1, 1, 1)])
def test_other_sections_are_refused_with_what_their_numbers_are(section: Any) -> None:
    with pytest.raises(CableError, match="perhaps factors on `clearance`"):
        Cable(conduit=(section,))


@pytest.mark.parametrize(
    "text",
    [
        "2",
        "2:",
        ":0.3",
        "2:0",
        "-1:0.3",
        "0:0.3",
        "2:-inf",
        "inf:1",
        "2:0.3,1:1",
        "800:150",
        "1:0.3:1",
        "1:0.3:1:1:1",
        "1:0.3:-1:1",
        "1:0.3:1:0",
        "1:0.3:1e9:1",
        "1:0.3:1:1e9",
        "1:0.3:inf:1",
        "1:0.3:1:",
    ],
)
def test_a_bad_conduit_is_refused(text):
    with pytest.raises(ValueError, match=r"`conduit` .*length:radius"):
        Cable.from_config({"conduit": text, "clearance": "1e-3"})


def test_relaxation_needs_one_seating_tension():
    wide = Cable(clearance=1e-3, conduit=((1.0, 0.3), (1.0, 0.3, 1.0, 2.0)))
    allowed = "`stress_relaxation` is 0.1; it must be 0 .off. where sections differ in"
    with pytest.raises(CableError, match=allowed):
        wide.replace(stress_relaxation=0.1)


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"bend": "free", "route": "path"}, "`bend` is 'free'; it must be `fixed`"),
        ({"bend": "", "route": "path"}, "`bend` is ''"),
        ({"bend": "route"}, "`bend` is 'route' but `route` is empty"),
        (
            {"path": "open", "route": "path", "clearance": "1e-3"},
            "`clearance` is that of a conduit; it must be 0 .off. where `path` is",
        ),
    ],
)
def test_a_bend_that_nothing_gives_is_refused(config, message):
    with pytest.raises(ValueError, match=message):
        Cable.from_config(config)


def test_bends_are_fixed_unless_said_otherwise():
    assert "bend" not in Cable(route="path").to_config()
    assert Cable.from_config({"route": "path", "bend": "fixed"}) == Cable(route="path")


def test_an_unknown_key_names_its_nearest_match():
    with pytest.raises(ValueError, match="unknown key `stifness`; did you mean"):
        Cable.from_config({"stifness": "1"})
    with pytest.raises(ValueError, match="did you mean `friction`"):
        Cable.from_config({"frictoin": "0.1"})


def test_friction_that_depends_on_tension_needs_a_pretension():
    with pytest.raises(ValueError, match=r"`tension_exponent` is 0\.2; .*`pretension`"):
        Cable(pretension=0.0, tension_exponent=0.2)
    assert Cable(pretension=0.0).tension_exponent == 0.0


def test_static_friction_below_the_kinetic_one_is_refused():
    with pytest.raises(ValueError, match=r"at least `friction` = 0\.2"):
        Cable(friction=0.2, static_friction=0.1)
    assert Cable(friction=0.2, static_friction=0.0).static_friction == 0.0
