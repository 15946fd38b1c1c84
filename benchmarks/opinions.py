"""Independent collision checks of a motion, sampled at a millimeter, by Coal and python-fcl.

This module does not use rr1plan's kinematics or collision checking. Frames are products of
the description's transforms, vectorized over samples. Pairs of bodies with disjoint oriented boxes (separating
axes, Gottschalk, Lin, Manocha 1996) are free; all other pairs are checked by the library at every sample.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import coal
import fcl
import numpy as np

import rr1plan as rp
from rr1plan.checks import Array

Motion = Callable[[Array], Array]  # places along a motion (n,) to configurations (n, nq)
_STEP = 0.001  # no point of the robot moves farther between two samples [m]


@dataclass(frozen=True, eq=False)
class Body:
    """A convex shape on a link (or on the world), and the box around it in the link's frame."""

    element: str
    shape: Any
    local: Array
    center: Array
    half: Array


class Bodies:
    """All shapes of a scene with one arm, and the pairs that must not touch."""

    def __init__(self, scene: rp.Scene) -> None:
        self.arm, placed = next(iter(scene.arms.items()))
        self.robot, self.base = placed.robot, placed.base
        self.moving = [
            _body(f"{self.arm}/{link.name}", g.shape, g.pose) for link in self.robot.links for g in link.collisions
        ]
        self.fixed = [
            _body(name, g.shape, thing.pose @ g.pose)
            for name, thing in scene.obstacles.items()
            for g in thing.geometries
        ]
        self.all = [*self.moving, *self.fixed]
        index: dict[str, list[int]] = {}
        for i, body in enumerate(self.all):
            index.setdefault(body.element, []).append(i)
        self.pairs = np.array([(i, j) for a, b in scene.checked_pairs for i in index[a] for j in index[b]])

    def frames(self, q: Array) -> Array:
        """T_world_body of all bodies at configurations q (n, nq), shape (n, bodies, 4, 4)."""
        links = link_frames(self.robot, q)
        moving = [self.base @ links[b.element.split("/", 1)[1]] @ b.local for b in self.moving]
        fixed = [np.broadcast_to(b.local, (len(q), 4, 4)) for b in self.fixed]
        return np.stack([*moving, *fixed], axis=1)

    def candidates(self, frames: Array) -> tuple[Array, Array]:
        """Samples and pairs whose boxes meet, as two arrays of indices."""
        centers = np.einsum("nbij,bj->nbi", frames[..., :3, :3], np.array([b.center for b in self.all]))
        centers += frames[..., :3, 3]
        half = np.array([b.half for b in self.all])
        i, j = self.pairs.T
        gap = np.linalg.norm(centers[:, i] - centers[:, j], axis=2)
        sample, pair = np.nonzero(gap <= np.linalg.norm(half, axis=1)[i] + np.linalg.norm(half, axis=1)[j])
        a, b = i[pair], j[pair]
        turns = frames[..., :3, :3]
        meet = boxes_meet(turns[sample, a], half[a], turns[sample, b], half[b], centers[sample, b] - centers[sample, a])
        return sample[meet], pair[meet]


def _body(element: str, shape: Any, local: Array) -> Body:
    match shape:
        case rp.Box(size):
            center, half = np.zeros(3), 0.5 * np.array(size)
        case rp.Cylinder(radius, length):
            center, half = np.zeros(3), np.array([radius, radius, 0.5 * length])
        case rp.Sphere(radius):
            center, half = np.zeros(3), np.full(3, radius)
        case rp.Capsule(radius, length):
            center, half = np.zeros(3), np.array([radius, radius, 0.5 * length + radius])
        case rp.Mesh():
            lower, upper = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
            center, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        case _:
            raise rp.InputError(f"no second opinion on a {type(shape).__name__}")
    return Body(element, shape, np.array(local), center, half)


