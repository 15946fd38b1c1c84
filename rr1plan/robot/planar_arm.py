"""Planar arms of two joints that turn (R) or slide (P), made from a few numbers."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import DEGREES, Array, check_text, counted, items_of, known_name, number_array, positive_length
from rr1plan.errors import InputError
from rr1plan.robot.check_robot import check_robot
from rr1plan.robot.joint_limits import WIDEST, Limits
from rr1plan.robot.link_masses import solid_inertial
from rr1plan.robot.robot import Robot
from rr1plan.robot.robot_parts import Geometry, Joint, JointKind, Link
from rr1plan.shapes import Box, Capsule, Color, Cylinder, Shape
from rr1plan.transforms import as_pose, rotation_about

log = logging.getLogger(__name__)

PLANAR_KINDS = ("RR", "RP", "PR", "PP")
_DARK: Color = (0.2, 0.2, 0.22, 1.0)
_ORANGE: Color = (1.0, 0.55, 0.05, 1.0)
_ALUMINUM: Color = (0.66, 0.68, 0.7, 1.0)
# Highest speed, acceleration, jerk, and torque or force of turning and sliding joints.
_DYNAMICS = {"R": (2.0, 8.0, 80.0, 50.0), "P": (1.0, 4.0, 40.0, 200.0)}
_CLEARANCE = 4.0  # of a gantry's beam above the plane, in widths
_X, _Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


def planar_arm(
    joints: str = "RR",
    lengths: ArrayLike = (1.0, 0.8),
    *,
    width: float | None = None,
    limits: Sequence[ArrayLike | None] | None = None,
    name: str | None = None,
) -> Robot:
    """An arm of two joints in the plane z = 0, for lessons and first experiments.

    "RR" is the 2R arm of textbooks. "RP" turns a sleeve of the first length, from which a rod slides out. "PR" slides
    along x and carries a turning link. "PP" is a gantry: its beam slides along x, above the plane, and its tool, a
    round rod, along y. Base and carriage are below the plane, the gantry's beam is above it, so obstacles that are
    centered at z = 0 and up to three widths high can only touch links and rod. The arm does not touch itself.

    Args:
        joints: "RR", "RP", "PR" or "PP".
        lengths: For a turning joint the length of its link, for a sliding joint its travel [m], shape (2,).
        width: Width of the links, diameter of the gantry's rod [m] (default: 8 % of the longer length, at most a fifth
            of the shorter one).
        limits: For each joint its lowest and highest value [rad or m], or None: turning joints then have no limits, and
            sliding joints a range from 0 to their length.
        name: Name of the robot (default: "planar_rr" and so on).

    Raises:
        UnknownNameError: other joints.
        InputError: a length or a width that is not positive, or limits that are not a range.
    """
    known_name("pair of joints", joints, PLANAR_KINDS)
    sizes = items_of("lengths", lengths, "two lengths [m]")
    if len(sizes) != 2:
        raise InputError(f"lengths has {counted(len(sizes), 'number')}, expected two [m]")
    first, second = (positive_length("length", value) for value in sizes)
    usual = min(0.08 * max(first, second), 0.2 * min(first, second))
    width = usual if width is None else positive_length("width", width)
    name = f"planar_{joints.lower()}" if name is None else name
    check_text("name", name)
    given = (None, None) if limits is None else items_of("limits", limits, "a range for each joint")
    if len(given) != 2:
        raise InputError(f"limits has {len(given)} entries, expected one for each of two joints")
    ranges = [
        _range(k, kind, length, limit)
        for k, (kind, length, limit) in enumerate(zip(joints, (first, second), given, strict=True), 1)
    ]
    parts = _parts(joints, first, second, width)
    links = [
        Link(name, solid_inertial(shapes, mass), shapes, shapes)
        for name, shapes, mass in zip(("base", "link1", "link2"), parts.bodies, parts.masses, strict=True)
    ]
    chain = [
        _joint(f"joint{k + 1}", kind, links[k : k + 2], parts.origins[k], parts.slides[k], ranges[k])
        for k, kind in enumerate(joints)
    ]
    tool = Joint("tool_joint", "fixed", "link2", "tool", as_pose(parts.origins[2]))
    lower, upper = np.array(ranges).T
    bounds = Limits(lower, upper, *np.array([_DYNAMICS[kind] for kind in joints]).T)
    middle = [0.6 if kind == "R" else 0.4 * length for kind, length in zip(joints, (first, second), strict=True)]
    robot = Robot(
        name=name,
        links=(*links, Link("tool")),
        joints=(*chain, tool),
        joint_names=("joint1", "joint2"),
        limits=bounds,
        configurations={"home": np.clip(middle, lower, upper)},
        locked_joints={},
        disabled_collisions=frozenset(map(frozenset, combinations([link.name for link in links], 2))),
        tool="tool",
        presets={"sim": bounds},
        source=f"planar_arm({joints!r})",
    )
    return check_robot(robot)


def _range(number: int, kind: str, length: float, limit: ArrayLike | None) -> tuple[float, float]:
    if limit is None:
        return (-np.inf, np.inf) if kind == "R" else (0.0, length)
    pair = number_array(f"limits of joint{number}", limit)
    if pair.shape != (2,) or not np.isfinite(pair).all() or not pair[0] < pair[1]:
        raise InputError(
            f"limits of joint{number} are {pair.tolist()}, expected a lower and a higher finite number, or None; "
            "limits has one such pair for each joint"
        )
    if kind == "R" and np.abs(pair).max() > WIDEST:
        log.warning("joint%d has limits %g to %g rad %s", number, *pair, DEGREES)
    return float(pair[0]), float(pair[1])


class _Parts(NamedTuple):
    """Shapes and masses [kg] of base and two links; poses of joints and tool in the previous link; axes of slides."""

    bodies: tuple[tuple[Geometry, ...], ...]
    masses: tuple[float, float, float]
    origins: tuple[ArrayLike, ArrayLike, ArrayLike]
    slides: tuple[Array, Array]


def _parts(joints: str, first: float, second: float, width: float) -> _Parts:
    w = width
    if joints == "PP":
        high = _CLEARANCE * w
        rails = tuple(
            _part(Box((first + 3 * w, 0.4 * w, 0.4 * w)), (0.5 * first, y, high), _ALUMINUM)
            for y in (-1.5 * w, second + 1.5 * w)
        )
        beam = _part(Box((0.6 * w, second + 3 * w, 0.4 * w)), (0.0, 0.5 * second, high + 0.4 * w), _DARK)
        rod = _part(Cylinder(0.5 * w, high + w), (0.0, 0.0, 0.5 * high), _ORANGE)
        return _Parts((rails, (beam,), (rod,)), (1.0, 2 * second, 1.0), ((0, 0, 0), (0, 0, 0), (0, 0, 0)), (_X, _Y))
    below = (0.0, 0.0, -2.0 * w)
    stand = _part(Cylinder(1.5 * w, 0.75 * w), below, _ALUMINUM)
    if joints == "PR":
        rail = _part(Box((first + 2 * w, 0.4 * w, 0.4 * w)), (0.5 * first, 0.0, -2.8 * w), _ALUMINUM)
        carriage = _part(Cylinder(w, 0.75 * w), below, _DARK)
        bodies = ((rail,), (carriage,), (_bar(0.0, second, w, _ORANGE),))
        return _Parts(bodies, (1.0, 1.0, 2 * second), ((0, 0, 0), (0, 0, 0), (second, 0, 0)), (_X, _X))
    sleeve = _bar(0.0, first, w, _DARK)
    if joints == "RP":
        # When retracted, the rod is inside the sleeve.
        bodies = ((stand,), (sleeve,), (_bar(-second, 0.0, 0.7 * w, _ORANGE),))
        return _Parts(bodies, (1.0, 2 * first, second), ((0, 0, 0), (first, 0, 0), (0, 0, 0)), (_X, _X))
    bodies = ((stand,), (sleeve,), (_bar(0.0, second, w, _ORANGE),))
    return _Parts(bodies, (1.0, 2 * first, 2 * second), ((0, 0, 0), (first, 0, 0), (second, 0, 0)), (_X, _X))


def _part(shape: Shape, center: ArrayLike, color: Color) -> Geometry:
    return Geometry("part", shape, as_pose(center), color)


def _bar(begin: float, end: float, width: float, color: Color) -> Geometry:
    """A capsule around the x axis between two points."""
    turned = as_pose((0.5 * (begin + end), 0.0, 0.0)).copy()
    turned[:3, :3] = rotation_about([0.0, 1.0, 0.0], np.pi / 2)
    return Geometry("part", Capsule(0.5 * width, end - begin), turned, color)


def _joint(
    name: str, kind: str, links: Sequence[Link], origin: ArrayLike, slide: Array, limits: tuple[float, float]
) -> Joint:
    parent, child = (link.name for link in links)
    turns: JointKind = "revolute" if np.isfinite(limits[0]) else "continuous"
    velocity, _, _, effort = _DYNAMICS[kind]
    axis = slide if kind == "P" else np.array([0.0, 0.0, 1.0])
    return Joint(
        name,
        "prismatic" if kind == "P" else turns,
        parent,
        child,
        as_pose(origin),
        axis,
        *limits,
        velocity,
        effort,
        damping=0.1,
    )
