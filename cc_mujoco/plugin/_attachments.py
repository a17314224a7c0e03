"""Compiled checks of the two ends and the route of a plugin instance.

The first actuator of an instance (in the order of the model) is the proximal end, the
second the distal end.
"""

import math

import mujoco
from mujoco import mjtBias, mjtEq, mjtGain, mjtJoint, mjtSleepPolicy, mjtTrn, mjtWrap

from cc_mujoco.native import FloatArray, internal
from cc_mujoco.plugin import _config as config
from cc_mujoco.plugin import _ffi as ffi
from cc_mujoco.plugin._ffi import MjModel

_REST_TOLERANCE = 1e-9
NO_LENGTH = (
    " has no length in the pose `qpos0` that MuJoCo can use; it must be finite and at "
    "most 1e10 m"
)


@internal
def find_actuators(model: MjModel, instance: int) -> tuple[int, int, int]:
    """Return the number of actuators of an instance, and its first two (-1: none)."""
    count, first, second = 0, -1, -1
    for actuator in range(model.nactuator):
        if model.actuator_plugin[actuator] == instance:
            if count == 0:
                first = actuator
            elif count == 1:
                second = actuator
            count += 1
    return count, first, second


@internal
def pulley_radius(model: MjModel, out: int) -> float:
    """Return an end's signed pulley radius [m] by its `actuator_length` index."""
    return float(model.actuator_gear[out, 0])


@internal
def end_radius(model: MjModel, actuator: int) -> float:
    return pulley_radius(model, model.actuator_outadr[actuator])


@internal
def is_length(metres: float) -> bool:
    """Return whether a length [m] is a finite number within MuJoCo's `mjMAXVAL`."""
    return abs(metres) <= float(mujoco.mjMAXVAL)


@internal
def holding_joint(model: MjModel, actuator: int) -> int:
    if model.actuator_trntype[actuator] != mjtTrn.mjTRN_JOINT:
        return -1
    return int(model.actuator_trnid[actuator, 0])


@internal
def holding_tendon(model: MjModel, actuator: int) -> int:
    if model.actuator_trntype[actuator] != mjtTrn.mjTRN_TENDON:
        return -1
    return int(model.actuator_trnid[actuator, 0])


@internal
def is_spatial(model: MjModel, tendon: int) -> bool:
    first = model.wrap_type[model.tendon_adr[tendon]]
    return bool(first != mjtWrap.mjWRAP_JOINT)


@internal
def blame(message: ffi.Message, model: MjModel, actuator: int, why: ffi.Bytes) -> None:
    ffi.append(message, "its actuator ")
    name = ffi.name(model, model.name_actuatoradr[actuator])
    ffi.append_label(message, name, actuator)
    ffi.append(message, why)


@internal
def explain(message: ffi.Message, model: MjModel, instance: int) -> None:
    """Append the reason, if any, why the ends of an instance cannot be used."""
    count, first, second = find_actuators(model, instance)
    if count != 2:
        ffi.append(message, "it is used by ")
        ffi.append_integer(message, count)
        ffi.append(
            message,
            " actuators; it must be used by two, first the proximal and then the "
            "distal end",
        )
        return
    blamed, why = first, _misfit(model, first)
    if why.size == 0:
        blamed, why = second, _misfit(model, second)
    is_joint = holding_joint(model, first) >= 0
    if (
        why.size == 0
        and model.actuator_trntype[first] == model.actuator_trntype[second]
        and model.actuator_trnid[first, 0] == model.actuator_trnid[second, 0]
        # On a tendon they may hold it in opposite directions.
        and (is_joint or end_radius(model, first) * end_radius(model, second) > 0.0)
    ):
        why = (
            " is on the same joint or tendon as the other end; a cable needs two that "
            "move against each other"
        )
    if why.size > 0:
        blame(message, model, blamed, why)


