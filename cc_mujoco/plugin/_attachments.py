"""Attachment of a plugin instance, checked compiled: its two ends and its route.

The first actuator of an instance (in the order of the model) is the proximal end, the
second the distal end.
"""

from __future__ import annotations

import math

import mujoco

from cc_mujoco.plugin import _config as config
from cc_mujoco.plugin import _mj_struct as mj_struct
from cc_mujoco.plugin._ffi import (
    Bytes,
    Floats,
    append,
    append_integer,
    fill,
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
_PRM_SIZE = 10  # of gain and bias of an actuator
_REST_TOLERANCE = 1e-9
_MAX_LENGTH = float(mujoco.mjMAXVAL)
"""Length from which MuJoCo takes a number for bad [m]."""
_AUTO_NEVER = int(mujoco.mjtSleepPolicy.mjSLEEP_AUTO_NEVER)
_NEVER = int(mujoco.mjtSleepPolicy.mjSLEEP_NEVER)
_ALLOWED = int(mujoco.mjtSleepPolicy.mjSLEEP_ALLOWED)
_INIT = int(mujoco.mjtSleepPolicy.mjSLEEP_INIT)

_USED_BY = config.constant("it is used by ")
_USED_BY_END = config.constant(
    " actuators; it must be used by two, first the proximal and then the distal end"
)
ITS_ACTUATOR = config.constant("its actuator ")
_OTHER_ACTUATOR = config.constant("actuator ")
_WRONG_TRANSMISSION = config.constant(
    " has the wrong transmission; it must be a hinge or slide `joint` or a spatial "
    "`tendon`"
)
_FORCE_RANGE_SET = config.constant(
    " has a `forcerange`, its own or that of a default, which would clamp the tension "
    'of the cable; set forcelimited="false" there'
)
_CLAMPED = (
    config.constant(" pulls a joint"),
    config.constant(" pulls a tendon"),
)
_CLAMPED_END = config.constant(
    " that has an `actuatorfrcrange`, its own or that of a default, which would clamp "
    "the tension of the cable; limit the motor by the `forcerange` of its actuator"
)
_ACTUATOR_DRAG = (
    config.constant(" has a `damping`"),
    config.constant(" has an `armature`"),
)
_ACTUATOR_DRAG_END = config.constant(
    ", its own or that of a default, which would act beside the cable; take it away "
    "there, and say it of the joint"
)
NO_LENGTH = config.constant(
    " has no length in the pose `qpos0` that MuJoCo can use; it must be finite and at "
    "most 1e10 m"
)
_WRONG_RADIUS = config.constant(
    " has a pulley of 1 m radius or more, of 1 m if no gear is given; `gear` must be "
    "the signed pulley radius in metres"
)
_WRONG_GEAR = config.constant(
    " has gear 0, or no finite number; it must be the signed pulley radius in metres"
)
_SAME_TARGET = config.constant(
    " is on the same joint or tendon as the other end; a cable needs two that move "
    "against each other"
)
_PULLS_WHOLE_TENDON = config.constant(
    " pulls its tendon as a whole, which passes friction by; give it the joint of a "
    "drum, and that joint to the proximal end"
)
_TENDON_HAS = config.constant("its tendon has ")
_TENDON_FEATURES = (
    config.constant("a `stiffness`"),
    config.constant("a `damping`"),
    config.constant("a `frictionloss`"),
    config.constant("a `range`"),
    config.constant("an `armature`"),
    config.constant("an equality"),
)
_TENDON_HAS_END = config.constant(
    " of its own, which pulls it as a whole and passes friction by; take it away, and "
    "say it of the cable or of a joint"
)
_TENDON_SPRING_END = config.constant(
    " of its own, which pulls it as a whole and passes friction by; take it away, and "
    "give the cable an `axial_stiffness` of `stiffness` times the upper `springlength` "
    "and, as `pretension`, the force of that spring in the pose `qpos0`"
)
_MAY_SLEEP = config.constant(
    " has a `sleep` of `allowed` or `init`, but the cable pulls its tree and wakes "
    "nothing that sleeps; take it away there"
)
_BODY_PREFIX = config.constant("body ")
_WRONG_TIED_GEAR = config.constant(
    " ties the cable to its own tendon; its gear must be 1 (-1 at the proximal end)"
)


@internal
def find_actuators(model: int, instance: int) -> tuple[int, int, int]:
    """Return the number of actuators of an instance, and its first two (-1: none)."""
    count, first, second = 0, -1, -1
    for actuator in range(mj_struct.actuators(model)):
        if mj_struct.integer(model, mj_struct.ACTUATOR_PLUGIN, actuator) == instance:
            if count == 0:
                first = actuator
            elif count == 1:
                second = actuator
            count += 1
    return count, first, second


@internal
def output_index(model: int, actuator: int) -> int:
    """Return the index of an actuator in `actuator_length` and `actuator_force`."""
    return mj_struct.integer(model, mj_struct.ACTUATOR_OUTADR, actuator)


@internal
def pulley_radius(model: int, out: int) -> float:
    """Return an end's signed pulley radius [m] by its `actuator_length` index."""
    return mj_struct.real(model, mj_struct.ACTUATOR_GEAR, 6 * out)


@internal
def is_length(metres: float) -> bool:
    """Return whether a length is a finite number that MuJoCo does not take for bad."""
    return abs(metres) <= _MAX_LENGTH


@internal
def _has_metre_radius(model: int, actuator: int) -> bool:
    """Return whether a hinge turns a pulley of 1 m, the default radius, or more."""
    if mj_struct.integer(model, mj_struct.ACTUATOR_TRNTYPE, actuator) != _TRN_JOINT:
        return False
    target = mj_struct.integer(model, mj_struct.ACTUATOR_TRNID, 2 * actuator)
    hinge = mj_struct.integer(model, mj_struct.JNT_TYPE, target) == _HINGE
    return hinge and abs(pulley_radius(model, output_index(model, actuator))) >= 1.0


@internal
def _has_valid_transmission(model: int, actuator: int) -> bool:
    kind = mj_struct.integer(model, mj_struct.ACTUATOR_TRNTYPE, actuator)
    target = mj_struct.integer(model, mj_struct.ACTUATOR_TRNID, 2 * actuator)
    if kind == _TRN_JOINT:
        joint = mj_struct.integer(model, mj_struct.JNT_TYPE, target)
        return joint == _SLIDE or joint == _HINGE
    return kind == _TRN_TENDON and is_spatial(model, target)


@internal
def is_spatial(model: int, tendon: int) -> bool:
    start = mj_struct.integer(model, mj_struct.TENDON_ADR, tendon)
    return mj_struct.integer(model, mj_struct.WRAP_TYPE, start) != _FIXED_TENDON


@internal
def name_actuator(
    message: Bytes, used: int, model: int, actuator: int, whose: Bytes
) -> int:
    """Append the name of an actuator, or its place in the model if it has none."""
    used = append(message, used, whose)
    name = mj_struct.actuator_name(model, actuator)
    if name.size == 0:
        return append_integer(message, used, actuator)
    return quote(message, used, name)


@internal
def explain(message: Bytes, used: int, model: int, instance: int) -> int:
    """Append to `message` why the ends of `instance` cannot be used.

    Args:
        message: bytes of the message.
        used: number of its bytes that are written.
        model: address of the `MjModel`.
        instance: plugin instance of the cable.

    Returns:
        The new number of written bytes; `used` where the ends can be used.
    """
    count, first, second = find_actuators(model, instance)
    if count != 2:
        used = append(message, used, _USED_BY)
        used = append_integer(message, used, count)
        return append(message, used, _USED_BY_END)
    for actuator in (first, second):
        fits = _has_valid_transmission(model, actuator)
        radius = pulley_radius(model, output_index(model, actuator))
        if not fits or radius == 0.0 or not math.isfinite(radius):
            used = name_actuator(message, used, model, actuator, ITS_ACTUATOR)
            return append(message, used, _WRONG_GEAR if fits else _WRONG_TRANSMISSION)
        limited = mj_struct.byte(model, mj_struct.FORCE_LIMITED, actuator) != 0
        if limited or _has_metre_radius(model, actuator):
            used = name_actuator(message, used, model, actuator, ITS_ACTUATOR)
            return append(message, used, _FORCE_RANGE_SET if limited else _WRONG_RADIUS)
        drags = _actuator_drag(model, actuator)
        if drags >= 0:
            used = name_actuator(message, used, model, actuator, ITS_ACTUATOR)
            used = append(message, used, _ACTUATOR_DRAG[drags])
            return append(message, used, _ACTUATOR_DRAG_END)
        clamped = _force_clamp(model, actuator)
        if clamped >= 0:
            used = name_actuator(message, used, model, actuator, ITS_ACTUATOR)
            used = append(message, used, _CLAMPED[clamped])
            return append(message, used, _CLAMPED_END)
        output = output_index(model, actuator)
        if not is_length(mj_struct.real(model, mj_struct.ACTUATOR_LENGTH0, output)):
            used = name_actuator(message, used, model, actuator, ITS_ACTUATOR)
            return append(message, used, NO_LENGTH)
    if _hold_same_target(model, first, second):
        used = name_actuator(message, used, model, second, ITS_ACTUATOR)
        return append(message, used, _SAME_TARGET)
    return used


@internal
def _actuator_drag(model: int, actuator: int) -> int:
    """Return which drag an actuator has: damping (0), armature (1), none (-1)."""
    damping = mj_struct.real(model, mj_struct.ACTUATOR_DAMPING, actuator)
    higher = mj_struct.ACTUATOR_DAMPINGPOLY
    if damping != 0.0 or mj_struct.real(model, higher, 2 * actuator) != 0.0:
        return 0
    if mj_struct.real(model, higher, 2 * actuator + 1) != 0.0:
        return 0
    return (
        1 if mj_struct.real(model, mj_struct.ACTUATOR_ARMATURE, actuator) != 0.0 else -1
    )


@internal
def _force_clamp(model: int, actuator: int) -> int:
    """Return the clamp of an actuator's force: joint (0), tendon (1), none (-1).

    MuJoCo clamps what all actuators of a joint, or of a tendon, make together.
    """
    target = mj_struct.integer(model, mj_struct.ACTUATOR_TRNID, 2 * actuator)
    if mj_struct.integer(model, mj_struct.ACTUATOR_TRNTYPE, actuator) == _TRN_JOINT:
        return (
            0 if mj_struct.byte(model, mj_struct.JNT_ACTFRCLIMITED, target) != 0 else -1
        )
    if mj_struct.byte(model, mj_struct.TENDON_ACTFRCLIMITED, target) != 0:
        return 1
    for joint in range(mj_struct.joints(model)):
        limited = mj_struct.byte(model, mj_struct.JNT_ACTFRCLIMITED, joint) != 0
        if limited and _moves_part(model, joint, target):
            return 0
    return -1


@internal
def _moves_part(model: int, joint: int, tendon: int) -> bool:
    """Return whether a joint moves a part of a tendon against the rest."""
    carried = mj_struct.integer(model, mj_struct.JNT_BODY, joint)
    start = mj_struct.integer(model, mj_struct.TENDON_ADR, tendon)
    inside, outside = 0, 0
    for i in range(
        start, start + mj_struct.integer(model, mj_struct.TENDON_NUM, tendon)
    ):
        kind = mj_struct.integer(model, mj_struct.WRAP_TYPE, i)
        if kind == _PULLEY:
            continue
        owner = mj_struct.SITE_BODY if kind == _SITE else mj_struct.GEOM_BODY
        thing = mj_struct.integer(model, mj_struct.WRAP_OBJID, i)
        body = mj_struct.integer(model, owner, thing)
        while body > carried:  # parents come before their children
            body = mj_struct.integer(model, mj_struct.BODY_PARENT, body)
        if body == carried:
            inside += 1
        else:
            outside += 1
    return inside > 0 and outside > 0


@internal
def _hold_same_target(model: int, first: int, second: int) -> bool:
    """Return whether one joint, or one tendon in one direction, holds both ends."""
    for field in (mj_struct.ACTUATOR_TRNTYPE, mj_struct.ACTUATOR_TRNID):
        step = 2 if field == mj_struct.ACTUATOR_TRNID else 1
        if mj_struct.integer(model, field, step * first) != mj_struct.integer(
            model, field, step * second
        ):
            return False
    one, other = (
        pulley_radius(model, output_index(model, first)),
        pulley_radius(model, output_index(model, second)),
    )
    return (
        mj_struct.integer(model, mj_struct.ACTUATOR_TRNTYPE, first) == _TRN_JOINT
        or one * other > 0.0
    )


@internal
def _has_affixes(
    candidate: Bytes, wanted: Bytes, name: Bytes, prefix: int, suffix: int
) -> bool:
    """Return whether a name is `wanted` between a prefix and a suffix of `name`.

    `prefix` and `suffix` are their sizes.
    """
    end = prefix + wanted.size
    return (
        candidate.size == end + suffix
        and config.equal_text(candidate[prefix:end], wanted)
        and config.equal_text(candidate[:prefix], name[:prefix])
        and config.equal_text(candidate[end:], name[name.size - suffix :])
    )


@internal
def _element_has_affixes(label: Bytes, name: Bytes, prefix: int, suffix: int) -> bool:
    """Return whether an element, if named, has that prefix and suffix of `name`."""
    return label.size == 0 or (
        label.size > prefix + suffix
        and config.equal_text(label[:prefix], name[:prefix])
        and config.equal_text(label[label.size - suffix :], name[name.size - suffix :])
    )


@internal
def _all_have_affixes(
    model: int, instance: int, tendon: int, prefix: int, suffix: int
) -> bool:
    """Return whether all elements of an instance and a tendon bear an affix too."""
    name = mj_struct.plugin_name(model, instance)
    _, first, second = find_actuators(model, instance)
    for actuator in (first, second):
        if actuator >= 0:
            label = mj_struct.actuator_name(model, actuator)
            if not _element_has_affixes(label, name, prefix, suffix):
                return False
    start = mj_struct.integer(model, mj_struct.TENDON_ADR, tendon)
    for i in range(
        start, start + mj_struct.integer(model, mj_struct.TENDON_NUM, tendon)
    ):
        kind = mj_struct.integer(model, mj_struct.WRAP_TYPE, i)
        if kind == _PULLEY:
            continue
        thing = mj_struct.integer(model, mj_struct.WRAP_OBJID, i)
        if kind == _SITE:
            label = mj_struct.site_name(model, thing)
        else:
            label = mj_struct.geom_name(model, thing)
        if not _element_has_affixes(label, name, prefix, suffix):
            return False
    return True


@internal
def find_route(model: int, instance: int, route: Bytes) -> int:
    """Return the index of the spatial tendon that an instance names as route, or -1.

    MuJoCo's `attach` renames all elements, not the text of a configuration. So `route`
    also stands for that name with a prefix and a suffix of the instance's own name,
    where its actuators and the sites and geoms of the tendon bear them too: instance
    `left_flexor` with `route` = `path` means tendon `left_path`, if there is one, else
    `path`. The longest counts; but a tendon of the instance's own name is its own.
    """
    name = mj_struct.plugin_name(model, instance)
    namesake = config.equal_text(route, name)
    best, longest = -1, -1
    for tendon in range(mj_struct.tendons(model)):
        candidate = mj_struct.tendon_name(model, tendon)
        if not is_spatial(model, tendon):
            continue
        if namesake and config.equal_text(candidate, name):
            return tendon
        extra = candidate.size - route.size
        if extra <= longest or (extra > 0 and extra >= name.size):
            continue
        for prefix in range(extra + 1):
            suffix = extra - prefix
            if _has_affixes(
                candidate, route, name, prefix, suffix
            ) and _all_have_affixes(model, instance, tendon, prefix, suffix):
                best, longest = tendon, extra
    return best


@internal
def find_mouth(
    model: int, instance: int, tendon: int, route: Bytes, mouth: Bytes
) -> int:
    """Return the place of an instance's mouth site in its route's path, or -1.

    The site has the prefix and suffix of the tendon. The first site and the last one
    are no mouths.
    """
    name = mj_struct.plugin_name(model, instance)
    own = mj_struct.tendon_name(model, tendon)
    start = mj_struct.integer(model, mj_struct.TENDON_ADR, tendon)
    extra = own.size - route.size
    for i in range(1, mj_struct.integer(model, mj_struct.TENDON_NUM, tendon) - 1):
        if mj_struct.integer(model, mj_struct.WRAP_TYPE, start + i) != _SITE:
            continue
        site = mj_struct.integer(model, mj_struct.WRAP_OBJID, start + i)
        candidate = mj_struct.site_name(model, site)
        for prefix in range(extra + 1):
            if _has_affixes(own, route, name, prefix, extra - prefix) and _has_affixes(
                candidate, mouth, name, prefix, extra - prefix
            ):
                return i
    return -1


@internal
def read_guides(
    model: int, instance: int, tendon: int, mouth: int, out: Floats
) -> bool:
    """Read the guides of an instance's open path; return whether all can be used.

    Written to `out` for every place of the path from the mouth, or from the first one
    behind the first site: 0 where nothing is given, `ROLLING`, or the radius of a site
    [m]. Every name must be one of a site, or of a geom that is a roller.
    """
    fill(out, 0.0)
    attributes = mj_struct.attributes(model, instance)
    written = config.key_text(attributes, config.GUIDES)
    route = config.key_text(attributes, config.ROUTE)
    name = mj_struct.plugin_name(model, instance)
    own = mj_struct.tendon_name(model, tendon)
    start = mj_struct.integer(model, mj_struct.TENDON_ADR, tendon)
    count = mj_struct.integer(model, mj_struct.TENDON_NUM, tendon)
    extra, first = own.size - route.size, max(mouth, 1)
    begin, colon, end = config.next_guide(written, 0)
    while begin >= 0:
        wanted, found = written[begin:colon], False
        radius = config.guide_radius(written[colon + 1 : end])
        for k in range(first, count - 1):
            thing = mj_struct.integer(model, mj_struct.WRAP_OBJID, start + k)
            site = mj_struct.integer(model, mj_struct.WRAP_TYPE, start + k) == _SITE
            if not site and radius != config.ROLLING:
                continue
            if site:
                candidate = mj_struct.site_name(model, thing)
            else:
                candidate = mj_struct.geom_name(model, thing)
            for prefix in range(extra + 1):
                suffix = extra - prefix
                if _has_affixes(own, route, name, prefix, suffix) and _has_affixes(
                    candidate, wanted, name, prefix, suffix
                ):
                    out[k - first] = radius
                    found = True
        if not found:
            return False
        begin, colon, end = config.next_guide(written, end)
    return True


@internal
def is_tied(model: int, actuator: int, tendon: int) -> bool:
    """Return whether an end is tied to a site of the cable's tendon: that moves it."""
    kind = mj_struct.integer(model, mj_struct.ACTUATOR_TRNTYPE, actuator)
    target = mj_struct.integer(model, mj_struct.ACTUATOR_TRNID, 2 * actuator)
    return kind == _TRN_TENDON and target == tendon


@internal
def explain_bypass(
    message: Bytes, used: int, model: int, instance: int, tendon: int
) -> int:
    """Append what else pulls the whole tendon of an open cable, if anything."""
    for actuator in range(mj_struct.actuators(model)):
        if (
            mj_struct.integer(model, mj_struct.ACTUATOR_TRNTYPE, actuator)
            == _TRN_TENDON
            and mj_struct.integer(model, mj_struct.ACTUATOR_TRNID, 2 * actuator)
            == tendon
            and mj_struct.integer(model, mj_struct.ACTUATOR_PLUGIN, actuator)
            != instance
        ):
            used = name_actuator(message, used, model, actuator, _OTHER_ACTUATOR)
            return append(message, used, _PULLS_WHOLE_TENDON)
    own = (
        mj_struct.real(model, mj_struct.TENDON_STIFFNESS, tendon),
        mj_struct.real(model, mj_struct.TENDON_DAMPING, tendon),
        mj_struct.real(model, mj_struct.TENDON_FRICTIONLOSS, tendon),
        float(mj_struct.byte(model, mj_struct.TENDON_LIMITED, tendon)),
        mj_struct.real(model, mj_struct.TENDON_ARMATURE, tendon),
        1.0 if _has_length_equality(model, tendon) else 0.0,
    )
    for what in range(6):
        if own[what] != 0.0:
            used = append(message, used, _TENDON_HAS)
            used = append(message, used, _TENDON_FEATURES[what])
            return append(
                message, used, _TENDON_SPRING_END if what == 0 else _TENDON_HAS_END
            )
    return used


@internal
def _has_length_equality(model: int, tendon: int) -> bool:
    for i in range(mj_struct.equalities(model)):
        if mj_struct.integer(model, mj_struct.EQ_TYPE, i) == _EQUAL_TENDONS and (
            mj_struct.integer(model, mj_struct.EQ_OBJECT_1, i) == tendon
            or mj_struct.integer(model, mj_struct.EQ_OBJECT_2, i) == tendon
        ):
            return True
    return False


@internal
def in_disabled_group(model: int, instance: int) -> bool:
    groups = mj_struct.disabled_groups(model)
    if groups == 0:
        return False
    _, first, second = find_actuators(model, instance)
    for actuator in (first, second):
        group = mj_struct.integer(model, mj_struct.ACTUATOR_GROUP, actuator)
        if 0 <= group < 31 and groups & (1 << group) != 0:
            return True
    return False


@internal
def explain_tied(
    message: Bytes, used: int, model: int, instance: int, tendon: int
) -> int:
    """Append which end has a gear that would scale its tension, if one has."""
    _, first, second = find_actuators(model, instance)
    for actuator, wanted in ((first, -1.0), (second, 1.0)):
        own = pulley_radius(model, output_index(model, actuator))
        if is_tied(model, actuator, tendon) and own != wanted:
            used = name_actuator(message, used, model, actuator, ITS_ACTUATOR)
            return append(message, used, _WRONG_TIED_GEAR)
    return used


@internal
def keep_awake(model: int, instance: int, route: int, mouth: int) -> int:
    """Keep all trees awake that a cable pulls; return a body that may sleep, or -1.

    MuJoCo does so for trees that an actuator moves. It sees nothing of the pieces of an
    open path, and nothing that a cable pulls wakes a tree. `route` is the tendon of an
    open or mixed path, else -1, `mouth` the place in its path where the conduit ends.
    The body is in a tree that the model lets sleep by a `sleep` of its own.
    """
    _, first, second = find_actuators(model, instance)
    found = -1
    for actuator in (first, second):
        target = mj_struct.integer(model, mj_struct.ACTUATOR_TRNID, 2 * actuator)
        if mj_struct.integer(model, mj_struct.ACTUATOR_TRNTYPE, actuator) == _TRN_JOINT:
            body = mj_struct.integer(model, mj_struct.JNT_BODY, target)
            found = max(found, _keep_tree_awake(model, body))
        else:
            found = max(found, _keep_path_awake(model, target, 0))
    if route >= 0:
        found = max(found, _keep_path_awake(model, route, mouth))
    return found


@internal
def _keep_path_awake(model: int, tendon: int, begin: int) -> int:
    """Keep all trees awake that hold a tendon from a place of its path on."""
    start = mj_struct.integer(model, mj_struct.TENDON_ADR, tendon)
    end = start + mj_struct.integer(model, mj_struct.TENDON_NUM, tendon)
    found = -1
    for i in range(start + begin, end):
        kind = mj_struct.integer(model, mj_struct.WRAP_TYPE, i)
        if kind != _PULLEY:
            owner = mj_struct.SITE_BODY if kind == _SITE else mj_struct.GEOM_BODY
            thing = mj_struct.integer(model, mj_struct.WRAP_OBJID, i)
            body = mj_struct.integer(model, owner, thing)
            found = max(found, _keep_tree_awake(model, body))
    return found


@internal
def _keep_tree_awake(model: int, body: int) -> int:
    """Keep the tree of a body awake; return the body if it could sleep, else -1."""
    tree = mj_struct.integer(model, mj_struct.BODY_TREE, body)
    if tree < 0:
        return -1
    policy = mj_struct.integer(model, mj_struct.TREE_SLEEP, tree)
    if policy != _AUTO_NEVER and policy != _NEVER:
        address = load_word(model + mj_struct.TREE_SLEEP) + 4 * tree
        store_integer(address, _AUTO_NEVER)
    return body if policy == _ALLOWED or policy == _INIT else -1


@internal
def explain_sleep(message: Bytes, used: int, model: int, body: int) -> int:
    """Append that a body of `keep_awake` must not sleep; nothing for -1."""
    if body < 0:
        return used
    used = append(message, used, _BODY_PREFIX)
    name = mj_struct.body_name(model, body)
    if name.size == 0:
        used = append_integer(message, used, body)
    else:
        used = quote(message, used, name)
    return append(message, used, _MAY_SLEEP)


@internal
def holding_tendon(model: int, actuator: int) -> int:
    """Return the tendon that holds an end, or -1 if a joint holds it."""
    if mj_struct.integer(model, mj_struct.ACTUATOR_TRNTYPE, actuator) == _TRN_JOINT:
        return -1
    return mj_struct.integer(model, mj_struct.ACTUATOR_TRNID, 2 * actuator)


@internal
def pushes(model: int, actuator: int, distal: bool) -> bool:
    """Return whether the tension at an end that holds a tendon lengthens it."""
    radius = pulley_radius(model, output_index(model, actuator))
    return holding_tendon(model, actuator) >= 0 and (radius < 0.0) == distal


@internal
def only_pays_out(model: int, instance: int, actuator: int) -> bool:
    """Return whether a motor at the proximal end can only move the cable to distal.

    From its pose in `qpos0`, by its range and by what drives it: a servo to positions
    in its `ctrlrange`, a motor of one sign. The antagonist of a cable that it winds up
    may be so.
    """
    if holding_tendon(model, actuator) >= 0:
        return False
    joint = mj_struct.integer(model, mj_struct.ACTUATOR_TRNID, 2 * actuator)
    place = mj_struct.integer(model, mj_struct.JNT_POSITION, joint)
    rest = mj_struct.real(model, mj_struct.QPOS0, place)
    radius = pulley_radius(model, output_index(model, actuator))
    sense = -1.0 if radius > 0.0 else 1.0  # in which the joint winds the cable up
    if mj_struct.byte(model, mj_struct.JNT_LIMITED, joint) != 0:
        low = mj_struct.real(model, mj_struct.JNT_RANGE, 2 * joint)
        high = mj_struct.real(model, mj_struct.JNT_RANGE, 2 * joint + 1)
        if max(sense * (low - rest), sense * (high - rest)) <= _REST_TOLERANCE:
            sense = 0.0
    driven = False
    for other in range(mj_struct.actuators(model)):
        if (
            mj_struct.integer(model, mj_struct.ACTUATOR_TRNTYPE, other) != _TRN_JOINT
            or mj_struct.integer(model, mj_struct.ACTUATOR_TRNID, 2 * other) != joint
        ):
            continue
        kind = mj_struct.integer(model, mj_struct.ACTUATOR_PLUGIN, other)
        if kind == instance:
            continue
        if (
            kind >= 0
            and radius * pulley_radius(model, output_index(model, other)) < 0.0
        ):
            return False
        driven = driven or kind < 0
        if kind < 0 and sense != 0.0 and _can_drive(model, other, sense, rest):
            return False
    return driven


@internal
def _can_drive(model: int, actuator: int, sense: float, rest: float) -> bool:
    """Return whether an actuator can drive its joint from rest in a sense.

    True where that cannot be seen from the model.
    """
    if mj_struct.integer(model, mj_struct.ACTUATOR_GAINTYPE, actuator) != _FIXED_GAIN:
        return True
    control = mj_struct.integer(model, mj_struct.ACTUATOR_CTRLADR, actuator)
    if mj_struct.byte(model, mj_struct.CTRL_LIMITED, control) == 0:
        return True
    factor = pulley_radius(model, output_index(model, actuator))
    gain = mj_struct.real(model, mj_struct.ACTUATOR_GAINPRM, _PRM_SIZE * actuator)
    bias = mj_struct.integer(model, mj_struct.ACTUATOR_BIASTYPE, actuator)
    aim = 0.0  # at which a servo does nothing
    if bias == _AFFINE_BIAS:
        if (
            mj_struct.real(model, mj_struct.ACTUATOR_BIASPRM, _PRM_SIZE * actuator + 1)
            != -gain
        ):
            return True
        aim = factor * rest
    elif bias != _NO_BIAS:
        return True
    for side in range(2):
        value = mj_struct.real(model, mj_struct.CTRL_RANGE, 2 * control + side)
        if sense * factor * gain * (value - aim) > _REST_TOLERANCE:
            return True
    return False


@internal
def ends_swapped(model: int, first: int, second: int, route: int) -> bool:
    """Return whether the ends are on joints at the wrong ends of a route."""
    if holding_tendon(model, first) >= 0 or holding_tendon(model, second) >= 0:
        return False
    start = mj_struct.integer(model, mj_struct.TENDON_ADR, route)
    last = start + mj_struct.integer(model, mj_struct.TENDON_NUM, route) - 1
    right = _site_near_joint(model, first, start) or _site_near_joint(
        model, second, last
    )
    return (
        not right
        and _site_near_joint(model, first, last)
        and _site_near_joint(model, second, start)
    )


@internal
def _site_near_joint(model: int, actuator: int, place: int) -> bool:
    """Return whether a site in a path is on the body of a joint or on its parent."""
    joint = mj_struct.integer(model, mj_struct.ACTUATOR_TRNID, 2 * actuator)
    body = mj_struct.integer(model, mj_struct.JNT_BODY, joint)
    site = mj_struct.integer(model, mj_struct.WRAP_OBJID, place)
    own = mj_struct.integer(model, mj_struct.SITE_BODY, site)
    return own != 0 and (
        own == body or own == mj_struct.integer(model, mj_struct.BODY_PARENT, body)
    )
