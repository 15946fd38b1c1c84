"""The bodies of a scene, the pairs that must stay separated, and bounds of their motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from rr1plan.checks import Array
from rr1plan.errors import InputError
from rr1plan.robot import Geometry
from rr1plan.scene import Scene
from rr1plan.shapes import HalfSpace, Shape
from slow_certificate.coal_distance import CoalDistance
from slow_certificate.link_frames import LinkFrames
from slow_certificate.polynomial_bounds import Index
from slow_certificate.scene_motion import SceneMotion
from slow_certificate.solids import HALF_SPACE, Solid, solid, support

_IDENTITY = np.eye(4)
# Rounding of the distances between axes and bodies computed here [m].
_REACH_ROUNDING = 1e-7


@dataclass(frozen=True, eq=False)
class ElementBodies:
    """The shapes of one element as solids in its link's frame, row by row.

    Args:
        solids: The solids.
        forms: `CONVEX`, `CONCAVE` (a cloud too) or `HALF_SPACE`, shape (b,).
        radius: Radii of their bounding balls [m], shape (b,).
        half: Half the edges of their bounding boxes [m], shape (b, 3).
        rotation, origin: Poses of their frames in the link's, shapes (b, 3, 3) and (b, 3).
        center: Centers of their bounding balls in the link's frame [m], shape (b, 3).
    """

    solids: tuple[Solid, ...]
    forms: Index
    radius: Array
    half: Array
    rotation: Array
    origin: Array
    center: Array

    @staticmethod
    def of(shapes: Sequence[Shape], poses: Array) -> ElementBodies:
        """The bodies of shapes at poses (b, 4, 4)."""
        solids = tuple(solid(shape) for shape in shapes)
        rotation, origin = poses[:, :3, :3], poses[:, :3, 3]
        centers = np.array([s.center for s in solids]).reshape(-1, 3)
        return ElementBodies(
            solids,
            np.array([s.form for s in solids], dtype=np.intp),
            np.array([s.radius for s in solids], dtype=np.float64),
            np.array([s.half for s in solids]).reshape(-1, 3),
            rotation,
            origin,
            np.einsum("bij,bj->bi", rotation, centers) + origin,
        )

    @staticmethod
    def joined(parts: Sequence[ElementBodies]) -> ElementBodies:
        """The rows of several elements, one after the other."""
        parts = parts or [_NO_BODIES]
        arrays = [np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(ElementBodies)[1:]]
        return ElementBodies(tuple(s for part in parts for s in part.solids), *arrays)


_NO_BODIES = ElementBodies.of((), np.zeros((0, 4, 4)))


def element_bodies(geometries: tuple[Geometry, ...], T: Array) -> ElementBodies:
    """The bodies of an element's geometries on its link, with T_link_element (4, 4)."""
    poses = np.array([T @ g.pose for g in geometries]).reshape(-1, 4, 4)
    return ElementBodies.of([g.shape for g in geometries], poses)


class Placed(NamedTuple):
    """Poses at n times: shapes' frames and the centers of their bounding spheres.

    Args:
        rotation: R_world_shape, shape (n, bodies, 3, 3).
        origin: Positions of the shapes' frames [m], shape (n, bodies, 3).
        center: Centers [m], shape (n, bodies, 3).
    """

    rotation: Array
    origin: Array
    center: Array


