"""Attachment of a plugin instance, checked compiled: its two ends and its route.

The first actuator of an instance (in the order of the model) is the proximal end, the
second the distal end.
"""

from __future__ import annotations

import math

import mujoco

from cc_mujoco.engine import fields
from cc_mujoco.engine.config import constant, same
from cc_mujoco.engine.memory import (
    Bytes,
    append,
    append_integer,
    internal,
    load_word,
    quote,
    store_integer,
)

_TRN_JOINT = int(mujoco.mjtTrn.mjTRN_JOINT)
_TRN_TENDON = int(mujoco.mjtTrn.mjTRN_TENDON)
_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)
_HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)
_SITE = int(mujoco.mjtWrap.mjWRAP_SITE)
_PULLEY = int(mujoco.mjtWrap.mjWRAP_PULLEY)
_FIXED_TENDON = int(mujoco.mjtWrap.mjWRAP_JOINT)
_EQUAL_TENDONS = int(mujoco.mjtEq.mjEQ_TENDON)
_FIXED_GAIN = int(mujoco.mjtGain.mjGAIN_FIXED)
_NO_BIAS = int(mujoco.mjtBias.mjBIAS_NONE)
_AFFINE_BIAS = int(mujoco.mjtBias.mjBIAS_AFFINE)
_PARAMETERS = 10  # of gain and bias of an actuator
_AT_REST = 1e-9
_AUTO_NEVER = int(mujoco.mjtSleepPolicy.mjSLEEP_AUTO_NEVER)
_NEVER = int(mujoco.mjtSleepPolicy.mjSLEEP_NEVER)
_ALLOWED = int(mujoco.mjtSleepPolicy.mjSLEEP_ALLOWED)
_INIT = int(mujoco.mjtSleepPolicy.mjSLEEP_INIT)

_COUNT = constant("it is used by ")
_COUNT_END = constant(
    " actuators; it must be used by two, first the proximal and then the distal end"
)
_ACTUATOR = constant("its actuator ")
_OTHER = constant("actuator ")
_TRANSMISSION = constant(
    " has the wrong transmission; it must be a hinge or slide `joint` or a spatial "
    "`tendon`"
)
_FORCE = constant(
    " has a `forcerange`, its own or that of a default, which would clamp the tension "
    'of the cable; set forcelimited="false" there'
)
_CLAMPED = (
    constant(" pulls a joint"),
    constant(" pulls a tendon"),
)
_CLAMPED_END = constant(
    " that has an `actuatorfrcrange`, its own or that of a default, which would clamp "
    "the tension of the cable; limit the motor by the `forcerange` of its actuator"
)
_DRAG = (constant(" has a `damping`"), constant(" has an `armature`"))
_DRAG_END = constant(
    ", its own or that of a default, which would act beside the cable; take it away "
    "there, and say it of the joint"
)
_METRE = constant(
    " has a pulley of 1 m radius or more, of 1 m if no gear is given; `gear` must be "
    "the signed pulley radius in metres"
)
_GEAR = constant(
    " has gear 0, or no finite number; it must be the signed pulley radius in metres"
)
_SAME = constant(
    " is on the same joint or tendon as the other end; a cable needs two that move "
    "against each other"
)
_OTHER_END = constant(
    " pulls its tendon as a whole, which passes friction by; give it the joint of a "
    "drum, and that joint to the proximal end"
)
_ITS = constant("its tendon has ")
_OWN = (
    constant("a `stiffness`"),
    constant("a `damping`"),
    constant("a `frictionloss`"),
    constant("a `range`"),
    constant("an `armature`"),
    constant("an equality"),
)
_ITS_END = constant(
    " of its own, which pulls it as a whole and passes friction by; take it away, and "
    "say it of the cable or of a joint"
)
_SPRING_END = constant(
    " of its own, which pulls it as a whole and passes friction by; take it away, and "
    "give the cable an `axial_stiffness` of `stiffness` times the upper `springlength` "
    "and, as `pretension`, the force of that spring in the pose `qpos0`"
)
_ASLEEP = constant(
    " has a `sleep` of `allowed` or `init`, but the cable pulls its tree and wakes "
    "nothing that sleeps; take it away there"
)
_BODY = constant("body ")
_TIED = constant(
    " ties the cable to its own tendon; its gear must be 1 (-1 at the proximal end)"
)


