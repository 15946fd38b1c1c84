"""The collision bodies of a scene at many configurations, in plain NumPy.

No kinematics or collision checking of the planners or the referee is used. Frames are products of the description's
transforms, vectorized over samples. Pairs of bodies with disjoint oriented boxes (separating axes, Gottschalk, Lin,
Manocha 1996) are free; only the other pairs are candidates for a checker.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.errors import InputError, UnknownNameError
from rr1plan.playback.cloud_boxes import cloud_boxes
from rr1plan.robot import Geometry, Robot
from rr1plan.scene import Scene
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere
from rr1plan.shapes.convex_hulls import is_own_hull
from rr1plan.transforms import pose

MotionFunction = Callable[[Array], Array]  # times (n,) to configurations (n, nq)
# Poses of bodies at samples that are computed at once.
_MOST_PLACED = 100_000
# More samples than this would take days.
_MOST_SAMPLES = 2_000_000


@dataclass(frozen=True, eq=False)
class SceneBody:
    """A shape of an element.

    Args:
        element: The scene element, "arm/link" or the name of an obstacle or attached object.
        frame: The link that carries it, "arm/link"; "" for the world.
        pose: T_frame_body, shape (4, 4).
        shape: The shape; clouds are split into boxes.
        center: Center of the box around it, in its own coordinates [m], shape (3,).
        half: Half edges of that box [m], shape (3,); inf for a half-space.
        is_surface: Whether the shape is a non-convex mesh, which libraries treat as a surface without an inside.
    """

    element: str
    frame: str
    pose: Array
    shape: Box | Sphere | Cylinder | Capsule | HalfSpace | Mesh
    center: Array
    half: Array
    is_surface: bool = False


class SceneBodies:
    """All collision bodies of a scene, and the pairs that must not touch.

    Args:
        scene: The scene.
        joint_names: Columns of the configurations, "arm/joint", with all joints of each arm that moves; other arms
            rest.

    Attributes:
        bodies: The bodies.
        pairs: Indices of the bodies that must not touch, shape (m, 2).

    Raises:
        UnknownNameError: a column that is no joint of the scene.
        InputError: only some joints of an arm have columns.
    """

    def __init__(self, scene: Scene, joint_names: Sequence[str]) -> None:
        self._scene = scene
        self._columns = _columns_of_arms(scene, joint_names)
        self.bodies = list(_bodies(scene))
        index: dict[str, list[int]] = {}
        for i, body in enumerate(self.bodies):
            index.setdefault(body.element, []).append(i)
        rows = [(i, j) for a, b in scene.checked_pairs for i in index[a] for j in index[b]]
        self.pairs: NDArray[np.int64] = np.array(rows, dtype=np.int64).reshape(-1, 2)
        self._center, self._half = (
            np.array([getattr(body, name) for body in self.bodies]).reshape(-1, 3) for name in ("center", "half")
        )
        self._radius = np.linalg.norm(self._half, axis=1)
        self._moving = [i for i, b in enumerate(self.bodies) if b.frame.split("/", 1)[0] in self._columns]

    def frames(self, q: Array) -> Array:
        """T_world_body of all bodies at configurations q (n, nq), shape (n, bodies, 4, 4)."""
        poses: dict[str, Array] = {"": np.eye(4)[None]}
        for name, arm in self._scene.arms.items():
            own = q[:, self._columns[name]] if name in self._columns else arm.q[None]
            poses |= {f"{name}/{link}": arm.base @ T for link, T in link_frames(arm.robot, own).items()}
        frames = np.empty((len(q), len(self.bodies), 4, 4))
        for k, body in enumerate(self.bodies):
            frames[:, k] = poses[body.frame] @ body.pose
        return frames

    def nearby_pairs(self, frames: Array, pairs: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The samples and pairs of bodies whose boxes intersect.

        Args:
            frames: T_world_body, shape (n, bodies, 4, 4).
            pairs: Indices of bodies, shape (m, 2).

        Returns:
            Indices of samples and of rows of `pairs`, each of shape (k,).
        """
        i, j = pairs.T
        centers = self._centers(frames)
        offset = centers[:, j] - centers[:, i]
        flat = np.isinf(self._radius)
        disjoint = np.linalg.norm(offset, axis=2) > self._radius[i] + self._radius[j]
        for k in np.flatnonzero(flat[i] | flat[j]):
            plane, other = (i[k], j[k]) if flat[i[k]] else (j[k], i[k])
            disjoint[:, k] = self._above_plane(frames, centers, plane, other)
        sample, pair = np.nonzero(~disjoint)
        bounded = ~(flat[i[pair]] | flat[j[pair]])
        a, b = i[pair][bounded], j[pair][bounded]
        turns, at = frames[..., :3, :3], sample[bounded]
        meet = np.ones(len(sample), dtype=np.bool_)
        meet[bounded] = boxes_meet(turns[at, a], self._half[a], turns[at, b], self._half[b], offset[at, pair[bounded]])
        return sample[meet], pair[meet]

    def reachable_pairs(self, curve: MotionFunction, times: Array) -> NDArray[np.int64]:
        """The rows of `pairs` whose bodies have intersecting bounds over all the times, shape (k, 2)."""
        lower, upper = np.full((len(self.bodies), 3), np.inf), np.full((len(self.bodies), 3), -np.inf)
        for part in self.parts(times):
            centers = self._centers(self.frames(curve(part)))
            lower = np.minimum(lower, centers.min(axis=0) - self._radius[:, None])
            upper = np.maximum(upper, centers.max(axis=0) + self._radius[:, None])
        i, j = self.pairs.T
        reach: NDArray[np.int64] = self.pairs[((lower[i] <= upper[j]) & (lower[j] <= upper[i])).all(axis=1)]
        return reach

    def parts(self, times: Array) -> list[Array]:
        """The times in parts small enough to compute all poses of a part at once."""
        most = max(1, _MOST_PLACED // max(1, len(self.bodies)))
        return np.array_split(times, max(1, -(-len(times) // most)))

    def sample_times(self, curve: MotionFunction, breaks: Array, step: float) -> Array:
        """Times between which no point of a moving body travels farther than `step` [m].

        Args:
            curve: The motion.
            breaks: Times to include, shape (m,).
            step: The largest distance [m].

        Raises:
            InputError: too many samples would be needed.
        """
        times = np.unique(np.concatenate([breaks, np.linspace(breaks[0], breaks[-1], 50)]))
        while True:
            travel = self._travel(curve, times)
            if travel.max(initial=0.0) <= step:
                return times
            counts = np.maximum(1.0, np.ceil(travel / (0.95 * step)))
            if not counts.sum() <= _MOST_SAMPLES:
                raise InputError(f"step of {step:g} m takes {counts.sum():.3g} samples, take a longer one")
            counts = counts.astype(np.int64)
            share = np.concatenate([np.arange(n) / n for n in counts])
            begin = np.repeat(times[:-1], counts)
            times = np.append(begin + share * np.repeat(np.diff(times), counts), times[-1])

    def _centers(self, frames: Array) -> Array:
        """Centers of the boxes around the bodies, shape (n, bodies, 3)."""
        return np.asarray(np.einsum("nbij,bj->nbi", frames[..., :3, :3], self._center) + frames[..., :3, 3])

    def _above_plane(self, frames: Array, centers: Array, plane: int, other: int) -> NDArray[np.bool_]:
        """The samples at which the ball around a body is completely outside a half-space, shape (n,)."""
        shape = self.bodies[plane].shape
        assert isinstance(shape, HalfSpace)
        T = frames[:, plane]
        normal = T[:, :3, :3] @ np.array(shape.normal)
        height = np.einsum("ni,ni->n", normal, centers[:, other] - T[:, :3, 3]) - shape.offset
        return np.asarray(height > self._radius[other])

    def _travel(self, curve: MotionFunction, times: Array) -> Array:
        """Displacement of the fastest corner of any box from each time to the next [m], shape (n - 1,)."""
        if not self._moving:
            return np.zeros(max(0, len(times) - 1))
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
        corners = self._center[self._moving, None] + signs * self._half[self._moving, None]
        travel, last = [], None
        for part in self.parts(times):
            frames = self.frames(curve(part))[:, self._moving]
            points = np.einsum("nbij,bkj->nbki", frames[..., :3, :3], corners) + frames[..., None, :3, 3]
            if last is not None:
                points = np.concatenate([last, points])
            travel.append(np.linalg.norm(np.diff(points, axis=0), axis=3).max(axis=(1, 2)))
            last = points[-1:]
        return np.concatenate(travel)


def _columns_of_arms(scene: Scene, joint_names: Sequence[str]) -> dict[str, list[int]]:
    """Columns of the planning joints of each arm that moves."""
    known = scene.joint_names() if scene.arms else ()
    for name in joint_names:
        if name not in known:
            raise UnknownNameError("joint", name, known)
    columns = {}
    for arm in dict.fromkeys(name.split("/", 1)[0] for name in joint_names):
        wanted = scene.joint_names([arm])
        missing = [name for name in wanted if name not in joint_names]
        if missing:
            raise InputError(f"the motion moves {arm!r} but has no column for {missing[0]!r}")
        columns[arm] = [list(joint_names).index(name) for name in wanted]
    return columns


def _bodies(scene: Scene) -> Iterator[SceneBody]:
    for name, arm in scene.arms.items():
        for link in arm.robot.links:
            yield from _parts(f"{name}/{link.name}", f"{name}/{link.name}", link.collisions, np.eye(4))
    for name, held in scene.attachments.items():
        yield from _parts(name, f"{held.arm}/{held.link}", held.geometries, held.pose)
    for name, obstacle in scene.obstacles.items():
        yield from _parts(name, "", obstacle.geometries, obstacle.pose)


def _parts(element: str, frame: str, geometries: Sequence[Geometry], T: Array) -> Iterator[SceneBody]:
    for geometry in geometries:
        if isinstance(geometry.shape, PointCloud):
            for center, half in zip(*cloud_boxes(geometry.shape), strict=True):
                placed = T @ geometry.pose @ pose(center)
                yield SceneBody(element, frame, placed, Box(tuple(2.0 * half)), np.zeros(3), half)
        else:
            center, half = _box_around(geometry.shape)
            yield SceneBody(element, frame, T @ geometry.pose, geometry.shape, center, half, is_surface(geometry.shape))


def is_surface(shape: Shape) -> bool:
    """Whether a shape is a mesh that is not convex."""
    return isinstance(shape, Mesh) and not (shape.convex or is_own_hull(shape))


def _box_around(shape: Shape) -> tuple[Array, Array]:
    """Center and half edges of a box around a shape [m]."""
    center = np.zeros(3)
    match shape:
        case Box(size):
            half = 0.5 * np.array(size)
        case Sphere(radius):
            half = np.full(3, radius)
        case Cylinder(radius, length):
            half = np.array([radius, radius, 0.5 * length])
        case Capsule(radius, length):
            half = np.array([radius, radius, 0.5 * length + radius])
        case Mesh():
            lower, upper = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
            center, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        case _:
            half = np.full(3, np.inf)
    return center, half


def link_frames(robot: Robot, q: Array) -> dict[str, Array]:
    """T_base_link of every link at configurations q (n, nq), each (n, 4, 4); Rodrigues' formula for every joint."""
    # All joints are an affine function of the planning joints, including mimic joints.
    rest = robot.joint_values(np.zeros(robot.nq))
    units = [robot.joint_values(unit) for unit in np.eye(robot.nq)]
    frames: dict[str, Array] = {robot.base: np.broadcast_to(np.eye(4), (len(q), 4, 4))}
    for joint in robot.joints:
        motion = np.broadcast_to(np.eye(4), (len(q), 4, 4)).copy()
        if joint.kind != "fixed":
            value = rest[joint.name] + q @ np.array([unit[joint.name] - rest[joint.name] for unit in units])
        if joint.kind == "prismatic":
            motion[:, :3, 3] = value[:, None] * joint.axis
        elif joint.kind != "fixed":
            x, y, z = joint.axis
            cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            sin, cos = np.sin(value)[:, None, None], np.cos(value)[:, None, None]
            motion[:, :3, :3] += sin * cross + (1.0 - cos) * (cross @ cross)
        frames[joint.child] = frames[joint.parent] @ joint.origin @ motion
    return frames


def boxes_meet(turn_a: Array, half_a: Array, turn_b: Array, half_b: Array, offset: Array) -> NDArray[np.bool_]:
    """Whether boxes intersect or touch, by the fifteen separating axes.

    Args:
        turn_a: Rotations of the first boxes, shape (n, 3, 3).
        half_a: Their half edges [m], shape (n, 3).
        turn_b: Rotations of the second boxes, shape (n, 3, 3).
        half_b: Their half edges [m], shape (n, 3).
        offset: From the centers of the first to those of the second [m], shape (n, 3).
    """
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