class Bodies:
    """The shapes of some pairs of elements as solids on their links, and the pairs of shapes to check.

    Args:
        scene: The scene.
        motion: The motion of at least the arms that the pairs are about.
        pairs: Names of the elements of each pair.

    Attributes:
        a, b: Bodies of each pair of shapes, shape (k,).
        pair: The pair of elements each pair of shapes belongs to, shape (k,).
        padding: Distance to keep, for each pair of elements [m].
        own: Whether both elements belong to one arm (links and attached objects), for each pair of elements.
        solids: The bodies.
        forms: Their forms, shape (b,).
        link: Number of the link of each body, shape (b,).
        local_rotation, local_origin, local_center: Pose of each shape's frame and center of its bounding ball
            in its link's frame, shapes (b, 3, 3), (b, 3), (b, 3).
        moved: 1 for the moving joints that carry each body, else 0, shape (b, joints).

    Raises:
        InputError: a half-space on a link that moves, or two half-spaces to keep apart.
    """

    def __init__(self, scene: Scene, motion: SceneMotion, pairs: Sequence[tuple[str, str]]) -> None:
        self.motion, self.pairs = motion, tuple(pairs)
        self.padding = np.array([scene.padding_of(a, b) for a, b in self.pairs], dtype=np.float64)
        self.own = np.array([scene.owner(a) == scene.owner(b) for a, b in self.pairs], dtype=np.bool_)
        self.calls = 0
        places: dict[str, int] = {}
        index = [[places.setdefault(name, len(places)) for name in pair] for pair in self.pairs]
        self._index = np.array(index, dtype=np.intp).reshape(-1, 2)
        elements = [self._element(scene, name) for name in places]
        counts = np.array([len(found.solids) for _, found in elements], dtype=np.intp)
        self._stack(elements, counts)
        self._pair_up(counts)
        self._classify()

    @cached_property
    def coal_distance(self) -> CoalDistance:
        """Coal's distances."""
        return CoalDistance()

    def _element(self, scene: Scene, name: str) -> tuple[int, ElementBodies]:
        """Number of the link that carries an element, and its bodies."""
        link, pose = name, _IDENTITY
        if name in scene.obstacles:
            link, pose, parts = "", scene.obstacles[name].pose, scene.obstacles[name].geometries
        elif name in scene.attachments:
            held = scene.attachments[name]
            link, pose, parts = f"{held.arm}/{held.link}", held.pose, held.geometries
        else:
            arm, part = name.split("/", 1)
            parts = scene.arms[arm].robot.link(part).collisions
        number, found = self.motion.links[link], element_bodies(parts, pose)
        if (found.forms == HALF_SPACE).any() and self.motion.movers[number].any():
            raise InputError(f"{name!r} moves and has a half-space for a shape; expected a bounded shape")
        return number, found

    def _stack(self, elements: list[tuple[int, ElementBodies]], counts: Index) -> None:
        """Arrays over all bodies."""
        rows = ElementBodies.joined([found for _, found in elements])
        self.solids, self.forms = rows.solids, rows.forms
        self.link = np.repeat(np.array([number for number, _ in elements], dtype=np.intp), counts)
        self.radius, self.half = rows.radius, rows.half
        self.local_rotation, self.local_origin, self.local_center = rows.rotation, rows.origin, rows.center
        self.moved = self.motion.movers[self.link].reshape(len(self.link), len(self.motion.column))
        # The joints that carry each body, padded to equal numbers with a joint without effect.
        depth = int(self.moved.sum(axis=1).max(initial=0.0))
        self._chain = np.argsort(-self.moved, axis=1, kind="stable")[:, :depth]
        self._in_chain = np.take_along_axis(self.moved, self._chain, 1)
        self._fixed: dict[int, Any] = {}

    def _pair_up(self, counts: Index) -> None:
        """All pairs of bodies of the two elements, for each pair of elements; a half-space comes second."""
        one, two = self._index.T
        first = np.cumsum(counts) - counts
        each = counts[one] * counts[two]
        self.pair = np.repeat(np.arange(len(each)), each)
        place = np.arange(len(self.pair)) - np.repeat(np.cumsum(each) - each, each)
        width = np.repeat(counts[two], each)
        a, b = first[one][self.pair] + place // width, first[two][self.pair] + place % width
        half_first = self.forms[a] == HALF_SPACE
        self.a, self.b = np.where(half_first, b, a), np.where(half_first, a, b)

    def _classify(self) -> None:
        self._kind_a, self._kind_b = self.forms[self.a], self.forms[self.b]
        both = np.flatnonzero(self._kind_a == HALF_SPACE)
        if len(both):
            names = self.pairs[int(self.pair[both[0]])]
            raise InputError(f"{names[0]!r} and {names[1]!r} are both half-spaces, which cannot be kept apart")
        # A joint that carries both bodies does not move them relative to each other.
        self._only_a = self._in_chain[self.a] * (1.0 - np.take_along_axis(self.moved[self.b], self._chain[self.a], 1))
        self._only_b = self._in_chain[self.b] * (1.0 - np.take_along_axis(self.moved[self.a], self._chain[self.b], 1))

    # ---- at n times ---------------------------------------------------------------------

    def place(self, frames: LinkFrames) -> Placed:
        """Poses of all bodies."""
        R = frames.rotation[:, self.link]
        rotation = R @ self.local_rotation
        origin = np.einsum("nbij,bj->nbi", R, self.local_origin) + frames.origin[:, self.link]
        center = np.einsum("nbij,bj->nbi", R, self.local_center) + frames.origin[:, self.link]
        return Placed(rotation, origin, center)

    def sweeps(self, frames: LinkFrames, placed: Placed, change: Array) -> Array:
        """Largest displacement of each body by each joint alone [m], shape (n, bodies, chain).

        The motion from one configuration to another is split into motions of one joint after the other,
        from the base outwards. While a joint turns, joints farther out are still as in
        `frames`, so the distance of a body from the axis is the one in `frames`.

        Args:
            frames: Poses at the configurations to start from.
            placed: Poses of the bodies there.
            change: Largest change of each moving joint [rad or m], shape (n, joints).
        """
        arm = placed.center[:, :, None] - frames.pivot[:, self._chain]
        along = np.einsum("nbji,nbji->nbj", arm, frames.axis[:, self._chain])
        across = np.sqrt(np.maximum(np.einsum("nbji,nbji->nbj", arm, arm) - along**2, 0.0))
        finite = np.where(np.isfinite(self.radius), self.radius, 0.0)
        moved = change[:, self._chain]
        # A chord is at most as long as the arc and the diameter.
        turned = np.minimum(moved, 2.0) * (across + finite[None, :, None] + _REACH_ROUNDING)
        return np.asarray(np.where(self.motion.slides[self._chain], moved, turned))

    def approach(self, sweeps: Array, node: Index, item: Index) -> Array:
        """Bound of the change of the distance of pair `item` around time `node` [m], each (k,)."""
        a = np.einsum("kj,kj->k", sweeps[node, self.a[item]], self._only_a[item])
        b = np.einsum("kj,kj->k", sweeps[node, self.b[item]], self._only_b[item])
        return np.asarray(a + b)

    def far_bound(self, placed: Placed, node: Index, item: Index) -> Array:
        """A cheap lower bound of the clearance of pair `item` at time `node` [m], each (k,)."""
        a, b = self.a[item], self.b[item]
        bounded = self._kind_b[item] != 3
        bound = np.empty(len(item))
        gap = placed.center[node, b] - placed.center[node, a]
        bound[bounded] = np.linalg.norm(gap[bounded], axis=1) - self.radius[a[bounded]] - self.radius[b[bounded]]
        plane = np.flatnonzero(~bounded)
        if len(plane):
            bound[plane] = self._above_plane(placed, node[plane], item[plane]) - self.radius[a[plane]]
        return np.asarray(bound - self.padding[self.pair[item]])

    def box_bound(self, placed: Placed, node: Index, item: Index) -> Array:
        """A tighter lower bound: one body's bounding sphere against the other's bounding box [m]."""
        a, b = self.a[item], self.b[item]
        gap = placed.center[node, b] - placed.center[node, a]
        near_a = np.einsum("kij,ki->kj", placed.rotation[node, a], gap)
        near_b = np.einsum("kij,ki->kj", placed.rotation[node, b], gap)
        from_a = np.linalg.norm(np.maximum(np.abs(near_a) - self.half[a], 0.0), axis=1)
        from_b = np.linalg.norm(np.maximum(np.abs(near_b) - self.half[b], 0.0), axis=1)
        # A center inside the other's box gives no bound of the depth.
        from_a = np.where(from_a > 0.0, from_a - self.radius[b], -np.inf)
        from_b = np.where(from_b > 0.0, from_b - self.radius[a], -np.inf)
        return np.asarray(np.maximum(from_a, from_b) - self.padding[self.pair[item]])

    def _above_plane(self, placed: Placed, node: Index, item: Index) -> Array:
        """Height of the center of body a above the half-space b [m], shape (k,)."""
        height = np.empty(len(item))
        for b in np.unique(self.b[item]):
            at = self.b[item] == b
            normal, offset = self._plane(placed, node[at], int(b))
            height[at] = np.einsum("ki,ki->k", placed.center[node[at], self.a[item[at]]], normal) - offset
        return height

    def _plane(self, placed: Placed, node: Index, b: int) -> tuple[Array, Array]:
        """Normals (k, 3) and offsets (k,) of half-space b in the world."""
        shape = self.solids[b].shape
        assert isinstance(shape, HalfSpace)
        normal = placed.rotation[node, b] @ np.array(shape.normal)
        return normal, shape.offset + np.einsum("ki,ki->k", normal, placed.origin[node, b])

    # ---- distances ------------------------------------------------------------------------

    def clearances(self, placed: Placed, node: Index, item: Index) -> tuple[Array, Array]:
        """Clearance [m] of pair `item` at time `node`, each (k,): distance minus padding; negative values are depths.

        Returns:
            The value found, and a proven lower bound of it.
        """
        value, proven = np.empty(len(item)), np.empty(len(item))
        self.calls += len(item)
        groups = np.where(self._kind_b[item] == 3, 3, np.maximum(self._kind_a[item], self._kind_b[item]))
        for kind, measure in ((1, self._convex), (2, self._compound), (3, self._over_plane)):
            at = np.flatnonzero(groups == kind)
            if len(at):
                value[at], proven[at] = measure(placed, node[at], item[at])
        padding = self.padding[self.pair[item]]
        return value - padding, proven - padding

    def _transforms(self, placed: Placed, node: Index, item: Index) -> list[tuple[int, Any, int, Any]]:
        import coal

        known: dict[tuple[int, int], Any] = {}
        out = []
        for n, i in zip(node.tolist(), item.tolist(), strict=True):
            both = []
            for body in (int(self.a[i]), int(self.b[i])):
                T = known.get((n, body)) or self._fixed.get(body)
                if T is None:
                    T = coal.Transform3s(placed.rotation[n, body], placed.origin[n, body])
                    if self.moved[body].any():
                        known[n, body] = T
                    else:
                        self._fixed[body] = T
                both += [body, T]
            out.append((both[0], both[1], both[2], both[3]))
        return out

    def _convex(self, placed: Placed, node: Index, item: Index) -> tuple[Array, Array]:
        value, normal = np.empty(len(item)), np.empty((len(item), 3))
        for k, (a, Ta, b, Tb) in enumerate(self._transforms(placed, node, item)):
            value[k], normal[k] = self.coal_distance.convex(self.solids[a], Ta, self.solids[b], Tb)
        length = np.linalg.norm(normal, axis=1)
        usable = np.isfinite(length) & (length > 0.5)
        normal[usable] /= length[usable, None]
        normal[~usable] = (0.0, 0.0, 1.0)
        proven = np.minimum(value, self._plane_gap(placed, node, item, normal))
        return value, np.where(value > 0.0, proven, value)

    def _plane_gap(self, placed: Placed, node: Index, item: Index, normal: Array) -> Array:
        """Gap between two bodies along a direction (k, 3) from a to b [m]: a bound of their distance."""
        a, b = self.a[item], self.b[item]
        apart = np.einsum("ki,ki->k", normal, placed.origin[node, b] - placed.origin[node, a])
        return np.asarray(apart - self._reach(placed, node, a, normal) - self._reach(placed, node, b, -normal))

    def _reach(self, placed: Placed, node: Index, body: Index, normal: Array) -> Array:
        """Support of each body along world directions (k, 3), from its frame's origin [m], shape (k,)."""
        local = np.einsum("kij,ki->kj", placed.rotation[node, body], normal)
        out = np.empty(len(body))
        for one in np.unique(body):
            at = body == one
            out[at] = support(self.solids[one], local[at])
        return out

    def _compound(self, placed: Placed, node: Index, item: Index) -> tuple[Array, Array]:
        both = [
            self.coal_distance.compound(self.solids[a], Ta, self.solids[b], Tb)
            for a, Ta, b, Tb in self._transforms(placed, node, item)
        ]
        value, proven = np.array(both).T
        return value, proven

    def _over_plane(self, placed: Placed, node: Index, item: Index) -> tuple[Array, Array]:
        value: Array = np.empty(len(item))
        for b in np.unique(self.b[item]):
            at = np.flatnonzero(self.b[item] == b)
            normal, offset = self._plane(placed, node[at], int(b))
            a = self.a[item[at]]
            height = np.einsum("ki,ki->k", placed.origin[node[at], a], normal) - offset
            value[at] = height - self._reach(placed, node[at], a, -normal)
        return value, value