@internal
def find(model: int, instance: int) -> tuple[int, int, int]:
    """Count the actuators of an instance.

    Returns:
        Their number, and the first and the second of them (-1: none).
    """
    count, first, second = 0, -1, -1
    for actuator in range(fields.actuators(model)):
        if fields.integer(model, fields.ACTUATOR_PLUGIN, actuator) == instance:
            if count == 0:
                first = actuator
            elif count == 1:
                second = actuator
            count += 1
    return count, first, second


@internal
def output(model: int, actuator: int) -> int:
    """Index of an actuator in `actuator_length` and `actuator_force`."""
    return fields.integer(model, fields.ACTUATOR_OUTADR, actuator)


@internal
def gear(model: int, out: int) -> float:
    """Signed pulley radius of an end, by its index in `actuator_length` [m]."""
    return fields.real(model, fields.ACTUATOR_GEAR, 6 * out)


@internal
def _a_metre(model: int, actuator: int) -> bool:
    """Return whether a hinge turns a pulley of 1 m (also by absent `gear`) or more."""
    if fields.integer(model, fields.ACTUATOR_TRNTYPE, actuator) != _TRN_JOINT:
        return False
    target = fields.integer(model, fields.ACTUATOR_TRNID, 2 * actuator)
    hinge = fields.integer(model, fields.JNT_TYPE, target) == _HINGE
    return hinge and abs(gear(model, output(model, actuator))) >= 1.0


@internal
def _fits(model: int, actuator: int) -> bool:
    kind = fields.integer(model, fields.ACTUATOR_TRNTYPE, actuator)
    target = fields.integer(model, fields.ACTUATOR_TRNID, 2 * actuator)
    if kind == _TRN_JOINT:
        joint = fields.integer(model, fields.JNT_TYPE, target)
        return joint == _SLIDE or joint == _HINGE
    return kind == _TRN_TENDON and spatial(model, target)


@internal
def spatial(model: int, tendon: int) -> bool:
    """Return whether a tendon is spatial."""
    start = fields.integer(model, fields.TENDON_ADR, tendon)
    return fields.integer(model, fields.WRAP_TYPE, start) != _FIXED_TENDON


@internal
def name_actuator(
    message: Bytes, used: int, model: int, actuator: int, whose: Bytes = _ACTUATOR
) -> int:
    """Add which actuator it is: its name, or its place in the model if it has none.

    Returns:
        The new length.
    """
    used = append(message, used, whose)
    name = fields.actuator_name(model, actuator)
    if name.size == 0:
        return append_integer(message, used, actuator)
    return quote(message, used, name)


@internal
def explain(message: Bytes, used: int, model: int, instance: int) -> int:
    """Add why the ends of an instance cannot be used; nothing where they can.

    Returns:
        The new length.
    """
    count, first, second = find(model, instance)
    if count != 2:
        used = append(message, used, _COUNT)
        used = append_integer(message, used, count)
        return append(message, used, _COUNT_END)
    for actuator in (first, second):
        fits = _fits(model, actuator)
        radius = gear(model, output(model, actuator))
        if not fits or radius == 0.0 or not math.isfinite(radius):
            used = name_actuator(message, used, model, actuator)
            return append(message, used, _GEAR if fits else _TRANSMISSION)
        limited = fields.byte(model, fields.FORCE_LIMITED, actuator) != 0
        if limited or _a_metre(model, actuator):
            used = name_actuator(message, used, model, actuator)
            return append(message, used, _FORCE if limited else _METRE)
        drags = _drags(model, actuator)
        if drags >= 0:
            used = name_actuator(message, used, model, actuator)
            used = append(message, used, _DRAG[drags])
            return append(message, used, _DRAG_END)
        clamped = _clamped(model, actuator)
        if clamped >= 0:
            used = name_actuator(message, used, model, actuator)
            used = append(message, used, _CLAMPED[clamped])
            return append(message, used, _CLAMPED_END)
    if _together(model, first, second):
        used = name_actuator(message, used, model, second)
        return append(message, used, _SAME)
    return used


