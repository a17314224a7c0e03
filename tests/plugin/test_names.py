"""A cable takes the tendon that its key `route` names, whatever others are called."""

from __future__ import annotations

import mujoco
from hypothesis import given, settings
from hypothesis import strategies as st

import cc_mujoco
from cc_mujoco.cable import Cable, Section
from cc_mujoco.plugin import cables, route_tendon, to_mjcf

NAMES = st.text("ab1_", min_size=1, max_size=3)
AFFIXES = st.sampled_from(["a", "1", "l_", "_b", "a1", "ab_a"])


def tendons(names: list[str]) -> mujoco.MjSpec:
    """Return a slider on a spatial tendon over a post for each name.

    No name of another element begins as the name of a cable may: an affix that all
    elements bear by accident is one that `attach` may have given them.
    """
    spec = mujoco.MjSpec()
    for place, name in enumerate(names):
        spec.worldbody.add_site(name=f"#{place}from", pos=[place, 0, 1])
        spec.worldbody.add_site(name=f"#{place}over", pos=[place, 0.1, 1.2])
        body = spec.worldbody.add_body(pos=[place, 0.2, 0.8])
        body.add_joint(
            name=f"#{place}slider", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1]
        )
        body.add_geom(size=[0.05, 0, 0], mass=1)
        body.add_site(name=f"#{place}to")
        tendon = spec.add_tendon(name=name)
        for site in ("from", "over", "to"):
            tendon.wrap_site(f"#{place}{site}")
    return spec


def taken(model: mujoco.MjModel) -> dict[str, str]:
    """Return the tendon of each cable."""
    return {
        name: model.tendon(route_tendon(model, name)).name for name in cables(model)
    }


@given(st.lists(NAMES, min_size=2, max_size=4, unique=True))
def test_a_tendon_with_friction_is_its_own_cable(names: list[str]) -> None:
    spec = tendons(names)
    for name in names:
        cc_mujoco.add_friction(spec, name, friction=0.1)
    assert taken(spec.compile()) == {name: name for name in names}


def routed(names: list[str], given: dict[str, str]) -> mujoco.MjSpec:
    """Cables, by name, and the tendons that they name as their routes."""
    spec = tendons(names)
    for place, (name, route) in enumerate(given.items()):
        cable = Cable(conduit=(Section(0.5, 0.3),), route=route, bend="route")
        ends = []
        for end in ("motor", "load"):
            body = spec.worldbody.add_body()
            body.add_joint(name=f"#{place}{end}")
            body.add_geom(size=[0.05, 0, 0], mass=1)
            ends.append((f"#{place}{end}", 0.02))
        to_mjcf(spec, name, cable, *ends)
        for actuator in spec.actuators[-2:]:
            actuator.name = f"#{place}{actuator.name[len(name) :]}."
    return spec


@settings(deadline=None, max_examples=60)
@given(st.data())
def test_a_cable_takes_what_it_names_and_attached_what_came_with_it(
    data: st.DataObject,
) -> None:
    names = data.draw(st.lists(NAMES, min_size=2, max_size=4, unique=True))
    labels = data.draw(st.lists(NAMES, min_size=1, max_size=2, unique=True))
    chosen = {label: data.draw(st.sampled_from(names)) for label in labels}
    assert taken(routed(names, chosen).compile()) == chosen

    prefix, suffix = data.draw(AFFIXES), data.draw(st.just("") | AFFIXES)
    parent = mujoco.MjSpec()
    for before, behind in ((prefix, suffix), ("other_", "")):
        frame = parent.worldbody.add_frame()
        parent.attach(routed(names, chosen), frame=frame, prefix=before, suffix=behind)
    assert taken(parent.compile()) == {
        before + label + behind: before + route + behind
        for before, behind in ((prefix, suffix), ("other_", ""))
        for label, route in chosen.items()
    }


def test_a_namesake_in_the_parent_is_not_taken_for_that_of_the_part() -> None:
    parent = routed(["path"], {"own": "path"})
    frame = parent.worldbody.add_frame()
    parent.attach(routed(["path"], {"flexor": "path"}), frame=frame, prefix="left_")
    assert taken(parent.compile()) == {"own": "path", "left_flexor": "left_path"}
