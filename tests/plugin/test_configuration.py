"""A configuration that cannot be used is a ValueError that says what and why."""

from __future__ import annotations

import math

import mujoco
import pytest

from cc_mujoco.cable import PARAMETERS
from cc_mujoco.cable._cable import ALLOWED
from cc_mujoco.errors import CableError
from cc_mujoco.plugin import PLUGIN, from_mjcf
from cc_mujoco.plugin._engine import REQUIRED
from plugin.scenes import CONFIG, build, end, instance, model, pull_pull

NOT_NUMBERS = ("abc", "4o", "nan", "inf", "1e400", "-1", "1e300", "1 2", " ")
NOT_CONDUITS = (
    "abc", "1", "1:", ":1", "1:x", "x:1", "0:1", "-1:1", "1:0", "1:-1", "1:nan",
    "inf:1", "1:1e400", "1:1:1", "1;1", "1:0.3,1:0.3", "1:INF", "1 : 1", " ",
    " ".join(["1:1"] * 65), "1:0.009", "50.1:inf", "1:1:1:1:1", "1:1:-1:1", "1:1:1:0",
    "1:1:1:1e9", "1:1:inf:1", "1:1:1:", "1:1::1",
)  # fmt: skip
NOT_SEGMENTS = ("abc", "4o", "nan", "1e1", "-1", "0", "1001", "2.0", "9" * 40, " ")
NOT_ROUTES = ("nowhere", "mix", "pathway")
NOT_BENDS = ("moving", "Route", "route", " ")  # `route` names no tendon here
BAD: dict[str, list[str]] = {
    "conduit": [*NOT_CONDUITS, ""],
    "segments": [*NOT_SEGMENTS],
    "route": [*NOT_ROUTES],
    "bend": [*NOT_BENDS],
}
for p in PARAMETERS:
    below = [repr(p.low - 1.0), *["0"] * p.low_open, *[""] * (p.name in REQUIRED)]
    numbers = [value for value in NOT_NUMBERS if value != "-1"]
    BAD[p.name] = [*numbers, *below, repr(p.high * 1.0001)]
BAD["static_friction"].append("0.1499")
BAD["end_compliance"] += [  # loading curves
    "0:0 .1:1 .2:2", "0:0 .1:1 .1:2 .2:3", "0:0 .1:3 .2:2 .3:4", "0:-1 .1:1 .2:2 .3:3",
    "0:1 .1:1 .2:1 .3:1", "0:0 .1:1:1:1 .2:3 .3:4", "0:0 .1:inf .2:inf .3:inf", "1e-4:",
    "0:0 9:1e-3 18:2e-3 27:3e-3", " ".join(f"{i}e-3:{i}" for i in range(65)),
]  # fmt: skip
BAD["proximal_compliance"].append("0:0 .1:1 .2:2")
ALLOWED = {p.name: p.allowed for p in PARAMETERS} | {
    "conduit": ALLOWED["conduit"],
    "segments": "a whole number in [1, 1000]",
    "route": "the name of a spatial tendon of the model",
    "bend": ALLOWED["bend"],
}


@pytest.mark.parametrize(("key", "value"), [("segments", " 7\t"), ("friction", " .2 ")])
def test_blanks_around_a_number_mean_nothing_to_mujoco_and_python(
    key: str, value: str
) -> None:
    compiled, _ = build(pull_pull(CONFIG | {key: value}))
    assert getattr(from_mjcf(compiled)["flexor"], key) == float(value)


@pytest.mark.parametrize("key", BAD)
def test_bad_value_is_named_with_what_is_allowed(key: str) -> None:
    for value in BAD[key]:
        xml = pull_pull(CONFIG | {key: value})
        with pytest.raises(ValueError, match="engine error") as caught:
            mujoco.MjModel.from_xml_string(xml)
        message = str(caught.value)
        for part in (PLUGIN, "'flexor'", f"`{key}`", ALLOWED[key]):
            assert part in message
        empty = not value and "missing or empty" in message
        assert empty or f"'{value[:90]}" in message
    build(pull_pull())  # a good model still compiles


@pytest.mark.parametrize("key", [key for key in BAD if key != "route"])
def test_python_refuses_the_same_values_and_an_empty_one(key: str) -> None:
    for value in (*BAD[key], ""):
        with pytest.raises(CableError, match="flexor") as caught:
            from_mjcf(pull_pull(CONFIG | {key: value}))
        assert key in str(caught.value)
        assert PLUGIN in str(caught.value)


@pytest.mark.parametrize("key", REQUIRED)
def test_missing_key_is_named(key: str) -> None:
    config = {k: v for k, v in CONFIG.items() if k != key}
    with pytest.raises(ValueError, match=f"`{key}` is missing") as caught:
        build(pull_pull(config))
    assert "'flexor'" in str(caught.value)
    with pytest.raises(CableError, match=f"`{key}` is missing"):
        from_mjcf(pull_pull(config))


