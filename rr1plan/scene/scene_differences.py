"""Messages about the differences between two scenes that affect motions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from rr1plan.checks import Array, counted, millimeters, of_kind
from rr1plan.errors import InputError
from rr1plan.object_cache import kept_in
from rr1plan.robot import Geometry, Joint, Link, Robot
from rr1plan.robot.joint_limits import LIMIT_NAMES, Limits
from rr1plan.scene.scene import Scene
from rr1plan.scene.scene_elements import Arm, Attachment, Obstacle, Pair
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere
from rr1plan.shapes.content_digest import value_hash
from rr1plan.transforms import rotation_angle

_T = TypeVar("_T")
# Differences in a message.
_MOST_CHANGES = 3


def scene_differences(before: Scene, after: Scene) -> tuple[str, ...]:
    """Differences between two scenes that affect motions or their simulation, one sentence each.

    Tools, masses and friction are compared, too, which hashes do not contain: a tool affects goals of its arm, not
    motions that are already planned; masses and friction affect simulations, those of held objects also torques.

    Args:
        before: The scene in which a motion was planned.
        after: Another scene.

    Raises:
        InputError: an argument is not a scene.
    """
    of_kind("before", before, Scene)
    of_kind("after", after, Scene)
    if before.content_hash == after.content_hash and _outside_hash(before) == _outside_hash(after):
        return ()
    found = [
        *_by_name("arm", before.arms, after.arms, _arm),
        *_by_name("obstacle", before.obstacles, after.obstacles, _obstacle),
        *_by_name("held object", before.attachments, after.attachments, _attachment),
        *_rules(before, after),
    ]
    if list(before.arms) != list(after.arms) and set(before.arms) == set(after.arms):
        found.append(f"the arms are in another order: {', '.join(after.arms)}")
    return tuple(found)


def _outside_hash(scene: Scene) -> dict[str, object]:
    """Tools of arms, and masses and friction of objects, by name."""
    things: dict[str, Obstacle | Attachment] = {**scene.obstacles, **scene.attachments}
    weights = {name: (thing.mass, thing.friction) for name, thing in things.items()}
    return {**weights, **{name: arm.robot.tool for name, arm in scene.arms.items()}}


def check_same_scene(what: str, own: Scene, scene: Scene, arms: Sequence[str], advice: str) -> None:
    """Require that something made for one scene is used in that scene, or one with equal content.

    Args:
        what: What was made for a scene, for messages.
        own: The scene it was made for.
        scene: The scene it is used in.
        arms: Arms whose configurations do not matter, because they move.
        advice: What to do instead, for messages.

    Raises:
        InputError: the scenes differ; the message says in what.
    """
    # Identity first: the first hash of a scene takes a millisecond, shorten a tenth of one.
    if own is scene:
        return
    one, two = _at_home(own, arms), _at_home(scene, arms)
    if one.content_hash != two.content_hash:
        changes = ", ".join(scene_differences(one, two)[:_MOST_CHANGES])
        raise InputError(
            f"{what} is for another scene, {own.name!r}, than the given {scene.name!r}, with these differences: "
            f"{changes}; {advice}"
        )


def _at_home(scene: Scene, arms: Sequence[str]) -> Scene:
    """The scene with those of the arms that it has at home."""

    def move() -> Scene:
        home = scene
        for name in arms:
            if name in scene.arms:
                home = home.with_configuration(name, scene.arms[name].robot.home)
        return home

    return kept_in(scene.kept, ("with arms at home", tuple(arms)), move)


def _by_name(kind: str, before: Mapping[str, _T], after: Mapping[str, _T], compare: Any) -> Iterator[str]:
    for name in (n for n in before if n not in after):
        yield f"{kind} {name!r} is gone"
    for name in after:
        if name not in before:
            yield f"{kind} {name!r} is new"
        else:
            yield from (f"{kind} {name!r} {change}" for change in compare(before[name], after[name]))


def _arm(before: Arm, after: Arm) -> Iterator[str]:
    yield from _moved(before.base, after.base)
    one, two = before.robot, after.robot
    if one.content_hash != two.content_hash:
        yield from _robot(one, two)
    if one.tool != two.tool:
        yield f"has the tool {two.tool!r}, not {one.tool!r}"
    if one.joint_names == two.joint_names and not np.array_equal(before.q, after.q):
        change = after.q - before.q
        largest = int(np.argmax(np.abs(change)))
        name = one.joint_names[largest]
        unit = one.joint(name).unit
        yield f"stands elsewhere: {name} by {change[largest]:.4g} {unit}"


def _obstacle(before: Obstacle, after: Obstacle) -> Iterator[str]:
    yield from _moved(before.pose, after.pose)
    yield from _shapes(before.geometries, after.geometries)
    yield from _weight(before, after)


def _attachment(before: Attachment, after: Attachment) -> Iterator[str]:
    if (before.arm, before.link) != (after.arm, after.link):
        yield f"is held by {after.arm}/{after.link}, not {before.arm}/{before.link}"
    yield from _moved(before.pose, after.pose)
    yield from _shapes(before.geometries, after.geometries)
    if before.touch != after.touch:
        now, then = (", ".join(sorted(held.touch)) or "no link" for held in (after, before))
        yield f"may touch {now}, not {then}"
    yield from _weight(before, after)


def _weight(before: Obstacle | Attachment, after: Obstacle | Attachment) -> Iterator[str]:
    if before.mass != after.mass:
        now = "no mass" if after.mass is None else f"a mass of {after.mass:.6g} kg"
        yield f"has {now}, {'had none' if before.mass is None else f'was {before.mass:.6g} kg'}"
    if before.friction != after.friction:
        yield f"has a friction of {after.friction:.6g}, was {before.friction:.6g}"


def _moved(before: Array, after: Array) -> Iterator[str]:
    if np.array_equal(before, after):
        return
    distance = float(np.linalg.norm(after[:3, 3] - before[:3, 3]))
    angle = rotation_angle(before[:3, :3].T @ after[:3, :3])
    parts = [f"moved by {millimeters(distance, 4)}"] if distance > 0.0 else []
    parts += [f"turned by {angle:.4g} rad"] if angle > 0.0 else []
    yield " and ".join(parts) or "moved by less than can be measured"


def _shapes(before: tuple[Geometry, ...], after: tuple[Geometry, ...]) -> Iterator[str]:
    """Differences in the shapes of an object, ignoring names and colors."""
    if _content(before) == _content(after):
        return
    if len(before) != len(after):
        yield f"has {counted(len(after), 'shape')}, was {len(before)}"
        return
    for one, two in zip(before, after, strict=True):
        new, old = _described(two.shape), _described(one.shape)
        if new != old:
            yield f"has a {new}, was a {old}"
        elif _content((one,)) != _content((two,)):
            yield f"has another {new}" if np.array_equal(one.pose, two.pose) else f"has its {new} elsewhere"


def _described(shape: Shape) -> str:
    match shape:
        case Box(size):
            return f"box of {' x '.join(f'{edge:.6g}' for edge in size)} m"
        case Sphere(radius):
            return f"sphere of radius {radius:.6g} m"
        case Cylinder(radius, length) | Capsule(radius, length):
            return f"{type(shape).__name__.lower()} of radius {radius:.6g} m and length {length:.6g} m"
        case HalfSpace(normal, offset):
            return f"half-space with normal {normal} and offset {offset:.6g} m"
        case PointCloud():
            return f"cloud of {counted(len(shape.points), 'point')}"
        case Mesh():
            return f"mesh of {counted(len(shape.faces), 'triangle')}"


def _content(geometries: tuple[Geometry, ...]) -> str:
    return value_hash([(g.pose, g.shape) for g in geometries])


def _robot(before: Robot, after: Robot) -> Iterator[str]:
    if before.name != after.name:
        yield f"is a {after.name!r}, not a {before.name!r}"
    if before.joint_names != after.joint_names:
        yield f"plans for the joints {', '.join(after.joint_names)}, not {', '.join(before.joint_names)}"
    else:
        yield from _limits(before.joint_names, before.limits, after.limits)
    for name in sorted({*before.locked_joints, *after.locked_joints}):
        if before.locked_joints.get(name) != after.locked_joints.get(name):
            yield f"holds {name!r} at {after.locked_joints.get(name)}, not {before.locked_joints.get(name)}"
    yield from _parts("link", {x.name: x for x in before.links}, {x.name: x for x in after.links})
    yield from _parts("joint", {x.name: x for x in before.joints}, {x.name: x for x in after.joints})
    yield from _pairs("never checks", before.disabled_collisions, after.disabled_collisions)


def _limits(names: tuple[str, ...], before: Limits, after: Limits) -> Iterator[str]:
    for kind in LIMIT_NAMES:
        old, new = getattr(before, kind), getattr(after, kind)
        changed = [f"{n} {b:.6g} (was {a:.6g})" for n, a, b in zip(names, old, new, strict=True) if a != b]
        if changed:
            yield f"has other {kind} limits: {', '.join(changed)}"


def _parts(kind: str, before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[str]:
    """Links or joints that are missing, new, or differ in content that the robot's hash covers."""
    for name in (n for n in before if n not in after):
        yield f"has no {kind} {name!r} any more"
    for name in after:
        if name not in before:
            yield f"has a new {kind} {name!r}"
        elif _part_content(before[name]) != _part_content(after[name]):
            yield f"has another {kind} {name!r}"