def link_frames(robot: rp.Robot, q: Array) -> dict[str, Array]:
    """T_base_link of every link, each (n, 4, 4); Rodrigues' formula for every joint."""
    fixed = robot.joint_values(q[0])
    frames = {robot.base: np.broadcast_to(np.eye(4), (len(q), 4, 4))}
    for joint in robot.joints:
        value = np.full(len(q), fixed.get(joint.name, 0.0))
        if joint.name in robot.joint_names:
            value = q[:, robot.joint_names.index(joint.name)]
        elif joint.mimic is not None and joint.mimic.joint in robot.joint_names:
            value = joint.mimic.multiplier * q[:, robot.joint_names.index(joint.mimic.joint)] + joint.mimic.offset
        motion = np.broadcast_to(np.eye(4), (len(q), 4, 4)).copy()
        if joint.kind == "prismatic":
            motion[:, :3, 3] = value[:, None] * joint.axis
        elif joint.kind != "fixed":
            x, y, z = joint.axis
            cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            sin, cos = np.sin(value)[:, None, None], np.cos(value)[:, None, None]
            motion[:, :3, :3] += sin * cross + (1.0 - cos) * (cross @ cross)
        frames[joint.child] = frames[joint.parent] @ joint.origin @ motion
    return frames


def boxes_meet(turn_a: Array, half_a: Array, turn_b: Array, half_b: Array, offset: Array) -> Array:
    """Whether boxes intersect or touch, by their fifteen separating axes, shape (n,)."""
    relative = np.einsum("nji,njk->nik", turn_a, turn_b)
    shift = np.einsum("nji,nj->ni", turn_a, offset)
    size = np.abs(relative) + 1e-9
    meet = (np.abs(shift) <= half_a + np.einsum("nij,nj->ni", size, half_b)).all(axis=1)
    along_b = np.einsum("ni,nij->nj", shift, relative)
    meet &= (np.abs(along_b) <= half_b + np.einsum("ni,nij->nj", half_a, size)).all(axis=1)
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            reach = half_a[:, i1] * size[:, i2, j] + half_a[:, i2] * size[:, i1, j]
            reach += half_b[:, j1] * size[:, i, j2] + half_b[:, j2] * size[:, i, j1]
            meet &= np.abs(shift[:, i2] * relative[:, i1, j] - shift[:, i1] * relative[:, i2, j]) <= reach + 1e-9
    return np.asarray(meet)


# ---- samples -----------------------------------------------------------------------------------


def path_motion(waypoints: Array) -> tuple[Motion, Array]:
    """A path as a motion, and the places of its waypoints."""
    waypoints = np.asarray(waypoints, dtype=np.float64)
    places = np.arange(float(len(waypoints)))

    def at(s: Array) -> Array:
        i = np.clip(s.astype(int), 0, max(0, len(waypoints) - 2))
        j = np.minimum(i + 1, len(waypoints) - 1)
        return np.asarray(waypoints[i] + (s - i)[:, None] * (waypoints[j] - waypoints[i]))

    return at, places


def millimeter_samples(bodies: Bodies, motion: Motion, places: Array) -> Array:
    """Places so near together that no point of the robot moves more than a millimeter between two."""
    places = np.unique(np.concatenate([places, np.linspace(places[0], places[-1], 50)]))
    while True:
        travel = _travel(bodies, motion(places))
        if len(places) < 2 or travel.max() <= _STEP:
            return places
        parts = np.maximum(1, np.ceil(travel / (0.95 * _STEP))).astype(int)
        share = np.concatenate([np.arange(n) / n for n in parts])
        start = np.repeat(places[:-1], parts)
        places = np.append(start + share * np.repeat(np.diff(places), parts), places[-1])


def _travel(bodies: Bodies, q: Array) -> Array:
    """How far the fastest corner of any body's box moves from each sample to the next [m], shape (n - 1,)."""
    frames = bodies.frames(q)[:, : len(bodies.moving)]
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    corners = np.array([b.center + signs * b.half for b in bodies.moving])
    points = np.einsum("nbij,bkj->nbki", frames[..., :3, :3], corners) + frames[..., None, :3, 3]
    return np.asarray(np.linalg.norm(np.diff(points, axis=0), axis=3).max(axis=(1, 2)))


# ---- the two libraries ---------------------------------------------------------------------------


class CoalOpinion:
    """Coal alone, contacts enabled: without them it misses some shapes that graze a surface with their core."""

    name = "Coal"

    def __init__(self, bodies: Sequence[Body]) -> None:
        self._shapes = [_coal_shape(b.shape) for b in bodies]
        self._request = coal.CollisionRequest(coal.CollisionRequestFlag.CONTACT, 1)

    def touch(self, a: int, Ta: Array, b: int, Tb: Array) -> bool:
        """Whether bodies a and b meet at those poses."""
        result = coal.CollisionResult()
        pose_a, pose_b = coal.Transform3s(Ta[:3, :3], Ta[:3, 3]), coal.Transform3s(Tb[:3, :3], Tb[:3, 3])
        return bool(coal.collide(self._shapes[a], pose_a, self._shapes[b], pose_b, self._request, result))