def test_unknown_key_names_plugin_instance_and_key() -> None:
    with pytest.raises(ValueError, match="stifness") as caught:
        build(pull_pull(CONFIG | {"stifness": "1"}))
    assert PLUGIN in str(caught.value)
    assert "'flexor'" in str(caught.value)
    with pytest.raises(CableError, match=r"frction.*did you mean `friction`"):
        from_mjcf(pull_pull(CONFIG | {"frction": "1"}))


def test_bad_value_in_a_specification() -> None:
    spec = mujoco.MjSpec.from_string(pull_pull())
    spec.plugins[0].config = CONFIG | {"friction": "4o"}
    with pytest.raises(ValueError, match=r"flexor.*friction.*4o.*\[0, 5\]"):
        spec.compile()


PROXIMAL = end("one", "flexor", 'joint="motor"', -0.02)
DISTAL = end("two", "flexor", 'joint="wrist"', -0.05)


@pytest.mark.parametrize(
    ("actuators", "wanted"),
    [
        ("", ["used by 0 actuators", "used by two"]),
        (PROXIMAL, ["used by 1 actuators", "used by two"]),
        (PROXIMAL + DISTAL + end("three", "flexor", 'joint="sledge"', 1),
         ["used by 3 actuators", "used by two"]),
        (PROXIMAL + end("two", "flexor", 'joint="ball"', 1), ["'two'", "transmission"]),
        (PROXIMAL + end("two", "flexor", 'tendon="mix"', 1), ["'two'", "`coef`"]),
        (PROXIMAL + end("two", "flexor", 'site="hook"', 1), ["'two'", "transmission"]),
        (PROXIMAL + end("two", "flexor", 'jointinparent="wrist"', 1),
         ["'two'", "transmission"]),
        (PROXIMAL + end("two", "flexor", 'joint="wrist"', 0), ["'two'", "gear 0"]),
        (PROXIMAL + end("two", "flexor", 'joint="wrist"', math.nan),
         ["'two'", "no finite number"]),
        (PROXIMAL + end("two", "flexor", 'joint="sledge"', math.inf),
         ["'two'", "no finite number"]),
        (PROXIMAL + end("two", "flexor", 'joint="motor"', -0.05),
         ["'two'", "same joint"]),
    ],
)  # fmt: skip
def test_wrong_ends_are_named(actuators: str, wanted: list[str]) -> None:
    with pytest.raises(ValueError, match="'flexor'") as caught:
        build(model(instance("flexor"), actuators))
    for part in [PLUGIN, *wanted]:
        assert part in str(caught.value)
    build(model(instance("flexor"), PROXIMAL + DISTAL))


def test_configuration_inside_an_actuator_has_no_partner() -> None:
    keys = "".join(f'<config key="{k}" value="{v}"/>' for k, v in CONFIG.items())
    inline = f'<plugin name="one" plugin="{PLUGIN}" joint="motor">{keys}</plugin>'
    with pytest.raises(ValueError, match="used by 1 actuators"):
        build(model("", inline))
    with pytest.raises(CableError, match="partner"):
        from_mjcf(model("", inline))


@pytest.mark.parametrize("step", [math.nan, math.inf, 0.0, -1e-3])
def test_time_step_that_is_none_is_refused(step: float) -> None:
    spec = mujoco.MjSpec.from_string(pull_pull())
    spec.option.timestep = step
    with pytest.raises(ValueError, match="`timestep` must be a positive finite number"):
        spec.compile()


@pytest.mark.parametrize("place", ["1e13", "1e200", "nan", "inf"])
def test_length_that_is_none_is_refused(place: str) -> None:
    ends = end("near", "flexor", 'joint="motor"', -0.02)
    ends += end("far", "flexor", 'tendon="path"', 0.5)
    keys = CONFIG | {"route": "path"}
    for config in (CONFIG, keys | {"bend": "route"}, keys | {"path": "open"}):
        xml = model(instance("flexor", config), ends)
        with pytest.raises(ValueError, match="has no length in the pose `qpos0`"):
            build(xml.replace('pos="0 0 1"', f'pos="0 0 {place}"', 1))


@pytest.mark.parametrize("name", ["%s%n%d", "x" * 3000, "übung"])
def test_names_of_any_kind_are_quoted(name: str) -> None:
    with pytest.raises(ValueError, match="plugin->init failed") as caught:
        build(model(instance(name, CONFIG | {"friction": "%s"}), ""))
    assert f"instance '{name[:90]}" in str(caught.value)


def test_optional_keys_have_the_defaults_of_the_table() -> None:
    m, _ = build(pull_pull({key: CONFIG[key] for key in REQUIRED}))
    cable = from_mjcf(m)["flexor"]
    assert cable.segments == 50
    for p in PARAMETERS:
        assert p.name in REQUIRED or getattr(cable, p.name) == p.default