@internal
def _misfit(model: MjModel, actuator: int) -> ffi.Bytes:
    """Return the reason why an actuator cannot be an end of a cable, or no text."""
    joint, tendon = holding_joint(model, actuator), holding_tendon(model, actuator)
    kind = model.jnt_type[joint] if joint >= 0 else -1
    moves = kind == mjtJoint.mjJNT_HINGE or kind == mjtJoint.mjJNT_SLIDE
    if not moves and tendon < 0:
        return (
            " has the wrong transmission; it must be a hinge or slide `joint` or a "
            "`tendon`"
        )
    radius = end_radius(model, actuator)
    if radius == 0.0 or not math.isfinite(radius):
        return (
            " has gear 0, or no finite number; it must be the signed pulley radius in "
            "metres"
        )
    if model.actuator_forcelimited[actuator] != 0:
        return (
            " has a `forcerange`, its own or that of a default, which would clamp the "
            'tension of the cable; set forcelimited="false" there'
        )
    if abs(radius) * _most_turning(model, joint, tendon) >= 1.0:
        return (
            " has a pulley of 1 m radius or more, of 1 m if no gear is given; `gear`, "
            "times `coef` of a fixed tendon, must be the signed pulley radius in metres"
        )
    drag = model.actuator_dampingpoly[actuator]
    if model.actuator_damping[actuator] != 0.0 or drag[0] != 0.0 or drag[1] != 0.0:
        return (
            " has a `damping`, its own or that of a default, which would act beside "
            "the cable; take it away there, and say it of the joint"
        )
    if model.actuator_armature[actuator] != 0.0:
        return (
            " has an `armature`, its own or that of a default, which would act beside "
            "the cable; take it away there, and say it of the joint"
        )
    if tendon >= 0 and model.tendon_actfrclimited[tendon] != 0:
        return (
            " pulls a tendon that has an `actuatorfrcrange`, its own or that of a "
            "default, which would clamp the tension of the cable; limit the motor by "
            "the `forcerange` of its actuator"
        )
    for other in range(model.njnt):
        moved = other == joint or (tendon >= 0 and _moves_part(model, other, tendon))
        if model.jnt_actfrclimited[other] != 0 and moved:
            return (
                " pulls a joint that has an `actuatorfrcrange`, its own or that of a "
                "default, which would clamp the tension of the cable; limit the motor "
                "by the `forcerange` of its actuator"
            )
    if not is_length(model.actuator_length0[model.actuator_outadr[actuator]]):
        return NO_LENGTH
    return ""


@internal
def _most_turning(model: MjModel, joint: int, tendon: int) -> float:
    """Return the largest factor by which hinges turn an end's joint or fixed tendon."""
    if tendon < 0:
        return float(model.jnt_type[joint] == mjtJoint.mjJNT_HINGE)
    most = 0.0
    for i in range(model.tendon_adr[tendon], ffi.path_end(model, tendon)):
        if model.wrap_type[i] == mjtWrap.mjWRAP_JOINT:
            turns = model.jnt_type[model.wrap_objid[i]] == mjtJoint.mjJNT_HINGE
            most = max(most, abs(model.wrap_prm[i]) if turns else 0.0)
    return most


@internal
def _moves_part(model: MjModel, joint: int, tendon: int) -> bool:
    carried = model.jnt_bodyid[joint]
    inside, outside = 0, 0
    for i in range(model.tendon_adr[tendon], ffi.path_end(model, tendon)):
        if model.wrap_type[i] == mjtWrap.mjWRAP_JOINT:
            if model.wrap_objid[i] == joint:
                return True
            continue
        body = ffi.wrap_body(model, i)
        if body < 0:
            continue
        while body > carried:  # parents come before their children
            body = model.body_parentid[body]
        if body == carried:
            inside += 1
        else:
            outside += 1
    return inside > 0 and outside > 0


@internal
def _has_affixes(
    candidate: ffi.Bytes, wanted: ffi.Bytes, name: ffi.Bytes, prefix: int, suffix: int
) -> bool:
    """Return whether `candidate` is `wanted` between prefix and suffix of `name`.

    `prefix` and `suffix` are their lengths in bytes.
    """
    end = prefix + wanted.size
    return (
        candidate.size == end + suffix
        and config.equal_text(candidate[prefix:end], wanted)
        and config.equal_text(candidate[:prefix], name[:prefix])
        and config.equal_text(candidate[end:], name[name.size - suffix :])
    )


@internal
def _element_has_affixes(
    label: ffi.Bytes, name: ffi.Bytes, prefix: int, suffix: int
) -> bool:
    """Return whether `label` is empty or begins and ends as `name`, at these sizes."""
    inner = max(label.size - prefix - suffix, 0)
    return label.size == 0 or (
        inner > 0
        and _has_affixes(label, label[prefix : prefix + inner], name, prefix, suffix)
    )


