"""Assembly of a `Robot` from a URDF and an SRDF: planning joints, tool, limits, configurations."""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import DEGREES, FARTHEST, Array, check_text, items_of, known_name, shown
from rr1plan.errors import InputError
from rr1plan.robot import Joint, Robot
from rr1plan.robot.arm_finder import ArmFinder
from rr1plan.robot.contact_bands import joints_between
from rr1plan.robot.disabled_collisions import adjacent_pairs, rigid_pairs
from rr1plan.robot.joint_limits import WIDEST, Limits
from rr1plan.robot.link_masses import with_assumed_masses
from rr1plan.robot.self_contacts import self_contacts
from rr1plan.robot.srdf import Semantics, chain_joints
from rr1plan.robot.urdf import Tree
from rr1plan.shapes.mesh_files import WIDEST_MESH

log = logging.getLogger(__name__)

UNKNOWN_VELOCITY = {"revolute": 1.0, "continuous": 1.0, "prismatic": 0.25}
SECONDS_TO_VELOCITY = 0.25
SECONDS_TO_ACCELERATION = 0.1
_TOOL_NAMES = ("tool", "tool0", "tcp", "ee_link")
_RATES = ("velocity", "acceleration", "jerk")
_ROUNDING = 1e-3  # states in files may exceed the limits by this much [rad or m]
_SAME_LIMIT = 1e-9  # limits that differ by less are the same [rad or m]


@dataclass(frozen=True)
class Choice:
    """Options of a robot; None selects the default from the files.

    Args:
        groups: The groups to plan for, as one: names of SRDF groups, or chains as (base link, tip link).
        joints: The joints to plan for, in this order.
        tool: The link whose frame is used for goals.
    """

    groups: Sequence[str | Sequence[str]] | None = None
    joints: Sequence[str] | None = None
    tool: str | None = None


def assemble(tree: Tree, semantics: Semantics | None, choice: Choice) -> Robot:
    """A robot from its URDF and SRDF.

    Args:
        tree: The URDF.
        semantics: The SRDF, or None.
        choice: Options.

    Raises:
        UnknownNameError: no such group, joint or link.
        InputError: no joint to plan for, or one that cannot be planned for.
    """
    known, chosen = _chosen_groups(tree, semantics or Semantics(), choice.groups)
    if known.is_partial and len(known.groups) > 1 and choice.groups is None and choice.joints is None:
        first, *others = known.groups
        log.warning(
            "%s: group %r is planned for, not %s; option groups of load_robot takes several",
            tree.name,
            first,
            ", ".join(others),
        )
    groups, names = _planning_joints(tree, known, chosen, choice.joints)
    tree = _limited_by_followers(_without_endless_ranges(tree))
    joints = {joint.name: joint for joint in tree.joints}
    limits = urdf_limits([joints[n] for n in names])
    _check_ranges(tree, names, limits)
    locked = {
        j.name: float(np.clip(known.default_positions.get(j.name, 0.0), j.lower, j.upper))
        for j in tree.joints
        if j.kind != "fixed" and j.mimic is None and j.name not in names
    }
    states = _states(tree.name, known, groups, names)
    led = {joint.mimic.joint for joint in tree.joints if joint.mimic is not None}
    turning = np.array([joints[n].kind == "revolute" and n not in led for n in names])
    configurations = _configurations(tree.name, names, states, limits, turning)
    robot = Robot(
        name=tree.name,
        links=tree.links,
        joints=tree.joints,
        joint_names=names,
        limits=limits,
        configurations={"home": _middle(limits)} | configurations,
        locked_joints=locked,
        disabled_collisions=known.disabled | rigid_pairs(tree.joints),
        tool=_tool(tree, known, groups, names, choice.tool),
        locked_joint_states=_locked_states(known, locked),
        source=tree.source,
    )
    if not groups and choice.joints is None:
        robot = _with_arm_end(tree, robot, choice.tool)
    _warn_of_millimeters(robot)
    robot = with_assumed_masses(robot)
    keeps_home = "home" in states and np.array_equal(robot.home, states["home"])
    robot = _with_self_contacts(robot, bool(known.disabled) and not known.is_partial, keeps_home)
    if not any(link.collisions for link in robot.links):
        log.warning("%s: no link has a <collision>, so no collision will be found", robot.name)
    elif robot.unchecked_links:
        bare = ", ".join(robot.unchecked_links)
        log.warning("%s: links without a <collision>, never checked though they are visible: %s", robot.name, bare)
    return robot


