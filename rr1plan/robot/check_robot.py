"""Validation of robots that were not read from a URDF, by the rules of the URDF reader."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np

from rr1plan.checks import HEAVIEST, finite_array, known_name, near_array, number_from_zero
from rr1plan.errors import InputError
from rr1plan.robot.robot import Robot
from rr1plan.robot.robot_parts import Inertial, Joint
from rr1plan.transforms import as_pose

_ROUNDING = 1e-6


def check_robot(robot: Robot) -> Robot:
    """Return the robot if its links form a tree and its names and numbers are consistent.

    Raises:
        InputError: an inconsistency; the message names it.
        UnknownNameError: a name that no link or joint of the robot has.
    """
    _distinct("link", robot.link_names)
    _distinct("joint", [joint.name for joint in robot.joints])
    _check_tree(robot)
    for joint in robot.joints:
        _check_joint(joint)
        _check_mimic(robot, joint)
    for link in robot.links:
        if link.inertial is not None:
            check_inertial(link.name, link.inertial)
    _check_driven_joints(robot)
    for name in (name for both in robot.disabled_collisions for name in both):
        known_name("link", name, robot.link_names)
    _check_named_values(robot)
    return robot


def _check_named_values(robot: Robot) -> None:
    """Require that presets, locked joints and configurations refer to the robot's joints."""
    for name, limits in robot.presets.items():
        if len(limits) != robot.nq:
            raise InputError(f"preset {name!r} has limits for {len(limits)} of {robot.nq} joints")
    for name, value in (
        item for values in (robot.locked_joints, *robot.locked_joint_states.values()) for item in values.items()
    ):
        near_array(f"locked joint {known_name('locked joint', name, robot.locked_joints)!r}", value, ())
    for name, q in robot.configurations.items():
        near_array(f"configuration {name!r}", q, (robot.nq,))


def _distinct(kind: str, names: Iterable[str]) -> None:
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise InputError(f"the robot has two {kind}s named {twice[0]!r}")


def _check_tree(robot: Robot) -> None:
    """Require that each joint connects a known link to a new one, and that links are listed in that order."""
    order = [robot.links[0].name]
    for joint in robot.joints:
        if joint.parent not in order:
            raise InputError(f"joint {joint.name!r} hangs on {joint.parent!r}, which no joint before it moves")
        if joint.child in order:
            raise InputError(f"joint {joint.name!r} moves {joint.child!r}, which is the base or moved by another joint")
        order.append(joint.child)
    if order != list(robot.link_names):
        odd = next((a for a, b in zip(robot.link_names, order, strict=False) if a != b), robot.link_names[-1])
        raise InputError(f"link {odd!r} is not where the joints have it: expected the links {', '.join(order)}")


def _check_joint(joint: Joint) -> None:
    name = f"joint {joint.name!r}"
    as_pose(joint.origin, f"origin of {name}")
    axis = finite_array(f"axis of {name}", joint.axis, (3,))
    if abs(float(np.linalg.norm(axis)) - 1.0) > _ROUNDING:
        raise InputError(f"axis of {name} is {axis.tolist()}, expected a unit vector")
    rates = (joint.velocity, joint.acceleration, joint.jerk, joint.effort)
    if not (joint.lower <= joint.upper and all(rate > 0.0 for rate in rates)):
        raise InputError(f"{name} has limits that leave it no motion: {joint.lower}, {joint.upper}, {rates}")
    if joint.kind in ("revolute", "prismatic"):
        finite_array(f"position limits of {name}", [joint.lower, joint.upper], (2,))
    for quantity in ("damping", "friction"):
        number_from_zero(f"{quantity} of {name}", getattr(joint, quantity))


def _check_mimic(robot: Robot, joint: Joint) -> None:
    """Require that a chain of mimic joints ends at an independent joint."""
    seen = [joint.name]
    while joint.mimic is not None:
        near_array(f"mimic of joint {joint.name!r}", [joint.mimic.multiplier, joint.mimic.offset], (2,))
        joint = robot.joint(joint.mimic.joint)
        if joint.name in seen:
            raise InputError(f"joints mimic each other in a circle: {', '.join([*seen, joint.name])}")
        if joint.kind == "fixed":
            raise InputError(f"joint {seen[-1]!r} mimics {joint.name!r}, which is fixed")
        seen.append(joint.name)


def check_inertial(link: str, inertial: Inertial) -> None:
    """Require the mass, center and inertia of a body that can exist.

    Raises:
        InputError: one of them is impossible; the message names the link.
    """
    near_array(f"center of mass of link {link!r}", inertial.com, (3,))
    inertia = finite_array(f"inertia of link {link!r}", inertial.inertia, (3, 3))
    mass = float(finite_array(f"mass of link {link!r}", inertial.mass, ()))
    size = float(np.abs(inertia).max())
    if mass <= 0.0 or max(mass, size) > HEAVIEST:
        raise InputError(f"link {link!r} has mass {mass:.3g} and an inertia up to {size:.3g}, which no body has")
    if np.abs(inertia - inertia.T).max() > _ROUNDING * size or (size and np.linalg.eigvalsh(inertia)[0] <= 0.0):
        raise InputError(f"inertia of link {link!r} is {inertia.tolist()}, expected zero or positive definite")


def _check_driven_joints(robot: Robot) -> None:
    """Require that every independent joint is either a planning joint or locked, and no other is."""
    driven = [joint.name for joint in robot.joints if joint.kind != "fixed" and joint.mimic is None]
    _distinct("planning joint", robot.joint_names)
    for name in (*robot.joint_names, *robot.locked_joints):
        known_name("independent joint", name, driven)
    both = set(robot.joint_names) & set(robot.locked_joints)
    neither = set(driven) - set(robot.joint_names) - set(robot.locked_joints)
    for names, fault in ((both, "both planned for and locked"), (neither, "neither planned for nor locked")):
        if names:
            raise InputError(f"joint {sorted(names)[0]!r} is {fault}")
