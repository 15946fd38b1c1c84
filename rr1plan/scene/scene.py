"""Scenes and modified copies of them. Immutable."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

from numpy.typing import ArrayLike

from rr1plan.checks import check_text, finite_number, items_of, known_name, of_kind
from rr1plan.errors import InputError
from rr1plan.robot import Geometry, Robot
from rr1plan.scene.scene_content import SceneContent
from rr1plan.scene.scene_elements import Arm, Attachment, Obstacle, Pair, moved_arm, pair, unchecked
from rr1plan.shapes import HalfSpace, PointCloud, Shape
from rr1plan.transforms import as_pose, identity, inverse


@dataclass(frozen=True, eq=False, repr=False)
class Scene(SceneContent):
    """Arms by name, obstacles by name, attached objects by name, allowed contacts, padding.

    Args:
        arms: Placed robots; the order is the order of the columns of q.
        obstacles: Objects of the world.
        attachments: Objects held by an arm.
        allowed: Pairs that may touch (element names, or arm names for all links of an arm).
        padding: Extra distance to keep between every checked pair [m].
        pair_padding: Padding of particular pairs [m]; by element names or arm names.
        name: Name of the scene.
        description: Description in a sentence.
    """

    def with_arm(self, name: str, robot: Robot, base: ArrayLike | None = None, *, q: str | ArrayLike = "home") -> Scene:
        """A scene with one more arm (or another one of that name).

        Args:
            name: Its name, without "/".
            robot: The robot.
            base: T_world_base: (4, 4), or a position (3,) [m] (default: the origin of the world).
            q: Its configuration: a name, or numbers [rad or m], shape (nq,).

        Raises:
            UnknownNameError: no configuration of that name.
            InputError: a name that is in use or invalid, not a robot, not a pose, or numbers that do not fit the robot.
        """
        check_text("name", name)
        return replace(self, arms={**self.arms, name: Arm(robot, as_pose(base, "base"), q)})

    def without_arm(self, name: str) -> Scene:
        """A scene without that arm and its attached objects.

        Args:
            name: The arm.

        Raises:
            UnknownNameError: no such arm.
        """
        self.arm(name)
        return with_fewer(
            self,
            arms={n: a for n, a in self.arms.items() if n != name},
            attachments={n: held for n, held in self.attachments.items() if held.arm != name},
        )

    def with_configuration(self, name: str, q: str | ArrayLike) -> Scene:
        """A scene with that arm at q: a configuration's name or numbers [rad or m], shape (nq,).

        Raises:
            UnknownNameError: no such arm or configuration.
            InputError: numbers that do not fit the arm.
        """
        return replace(self, arms={**self.arms, name: moved_arm(self.arm(name), q)})

    def with_robot(self, name: str, robot: Robot) -> Scene:
        """A scene with another robot for that arm (e.g. other limits or gripper), in the same configuration.

        Args:
            name: The arm.
            robot: Its new robot.

        Raises:
            UnknownNameError: no such arm.
            InputError: not a robot, or one with another number of joints.
        """
        return replace(self, arms={**self.arms, name: replace(self.arm(name), robot=robot)})

    def with_obstacle(
        self,
        name: str,
        shape: Shape | Iterable[Geometry],
        pose: ArrayLike | None = None,
        *,
        color: str | ArrayLike | None = None,
        mass: float | None = None,
        friction: float = 1.0,
    ) -> Scene:
        """A scene with one more obstacle (or another one of that name).

        Args:
            name: Its name, without "/".
            shape: A shape, or several posed ones.
            pose: T_world_object: (4, 4), or a position (3,) [m].
            color: Its color: "#rrggbb", "#rrggbbaa", rgb or rgba (0..1).
            mass: Mass of a loose body [kg]; None: fixed.
            friction: Coulomb friction coefficient of a loose body.

        Raises:
            InputError: as `Obstacle`.
        """
        check_text("name", name)
        if isinstance(shape, Shape):
            shape = (Geometry(name, shape, identity(), color),)
        return self.with_obstacles({name: Obstacle(shape, as_pose(pose), mass, friction)})

    def with_obstacles(self, obstacles: Mapping[str, Obstacle]) -> Scene:
        """A scene with more obstacles by name (or others of those names), such as those of `stack_bodies`.

        Raises:
            InputError: not a mapping from names to obstacles.
        """
        of_kind("obstacles", obstacles, Mapping)
        return replace(self, obstacles={**self.obstacles, **obstacles})

    def with_obstacle_at(self, name: str, pose: ArrayLike) -> Scene:
        """A scene in which that obstacle has another pose.

        Args:
            name: The obstacle.
            pose: T_world_object: (4, 4), or a position (3,) [m].

        Raises:
            UnknownNameError: no such obstacle.
            InputError: not a pose.
        """
        thing = self.obstacles[known_name("obstacle", name, self.obstacles)]
        other = self.with_obstacles({name: replace(thing, pose=as_pose(pose))})
        for kept in ("element_names", "contact_rules"):
            other.__dict__[kept] = getattr(self, kept)
        return other

    def without_obstacle(self, name: str) -> Scene:
        """A scene without that obstacle.

        Args:
            name: The obstacle.

        Raises:
            UnknownNameError: no such obstacle.
        """
        known_name("obstacle", name, self.obstacles)
        return with_fewer(self, obstacles={n: o for n, o in self.obstacles.items() if n != name})

    def allow(self, a: str, b: str) -> Scene:
        """A scene in which two elements may touch.

        Args:
            a: An element ("arm/link", an obstacle or an attached object), or an arm for all its links.
            b: Another one.

        Raises:
            UnknownNameError: no such element or arm.
            InputError: the same name twice.
        """
        check_text("a", a)
        check_text("b", b)
        if a == b:
            raise InputError(f"allow got {a!r} twice, expected two elements; an arm's own pairs are its robot's")
        return replace(self, allowed=self.allowed | {pair(a, b)})

    def with_padding(self, distance: float, a: str | None = None, b: str | None = None) -> Scene:
        """A scene that keeps another distance between the elements of every pair, or of one pair.

        Args:
            distance: The distance, zero or more [m].
            a: An element or an arm (default: the distance is that of every pair without a padding set by names).
            b: Another one; the same arm again stands for the pairs of that arm.

        Raises:
            UnknownNameError: no such element or arm.
            InputError: a negative distance, one name only, or the same element twice.
        """
        if (a is None) != (b is None):
            raise InputError("with_padding takes a distance, or a distance and two names")
        for one in (a, b):
            if one is not None:
                check_text("element", one)
        if a is None or b is None:
            return self._padded(distance, self.pair_padding)
        if a == b and a not in self.arms:
            raise InputError(f"with_padding got the element {a!r} twice, expected two elements, or an arm twice")
        return self._padded(self.padding, {**self.pair_padding, pair(a, b): distance})

    def with_margin(self, distance: float) -> Scene:
        """A scene that keeps `distance` [m] more between the elements of every pair than this one.

        Raises:
            InputError: not finite, or a padding that would become negative.
        """
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
        *,
        touch: Iterable[str] = (),
        pose: ArrayLike | None = None,
    ) -> Scene:
        """A scene in which an obstacle is attached to a link.

        Args:
            obstacle: Name of the obstacle, and of the attached object.
            arm: The arm (default: the only one).
            link: The link (default: the robot's tool).
            touch: Other links of that arm that it may touch, e.g. the fingers.
            pose: T_link_object: (4, 4), or a position (3,) [m] (default: its current pose relative to the link in the
                arm's configuration).

        Raises:
            UnknownNameError: no such obstacle, arm or link.
            InputError: a half-space or a point cloud, which cannot be attached.
        """
        thing = self.obstacles[known_name("obstacle", obstacle, self.obstacles)]
        if any(isinstance(g.shape, HalfSpace | PointCloud) for g in thing.geometries):
            raise InputError(f"obstacle {obstacle!r} holds a half-space or a point cloud, which an arm cannot carry")
        arm = self.only_arm(arm)
        robot = self.arm(arm).robot
        link = robot.link(robot.tool if link is None else link).name
        touch = frozenset(robot.link(name).name for name in items_of("touch", touch, "links"))
        where = inverse(self.link_poses()[f"{arm}/{link}"]) @ thing.pose if pose is None else pose
        T = as_pose(where, "pose of the held object")
        held = Attachment(thing.geometries, arm, link, T, touch, thing.mass, thing.friction)
        rest = {n: o for n, o in self.obstacles.items() if n != obstacle}
        return replace(self, obstacles=rest, attachments={**self.attachments, obstacle: held})

    def detach(self, name: str) -> Scene:
        """A scene in which an attached object is an obstacle at its pose in the arm's configuration.

        Args:
            name: The object.

        Raises:
            UnknownNameError: no such attached object.
        """
        held = self.attachments[known_name("attached object", name, self.attachments)]
        T = self.link_poses()[f"{held.arm}/{held.link}"] @ held.pose
        rest = {n: a for n, a in self.attachments.items() if n != name}
        thing = Obstacle(held.geometries, T, held.mass, held.friction)
        return replace(self, attachments=rest, obstacles={**self.obstacles, name: thing})


def with_fewer(scene: Scene, **parts: Any) -> Scene:
    """A scene with fewer arms, obstacles or attached objects, without the rules about those removed.

    Args:
        scene: The scene.
        **parts: `arms`, `obstacles` or `attachments`, by name; the others are kept.
    """
    kept = {name: getattr(scene, name) for name in scene.__dataclass_fields__}
    # All its parts were checked with the scene.
    fewer = unchecked(type(scene), **kept | {name: MappingProxyType(dict(part)) for name, part in parts.items()})
    if not scene.allowed and not scene.pair_padding:
        return fewer
    names = {*fewer.element_names, *fewer.arms}
    return replace(
        fewer,
        allowed=frozenset(both for both in scene.allowed if both <= names),
        pair_padding={both: distance for both, distance in scene.pair_padding.items() if both <= names},
    )