@internal
def _drags(model: int, actuator: int) -> int:
    """Return what an actuator has itself: damping (0), armature (1), nothing (-1)."""
    damping = fields.real(model, fields.ACTUATOR_DAMPING, actuator)
    higher = fields.ACTUATOR_DAMPINGPOLY
    if damping != 0.0 or fields.real(model, higher, 2 * actuator) != 0.0:
        return 0
    if fields.real(model, higher, 2 * actuator + 1) != 0.0:
        return 0
    return 1 if fields.real(model, fields.ACTUATOR_ARMATURE, actuator) != 0.0 else -1


@internal
def _clamped(model: int, actuator: int) -> int:
    """Return what clamps an actuator's force: joint (0), its tendon (1), nothing (-1).

    MuJoCo clamps what all actuators of a joint, or of a tendon, make together.
    """
    target = fields.integer(model, fields.ACTUATOR_TRNID, 2 * actuator)
    if fields.integer(model, fields.ACTUATOR_TRNTYPE, actuator) == _TRN_JOINT:
        return 0 if fields.byte(model, fields.JNT_ACTFRCLIMITED, target) != 0 else -1
    if fields.byte(model, fields.TENDON_ACTFRCLIMITED, target) != 0:
        return 1
    for joint in range(fields.joints(model)):
        limited = fields.byte(model, fields.JNT_ACTFRCLIMITED, joint) != 0
        if limited and _leads(model, joint, target):
            return 0
    return -1


@internal
def _leads(model: int, joint: int, tendon: int) -> bool:
    """Return whether a joint moves a part of a tendon against the rest."""
    carried = fields.integer(model, fields.JNT_BODY, joint)
    start = fields.integer(model, fields.TENDON_ADR, tendon)
    inside, outside = 0, 0
    for i in range(start, start + fields.integer(model, fields.TENDON_NUM, tendon)):
        kind = fields.integer(model, fields.WRAP_TYPE, i)
        if kind == _PULLEY:
            continue
        owner = fields.SITE_BODY if kind == _SITE else fields.GEOM_BODY
        thing = fields.integer(model, fields.WRAP_OBJID, i)
        body = fields.integer(model, owner, thing)
        while body > carried:  # parents come before their children
            body = fields.integer(model, fields.BODY_PARENT, body)
        if body == carried:
            inside += 1
        else:
            outside += 1
    return inside > 0 and outside > 0


@internal
def _together(model: int, first: int, second: int) -> bool:
    """Return whether one joint, or one tendon in one direction, holds both ends."""
    for field in (fields.ACTUATOR_TRNTYPE, fields.ACTUATOR_TRNID):
        step = 2 if field == fields.ACTUATOR_TRNID else 1
        if fields.integer(model, field, step * first) != fields.integer(
            model, field, step * second
        ):
            return False
    one, other = gear(model, output(model, first)), gear(model, output(model, second))
    return (
        fields.integer(model, fields.ACTUATOR_TRNTYPE, first) == _TRN_JOINT
        or one * other > 0.0
    )


@internal
def _affixed(
    candidate: Bytes, wanted: Bytes, name: Bytes, prefix: int, suffix: int
) -> bool:
    """Return whether a name is `wanted` between a prefix and a suffix of `name`.

    `prefix` and `suffix` are their sizes.
    """
    end = prefix + wanted.size
    return (
        candidate.size == end + suffix
        and same(candidate[prefix:end], wanted)
        and same(candidate[:prefix], name[:prefix])
        and same(candidate[end:], name[name.size - suffix :])
    )


@internal
def _bears(label: Bytes, name: Bytes, prefix: int, suffix: int) -> bool:
    """Return whether an element, if named, has that prefix and suffix of `name`."""
    return label.size == 0 or (
        label.size > prefix + suffix
        and same(label[:prefix], name[:prefix])
        and same(label[label.size - suffix :], name[name.size - suffix :])
    )


@internal
def _attached(model: int, instance: int, tendon: int, prefix: int, suffix: int) -> bool:
    """Return whether all elements of an instance and a tendon bear an affix too."""
    name = fields.plugin_name(model, instance)
    _, first, second = find(model, instance)
    for actuator in (first, second):
        if actuator >= 0:
            label = fields.actuator_name(model, actuator)
            if not _bears(label, name, prefix, suffix):
                return False
    start = fields.integer(model, fields.TENDON_ADR, tendon)
    for i in range(start, start + fields.integer(model, fields.TENDON_NUM, tendon)):
        kind = fields.integer(model, fields.WRAP_TYPE, i)
        if kind == _PULLEY:
            continue
        thing = fields.integer(model, fields.WRAP_OBJID, i)
        if kind == _SITE:
            label = fields.site_name(model, thing)
        else:
            label = fields.geom_name(model, thing)
        if not _bears(label, name, prefix, suffix):
            return False
    return True