@internal
def _wrap_name(model: MjModel, place: int) -> ffi.Bytes:
    thing = model.wrap_objid[place]
    if model.wrap_type[place] == mjtWrap.mjWRAP_SITE:
        return ffi.name(model, model.name_siteadr[thing])
    return ffi.name(model, model.name_geomadr[thing])


@internal
def _all_have_affixes(
    model: MjModel, instance: int, tendon: int, prefix: int, suffix: int
) -> bool:
    """Return whether elements of a cable's ends and path have its name's affixes."""
    name = ffi.name(model, model.name_pluginadr[instance])
    _, first, second = find_actuators(model, instance)
    for actuator in (first, second):
        if actuator >= 0:
            label = ffi.name(model, model.name_actuatoradr[actuator])
            if not _element_has_affixes(label, name, prefix, suffix):
                return False
    for i in range(model.tendon_adr[tendon], ffi.path_end(model, tendon)):
        if ffi.wrap_body(model, i) >= 0:
            label = _wrap_name(model, i)
            if not _element_has_affixes(label, name, prefix, suffix):
                return False
    return True


@internal
def find_route(model: MjModel, instance: int, route: ffi.Bytes) -> int:
    """Return the index of the spatial tendon that an instance names as route, or -1.

    MuJoCo's `attach` renames all elements, but not the text of a configuration. So
    `route` also stands for that name with a prefix and a suffix of the instance's own
    name, if its actuators and the sites and geoms of the tendon have them too: instance
    `left_flexor` with `route` = `path` means tendon `left_path`, or else `path`. The
    longest match counts, unless a tendon is named exactly as instance and `route`.
    """
    name = ffi.name(model, model.name_pluginadr[instance])
    namesake = config.equal_text(route, name)
    best, longest = -1, -1
    for tendon in range(model.ntendon):
        if not is_spatial(model, tendon):
            continue
        candidate = ffi.name(model, model.name_tendonadr[tendon])
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
def _is_named(
    model: MjModel, instance: int, tendon: int, place: int, wanted: ffi.Bytes
) -> bool:
    """Return whether a place of a route has this name, affixes of `attach` aside."""
    attributes = ffi.attributes(model, instance)
    route = config.key_text(attributes, config.KEY.route)
    name = ffi.name(model, model.name_pluginadr[instance])
    own = ffi.name(model, model.name_tendonadr[tendon])
    candidate, extra = _wrap_name(model, place), own.size - route.size
    for prefix in range(extra + 1):
        if _has_affixes(own, route, name, prefix, extra - prefix) and _has_affixes(
            candidate, wanted, name, prefix, extra - prefix
        ):
            return True
    return False


@internal
def find_mouth(model: MjModel, instance: int, tendon: int) -> int:
    """Return the index in a route of its mouth, where the conduit ends, or -1."""
    mouth = config.key_text(ffi.attributes(model, instance), config.KEY.mouth)
    start = model.tendon_adr[tendon]
    for i in range(1, model.tendon_num[tendon] - 1):
        is_site = model.wrap_type[start + i] == mjtWrap.mjWRAP_SITE
        if is_site and _is_named(model, instance, tendon, start + i, mouth):
            return i
    return -1


@internal
def read_guides(
    model: MjModel, instance: int, tendon: int, mouth: int, out: FloatArray
) -> bool:
    """Read the key `guides` of an instance; return whether all of it can be used.

    Every name must be that of a site, or of a geom that is a roller. `out` gets a
    number for each place of the path after its first site, or from the mouth on: 0 for
    no guide, `ROLLING` for a roller, or the radius of a site [m].
    """
    out[:] = 0.0
    written = config.key_text(ffi.attributes(model, instance), config.KEY.guides)
    first = max(mouth, 1)
    start = model.tendon_adr[tendon] + first
    begin, colon, end = config.next_guide(written, 0)
    while begin >= 0:
        radius, found = config.guide_radius(written[colon + 1 : end]), False
        for k in range(model.tendon_num[tendon] - 1 - first):
            is_site = model.wrap_type[start + k] == mjtWrap.mjWRAP_SITE
            usable = is_site or radius == config.ROLLING
            wanted = written[begin:colon]
            if usable and _is_named(model, instance, tendon, start + k, wanted):
                out[k] = radius
                found = True
        if not found:
            return False
        begin, colon, end = config.next_guide(written, end)
    return True


