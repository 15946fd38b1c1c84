"""The joints of a URDF, and the origins that joints and shapes share."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping

import numpy as np

from rr1plan.checks import FARTHEST, Array, read_only
from rr1plan.errors import InputError
from rr1plan.files.xml_reader import Element
from rr1plan.robot import Joint, JointKind, Mimic
from rr1plan.transforms import identity, pose

log = logging.getLogger(__name__)

_KINDS: dict[str, JointKind] = {
    "revolute": "revolute",
    "continuous": "continuous",
    "prismatic": "prismatic",
    "fixed": "fixed",
    # A floating or rolling base does not move with its arm.
    "floating": "fixed",
    "planar": "fixed",
}
# Faster than any joint; exporters write the largest float for a joint without a limit [rad/s or m/s].
_FASTEST = 1e4


def read_joint(element: Element) -> Joint:
    """One joint; floating and planar joints become fixed, with a warning.

    A joint whose two limits are equal keeps them; see `with_constant_joints_fixed`.

    Raises:
        FormatError: an unknown type, a missing or inverted limit, a zero axis, or a rate that is not positive.
    """
    name = element.text("name")
    kind = _kind(element, name)
    parent = element.required("parent").text("link")
    child = element.required("child").text("link")
    if parent == child:
        raise element.error(f"joint {name!r} joins link {parent!r} to itself")
    origin = read_origin(element)
    if kind == "fixed":
        return Joint(name, kind, parent, child, origin)
    lower, upper, velocity, effort = _limit(element, name, kind)
    acceleration, jerk = _rates(element, name)
    dynamics = element.child("dynamics")
    damping, friction = (0.0, 0.0) if dynamics is None else (_coefficient(dynamics, n) for n in ("damping", "friction"))
    return Joint(
        name=name,
        kind=kind,
        parent=parent,
        child=child,
        origin=origin,
        axis=_axis(element, name),
        lower=lower,
        upper=upper,
        velocity=velocity,
        effort=effort,
        damping=damping,
        friction=friction,
        mimic=_mimic(element),
        acceleration=acceleration,
        jerk=jerk,
    )


def with_constant_joints_fixed(elements: Mapping[str, Element], joints: Mapping[str, Joint]) -> dict[str, Joint]:
    """The joints; those without a range, and those that mimic one of these, become fixed, with a warning.

    Args:
        elements: The element of each joint.
        joints: The joints by name; chains of mimic joints end at a joint among them.

    Raises:
        FormatError: a value that no joint can have.
    """
    fixed = dict(joints)
    for name, joint in joints.items():
        leader, gain, offset = joint, 1.0, 0.0
        while leader.lower < leader.upper and leader.mimic is not None:
            gain, offset = gain * leader.mimic.multiplier, offset + gain * leader.mimic.offset
            leader = joints[leader.mimic.joint]
        if leader.lower < leader.upper:
            continue
        value = gain * leader.lower + offset
        if not abs(value) <= FARTHEST:
            raise elements[name].error(f"joint {name!r} is fixed at {value:g}, expected at most ±{FARTHEST:g}")
        if leader is joint:
            text = "%s:%d: joint %r has no range but %g alone, it is taken as fixed; if it moves, give it other limits"
            log.warning(text, *elements[name].at, name, value)
        else:
            text = "%s:%d: joint %r follows %r, which has no range, it is taken as fixed at %g"
            log.warning(text, *elements[name].at, name, leader.name, value)
        fixed[name] = Joint(name, "fixed", joint.parent, joint.child, read_only(joint.origin @ joint.motion(value)))
    return fixed


def read_origin(element: Element) -> Array:
    """The transform of an element's `<origin>`, shape (4, 4); identity if there is none.

    Raises:
        FormatError: not three finite numbers, angles that look like degrees, or a quaternion without a direction.
    """
    origin = element.child("origin")
    if origin is None:
        return identity()
    xyz = origin.vector("xyz", 3, (0.0, 0.0, 0.0))
    if "quat_xyzw" not in origin.attributes:
        rotation = {"rpy": origin.vector("rpy", 3, (0.0, 0.0, 0.0))}
    elif "rpy" in origin.attributes:
        raise origin.error("<origin> has both rpy and quat_xyzw, expected one of them")
    else:
        x, y, z, w = origin.vector("quat_xyzw", 4)
        rotation = {"quaternion": (w, x, y, z)}
    try:
        return pose(xyz, **rotation)
    except InputError as error:
        raise origin.error(str(error)) from error


def _kind(element: Element, name: str) -> JointKind:
    word = element.text("type")
    if word not in _KINDS:
        raise element.error(f"joint {name!r} has the unknown type {word!r}, expected one of {', '.join(_KINDS)}")
    if _KINDS[word] != word:
        text = "%s:%d: joint %r is %s, it is taken as fixed: joints with several degrees of freedom are not modeled"
        log.warning(text, *element.at, name, word)
    return _KINDS[word]


def _axis(element: Element, name: str) -> Array:
    """The unit axis; URDF's default is x."""
    axis = element.child("axis")
    xyz = np.array((1.0, 0.0, 0.0) if axis is None else axis.vector("xyz", 3))
    length = math.hypot(*xyz)
    if not 1e-6 <= length < np.inf:
        raise element.error(f"the axis of joint {name!r} is {xyz.tolist()}, expected a direction")
    return read_only(xyz / length)