def _with_arm_end(tree: Tree, robot: Robot, tool: str | None) -> Robot:
    """The robot with the end of an arm as its tool, unless another one is chosen.

    Logs that fingers, wheels or a second arm are planned for, and which chain omits them; or that none
    of the planning joints moves the tool.
    """
    finder = ArmFinder(tree)
    tip = tool or finder.named_tool(robot.base) or finder.hand(robot.base)
    if not finder.arm_joints(tip):  # a hand
        tip = robot.tool
    arm = finder.arm_joints(tip) or chain_joints(tree.joints, robot.base, tip)
    while len(finder.moving.intersection(chain_joints(tree.joints, robot.base, tip))) > len(arm):
        tip = finder.above[tip].parent  # above the fingers
    robot = replace(robot, tool=tool or tip)
    others = [name for name in robot.joint_names if name not in arm]
    if len(others) == len(robot.joint_names):
        log.warning("%s: no planning joint is on the way to the tool %r", robot.name, robot.tool)
    elif others:
        left_out = repr(others[0]) + (f" and {len(others) - 1} more" if len(others) > 1 else "")
        log.warning(
            "%s: all %d joints are planned for, to the tool %r; groups=[(%r, %r)] leaves out %s",
            robot.name, len(robot.joint_names), robot.tool, robot.base, tip, left_out,
        )  # fmt: skip
    return robot


def _warn_of_millimeters(robot: Robot) -> None:
    """Log that a robot reaches so far that the lengths of its file seem to be in millimeters."""
    reach = {link.name: 0.0 for link in robot.bodies[0]}
    for joint in robot.joints:
        if joint.child not in reach:
            slides = joint.kind == "prismatic" and joint.name in robot.joint_names
            travel = max(-joint.lower, joint.upper) if slides else 0.0
            reach[joint.child] = reach[joint.parent] + float(np.linalg.norm(joint.origin[:3, 3])) + travel
    farthest = max(reach.values())
    if farthest > WIDEST_MESH:
        text = "%s: its joints reach %.4g m from the base; if its file is in millimeters, multiply all lengths by 0.001"
        log.warning(text, robot.name, farthest)


def _with_self_contacts(robot: Robot, has_rules: bool, keeps_home: bool) -> Robot:
    """The robot with its unchecked pairs of links, and a home configuration without self-collision."""
    found = self_contacts(robot, has_rules, keeps_home)
    always, at_home = (
        _listed(found.always - adjacent_pairs(robot.joints) - robot.disabled_collisions),
        _listed(found.at_home),
    )
    if always and has_rules:
        log.warning("%s: touching wherever it is, not checked though the SRDF asks for it: %s", robot.name, always)
    elif always:
        log.info("%s: always touching, not checked: %s", robot.name, always)
    never = robot.disabled_collisions | found.always
    if at_home and (has_rules or keeps_home):
        advice = _contact_advice(robot, found.at_home)
        log.warning("%s: links touch each other at home: %s; %s", robot.name, at_home, advice)
    elif at_home:
        # As in MoveIt's setup assistant; otherwise no configuration of the robot would be free.
        log.warning("%s: touching at home and nearly everywhere, not checked: %s", robot.name, at_home)
        never |= found.at_home
    return replace(robot, disabled_collisions=never, configurations={**robot.configurations, "home": found.home})


def _contact_advice(robot: Robot, pairs: Collection[frozenset[str]]) -> str:
    """How to avoid contacts of pairs of links at home."""
    stuck = [pair for pair in pairs if not joints_between(robot, pair)]
    if not stuck:
        return "start elsewhere"
    which = "them" if len(stuck) == len(pairs) else _listed(stuck)
    states = ", ".join(map(repr, robot.locked_joint_states)) or "no states are named"
    return f"no planned joint separates {which}: set the locked joints, robot.with_locked_joints ({states})"


def _listed(pairs: Iterable[frozenset[str]]) -> str:
    return ", ".join(sorted(" - ".join(sorted(pair)) for pair in pairs))


def _without_endless_ranges(tree: Tree) -> Tree:
    """The tree with revolute joints whose limits no configuration can reach as continuous joints.

    SDF, and URDFs converted from it, write limits of ±1e16 for a joint without limits.
    """
    joints = []
    for joint in tree.joints:
        is_endless = joint.kind == "revolute" and joint.lower <= -FARTHEST and joint.upper >= FARTHEST
        if is_endless:
            text = "%s: joint %r has limits %g to %g rad, it is taken as continuous: without limits"
            log.warning(text, tree.name, joint.name, joint.lower, joint.upper)
            joint = replace(joint, kind="continuous", lower=-np.inf, upper=np.inf)
        elif joint.kind == "revolute" and max(-joint.lower, joint.upper) > WIDEST:
            text = "%s: joint %r has limits %g to %g rad %s"
            log.warning(text, tree.name, joint.name, joint.lower, joint.upper, DEGREES)
        joints.append(joint)
    return replace(tree, joints=tuple(joints))


