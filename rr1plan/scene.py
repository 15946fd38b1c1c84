"""A scene: placed arms, obstacles, what the arms hold, and what may touch what. Immutable.

Names. An arm's link is "arm/link", an obstacle or an attached object is its own name (no
slash). A pair that may touch is a pair of such names; a whole arm's name stands for all its links.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, Value, finite_number, known_name, read_only
from rr1plan.contact_rules import ContactRules, RuleContent, rules_of
from rr1plan.errors import InputError
from rr1plan.limits import Limits
from rr1plan.robot import Color, Geometry, Robot, feed_digest
from rr1plan.shapes import HalfSpace, PointCloud, Shape
from rr1plan.transforms import as_pose, identity, inverse

Pair = frozenset[str]


@dataclass(frozen=True, eq=False)
class Arm(Value):
    """A robot at a place, in a posture.

    Args:
        robot: The robot.
        base: T_world_base, shape (4, 4).
        q: Where its planning joints are [rad or m], shape (nq,) (default: home).
    """

    robot: Robot
    base: Array = field(default_factory=identity)
    q: Any = "home"

    def __post_init__(self) -> None:
        if not isinstance(self.robot, Robot):
            raise InputError(f"robot is {self.robot!r}, expected a Robot; load one with load_robot")
        object.__setattr__(self, "base", as_pose(self.base, "arm base"))
        object.__setattr__(self, "q", self.robot.configuration(self.q, "arm posture"))


@dataclass(frozen=True, eq=False)
class Obstacle(Value):
    """A rigid object in the world, of one shape or several.

    Args:
        geometries: Its shapes, posed in the object's frame.
        pose: T_world_object, shape (4, 4).
    """

    geometries: tuple[Geometry, ...]
    pose: Array = field(default_factory=identity)

    def __post_init__(self) -> None:
        object.__setattr__(self, "geometries", _geometries(self.geometries))
        object.__setattr__(self, "pose", as_pose(self.pose, "obstacle pose"))
        if not self.geometries:
            raise InputError("an obstacle has at least one shape, got none")


def _geometries(values: Any) -> tuple[Geometry, ...]:
    """Posed shapes.

    Raises:
        InputError: something else.
    """
    geometries = tuple(values) if isinstance(values, Iterable) else (values,)
    for one in geometries:
        if not isinstance(one, Geometry):
            raise InputError(f"got {one!r} as an object's shape, expected a shape, or Geometry values")
    return geometries


@dataclass(frozen=True, eq=False)
class Attachment(Value):
    """An object that moves with a link.

    Args:
        geometries: Its shapes, posed in the object's frame.
        arm: The arm that holds it.
        link: The link it is fixed to.
        pose: T_link_object, shape (4, 4).
        touch: Links of that arm it may touch (always its own link).
    """

    geometries: tuple[Geometry, ...]
    arm: str
    link: str
    pose: Array
    touch: frozenset[str] = frozenset()


def pair(a: str, b: str) -> Pair:
    """The unordered pair of two element names."""
    return frozenset((a, b))


@dataclass(frozen=True, eq=False)
class Scene(Value):
    """Arms by name, obstacles by name, attached objects by name, allowed contacts, padding.

    Args:
        arms: Placed robots; the order is the order of the columns of q.
        obstacles: Objects of the world.
        attachments: Objects held by an arm.
        allowed: Pairs that may touch (element names, or arm names for all links of an arm).
        padding: Extra distance to keep between every checked pair [m].
        pair_padding: Other distances for some pairs [m]; by element names or arm names.
        name: Name of the scene.
        description: What it is for, in a sentence.
    """

    arms: Mapping[str, Arm] = field(default_factory=dict)
    obstacles: Mapping[str, Obstacle] = field(default_factory=dict)
    attachments: Mapping[str, Attachment] = field(default_factory=dict)
    allowed: frozenset[Pair] = frozenset()
    padding: float = 0.0
    pair_padding: Mapping[Pair, float] = field(default_factory=dict)
    name: str = "scene"
    description: str = ""

    def __post_init__(self) -> None:
        for name in ("arms", "obstacles", "attachments", "pair_padding"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        object.__setattr__(self, "allowed", frozenset(self.allowed))
        self._check_names()
        for value in (self.padding, *self.pair_padding.values()):
            if finite_number("padding", value) < 0.0:
                raise InputError(f"padding is {value}, expected a distance >= 0")

    def _check_names(self) -> None:
        names = [*self.arms, *self.obstacles, *self.attachments]
        for name in names:
            if not isinstance(name, str) or not name.isprintable() or not name or "/" in name:
                raise InputError(f"{name!r} cannot name an element of a scene: expected printable text without '/'")
        if len(set(names)) != len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise InputError(f"the scene has two elements named {twice!r}")
        for held in self.attachments.values():
            self.arm(held.arm).robot.link(held.link)
        for both in (*self.allowed, *self.pair_padding):
            for name in both:
                known_name("element", name, (*self.element_names, *self.arms))

    def __repr__(self) -> str:
        parts = (("arms", self.arms), ("obstacles", self.obstacles), ("attachments", self.attachments))
        return ", ".join([f"Scene({self.name!r}", *(f"{n}=[{', '.join(names)}]" for n, names in parts if names)]) + ")"

    # ---- reading -----------------------------------------------------------------------

    @cached_property
    def kept(self) -> dict[Any, Any]:
        """What others have built from this scene and may use again; neither copied nor pickled with it."""
        return {}

    @cached_property
    def kept_for_any_padding(self) -> dict[Any, Any]:
        """The same of what does not depend on padding: scenes that differ in padding alone may share it."""
        return {}

    @cached_property
    def element_names(self) -> tuple[str, ...]:
        """Every element that can touch another: "arm/link" of links with a shape, obstacles, attached objects."""
        links = [f"{a}/{link.name}" for a, arm in self.arms.items() for link in arm.robot.links if link.collisions]
        return (*links, *self.obstacles, *self.attachments)

    def arm(self, name: str) -> Arm:
        """An arm by name.

        Raises:
            UnknownNameError: there is no such arm.
        """
        return self.arms[known_name("arm", name, self.arms)]

    def arm_names(self, arms: Sequence[str] | None = None) -> tuple[str, ...]:
        """The named arms in the order of the scene; all of them for None.

        Raises:
            UnknownNameError: there is no such arm.
            InputError: no sequence of names, none, or one of them twice.
        """
        if arms is None:
            return tuple(self.arms)
        if isinstance(arms, str) or not isinstance(arms, Sequence):
            raise InputError(f"arms is {arms!r}, expected a sequence of names")
        for name in arms:
            self.arm(name)
        if not arms or len(set(arms)) != len(arms):
            raise InputError(f"arms is {tuple(arms)}, expected distinct names, at least one")
        return tuple(name for name in self.arms if name in arms)

    def joint_names(self, arms: Sequence[str] | None = None) -> tuple[str, ...]:
        """Column names "arm/joint" of those arms, in order."""
        return tuple(f"{a}/{j}" for a in self.arm_names(arms) for j in self.arms[a].robot.joint_names)

    def limits(self, arms: Sequence[str] | None = None) -> Limits:
        """Limits of those arms' planning joints, in order."""
        return Limits.stack([self.arms[a].robot.limits for a in self.arm_names(arms)])

    def configuration(self, arms: Sequence[str] | None = None) -> Array:
        """The postures of those arms, one after the other, shape (nq,)."""
        return np.concatenate([self.arms[a].q for a in self.arm_names(arms)])

    def split(self, q: Array, arms: Sequence[str] | None = None) -> dict[str, Array]:
        """Posture of every arm of the scene, with q (nq,) for the named ones and the scene's for the rest."""
        postures = {name: arm.q for name, arm in self.arms.items()}
        start = 0
        for name in self.arm_names(arms):
            nq = self.arms[name].robot.nq
            postures[name] = np.asarray(q[start : start + nq], dtype=np.float64)
            start += nq
        return postures

    def link_poses(self, postures: Mapping[str, Array] | None = None) -> dict[str, Array]:
        """T_world_link of every link as "arm/link", by plain numpy; `postures` by arm (default: the scene's)."""
        poses = {}
        for name, arm in self.arms.items():
            q = arm.q if postures is None else postures.get(name, arm.q)
            for link, T in arm.robot.link_poses(q).items():
                poses[f"{name}/{link}"] = arm.base @ T
        return poses

    def may_touch(self, a: str, b: str) -> bool:
        """Whether contact between two elements is allowed or meaningless (the same arm's own rules included)."""
        arm_a, arm_b = self.owner(a), self.owner(b)
        if arm_a is None and arm_b is None:
            return True
        if any(pair(x, y) in self.allowed for x in {a, arm_a} for y in {b, arm_b} if x and y and x != y):
            return True
        if arm_a is not None and arm_a == arm_b:
            return self._own_contact(arm_a, a, b)
        return self._is_mounting(a, b) or self._is_mounting(b, a)

    def _is_mounting(self, link: str, obstacle: str) -> bool:
        """The base link of an arm against the world: neither of them moves."""
        arm = self.owner(link)
        return arm is not None and obstacle in self.obstacles and link == f"{arm}/{self.arms[arm].robot.base}"

    def _own_contact(self, arm: str, a: str, b: str) -> bool:
        held_a, held_b = self.attachments.get(a), self.attachments.get(b)
        if held_a is not None and held_b is not None:
            return held_a.link == held_b.link
        if held_a is None and held_b is None:
            return frozenset((a.split("/", 1)[1], b.split("/", 1)[1])) in self.arms[arm].robot.never_collide
        held, link = (held_a, b) if held_a is not None else (held_b, a)
        assert held is not None
        return link.split("/", 1)[1] in held.touch | {held.link}

    def owner(self, element: str) -> str | None:
        """The arm an element moves with, or None for an obstacle."""
        if element in self.attachments:
            return self.attachments[element].arm
        return element.split("/", 1)[0] if "/" in element else None

    def padding_of(self, a: str, b: str) -> float:
        """Distance to keep between two elements [m]."""
        arm_a, arm_b = self.owner(a), self.owner(b)
        for x, y in ((a, b), (a, arm_b), (arm_a, b), (arm_a, arm_b)):
            if x and y and pair(x, y) in self.pair_padding:
                return self.pair_padding[pair(x, y)]
        return self.padding

    @cached_property
    def checked_pairs(self) -> tuple[tuple[str, str], ...]:
        """All pairs of elements that must not touch, in a fixed order (obstacle against obstacle is never one)."""
        names = self.element_names
        return tuple((names[i], names[j]) for i, j in self.checked_index.tolist())

    @cached_property
    def checked_index(self) -> NDArray[np.int64]:
        """Indices in `element_names` of the `checked_pairs`, shape (m, 2)."""
        return self.contact_rules.checked

    @cached_property
    def checked_padding(self) -> Array:
        """Distance to keep between each of the `checked_pairs` [m], shape (m,)."""
        return read_only(self.contact_rules.paddings(self.padding, self.pair_padding))

    @cached_property
    def contact_rules(self) -> ContactRules:
        """Which pairs of elements must not touch; scenes that agree in that share it."""
        names, held = self.element_names, self.attachments.items()
        content = RuleContent(
            names,
            tuple(self.owner(name) for name in names),
            tuple((name, arm.robot.base, frozenset(arm.robot.never_collide)) for name, arm in self.arms.items()),
            tuple((name, thing.arm, thing.link, frozenset(thing.touch)) for name, thing in held),
            self.allowed,
        )
        return rules_of(content)

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 of everything that plans depend on: robots, places, postures, obstacles, rules (hex)."""
        digest = hashlib.sha256()
        for name, arm in self.arms.items():
            feed_digest(digest, (name, arm.robot.content_hash, arm.base, arm.q))
        for name, obstacle in sorted(self.obstacles.items()):
            feed_digest(digest, (name, obstacle.pose, [(g.pose, g.shape) for g in obstacle.geometries]))
        for name, held in sorted(self.attachments.items()):
            feed_digest(digest, (name, held.arm, held.link, sorted(held.touch), held.pose))
            feed_digest(digest, [(g.pose, g.shape) for g in held.geometries])
        feed_digest(digest, sorted(sorted(p) for p in self.allowed))
        feed_digest(digest, (float(self.padding), sorted((sorted(p), float(d)) for p, d in self.pair_padding.items())))
        return digest.hexdigest()

    # ---- other scenes like this one -----------------------------------------------------

    def with_arm(self, name: str, robot: Robot, base: Any = None, q: Any = "home") -> Scene:
        """A scene with one more arm (or another one of that name)."""
        return replace(self, arms={**self.arms, name: Arm(robot, as_pose(base, "base"), q)})

    def without_arm(self, name: str) -> Scene:
        """A scene without that arm and what it holds."""
        self.arm(name)
        gone = {n for n, held in self.attachments.items() if held.arm == name}
        return self._keep(
            arms={n: a for n, a in self.arms.items() if n != name},
            attachments={n: h for n, h in self.attachments.items() if n not in gone},
        )

    def with_posture(self, name: str, q: Any) -> Scene:
        """A scene in which that arm stands at q: a name or numbers (nq,)."""
        return replace(self, arms={**self.arms, name: replace(self.arm(name), q=q)})

    def with_robot(self, name: str, robot: Robot) -> Scene:
        """A scene in which that arm is another copy of its robot (other limits, other gripper)."""
        return replace(self, arms={**self.arms, name: replace(self.arm(name), robot=robot)})

    def with_obstacle(
        self, name: str, shape: Shape | Iterable[Geometry], pose: Any = None, color: Color | None = None
    ) -> Scene:
        """A scene with one more obstacle (or another one of that name).

        Args:
            name: Its name, without "/".
            shape: A shape, or several posed ones.
            pose: T_world_object: (4, 4), or a position (3,) [m].
            color: Its colour (rgba, 0..1).
        """
        if isinstance(shape, Shape):
            shape = (Geometry(name, shape, identity(), color),)
        return replace(self, obstacles={**self.obstacles, name: Obstacle(_geometries(shape), as_pose(pose))})

    def without_obstacle(self, name: str) -> Scene:
        """A scene without that obstacle."""
        known_name("obstacle", name, self.obstacles)
        return self._keep(obstacles={n: o for n, o in self.obstacles.items() if n != name})

    def allow(self, a: str, b: str) -> Scene:
        """A scene in which two elements (or all links of an arm, by the arm's name) may touch."""
        if a == b:
            raise InputError(f"allow got {a!r} twice, expected two elements; an arm's own pairs are its robot's")
        return replace(self, allowed=self.allowed | {pair(a, b)})

    def with_padding(self, distance: float, a: str | None = None, b: str | None = None) -> Scene:
        """A scene that keeps `distance` [m] between every pair, or between a and b only."""
        if (a is None) != (b is None):
            raise InputError("with_padding takes a distance, or a distance and two names")
        if a is None or b is None:
            return self._padded(distance, self.pair_padding)
        return self._padded(self.padding, {**self.pair_padding, pair(a, b): distance})

    def with_margin(self, distance: float) -> Scene:
        """A scene that keeps `distance` [m] more between every pair than this one."""
        distance = finite_number("margin", distance)
        return self._padded(self.padding + distance, {both: d + distance for both, d in self.pair_padding.items()})

    def _padded(self, padding: float, pair_padding: Mapping[Pair, float]) -> Scene:
        other = replace(self, padding=padding, pair_padding=pair_padding)
        for name in ("kept_for_any_padding", "element_names", "contact_rules"):
            other.__dict__[name] = getattr(self, name)
        return other

    def attach(
        self,
        obstacle: str,
        arm: str | None = None,
        link: str | None = None,
        touch: Iterable[str] = (),
        pose: Any = None,
    ) -> Scene:
        """A scene in which an arm holds what was an obstacle.

        Args:
            obstacle: Name of the obstacle; it keeps the name as an attached object.
            arm: The arm that holds it (default: the only one).
            link: The link it is fixed to (default: the robot's tool).
            touch: Links of that arm it may touch besides, e.g. the fingers.
            pose: T_link_object; default: where it is now, the arm standing in its posture.

        Raises:
            UnknownNameError: no such obstacle, arm or link.
            InputError: a half-space or a point cloud, which cannot be carried.
        """
        thing = self.obstacles[known_name("obstacle", obstacle, self.obstacles)]
        if any(isinstance(g.shape, HalfSpace | PointCloud) for g in thing.geometries):
            raise InputError(f"obstacle {obstacle!r} holds a half-space or a point cloud, which an arm cannot carry")
        arm = self.only_arm(arm)
        robot = self.arm(arm).robot
        link = robot.link(robot.tool if link is None else link).name
        touch = frozenset(robot.link(name).name for name in touch)
        where = inverse(self.link_poses()[f"{arm}/{link}"]) @ thing.pose if pose is None else pose
        T = as_pose(where, "pose of the held object")
        held = Attachment(thing.geometries, arm, link, T, touch)
        rest = {n: o for n, o in self.obstacles.items() if n != obstacle}
        return replace(self, obstacles=rest, attachments={**self.attachments, obstacle: held})

    def detach(self, name: str) -> Scene:
        """A scene in which a held object is an obstacle again, where the arm's posture has it."""
        held = self.attachments[known_name("attached object", name, self.attachments)]
        T = self.link_poses()[f"{held.arm}/{held.link}"] @ held.pose
        rest = {n: a for n, a in self.attachments.items() if n != name}
        return replace(self, attachments=rest, obstacles={**self.obstacles, name: Obstacle(held.geometries, T)})

    def only_arm(self, name: str | None = None) -> str:
        """`name` if there is such an arm, or for None the name of the only arm.

        Raises:
            UnknownNameError: no such arm.
            InputError: None, and there is not exactly one arm.
        """
        if name is not None:
            self.arm(name)
            return name
        if len(self.arms) != 1:
            raise InputError(f"the scene has {len(self.arms)} arms ({', '.join(self.arms)}); say which one")
        return next(iter(self.arms))

    def _keep(self, **changes: Any) -> Scene:
        """`replace`, dropping rules about elements that are gone."""
        bare = replace(self, allowed=frozenset(), pair_padding={}, **changes)
        names = {*bare.element_names, *bare.arms}
        return replace(
            bare,
            allowed=frozenset(p for p in self.allowed if p <= names),
            pair_padding={p: d for p, d in self.pair_padding.items() if p <= names},
        )