def _limit(element: Element, name: str, kind: JointKind) -> tuple[float, float, float, float]:
    """Lower, upper, velocity and effort; unknown velocities are 0 or huge in files, unknown efforts 0 or -1."""
    limit = element.child("limit")
    if limit is None:
        if kind != "continuous":
            raise element.error(f"{kind} joint {name!r} has no <limit>; add lower, upper, velocity and effort")
        return -np.inf, np.inf, np.inf, np.inf
    velocity = _rate(limit, name, "velocity")
    if _FASTEST < velocity < np.inf:
        log.warning("%s:%d: joint %r has velocity %g, it is taken as unknown", *limit.at, name, velocity)
        velocity = np.inf
    effort = limit.number("effort", np.inf)
    if effort < 0.0:
        log.warning("%s:%d: joint %r has effort %g, it is taken as unknown: no limit", *limit.at, name, effort)
        effort = np.inf
    if kind == "continuous":
        return -np.inf, np.inf, velocity, effort or np.inf
    lower, upper = limit.number("lower", 0.0), limit.number("upper", 0.0)
    if lower > upper:
        raise limit.error(f"joint {name!r} has lower limit {lower} and upper limit {upper}, expected lower < upper")
    return lower, upper, velocity, effort or np.inf


def _rates(element: Element, name: str) -> tuple[float, float]:
    """Limits of acceleration, the same in both directions here, and of jerk; URDF has them from version 1.2 on."""
    limit = element.child("limit")
    if limit is None:
        return np.inf, np.inf
    acceleration, deceleration, jerk = (_rate(limit, name, rate) for rate in ("acceleration", "deceleration", "jerk"))
    return min(acceleration, deceleration), jerk


def _rate(limit: Element, name: str, rate: str) -> float:
    """A limit of a joint's velocity or of a derivative of it; files use 0 for an unknown one."""
    value = limit.number(rate, np.inf)
    if value == 0.0:
        log.warning("%s:%d: joint %r has %s 0, it is taken as unknown", *limit.at, name, rate)
        return np.inf
    if value < 0.0:
        raise limit.error(f"joint {name!r} has {rate} {value}, expected a number above zero")
    return value


def _coefficient(dynamics: Element, name: str) -> float:
    value = dynamics.number(name, 0.0)
    if value < 0.0:
        raise dynamics.error(f"<dynamics> {name}={value}, expected a number not below zero")
    return value


def _mimic(element: Element) -> Mimic | None:
    mimic = element.child("mimic")
    if mimic is None:
        return None
    return Mimic(mimic.text("joint"), mimic.number("multiplier", 1.0), mimic.number("offset", 0.0))