def _part_content(part: Link | Joint) -> str:
    skipped = ("visuals", "collisions", "inertial")
    values = [getattr(part, name) for name in part.__dataclass_fields__ if name not in skipped]
    if isinstance(part, Link):
        own = part.inertial
        values += [() if own is None else (own.mass, own.com, own.inertia)]
        values += [(g.name, g.pose, g.shape) for g in part.collisions]
    return value_hash(values)


def _rules(before: Scene, after: Scene) -> Iterator[str]:
    if before.padding != after.padding:
        yield f"the padding is {millimeters(after.padding, 4)}, was {millimeters(before.padding, 4)}"
    yield from _pairs("contact is allowed between", before.allowed, after.allowed)
    for both in sorted({*before.pair_padding, *after.pair_padding}, key=sorted):
        old, new = (scene.pair_padding.get(both, scene.padding) for scene in (before, after))
        if old != new or (both in before.pair_padding) != (both in after.pair_padding):
            yield f"the padding between {_listed(both)} is {millimeters(new, 4)}, was {millimeters(old, 4)}"


def _pairs(rule: str, before: frozenset[Pair], after: frozenset[Pair]) -> Iterator[str]:
    for both in sorted(after - before, key=sorted):
        yield f"{rule} {_listed(both)} now"
    for both in sorted(before - after, key=sorted):
        yield f"{rule} {_listed(both)} no more"


def _listed(both: Pair) -> str:
    return " and ".join(map(repr, sorted(both)))