@internal
def find_route(model: int, instance: int, route: Bytes) -> int:
    """Index of the spatial tendon that an instance names as its route, or -1.

    MuJoCo's `attach` renames all elements, not the text of a configuration. So `route`
    also stands for that name with a prefix and a suffix of the instance's own name,
    where its actuators and the sites and geoms of the tendon bear them too: instance
    `left_flexor` with `route` = `path` means tendon `left_path`, if there is one, else
    `path`. The longest counts; but a tendon of the instance's own name is its own.
    """
    name = fields.plugin_name(model, instance)
    namesake = same(route, name)
    best, longest = -1, -1
    for tendon in range(fields.tendons(model)):
        candidate = fields.tendon_name(model, tendon)
        if not spatial(model, tendon):
            continue
        if namesake and same(candidate, name):
            return tendon
        extra = candidate.size - route.size
        if extra <= longest or (extra > 0 and extra >= name.size):
            continue
        for prefix in range(extra + 1):
            suffix = extra - prefix
            if _affixed(candidate, route, name, prefix, suffix) and _attached(
                model, instance, tendon, prefix, suffix
            ):
                best, longest = tendon, extra
    return best


@internal
def find_mouth(
    model: int, instance: int, tendon: int, route: Bytes, mouth: Bytes
) -> int:
    """Place in the path of its route of the site that an instance names, or -1.

    The site has the prefix and suffix of the tendon. The first site and the last one
    are no mouths.
    """
    name = fields.plugin_name(model, instance)
    own = fields.tendon_name(model, tendon)
    start = fields.integer(model, fields.TENDON_ADR, tendon)
    extra = own.size - route.size
    for i in range(1, fields.integer(model, fields.TENDON_NUM, tendon) - 1):
        if fields.integer(model, fields.WRAP_TYPE, start + i) != _SITE:
            continue
        site = fields.integer(model, fields.WRAP_OBJID, start + i)
        candidate = fields.site_name(model, site)
        for prefix in range(extra + 1):
            if _affixed(own, route, name, prefix, extra - prefix) and _affixed(
                candidate, mouth, name, prefix, extra - prefix
            ):
                return i
    return -1


@internal
def tied(model: int, actuator: int, tendon: int) -> bool:
    """Return whether an end is tied to a site of the cable's tendon: that moves it."""
    kind = fields.integer(model, fields.ACTUATOR_TRNTYPE, actuator)
    target = fields.integer(model, fields.ACTUATOR_TRNID, 2 * actuator)
    return kind == _TRN_TENDON and target == tendon


@internal
def explain_bypass(
    message: Bytes, used: int, model: int, instance: int, tendon: int
) -> int:
    """Add what else pulls the tendon of an open cable, as a whole; else nothing.

    Returns:
        The new length.
    """
    for actuator in range(fields.actuators(model)):
        if (
            fields.integer(model, fields.ACTUATOR_TRNTYPE, actuator) == _TRN_TENDON
            and fields.integer(model, fields.ACTUATOR_TRNID, 2 * actuator) == tendon
            and fields.integer(model, fields.ACTUATOR_PLUGIN, actuator) != instance
        ):
            used = name_actuator(message, used, model, actuator, _OTHER)
            return append(message, used, _OTHER_END)
    own = (
        fields.real(model, fields.TENDON_STIFFNESS, tendon),
        fields.real(model, fields.TENDON_DAMPING, tendon),
        fields.real(model, fields.TENDON_FRICTIONLOSS, tendon),
        float(fields.byte(model, fields.TENDON_LIMITED, tendon)),
        fields.real(model, fields.TENDON_ARMATURE, tendon),
        1.0 if _equated(model, tendon) else 0.0,
    )
    for what in range(6):
        if own[what] != 0.0:
            used = append(message, used, _ITS)
            used = append(message, used, _OWN[what])
            return append(message, used, _SPRING_END if what == 0 else _ITS_END)
    return used


