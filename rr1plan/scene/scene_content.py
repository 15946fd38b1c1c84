"""Content of a scene and queries of it: names, configurations, poses, contact rules."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np

from rr1plan.checks import (
    Array,
    Value,
    check_text,
    finite_array,
    items_of,
    known_name,
    number_from_zero,
    of_kind,
    shown,
)
from rr1plan.errors import InputError, UnknownNameError
from rr1plan.notebook_view import NotebookView
from rr1plan.robot import Robot
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene.contact_rules import ContactRules, RuleContent, rules_of
from rr1plan.scene.scene_elements import Arm, Attachment, Obstacle, Pair, pair
from rr1plan.shapes.content_digest import feed_digest

_NO_ARM = "the scene has no arm; add one: [arms.NAME] in a scene file, with_arm in Python"


@dataclass(frozen=True, eq=False)
class SceneContent(Value, NotebookView):
    """Content of a `Scene` and queries of it."""

    arms: Mapping[str, Arm] = field(default_factory=dict)
    obstacles: Mapping[str, Obstacle] = field(default_factory=dict)
    attachments: Mapping[str, Attachment] = field(default_factory=dict)
    allowed: frozenset[Pair] = frozenset()
    padding: float = 0.0
    pair_padding: Mapping[Pair, float] = field(default_factory=dict)
    name: str = "scene"
    description: str = ""

    def __post_init__(self) -> None:
        for name, kind in (("arms", Arm), ("obstacles", Obstacle), ("attachments", Attachment)):
            if isinstance(getattr(self, name), Robot):
                raise InputError(f"{name} is a robot, expected arms by name: try Scene().with_arm('arm', robot)")
            of_kind(name, getattr(self, name), Mapping)
            # A scene may have thousands of elements, and is checked anew with each one that is added.
            wrong = [value for value in getattr(self, name).values() if not isinstance(value, kind)]
            for value in wrong:
                of_kind(f"one of the {name}", value, kind)
        of_kind("pair_padding", self.pair_padding, Mapping)
        for name in ("arms", "obstacles", "attachments"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        object.__setattr__(self, "pair_padding", MappingProxyType(_checked_distances(self.pair_padding)))
        for name in ("name", "description"):
            check_text(f"{name} of the scene", getattr(self, name))
        pairs = items_of("allowed", self.allowed, "pairs of names")
        object.__setattr__(self, "allowed", frozenset(_checked_pair("allowed", both) for both in pairs))
        self._check_names()
        for value in (self.padding, *self.pair_padding.values()):
            number_from_zero("padding", value)

    def _check_names(self) -> None:
        names = [*self.arms, *self.obstacles, *self.attachments]
        wrong = [name for name in names if not (isinstance(name, str) and name and name.isprintable()) or "/" in name]
        if wrong:
            raise InputError(
                f"{shown(wrong[0])} cannot name an element of a scene: expected printable text without '/'"
            )
        if len(set(names)) != len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise InputError(f"the scene has two elements named {twice!r}")
        for held in self.attachments.values():
            for link in (held.link, *held.touch):
                self.arm(held.arm).robot.link(link)
        rules = (*self.allowed, *self.pair_padding)
        if rules:
            known = (*self.element_names, *self.arms)
            for name in sorted({name for both in rules for name in both}.difference(known)):
                known_name("element", name, known)

    def __repr__(self) -> str:
        parts = (("arms", self.arms), ("obstacles", self.obstacles), ("attachments", self.attachments))
        return ", ".join([f"Scene({self.name!r}", *(f"{n}=[{', '.join(names)}]" for n, names in parts if names)]) + ")"

    @cached_property
    def kept(self) -> dict[Any, Any]:
        """Cache of values computed from this scene; neither copied nor pickled."""
        return {}

    @cached_property
    def kept_for_any_padding(self) -> dict[object, object]:
        """Cache of values that do not depend on padding, shared by scenes that differ in padding only."""
        return {}

    @cached_property
    def element_names(self) -> tuple[str, ...]:
        """Elements with collision geometry: "arm/link" of links with a shape, obstacles, attached objects."""
        links = [f"{a}/{link}" for a, arm in self.arms.items() for link in arm.robot.solid_links]
        return (*links, *self.obstacles, *self.attachments)

    def arm(self, name: str) -> Arm:
        """An arm by name.

        Raises:
            UnknownNameError: no such arm.
        """
        if isinstance(name, str) and name in self.arms:
            return self.arms[name]
        columns = (column for column in self.joint_names() if isinstance(name, str) and column.endswith(f"/{name}"))
        column = next(columns, None)
        advice = "" if column is None else f"In a scene a joint is named {column!r}; see scene.joint_names()."
        raise UnknownNameError("arm", name, self.arms, advice)

    def only_arm(self, name: str | None = None) -> str:
        """`name` if there is such an arm, or for None the name of the only arm.

        Raises:
            UnknownNameError: no such arm.
            InputError: None, and there is not exactly one arm.
        """
        if name is not None:
            self.arm(name)
            return name
        if not self.arms:
            raise InputError(_NO_ARM)
        if len(self.arms) != 1:
            raise InputError(
                f"the scene has {len(self.arms)} arms ({', '.join(self.arms)}); say which one with option arm"
            )
        return next(iter(self.arms))

    def arm_names(self, arms: str | Sequence[str] | None = None) -> tuple[str, ...]:
        """The named arms, or the one of that name, in the order of the scene; all of them for None.

        Raises:
            UnknownNameError: no such arm.
            InputError: not a sequence of names, an empty one, or a duplicate.
        """
        if arms is None:
            return tuple(self.arms)
        if isinstance(arms, str):
            arms = (arms,)
        if not isinstance(arms, (tuple, Sequence)):  # tuples are found faster
            raise InputError(f"arms is {shown(arms)}, expected a sequence of names")
        for name in arms:
            self.arm(name)
        if not self.arms:
            raise InputError(_NO_ARM)
        chosen = frozenset(arms)
        if not arms or len(chosen) != len(arms):
            raise InputError(f"arms is {shown(tuple(arms))}, expected distinct names, at least one")
        return tuple([name for name in self.arms if name in chosen])

    def joint_names(self, arms: Sequence[str] | None = None) -> tuple[str, ...]:
        """Column names "arm/joint" of those arms, in order."""
        return tuple(f"{a}/{j}" for a in self.arm_names(arms) for j in self.arms[a].robot.joint_names)

    def limits(self, arms: Sequence[str] | None = None) -> Limits:
        """Limits of those arms' planning joints, in order."""
        return Limits.stack([self.arms[a].robot.limits for a in self.arm_names(arms)])

    def configuration(self, arms: Sequence[str] | None = None) -> Array:
        """The concatenated configurations of the named arms, shape (nq,)."""
        return np.concatenate([np.zeros(0), *(self.arms[a].q for a in self.arm_names(arms))])

    def split(self, q: Array, arms: Sequence[str] | None = None) -> dict[str, Array]:
        """The configuration of every arm by name: parts of q (nq,) for the named arms, the scene's for the others.

        Raises:
            UnknownNameError: no such arm.
            InputError: q of another shape, or not finite.
        """
        configurations = {name: arm.q for name, arm in self.arms.items()}
        start, names = 0, self.arm_names(arms)
        q = finite_array("q", q, (sum(self.arms[name].robot.nq for name in names),))
        for name in names:
            nq = self.arms[name].robot.nq
            configurations[name] = q[start : start + nq]
            start += nq
        return configurations

    def link_poses(self, configurations: Mapping[str, Array] | None = None) -> dict[str, Array]:
        """T_world_link of every link, shape (4, 4), by "arm/link", by plain numpy.

        Args:
            configurations: Configuration of each arm [rad or m], shape (nq,) (default: the scene's).

        Raises:
            UnknownNameError: no such arm.
            InputError: not a mapping, a configuration of another shape, or not finite.
        """
        of_kind("configurations", configurations, Mapping, optional=True)
        for name in configurations or ():
            self.arm(name)
        poses = {}
        for name, arm in self.arms.items():
            q = arm.q if configurations is None else configurations.get(name, arm.q)
            for link, T in arm.robot.link_poses(q).items():
                poses[f"{name}/{link}"] = arm.base @ T
        return poses

    def may_touch(self, a: str, b: str) -> bool:
        """Whether contact between two elements is allowed or not checked, by rules of the scene and the robots.

        Args:
            a: An element: "arm/link", an obstacle or an attached object.
            b: Another one.

        Raises:
            UnknownNameError: no such element.
        """
        arm_a, arm_b = self._owner(a), self._owner(b)
        if arm_a is None and arm_b is None:
            return True
        if any(pair(x, y) in self.allowed for x in {a, arm_a} for y in {b, arm_b} if x and y and x != y):
            return True
        if arm_a is not None and arm_a == arm_b:
            return self._own_contact(arm_a, a, b)
        return self._is_mounting(a, b) or self._is_mounting(b, a)

    def _is_mounting(self, link: str, obstacle: str) -> bool:
        """Whether `link` is the base link of an arm, which does not move relative to an obstacle."""
        arm = self.owner(link)
        return arm is not None and obstacle in self.obstacles and link == f"{arm}/{self.arms[arm].robot.base}"

    def _own_contact(self, arm: str, a: str, b: str) -> bool:
        held_a, held_b = self.attachments.get(a), self.attachments.get(b)
        if held_a is not None and held_b is not None:
            return held_a.link == held_b.link
        if held_a is None and held_b is None:
            return frozenset((a.split("/", 1)[1], b.split("/", 1)[1])) in self.arms[arm].robot.disabled_collisions
        held, link = (held_a, b) if held_a is not None else (held_b, a)
        assert held is not None
        return link.split("/", 1)[1] in held.touch | {held.link}

    def owner(self, element: str) -> str | None:
        """The arm an element moves with, or None for an obstacle."""
        if not isinstance(element, str):
            raise InputError(f"element is {shown(element)}, expected a name")
        if element in self.attachments:
            return self.attachments[element].arm
        return element.split("/", 1)[0] if "/" in element else None

    def _owner(self, element: str) -> str | None:
        """As `owner`, for names of elements only.

        Raises:
            UnknownNameError: no such element; a link without a shape counts as one.
        """
        arm = self.owner(element)
        if arm is None:
            known_name("element", element, self.obstacles)
        elif element not in self.attachments:
            self.arm(arm).robot.link(element.split("/", 1)[1])
        return arm

    def padding_of(self, a: str, b: str) -> float:
        """Distance to keep between two elements [m].

        A rule for the two elements precedes one for an element and the other's arm, which precedes one for both arms.
        If each element has a rule with the other's arm, the larger distance counts.

        Args:
            a: An element: "arm/link", an obstacle or an attached object.
            b: Another one.

        Raises:
            UnknownNameError: no such element.
        """
        arm_a, arm_b = self._owner(a), self._owner(b)
        for rank in (((a, b),), ((a, arm_b), (arm_a, b)), ((arm_a, arm_b),)):
            rules = [pair(x, y) for x, y in rank if x and y]
            found = [self.pair_padding[both] for both in rules if both in self.pair_padding]
            if found:
                return max(found)
        return self.padding

    @cached_property
    def checked_pairs(self) -> tuple[tuple[str, str], ...]:
        """All pairs of elements that must not touch, in a fixed order (never two obstacles)."""
        names = self.element_names
        return tuple((names[i], names[j]) for i, j in self.contact_rules.checked.tolist())

    @cached_property
    def contact_rules(self) -> ContactRules:
        """The pairs of elements that must not touch, shared by scenes with equal rules."""
        robots = ((name, arm.robot) for name, arm in self.arms.items())
        content = RuleContent(
            tuple(
                (name, robot.base, robot.solid_links, frozenset(robot.disabled_collisions)) for name, robot in robots
            ),
            tuple(self.obstacles),
            tuple((name, thing.arm, thing.link, frozenset(thing.touch)) for name, thing in self.attachments.items()),
            self.allowed,
        )
        return rules_of(content)

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 of everything that affects plans: robots, poses, configurations, obstacles, rules (hex)."""
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


def largest_padding(scene: SceneContent) -> float:
    """The largest distance to keep between two elements of a scene [m]."""
    return max((scene.padding, *scene.pair_padding.values()))


def _checked_pair(rules: str, both: Any) -> Pair:
    """A pair of names, from a set, a list or a tuple of them; one name for a pair of elements of one arm.

    Args:
        rules: The argument that contains the pair.
        both: The pair.

    Raises:
        InputError: not one or two names.
    """
    names = items_of(f"one of {rules}", both, "names")
    for name in names:
        check_text(f"a name in {rules}", name)
    if len(names) not in (1, 2):
        raise InputError(f"one of {rules} is {shown(both)}, expected the names of two elements or arms")
    return frozenset(names)


def _checked_distances(distances: Mapping[Any, float]) -> dict[Pair, float]:
    """Paddings by pair of names.

    Raises:
        InputError: a key that is not a pair of names, or two keys for one pair.
    """
    checked: dict[Pair, float] = {}
    for key, distance in distances.items():
        both = _checked_pair("pair_padding", key)
        if both in checked:
            raise InputError(
                f"pair_padding has two distances for {' and '.join(map(repr, sorted(both)))}: "
                f"{checked[both]} and {distance}; keep one"
            )
        checked[both] = distance
    return checked