@internal
def explain_bypass(
    message: ffi.Message, model: MjModel, instance: int, tendon: int
) -> None:
    for actuator in range(model.nactuator):
        pulls = holding_tendon(model, actuator) == tendon
        if pulls and model.actuator_plugin[actuator] != instance:
            ffi.append(message, "actuator ")
            name = ffi.name(model, model.name_actuatoradr[actuator])
            ffi.append_label(message, name, actuator)
            ffi.append(
                message,
                " pulls its tendon as a whole, which passes friction by; give it the "
                "joint of a drum, and that joint to the proximal end",
            )
            return
    feature = _tendon_feature(model, tendon)
    if feature.size > 0:
        ffi.append(message, "its tendon has ")
        ffi.append(message, feature)
        ffi.append(
            message,
            " of its own, which pulls it as a whole and passes friction by; take it "
            "away, and ",
        )
        ffi.append(
            message,
            "give the cable an `axial_stiffness` of `stiffness` times the upper "
            "`springlength` and, as `pretension`, the force of that spring in the pose "
            "`qpos0`"
            if config.equal_text(feature, "a `stiffness`")
            else "say it of the cable or of a joint",
        )


@internal
def _tendon_feature(model: MjModel, tendon: int) -> ffi.Bytes:
    """Return the feature that acts on a tendon as a whole ("a `range`"), or ""."""
    if model.tendon_stiffness[tendon] != 0.0:
        return "a `stiffness`"
    if model.tendon_damping[tendon] != 0.0:
        return "a `damping`"
    if model.tendon_frictionloss[tendon] != 0.0:
        return "a `frictionloss`"
    if model.tendon_limited[tendon] != 0:
        return "a `range`"
    if model.tendon_armature[tendon] != 0.0:
        return "an `armature`"
    for i in range(model.neq):
        own = model.eq_obj1id[i] == tendon or model.eq_obj2id[i] == tendon
        if own and model.eq_type[i] == mjtEq.mjEQ_TENDON:
            return "an equality"
    return ""


@internal
def in_disabled_group(model: MjModel, instance: int) -> bool:
    groups = model.opt.disableactuator
    if groups == 0:
        return False
    _, first, second = find_actuators(model, instance)
    for actuator in (first, second):
        group = model.actuator_group[actuator]
        if 0 <= group < 31 and groups & (1 << group) != 0:
            return True
    return False


@internal
def explain_tied(
    message: ffi.Message, model: MjModel, instance: int, tendon: int
) -> None:
    """Add to a refusal if an end on `tendon` has not gear -1 (proximal) or 1."""
    _, first, second = find_actuators(model, instance)
    for actuator, wanted in ((first, -1.0), (second, 1.0)):
        tied = holding_tendon(model, actuator) == tendon
        if tied and end_radius(model, actuator) != wanted:
            why: ffi.Bytes = (
                " ties the cable to its own tendon; its gear must be 1 (-1 at the "
                "proximal end)"
            )
            blame(message, model, actuator, why)
            return


@internal
def keep_awake(model: MjModel, instance: int, route: int, mouth: int) -> int:
    """Forbid sleep to all kinematic trees that a cable pulls.

    MuJoCo does so for trees that an actuator moves, but not for those that pieces of an
    open path pull. `route` is the tendon of an open or mixed path, else -1, and `mouth`
    the place in it where the conduit ends. Return a body whose tree the model
    explicitly lets sleep by its `sleep`, or -1.
    """
    _, first, second = find_actuators(model, instance)
    found = -1
    for actuator in (first, second):
        joint = holding_joint(model, actuator)
        if joint >= 0:
            found = max(found, _keep_tree_awake(model, model.jnt_bodyid[joint]))
        else:
            tendon = model.actuator_trnid[actuator, 0]
            found = max(found, _keep_path_awake(model, tendon, 0))
    if route >= 0:
        found = max(found, _keep_path_awake(model, route, mouth))
    return found


@internal
def _keep_path_awake(model: MjModel, tendon: int, begin: int) -> int:
    """Do `keep_awake` for the path of a tendon, from place `begin` on."""
    found, start = -1, model.tendon_adr[tendon] + begin
    for i in range(start, ffi.path_end(model, tendon)):
        body = ffi.wrap_body(model, i)
        if body >= 0:
            found = max(found, _keep_tree_awake(model, body))
    return found