def _check_ranges(tree: Tree, names: Sequence[str], limits: Limits) -> None:
    """Reject a planning joint with a limit that no configuration can reach; planners sample the whole range."""
    for name, lower, upper, travel in zip(names, limits.lower, limits.upper, limits.travel, strict=True):
        if FARTHEST < travel < np.inf:
            raise InputError(
                f"{tree.source}: joint {name!r} has limits {lower:g} to {upper:g}, expected at most ±{FARTHEST:g}; "
                "give it limits, or load the robot with joints= or groups= that leave it out"
            )


def _limited_by_followers(tree: Tree) -> Tree:
    """The tree with tighter limits of joints that others mimic, so that these keep their own limits."""
    given = {joint.name: joint for joint in tree.joints}
    limited = dict(given)
    for follower in tree.joints:
        leader, gain, offset = follower, 1.0, 0.0
        while leader.mimic is not None:
            gain, offset = gain * leader.mimic.multiplier, offset + gain * leader.mimic.offset
            leader = given[leader.mimic.joint]
        if leader is follower or gain == 0.0:
            continue
        low, high = sorted(((follower.lower - offset) / gain, (follower.upper - offset) / gain))
        before = limited[leader.name]
        joint = replace(before, **{n: min(getattr(before, n), getattr(follower, n) / abs(gain)) for n in _RATES})
        if low > before.lower + _SAME_LIMIT or high < before.upper - _SAME_LIMIT:
            joint = replace(joint, lower=max(low, before.lower), upper=min(high, before.upper))
        if not joint.lower < joint.upper:
            log.warning("%s: joint %r follows %r beyond its limits", tree.name, follower.name, leader.name)
            continue
        if joint.kind == "continuous" and (np.isfinite(joint.upper - joint.lower) or not gain.is_integer()):
            # Not equivalent after a turn.
            turns = max(joint.lower, -2.0 * np.pi), min(joint.upper, 2.0 * np.pi)
            joint = replace(joint, kind="revolute", lower=turns[0], upper=turns[1])
        if any(getattr(joint, n) != getattr(before, n) for n in ("lower", "upper", *_RATES)):
            limited[leader.name] = joint
            log.warning("%s: joint %r is limited by %r, which follows it", tree.name, leader.name, follower.name)
    return replace(tree, joints=tuple(limited.values()))


def urdf_limits(joints: Sequence[Joint]) -> Limits:
    """The limits of joints, with conservative defaults for unknown ones.

    A missing velocity limit becomes 1 rad/s (0.25 m/s); a missing acceleration limit reaches the velocity in 0.25 s, a
    missing jerk limit reaches the acceleration in 0.1 s.
    """
    velocity = np.array([j.velocity if np.isfinite(j.velocity) else UNKNOWN_VELOCITY[j.kind] for j in joints])
    acceleration = _known([j.acceleration for j in joints], velocity / SECONDS_TO_VELOCITY)
    return Limits(
        lower=np.array([j.lower for j in joints]),
        upper=np.array([j.upper for j in joints]),
        velocity=velocity,
        acceleration=acceleration,
        jerk=_known([j.jerk for j in joints], acceleration / SECONDS_TO_ACCELERATION),
        effort=np.array([j.effort for j in joints]),
    )


def warn_of_unknown_velocities(robot: Robot, joints: Iterable[str]) -> None:
    """Log the joints among some for which the robot's file has no velocity limit."""
    unknown = [name for name in joints if not np.isfinite(robot.joint(name).velocity)]
    if unknown:
        text = (
            "no velocity limit for %s: 1 rad/s (0.25 m/s) is taken; set others by robot.with_limits, or in a scene "
            "file by limits = { velocity = [...] } of the arm"
        )
        log.warning(text, ", ".join(unknown))


def _known(values: Sequence[float], default: Array) -> Array:
    """The values, those of `default` for infinite ones, shape (n,)."""
    return np.where(np.isfinite(values), values, default)