@internal
def _equated(model: int, tendon: int) -> bool:
    """Return whether an equality constraint holds the length of a tendon."""
    for i in range(fields.equalities(model)):
        if fields.integer(model, fields.EQ_TYPE, i) == _EQUAL_TENDONS and (
            fields.integer(model, fields.EQ_OBJECT_1, i) == tendon
            or fields.integer(model, fields.EQ_OBJECT_2, i) == tendon
        ):
            return True
    return False


@internal
def idle(model: int, instance: int) -> bool:
    """Return whether an end is in a disabled group of actuators."""
    groups = fields.disabled_groups(model)
    if groups == 0:
        return False
    _, first, second = find(model, instance)
    for actuator in (first, second):
        group = fields.integer(model, fields.ACTUATOR_GROUP, actuator)
        if 0 <= group < 31 and groups & (1 << group) != 0:
            return True
    return False


@internal
def explain_tied(
    message: Bytes, used: int, model: int, instance: int, tendon: int
) -> int:
    """Add which end is tied by a gear that would scale its tension; else nothing.

    Returns:
        The new length.
    """
    _, first, second = find(model, instance)
    for actuator, wanted in ((first, -1.0), (second, 1.0)):
        own = gear(model, output(model, actuator))
        if tied(model, actuator, tendon) and own != wanted:
            used = name_actuator(message, used, model, actuator)
            return append(message, used, _TIED)
    return used


@internal
def keep_awake(model: int, instance: int, route: int, mouth: int) -> int:
    """Let no tree sleep that a cable pulls.

    MuJoCo does so for trees that an actuator moves. It sees nothing of the pieces of an
    open path, and nothing that a cable pulls wakes a tree.

    Args:
        model: address of the model, whose `tree_sleep_policy` changes.
        instance: index of the cable.
        route: tendon of an open or mixed path, else -1.
        mouth: place in its path where the conduit ends.

    Returns:
        A body in a tree that the model lets sleep by a `sleep` of its own, or -1.
    """
    _, first, second = find(model, instance)
    found = -1
    for actuator in (first, second):
        target = fields.integer(model, fields.ACTUATOR_TRNID, 2 * actuator)
        if fields.integer(model, fields.ACTUATOR_TRNTYPE, actuator) == _TRN_JOINT:
            body = fields.integer(model, fields.JNT_BODY, target)
            found = max(found, _keep_tree_awake(model, body))
        else:
            found = max(found, _keep_path_awake(model, target, 0))
    if route >= 0:
        found = max(found, _keep_path_awake(model, route, mouth))
    return found


@internal
def _keep_path_awake(model: int, tendon: int, begin: int) -> int:
    """Let no tree sleep that holds a tendon from a place of its path on."""
    start = fields.integer(model, fields.TENDON_ADR, tendon)
    end = start + fields.integer(model, fields.TENDON_NUM, tendon)
    found = -1
    for i in range(start + begin, end):
        kind = fields.integer(model, fields.WRAP_TYPE, i)
        if kind != _PULLEY:
            owner = fields.SITE_BODY if kind == _SITE else fields.GEOM_BODY
            thing = fields.integer(model, fields.WRAP_OBJID, i)
            body = fields.integer(model, owner, thing)
            found = max(found, _keep_tree_awake(model, body))
    return found


@internal
def _keep_tree_awake(model: int, body: int) -> int:
    """Let the tree of a body not sleep; the body if its model lets it, else -1."""
    tree = fields.integer(model, fields.BODY_TREE, body)
    if tree < 0:
        return -1
    policy = fields.integer(model, fields.TREE_SLEEP, tree)
    if policy != _AUTO_NEVER and policy != _NEVER:
        address = load_word(model + fields.TREE_SLEEP) + 4 * tree
        store_integer(address, _AUTO_NEVER)
    return body if policy == _ALLOWED or policy == _INIT else -1


@internal
def explain_sleep(message: Bytes, used: int, model: int, body: int) -> int:
    """Add that a body of `keep_awake` must not be allowed to sleep; nothing for -1.

    Returns:
        The new length.
    """
    if body < 0:
        return used
    used = append(message, used, _BODY)
    name = fields.body_name(model, body)
    if name.size == 0:
        used = append_integer(message, used, body)
    else:
        used = quote(message, used, name)
    return append(message, used, _ASLEEP)