@internal
def _keep_tree_awake(model: MjModel, body: int) -> int:
    tree = model.body_treeid[body]
    if tree < 0:
        return -1
    policy = model.tree_sleep_policy[tree]
    never = mjtSleepPolicy.mjSLEEP_AUTO_NEVER
    if policy != never and policy != mjtSleepPolicy.mjSLEEP_NEVER:
        model.tree_sleep_policy[tree] = never
    allowed = policy == mjtSleepPolicy.mjSLEEP_ALLOWED
    return body if allowed or policy == mjtSleepPolicy.mjSLEEP_INIT else -1


@internal
def explain_sleep(message: ffi.Message, model: MjModel, body: int) -> None:
    """Append to `message` that `body` must not sleep; append nothing if it is -1."""
    if body < 0:
        return
    ffi.append(message, "body ")
    ffi.append_label(message, ffi.name(model, model.name_bodyadr[body]), body)
    ffi.append(
        message,
        " has a `sleep` of `allowed` or `init`, but the cable pulls its tree and wakes "
        "nothing that sleeps; take it away there",
    )


@internal
def pushes(model: MjModel, actuator: int, distal: bool) -> bool:
    tendon, radius = holding_tendon(model, actuator), end_radius(model, actuator)
    return tendon >= 0 and is_spatial(model, tendon) and (radius < 0.0) == distal


@internal
def only_pays_out(model: MjModel, instance: int, actuator: int) -> bool:
    """Return whether the motor at the proximal end can only slacken the cable.

    That follows from its position in `qpos0`, the range of its joint, and its drive: a
    servo to positions in its `ctrlrange`, or a motor of one sign. The joint of an
    antagonist, a cable that pulls in the opposite sense, never counts.
    """
    joint = holding_joint(model, actuator)
    if joint < 0:
        return False
    rest = model.qpos0[model.jnt_qposadr[joint]]
    radius = end_radius(model, actuator)
    sense = -1.0 if radius > 0.0 else 1.0  # in which the joint winds the cable up
    if model.jnt_limited[joint] != 0:
        low, high = model.jnt_range[joint, 0], model.jnt_range[joint, 1]
        if max(sense * (low - rest), sense * (high - rest)) <= _REST_TOLERANCE:
            sense = 0.0
    driven = False
    for other in range(model.nactuator):
        if holding_joint(model, other) != joint:
            continue
        kind = model.actuator_plugin[other]
        if kind == instance:
            continue
        if kind >= 0 and radius * end_radius(model, other) < 0.0:
            return False
        driven = driven or kind < 0
        if kind < 0 and sense != 0.0 and _can_drive(model, other, sense, rest):
            return False
    return driven


@internal
def _can_drive(model: MjModel, actuator: int, sense: float, rest: float) -> bool:
    if model.actuator_gaintype[actuator] != mjtGain.mjGAIN_FIXED:
        return True
    control = model.actuator_ctrladr[actuator]
    if model.actuator_ctrllimited[control] == 0:
        return True
    factor, gain = end_radius(model, actuator), model.actuator_gainprm[actuator, 0]
    bias, aim = model.actuator_biastype[actuator], 0.0  # aim: control without force
    if bias == mjtBias.mjBIAS_AFFINE:
        if model.actuator_biasprm[actuator, 1] != -gain:
            return True
        aim = factor * rest
    elif bias != mjtBias.mjBIAS_NONE:
        return True
    for side in range(2):
        value = model.actuator_ctrlrange[control, side]
        if sense * factor * gain * (value - aim) > _REST_TOLERANCE:
            return True
    return False


@internal
def ends_swapped(model: MjModel, instance: int) -> bool:
    _, first, second = find_actuators(model, instance)
    written = config.key_text(ffi.attributes(model, instance), config.KEY.route)
    route = find_route(model, instance, written) if written.size > 0 else -1
    joint, other = holding_joint(model, first), holding_joint(model, second)
    if route < 0 or joint < 0 or other < 0:
        return False
    start, last = model.tendon_adr[route], ffi.path_end(model, route) - 1
    if _is_near(model, joint, start) or _is_near(model, other, last):
        return False
    return _is_near(model, joint, last) and _is_near(model, other, start)


@internal
def _is_near(model: MjModel, joint: int, place: int) -> bool:
    """Return whether a site of a path is on a joint's body or its parent body."""
    body = model.jnt_bodyid[joint]
    own = model.site_bodyid[model.wrap_objid[place]]
    return bool(own != 0 and (own == body or own == model.body_parentid[body]))