def _chosen_groups(
    tree: Tree, known: Semantics, wanted: Sequence[str | Sequence[str]] | None
) -> tuple[Semantics, tuple[str, ...]]:
    """The semantics with the chosen chains added as groups, and the names of the chosen groups."""
    entries = () if wanted is None else items_of("groups", wanted, "groups")
    chains: dict[str, tuple[str, str]] = {}
    names: list[str] = []
    for entry in entries:
        if isinstance(entry, str):
            names.append(known_name("group", entry, known.groups))
        else:
            base, tip = _chain_ends(tree, entry)
            names.append(f"{base} to {tip}")
            chains[names[-1]] = base, tip
    if wanted is not None:
        _check_distinct("groups", names)
    members = {name: chain_joints(tree.joints, *ends) for name, ends in chains.items()}
    return replace(known, groups={**known.groups, **members}, chains={**known.chains, **chains}), tuple(names)


def _chain_ends(tree: Tree, entry: Any) -> tuple[str, str]:
    ends = items_of("one of groups", entry, "names of two links")
    if len(ends) != 2:
        raise InputError(f"one of groups is {shown(entry)}, expected a name or two: (base link, tip link)")
    links = [link.name for link in tree.links]
    base, tip = known_name("link", ends[0], links), known_name("link", ends[1], links)
    chain = chain_joints(tree.joints, base, tip)
    if chain and not any(joint.child == tip for joint in tree.joints if joint.name in chain):
        raise InputError(
            f"one of groups is ({base!r}, {tip!r}), but no joint below {base!r} moves {tip!r}; expected "
            "(base link, tip link)"
        )
    return base, tip