def _coal_shape(shape: Any) -> Any:
    match shape:
        case rp.Box(size):
            return coal.Box(*size)
        case rp.Cylinder(radius, length):
            return coal.Cylinder(radius, length)
        case rp.Sphere(radius):
            return coal.Sphere(radius)
        case rp.Capsule(radius, length):
            return coal.Capsule(radius, length)
    points = coal.StdVec_Vec3s()
    for vertex in shape.vertices:
        points.append(vertex)
    return coal.Convex.convexHull(points, True, "Qt")


class FclOpinion:
    """python-fcl, which has forked from the same ancestor long ago and shares no narrow phase with Coal."""

    name = "FCL"

    def __init__(self, bodies: Sequence[Body]) -> None:
        self._things = [fcl.CollisionObject(fcl_shape(b.shape)) for b in bodies]
        self._request = fcl.CollisionRequest()

    def touch(self, a: int, Ta: Array, b: int, Tb: Array) -> bool:
        """Whether bodies a and b meet at those poses."""
        for k, T in ((a, Ta), (b, Tb)):
            self._things[k].setTransform(fcl.Transform(np.ascontiguousarray(T[:3, :3]), np.ascontiguousarray(T[:3, 3])))
        return bool(fcl.collide(self._things[a], self._things[b], self._request, fcl.CollisionResult()) > 0)


def fcl_shape(shape: Any) -> Any:
    match shape:
        case rp.Box(size):
            return fcl.Box(*size)
        case rp.Cylinder(radius, length):
            return fcl.Cylinder(radius, length)
        case rp.Sphere(radius):
            return fcl.Sphere(radius)
        case rp.Capsule(radius, length):
            return fcl.Capsule(radius, length)
    faces = np.concatenate([[3, *face] for face in shape.faces]).astype(np.int32)
    return fcl.Convex(np.array(shape.vertices), len(shape.faces), faces)


@dataclass(frozen=True)
class Verdict:
    """What the opinions say of one motion: samples, pairs asked, and the first touch each of them sees."""

    samples: int
    asked: int
    touches: dict[str, tuple[str, str, float] | None]

    @property
    def free(self) -> bool:
        """None of them sees a touch."""
        return all(touch is None for touch in self.touches.values())


class Opinions:
    """Coal's and FCL's opinions on motions in one scene."""

    def __init__(self, scene: rp.Scene) -> None:
        self.bodies = Bodies(scene)
        self._all = (CoalOpinion(self.bodies.all), FclOpinion(self.bodies.all))

    def judge_path(self, waypoints: Array) -> Verdict:
        """What they say of straight lines between waypoints (n, nq)."""
        return self._judge(*path_motion(waypoints))

    def judge_trajectory(self, trajectory: rp.Trajectory) -> Verdict:
        """What they say of a timed motion."""
        return self._judge(trajectory, np.array(trajectory.breaks))

    def _judge(self, motion: Motion, places: Array) -> Verdict:
        places = millimeter_samples(self.bodies, motion, places)
        touches: dict[str, tuple[str, str, float] | None] = {opinion.name: None for opinion in self._all}
        asked = 0
        for part in np.array_split(places, max(1, len(places) // 1000)):
            frames = self.bodies.frames(motion(part))
            samples, pairs = self.bodies.candidates(frames)
            asked += len(samples)
            for opinion in self._all:
                if touches[opinion.name] is None:
                    touches[opinion.name] = self._first(opinion, frames, samples, pairs, part)
        return Verdict(len(places), asked, touches)

    def _first(self, opinion: Any, frames: Array, samples: Array, pairs: Array, places: Array) -> Any:
        for n, p in zip(samples, pairs, strict=True):
            a, b = self.bodies.pairs[p]
            if opinion.touch(a, frames[n, a], b, frames[n, b]):
                return self.bodies.all[a].element, self.bodies.all[b].element, float(places[n])
        return None