@internal
def holder(model: int, actuator: int) -> int:
    """The tendon that holds an end, or -1 where that is a joint."""
    if fields.integer(model, fields.ACTUATOR_TRNTYPE, actuator) == _TRN_JOINT:
        return -1
    return fields.integer(model, fields.ACTUATOR_TRNID, 2 * actuator)


@internal
def pushes(model: int, actuator: int, distal: bool) -> bool:
    """Return whether the tension at an end that holds a tendon lengthens it."""
    radius = gear(model, output(model, actuator))
    return holder(model, actuator) >= 0 and (radius < 0.0) == distal


@internal
def pays_out(model: int, instance: int, actuator: int) -> bool:
    """Return whether a motor at the proximal end can only move the cable to distal.

    From its pose in `qpos0`, by its range and by what drives it: a servo to positions
    in its `ctrlrange`, a motor of one sign. The antagonist of a cable that it winds up
    may be so.
    """
    if holder(model, actuator) >= 0:
        return False
    joint = fields.integer(model, fields.ACTUATOR_TRNID, 2 * actuator)
    place = fields.integer(model, fields.JNT_POSITION, joint)
    rest = fields.real(model, fields.REST, place)
    radius = gear(model, output(model, actuator))
    sense = -1.0 if radius > 0.0 else 1.0  # in which the joint winds the cable up
    if fields.byte(model, fields.JNT_LIMITED, joint) != 0:
        low = fields.real(model, fields.JNT_RANGE, 2 * joint)
        high = fields.real(model, fields.JNT_RANGE, 2 * joint + 1)
        if max(sense * (low - rest), sense * (high - rest)) <= _AT_REST:
            sense = 0.0
    driven = False
    for other in range(fields.actuators(model)):
        if (
            fields.integer(model, fields.ACTUATOR_TRNTYPE, other) != _TRN_JOINT
            or fields.integer(model, fields.ACTUATOR_TRNID, 2 * other) != joint
        ):
            continue
        kind = fields.integer(model, fields.ACTUATOR_PLUGIN, other)
        if kind == instance:
            continue
        if kind >= 0 and radius * gear(model, output(model, other)) < 0.0:
            return False
        driven = driven or kind < 0
        if kind < 0 and sense != 0.0 and _drives(model, other, sense, rest):
            return False
    return driven


@internal
def _drives(model: int, actuator: int, sense: float, rest: float) -> bool:
    """Return whether an actuator can drive its joint from rest in a sense.

    True where that cannot be seen from the model.
    """
    if fields.integer(model, fields.GAINTYPE, actuator) != _FIXED_GAIN:
        return True
    control = fields.integer(model, fields.CTRLADR, actuator)
    if fields.byte(model, fields.CTRL_LIMITED, control) == 0:
        return True
    factor = gear(model, output(model, actuator))
    gain = fields.real(model, fields.GAINPRM, _PARAMETERS * actuator)
    bias = fields.integer(model, fields.BIASTYPE, actuator)
    aim = 0.0  # at which a servo does nothing
    if bias == _AFFINE_BIAS:
        if fields.real(model, fields.BIASPRM, _PARAMETERS * actuator + 1) != -gain:
            return True
        aim = factor * rest
    elif bias != _NO_BIAS:
        return True
    for side in range(2):
        value = fields.real(model, fields.CTRL_RANGE, 2 * control + side)
        if sense * factor * gain * (value - aim) > _AT_REST:
            return True
    return False


@internal
def swapped(model: int, first: int, second: int, route: int) -> bool:
    """Return whether the ends are on joints at the wrong ends of a route."""
    if holder(model, first) >= 0 or holder(model, second) >= 0:
        return False
    start = fields.integer(model, fields.TENDON_ADR, route)
    last = start + fields.integer(model, fields.TENDON_NUM, route) - 1
    right = _beside(model, first, start) or _beside(model, second, last)
    return not right and _beside(model, first, last) and _beside(model, second, start)


@internal
def _beside(model: int, actuator: int, place: int) -> bool:
    """Return whether a site in a path is on the body of a joint or on its parent."""
    joint = fields.integer(model, fields.ACTUATOR_TRNID, 2 * actuator)
    body = fields.integer(model, fields.JNT_BODY, joint)
    site = fields.integer(model, fields.WRAP_OBJID, place)
    own = fields.integer(model, fields.SITE_BODY, site)
    return own != 0 and (
        own == body or own == fields.integer(model, fields.BODY_PARENT, body)
    )