def _planning_joints(
    tree: Tree, known: Semantics, groups: tuple[str, ...], chosen: Sequence[str] | None
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The planning groups, if any, and the planning joints."""
    joints = {joint.name: joint for joint in tree.joints}
    if chosen is not None:
        names = items_of("joints", chosen, "names")
        for name in names:
            check_text("one of joints", name)
            if not _is_driven(joints[known_name("joint", name, joints)]):
                raise InputError(f"joint {name!r} is fixed or mimics another, it cannot be planned for")
        _check_distinct("joints", names)
        return groups, tuple(names)
    movable = tuple(n for n, j in joints.items() if _is_driven(j) and n not in known.passive)
    groups = groups or _default_groups(tree, known)
    # Groups may share joints, such as a torso that carries both arms.
    names = tuple(dict.fromkeys(n for g in groups for n in known.groups[g] if n in movable)) if groups else movable
    if not names:
        where = f" in group {' or '.join(map(repr, groups))}" if groups else ""
        raise InputError(
            f"{tree.source}: there is no joint to plan for{where}, expected at least one with a range; joints that are "
            "fixed, have two equal limits, mimic another one, or are passive in the SRDF are not planned for"
        )
    return groups, names


def _is_driven(joint: Joint) -> bool:
    return joint.kind != "fixed" and joint.mimic is None


def _check_distinct(what: str, names: Sequence[str]) -> None:
    if not names or len(set(names)) != len(names):
        raise InputError(f"{what} is {shown(list(names))}, expected at least one name and none twice")


def _default_groups(tree: Tree, known: Semantics) -> tuple[str, ...]:
    """The arm with an end effector, else the first group with joints that is not a gripper."""
    carriers = [e.parent_group for e in known.end_effectors if e.parent_group not in (None, e.group)]
    grippers = {e.group for e in known.end_effectors if _is_below(tree, known.groups[e.group], e.parent_link)}
    others = [name for name in known.groups if name not in grippers]
    return tuple(name for name in (*carriers, *others) if name and known.groups[name])[:1]


def _is_below(tree: Tree, names: Sequence[str], link: str) -> bool:
    """Whether all these joints are descendants of a link, like those of a gripper."""
    links = {link}
    for joint in tree.joints:
        if joint.parent in links:
            links.add(joint.child)
    return all(joint.parent in links for joint in tree.joints if joint.name in names)


def _states(name: str, known: Semantics, groups: tuple[str, ...], names: tuple[str, ...]) -> dict[str, Array]:
    """The named states that define every planning joint, each (nq,): of one group, or of all chosen groups together."""
    own_first = sorted(known.states.items(), key=lambda item: item[0][0] not in groups)
    together: dict[str, dict[str, float]] = {}
    for (group, state), values in known.states.items():
        if group in groups:
            together[state] = {**together.get(state, {}), **values}
    for group, state in known.states:
        missing = [n for n in known.groups.get(group, ()) if n in names and n not in together.get(state, {})]
        if group in groups and missing:
            text = "%s: the state %r of group %r is left out, it has no value of %s"
            log.warning(text, name, state, group, ", ".join(missing))
    found: dict[str, Array] = {}
    for state, values in (*((state, values) for (_, state), values in own_first), *together.items()):
        if state not in found and set(names) <= set(values):
            found[state] = np.array([values[n] for n in names])
    return found


def _configurations(
    name: str, joints: tuple[str, ...], states: Mapping[str, Array], limits: Limits, turning: NDArray[np.bool_]
) -> dict[str, Array]:
    """The named states of all planning joints; "home" is within the limits, and may be a copy of another one.

    Values outside the limits by whole turns of turning joints, or by rounding errors, are moved into them.
    """
    found = dict(states)
    inside: dict[str, Array] = {}
    for state, q in states.items():
        turned = _turned_inside(q, limits, turning)
        nearest = np.clip(turned, limits.lower, limits.upper)
        is_inside = bool((np.abs(nearest - turned) <= _ROUNDING).all())
        if is_inside or state == "home":
            found[state] = nearest
        if is_inside:
            inside[state] = nearest
        out = np.flatnonzero((q < limits.lower - _ROUNDING) | (q > limits.upper + _ROUNDING))
        if len(out) == 0:
            continue
        which = ", ".join(f"{joints[j]} at {q[j]:.6g}, not {limits.lower[j]:.6g} to {limits.upper[j]:.6g}" for j in out)
        moved = "; it is moved by whole turns" if is_inside else "; it is moved to them" if state == "home" else ""
        hint = f" {DEGREES}" if (turning & (np.abs(q) > WIDEST)).any() else ""
        log.warning("%s: the state %r is outside the joints' limits (%s)%s%s", name, state, which, moved, hint)
    if inside and "home" not in found:
        found["home"] = inside.get("ready", next(iter(inside.values())))
    return found


def _turned_inside(q: Array, limits: Limits, turning: NDArray[np.bool_]) -> Array:
    """A configuration whose turning joints are moved by the fewest whole turns into their limits, where possible."""
    turn = 2.0 * np.pi
    fewest, most = np.ceil((limits.lower - _ROUNDING - q) / turn), np.floor((limits.upper + _ROUNDING - q) / turn)
    return q + turn * np.where(turning & (fewest <= most), np.clip(0.0, fewest, most), 0.0)


def _middle(limits: Limits) -> Array:
    """Zero if it is well inside a joint's range, else the middle of the range."""
    with np.errstate(invalid="ignore"):
        middle = 0.5 * (limits.lower + limits.upper)
    inside = (limits.lower < 0.0) & (limits.upper > 0.0)
    return np.where(inside, 0.0, middle)


def _locked_states(known: Semantics, locked: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """The named states of joints other than planning joints, e.g. of a gripper."""
    found: dict[str, dict[str, float]] = {}
    for (_, state), values in known.states.items():
        mine = {name: value for name, value in values.items() if name in locked}
        if mine:
            found.setdefault(state, {}).update(mine)
    return found


def _tool(tree: Tree, known: Semantics, groups: tuple[str, ...], names: tuple[str, ...], chosen: str | None) -> str:
    """The chosen link, the tip of the first group's chain, or the last link after its last joint.

    The links after a joint are those that are fixed to it or move by joints that mimic a planning joint.
    """
    moved = _followers(tree, names)
    links = [link.name for link in tree.links]
    if chosen is not None:
        return known_name("link", chosen, links)
    for group in groups[:1]:
        if group in known.chains:
            return known.chains[group][1]
        for effector in known.end_effectors:
            if group in (effector.parent_group, effector.group):
                return effector.parent_link
        names = tuple(n for n in names if n in known.groups[group]) or names
    for group, members in known.groups.items() if known.is_partial else ():
        if members[-1:] == names[-1:]:
            return known.chains[group][1]
    link = next(j.child for j in tree.joints if j.name == names[-1])
    while True:
        below = [j.child for j in tree.joints if j.parent == link and (j.kind == "fixed" or j.name in moved)]
        named = [name for name in _TOOL_NAMES if name in below]
        if not named and len(below) != 1:
            return link
        link = (named or below)[0]


def _followers(tree: Tree, names: Sequence[str]) -> set[str]:
    """Names of the joints that mimic one of the named joints, directly or through others."""
    mimics = {joint.name: joint.mimic.joint for joint in tree.joints if joint.mimic is not None}
    found: set[str] = set()
    for name in mimics:
        leader = name
        while leader in mimics:
            leader = mimics[leader]
        if leader in names:
            found.add(name)
    return found
