"""The collision bodies of a scene at many configurations, in plain NumPy.

No kinematics or collision checking of the planners or the referee is used. Frames are products of the description's
transforms, vectorized over samples. Pairs of bodies with disjoint oriented boxes (separating axes, Gottschalk, Lin,
Manocha 1996) are free; only the other pairs are candidates for a checker.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, known_name
from rr1plan.errors import InputError
from rr1plan.path import arms_of
from rr1plan.playback.cloud_boxes import cloud_boxes
from rr1plan.robot import Geometry, Robot
from rr1plan.scene import Scene
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere
from rr1plan.shapes.convex_hulls import is_own_hull
from rr1plan.trajectory import Trajectory
from rr1plan.transforms import pose

MotionFunction = Callable[[Array], Array]  # times (n,) to configurations (n, nq)
# Poses of bodies at samples that are computed at once.
_MOST_PLACED = 100_000
# More samples than this would take days.
_MOST_SAMPLES = 2_000_000
# The joints that move a body turn together by at most this between samples [rad].
_MOST_TURN = 0.1
# Largest jump of a joint at a break that counts as rounding [rad or m].
_MOST_JUMP = 1e-6


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
        frames = [self.bodies[i].frame for i in self._moving]
        self._joints = [
            joint
            for name, columns in self._columns.items()
            for joint in _moving_joints(name, scene.arms[name].robot, columns, len(joint_names), frames)
        ]

    def frames(self, q: Array) -> Array:
        """T_world_body of all bodies at configurations q (n, nq), shape (n, bodies, 4, 4)."""
        return self._body_frames(self._link_frames(q), len(q))

    def _link_frames(self, q: Array) -> dict[str, Array]:
        """T_world_link of every "arm/link" and of the world "" at configurations q (n, nq)."""
        poses: dict[str, Array] = {"": np.eye(4)[None]}
        for name, arm in self._scene.arms.items():
            own = q[:, self._columns[name]] if name in self._columns else arm.q[None]
            poses |= {f"{name}/{link}": arm.base @ T for link, T in link_frames(arm.robot, own).items()}
        return poses

    def _body_frames(self, poses: dict[str, Array], count: int) -> Array:
        """T_world_body of all bodies, shape (count, bodies, 4, 4), from the frames of their links."""
        frames = np.empty((count, len(self.bodies), 4, 4))
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

    def sample_times(self, motion: Trajectory, step: float) -> Array:
        """Times between which no point of a moving body travels farther than `step` [m], with all breaks.

        Args:
            motion: The motion.
            step: The largest distance [m].

        Raises:
            InputError: the motion jumps, or too many samples would be needed.
        """
        _check_continuity(motion)
        times = motion.breaks
        while True:
            parts = self._parts_needed(motion, times, step)
            if parts.max(initial=0.0) <= 1.0:
                return times
            counts = np.maximum(1.0, np.ceil(parts / 0.95))
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

    def _parts_needed(self, motion: Trajectory, times: Array, step: float) -> Array:
        """Estimates of the parts into which intervals have to be cut, shape (n - 1,); at most 1 is a proof of the step.

        Joints that turn by d_j in total, at distances of at most L_j from the points of a body at the start of an
        interval, move none of these points farther than exp(sum d_j) sum L_j d_j, because the distances grow by at most
        the travel so far (Grönwall's inequality). Joints that slide have L_j = 1 and do not count in the exponent.
        """
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
        corners = self._center[self._moving, None] + signs * self._half[self._moving, None]
        needed = []
        for begin, end in zip(self.parts(times[:-1]), self.parts(times[1:]), strict=True):
            poses = self._link_frames(motion(begin))
            frames = self._body_frames(poses, len(begin))[:, self._moving]
            points = np.einsum("nbij,bkj->nbki", frames[..., :3, :3], corners) + frames[..., None, :3, 3]
            changes = _joint_changes(motion, begin, end)
            travel, turn = np.zeros((2, len(begin), len(self._moving)))
            for joint in self._joints:
                change = (changes @ joint.slopes)[:, None]
                if joint.slides:
                    travel[:, joint.bodies] += change
                    continue
                T = poses[joint.frame][:, None, None]
                offset = points[:, joint.bodies] - T[..., :3, 3]
                lever = np.linalg.norm(np.cross(offset, T[..., :3, :3] @ joint.axis), axis=3).max(axis=2)
                travel[:, joint.bodies] += lever * change
                turn[:, joint.bodies] += change
            # An interval in which joints turn farther is cut anyway.
            travel *= np.exp(np.minimum(turn, _MOST_TURN))
            needed.append(np.maximum(travel / step, turn / _MOST_TURN).max(axis=1, initial=0.0))
        return np.concatenate(needed)


@dataclass(frozen=True, eq=False)
class _MovingJoint:
    """A joint that moves with the columns.

    Args:
        frame: The link that it moves, "arm/link", whose origin is on its axis.
        axis: Its axis in that link, shape (3,).
        slides: Whether it is prismatic.
        slopes: Absolute change per change of each column, shape (nq,).
        bodies: Indices of the bodies that it moves, among the moving ones.
    """

    frame: str
    axis: Array
    slides: bool
    slopes: Array
    bodies: list[int]


def _moving_joints(
    arm: str, robot: Robot, columns: list[int], nq: int, frames: Sequence[str]
) -> Iterator[_MovingJoint]:
    """The joints of an arm that move with its columns of all nq, for bodies on the given links "arm/link"."""
    above: dict[str, set[str]] = {f"{arm}/{robot.base}": set()}
    _, units = _joint_map(robot)
    for joint in robot.joints:
        above[f"{arm}/{joint.child}"] = above[f"{arm}/{joint.parent}"] | {joint.name}
    for joint in robot.joints:
        if joint.kind != "fixed" and units[joint.name].any():
            slopes = np.zeros(nq)
            slopes[columns] = np.abs(units[joint.name])
            bodies = [k for k, frame in enumerate(frames) if joint.name in above.get(frame, ())]
            yield _MovingJoint(f"{arm}/{joint.child}", joint.axis, joint.kind == "prismatic", slopes, bodies)


def _check_continuity(motion: Trajectory) -> None:
    powers = np.diff(motion.breaks)[:-1, None] ** np.arange(motion.coefficients.shape[1])
    ends = np.einsum("mkj,mk->mj", motion.coefficients[:-1], powers)
    jumps = np.abs(motion.coefficients[1:, 0] - ends)
    if jumps.max(initial=0.0) > _MOST_JUMP:
        piece, column = np.unravel_index(jumps.argmax(), jumps.shape)
        raise InputError(
            f"joint {motion.joint_names[column]!r} jumps by {jumps.max():.3g} rad or m at "
            f"{motion.breaks[piece + 1]:.5f} s, expected a continuous motion"
        )


def _joint_changes(motion: Trajectory, begin: Array, end: Array) -> Array:
    """Upper bounds on the total variation of each joint in intervals that contain no break [rad or m], shape (n, nq).

    The variation of a polynomial is at most that of its Bernstein coefficients.
    """
    piece = np.clip(np.searchsorted(motion.breaks, begin, side="right") - 1, 0, len(motion.coefficients) - 1)
    coefficients, degree = motion.coefficients[piece], motion.coefficients.shape[1] - 1
    since, span = begin - motion.breaks[piece], end - begin
    # In powers of the share of the interval: sum over m of C(m, k) c_m since^(m - k) span^k.
    powers = np.zeros_like(coefficients)
    for k in range(degree + 1):
        for m in range(k, degree + 1):
            powers[:, k] += (math.comb(m, k) * since ** (m - k) * span**k)[:, None] * coefficients[:, m]
    bernstein = np.array(
        [[math.comb(i, k) / math.comb(degree, k) for k in range(degree + 1)] for i in range(degree + 1)]
    )
    return np.asarray(np.abs(np.diff(bernstein @ powers, axis=1)).sum(axis=1))


def _columns_of_arms(scene: Scene, joint_names: Sequence[str]) -> dict[str, list[int]]:
    """Columns of the planning joints of each arm that moves."""
    known = scene.joint_names() if scene.arms else ()
    for name in joint_names:
        known_name("joint", name, known)
    columns = {}
    for arm in arms_of(joint_names):
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
    rest, units = _joint_map(robot)
    frames: dict[str, Array] = {robot.base: np.broadcast_to(np.eye(4), (len(q), 4, 4))}
    for joint in robot.joints:
        motion = np.broadcast_to(np.eye(4), (len(q), 4, 4)).copy()
        if joint.kind != "fixed":
            value = rest[joint.name] + q @ units[joint.name]
        if joint.kind == "prismatic":
            motion[:, :3, 3] = value[:, None] * joint.axis
        elif joint.kind != "fixed":
            x, y, z = joint.axis
            cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            sin, cos = np.sin(value)[:, None, None], np.cos(value)[:, None, None]
            motion[:, :3, :3] += sin * cross + (1.0 - cos) * (cross @ cross)
        frames[joint.child] = frames[joint.parent] @ joint.origin @ motion
    return frames


def _joint_map(robot: Robot) -> tuple[dict[str, float], dict[str, Array]]:
    """Movable joints, including mimic joints, as affine functions of the planning joints: offsets, slopes (nq,)."""
    rest = robot.joint_values(np.zeros(robot.nq))
    units = [robot.joint_values(unit) for unit in np.eye(robot.nq)]
    return rest, {name: np.array([unit[name] - rest[name] for unit in units]) for name in rest}


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
