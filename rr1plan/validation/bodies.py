"""The bodies of a scene, the pairs of them that must stay apart, and bounds of how they move."""

from __future__ import annotations

from copy import copy
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from rr1plan.checks import Array
from rr1plan.errors import InputError
from rr1plan.robot import Geometry
from rr1plan.scene import Scene
from rr1plan.shapes import HalfSpace, Shape
from rr1plan.validation.meter import DistanceMeter
from rr1plan.validation.motion import Frames, SceneMotion
from rr1plan.validation.polynomials import Index
from rr1plan.validation.solids import Solid, solid, support

# Rounding of the distances between axes and bodies computed here [m].
_REACH_ROUNDING = 1e-7


class Placed(NamedTuple):
    """Poses at n times: shapes' frames and the centres of their bounding spheres.

    Args:
        rotation: R_world_shape, shape (n, bodies, 3, 3).
        origin: Positions of the shapes' frames [m], shape (n, bodies, 3).
        center: Centres [m], shape (n, bodies, 3).
    """

    rotation: Array
    origin: Array
    center: Array


class Bodies:
    """All shapes of a scene as solids on their links, and the pairs of shapes to check.

    Attributes:
        pairs: The checked pairs of elements, as names.
        a, b: Bodies of each pair of shapes, shape (k,).
        pair: The pair of elements each pair of shapes belongs to, shape (k,).
        padding: Distance to keep, for each pair of elements [m].
        own: Whether one arm owns both elements (its links, and what it holds), for each pair of elements.
        solids: The bodies.
        link: Number of the link of each body, shape (b,).
        local_rotation, local_origin, local_center: Pose of each shape's frame and centre of its bounding ball
            in its link's frame, shapes (b, 3, 3), (b, 3), (b, 3).
        moved: Which moving joints carry each body, shape (b, joints) of 0 and 1.

    Raises:
        InputError: a half-space on a link that moves, or two half-spaces to keep apart.
    """

    def __init__(self, scene: Scene, motion: SceneMotion) -> None:
        self.motion = motion
        self.pairs = scene.checked_pairs
        self.padding = scene.checked_padding
        owners = [scene.owner(name) for name in scene.element_names]
        numbered = np.array([owners.index(owner) for owner in owners], dtype=np.intp)
        self.own = np.equal(*numbered[scene.checked_index].T)
        self.asked = 0
        self._solids: dict[int, Solid] = {}
        self.solids: list[Solid] = []
        self._links: list[int] = []
        self._poses: list[Array] = []
        needed = {name for pair in self.pairs for name in pair}
        numbers = {name: self._add(scene, name) for name in scene.element_names if name in needed}
        self.link = np.array(self._links, dtype=np.intp)
        self._stack()
        pairs = [(i, j, k) for k, (a, b) in enumerate(self.pairs) for i in numbers[a] for j in numbers[b]]
        table = np.array(pairs, dtype=np.intp).reshape(-1, 3)
        half_first = np.isinf(self.radius[table[:, 0]])
        table[half_first, :2] = table[half_first, 1::-1]
        self.a, self.b, self.pair = table.T.copy()
        self._classify()

    def along(self, motion: SceneMotion) -> Bodies:
        """The same bodies along another motion of the same columns, with nothing asked so far."""
        other = copy(self)
        other.motion, other.asked = motion, 0
        other.__dict__.pop("meter", None)
        return other

    @cached_property
    def meter(self) -> DistanceMeter:
        """Who asks Coal."""
        return DistanceMeter()

    def _add(self, scene: Scene, element: str) -> list[int]:
        """Add all shapes of an element; their numbers."""
        parts: tuple[Geometry, ...]
        if element in scene.obstacles:
            link, pose, parts = "", scene.obstacles[element].pose, scene.obstacles[element].geometries
        elif element in scene.attachments:
            held = scene.attachments[element]
            link, pose, parts = f"{held.arm}/{held.link}", held.pose, held.geometries
        else:
            arm, name = element.split("/", 1)
            link, pose, parts = element, np.eye(4), scene.arms[arm].robot.link(name).collisions
        first = len(self.solids)
        for part in parts:
            self.solids.append(self._solid(part.shape))
            self._links.append(self.motion.links[link])
            self._poses.append(pose @ part.pose)
            if isinstance(part.shape, HalfSpace) and self.motion.movers[self._links[-1]].any():
                raise InputError(f"{element!r} moves and has a half-space for a shape; expected a bounded shape")
        return list(range(first, len(self.solids)))

    def _solid(self, shape: Shape) -> Solid:
        if id(shape) not in self._solids:
            self._solids[id(shape)] = solid(shape)
        return self._solids[id(shape)]

    def _stack(self) -> None:
        """Arrays over all bodies."""
        poses = np.array(self._poses, dtype=np.float64).reshape(-1, 4, 4)
        self.radius = np.array([s.radius for s in self.solids], dtype=np.float64)
        self.half = np.array([s.half for s in self.solids], dtype=np.float64).reshape(-1, 3)
        self.local_rotation, self.local_origin = poses[:, :3, :3], poses[:, :3, 3]
        centers = np.array([s.center for s in self.solids], dtype=np.float64).reshape(-1, 3)
        self.local_center = np.einsum("bij,bj->bi", self.local_rotation, centers) + self.local_origin
        self.moved = self.motion.movers[self.link].reshape(len(self.link), len(self.motion.column))
        # The joints that carry each body, padded to the same number with a joint that counts nothing.
        depth = int(self.moved.sum(axis=1).max(initial=0.0))
        self._chain = np.argsort(-self.moved, axis=1, kind="stable")[:, :depth]
        self._in_chain = np.take_along_axis(self.moved, self._chain, 1)
        self._fixed: dict[int, Any] = {}

    def _classify(self) -> None:
        kinds = np.array([1 if s.convex else 2 if np.isfinite(s.radius) else 3 for s in self.solids], dtype=np.intp)
        self._kind_a, self._kind_b = kinds[self.a], kinds[self.b]
        if (self._kind_a == 3).any():
            names = self.pairs[self.pair[int(np.argmax(self._kind_a == 3))]]
            raise InputError(f"{names[0]!r} and {names[1]!r} are both half-spaces, which cannot be kept apart")
        # A joint that carries both bodies does not move one against the other.
        self._only_a = self._in_chain[self.a] * (1.0 - np.take_along_axis(self.moved[self.b], self._chain[self.a], 1))
        self._only_b = self._in_chain[self.b] * (1.0 - np.take_along_axis(self.moved[self.a], self._chain[self.b], 1))

    # ---- at n times ---------------------------------------------------------------------

    def place(self, frames: Frames) -> Placed:
        """Poses of all bodies."""
        R = frames.rotation[:, self.link]
        rotation = R @ self.local_rotation
        origin = np.einsum("nbij,bj->nbi", R, self.local_origin) + frames.origin[:, self.link]
        center = np.einsum("nbij,bj->nbi", R, self.local_center) + frames.origin[:, self.link]
        return Placed(rotation, origin, center)

    def sweeps(self, frames: Frames, placed: Placed, change: Array) -> Array:
        """How far each joint alone can carry each body [m], shape (n, bodies, chain).

        The way from one configuration to another is cut into one joint after the other, from
        the base outwards. While a joint turns, those farther out still stand as they do in
        `frames`, so the distance of a body from the axis is the one found there.

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
        # A chord is never longer than the arc, nor than the diameter.
        turned = np.minimum(moved, 2.0) * (across + finite[None, :, None] + _REACH_ROUNDING)
        return np.asarray(np.where(self.motion.slides[self._chain], moved, turned))

    def approach(self, sweeps: Array, node: Index, item: Index) -> Array:
        """Bound of how much the distance of pair `item` can change around time `node` [m], each (k,)."""
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
        # A centre inside the other's box says nothing about how deep it is.
        from_a = np.where(from_a > 0.0, from_a - self.radius[b], -np.inf)
        from_b = np.where(from_b > 0.0, from_b - self.radius[a], -np.inf)
        return np.asarray(np.maximum(from_a, from_b) - self.padding[self.pair[item]])

    def _above_plane(self, placed: Placed, node: Index, item: Index) -> Array:
        """Height of the centre of body a above the half-space b [m], shape (k,)."""
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
        """Clearance [m] of pair `item` at time `node`, each (k,): distance minus padding; below 0 a depth.

        Returns:
            The value found, and a proven lower bound of it.
        """
        value, proven = np.empty(len(item)), np.empty(len(item))
        self.asked += len(item)
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
            value[k], normal[k] = self.meter.convex(self.solids[a], Ta, self.solids[b], Tb)
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
            self.meter.compound(self.solids[a], Ta, self.solids[b], Tb)
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
