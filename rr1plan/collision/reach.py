"""The broad phase between arms: who can ever come near a moving arm, by balls that contain all an arm can reach."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.collision.arm_geometry import ArmGeometry
from rr1plan.collision.arm_tables import arm_tables
from rr1plan.collision.obstacle_geometry import ObstacleGeometry, arm_posture
from rr1plan.collision.obstacle_tables import obstacle_tables
from rr1plan.kept import kept_in
from rr1plan.scene import Scene

# So many obstacles are never left out: scenes that differ in where these are share their pairs.
_FEW_OBSTACLES = 64
# Far above the rounding of the sums here, relative and absolute [m].
_RELATIVE, _ROUNDING = 1.0 + 1e-9, 1e-9


@dataclass(frozen=True)
class Near:
    """What can come near the moving arms.

    Args:
        arms: Arms that stand still.
        obstacles: Obstacles.
        near_pairs: Pairs of arms, and of arms and obstacles, that can come near each other; None: all moving arms
            with each other and with all obstacles, and no arm stands still.
        least_gap: All others stay at least this far apart [m].
    """

    arms: tuple[str, ...]
    obstacles: tuple[str, ...]
    near_pairs: frozenset[frozenset[str]] | None
    least_gap: float


def find_near(
    scene: Scene,
    geometries: Mapping[str, ArmGeometry],
    obstacles: Sequence[ObstacleGeometry],
    arms: tuple[str, ...],
    distance: float,
) -> Near:
    """What can come nearer than a distance to the moving arms, whatever their configuration.

    Args:
        scene: The scene.
        geometries: Of its arms.
        obstacles: Its obstacles, in their order.
        arms: The arms that move.
        distance: The distance [m].
    """
    if len(scene.arms) == 1 and len(obstacles) <= _FEW_OBSTACLES:
        return Near((), tuple(scene.obstacles), None, np.inf)
    others = [name for name in scene.arms if name not in set(arms)]
    balls = placed_balls(np.array([reach_ball(geometries[a]) for a in arms]).reshape(-1, 4), bases_of(scene, arms))
    still = posture_balls(scene, geometries, others)
    names = list(scene.obstacles)
    everyone = [*arms, *others, *names]
    boxes = obstacle_boxes(obstacles)
    gaps = np.concatenate([ball_gaps(balls, balls), ball_gaps(balls, still), box_gaps(balls, boxes)], axis=1)
    np.fill_diagonal(gaps, -np.inf)
    if len(names) <= _FEW_OBSTACLES:
        gaps[:, len(everyone) - len(names) :] = -np.inf
    is_near = np.array(gaps <= distance, dtype=np.bool_)
    kept: NDArray[np.bool_] = np.any(is_near, axis=0)
    first, last = len(arms), len(arms) + len(others)
    least_gap = float(gaps[~is_near].min(initial=np.inf))
    near_arms = tuple(name for name, near in zip(others, kept[first:last].tolist(), strict=True) if near)
    near_obstacles = tuple(name for name, near in zip(names, kept[last:].tolist(), strict=True) if near)
    near_pairs = None
    if near_arms or not is_near.all():
        rows, columns = np.nonzero(is_near)
        near_pairs = frozenset(
            frozenset((arms[i], everyone[j])) for i, j in zip(rows.tolist(), columns.tolist(), strict=True)
        )
    return Near(near_arms, near_obstacles, near_pairs, least_gap)


def posture_balls(scene: Scene, geometries: Mapping[str, ArmGeometry], arms: Sequence[str]) -> Array:
    """Balls around arms in their configurations of the scene: center and radius [m], shape (n, 4)."""
    own = [arm_posture(geometries[name], scene.arms[name].q.tobytes()).ball for name in arms]
    return placed_balls(np.array(own).reshape(-1, 4), bases_of(scene, arms))


def bases_of(scene: Scene, arms: Sequence[str]) -> Array:
    """T_world_base of arms, shape (n, 4, 4)."""
    return np.array([scene.arms[name].base for name in arms]).reshape(-1, 4, 4)


def reach_ball(geometry: ArmGeometry) -> Array:
    """A ball that contains an arm in every configuration: center in the frame of its base and radius [m], shape (4,).

    Its radius is infinite where a joint slides: the configurations that are checked need not be within limits.
    """
    return kept_in(geometry.kept, "reach", lambda: _reach_ball(geometry))


def _reach_ball(geometry: ArmGeometry) -> Array:
    tables = arm_tables(geometry)
    bodies, poses = tables.bodies, tables.joint_poses
    center, anchor = poses[0, 9:], 0
    driven = [joint for joint in range(1, len(tables.joints)) if tables.joints[joint, 2] >= 0]
    if any(tables.joints[joint, 1] for joint in driven):
        return np.array([*center, np.inf])
    # The origin of a joint stays where it is while it lies on the axes of all joints before it.
    for joint in driven:
        chain = _driven_above(tables.joints, joint)
        if all(_is_on_axis(poses[joint, 9:], poses[j], tables.joint_values[j, 12:15]) for j in chain):
            center, anchor = poses[joint, 9:], joint
    radius = 0.0
    for body, at, ball in zip(bodies.bodies.tolist(), bodies.centers, bodies.values[:, 15], strict=True):
        points = [at]
        joint = body[1]
        # Down to the anchor: two points that one joint carries stay as far apart as they are.
        for j in reversed(_driven_above(tables.joints, joint, inclusive=True)):
            if j == anchor:
                break
            points.append(poses[j, 9:])
        points.append(center)
        radius = max(radius, _length(points) + float(ball))
    return np.array([*center, radius * _RELATIVE + _ROUNDING])


def _length(points: list[Array]) -> float:
    return float(np.linalg.norm(np.diff(np.array(points), axis=0), axis=1).sum())


def _driven_above(joints: NDArray[np.int64], joint: int, *, inclusive: bool = False) -> list[int]:
    """The driven joints between the world and a joint, root first."""
    chain = []
    at = joint if inclusive else int(joints[joint, 0])
    while at:
        if joints[at, 2] >= 0:
            chain.append(at)
        at = int(joints[at, 0])
    return chain[::-1]


def _is_on_axis(point: Array, pose: Array, axis: Array) -> bool:
    """Whether a point is on the axis of a joint, at q = 0, to a picometer."""
    arm = point - pose[9:]
    return float(np.linalg.norm(np.cross(pose[:9].reshape(3, 3) @ axis, arm))) < 1e-12


def placed_balls(balls: Array, bases: Array) -> Array:
    """Balls (n, 4) or (n, m, 4), each or each row moved by a transform of (n, 4, 4)."""
    centers = np.einsum("nij,n...j->n...i", bases[:, :3, :3], balls[..., :3])
    shift = bases[:, :3, 3] if balls.ndim == 2 else bases[:, None, :3, 3]
    return np.concatenate([centers + shift, balls[..., 3:]], axis=-1)


def obstacle_boxes(obstacles: Sequence[ObstacleGeometry]) -> Array:
    """Low and high corner of a box around each obstacle [m], infinite for a half-space, shape (n, 6)."""
    if not obstacles:
        return np.zeros((0, 6))
    boxes = np.concatenate([own.boxes for own in obstacle_tables(obstacles)])
    counts = np.array([len(obstacle.solids) for obstacle in obstacles])
    first = np.cumsum(counts) - counts
    low, high = np.minimum.reduceat(boxes[:, :3], first), np.maximum.reduceat(boxes[:, 3:], first)
    return np.concatenate([low, high], axis=1)


def ball_gaps(one: Array, two: Array) -> Array:
    """Gaps between balls [m], shape (n, m)."""
    distances = np.linalg.norm(one[:, None, :3] - two[None, :, :3], axis=2)
    return np.asarray(distances / _RELATIVE - one[:, None, 3] - two[None, :, 3] - _ROUNDING)


def near_balls(balls: Array, distance: float) -> NDArray[np.int64]:
    """Pairs of balls (n, 4) that are within a distance [m], ascending, shape (m, 2): sweep and prune along x."""
    low, high = balls[:, 0] - balls[:, 3] - distance - _ROUNDING, balls[:, 0] + balls[:, 3] + _ROUNDING
    order = np.argsort(low, kind="stable")
    # Those whose interval begins before the end of another's, and after its begin.
    ends = np.searchsorted(low[order], high[order], side="right")
    counts = ends - np.arange(len(order)) - 1
    one = np.repeat(np.arange(len(order)), counts)
    two = one + 1 + np.arange(len(one)) - np.repeat(np.cumsum(counts) - counts, counts)
    pairs = np.sort(np.column_stack([order[one], order[two]]), axis=1)
    a, b = balls[pairs[:, 0]], balls[pairs[:, 1]]
    gaps = np.linalg.norm(a[:, :3] - b[:, :3], axis=1) / _RELATIVE - a[:, 3] - b[:, 3] - _ROUNDING
    pairs = pairs[gaps <= distance]
    return np.asarray(pairs[np.lexsort(pairs.T[::-1])], np.int64)


def box_gaps(balls: Array, boxes: Array) -> Array:
    """Gaps between balls and boxes [m], shape (n, m)."""
    center = balls[:, None, :3]
    outside = np.maximum(np.maximum(boxes[None, :, :3] - center, center - boxes[None, :, 3:]), 0.0)
    return np.asarray(np.linalg.norm(outside, axis=2) / _RELATIVE - balls[:, None, 3] - _ROUNDING)
