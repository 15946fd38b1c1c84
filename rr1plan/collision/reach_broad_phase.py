"""The broad phase between arms: what can ever come near a moving arm, by balls that contain everything it can reach."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.collision.arm_geometry import ArmGeometry
from rr1plan.collision.obstacle_geometry import ObstacleGeometry, placed_arm
from rr1plan.collision.tables.arm_tables import arm_tables
from rr1plan.collision.tables.obstacle_tables import boxes_of
from rr1plan.object_cache import kept_in
from rr1plan.scene import Scene

FEW_OBSTACLES = 64
"""Up to this many obstacles, none is omitted, so that scenes with obstacles at different poses share their pairs."""
# Far above the rounding error of the sums here, relative and absolute [m].
_RELATIVE, _ROUNDING = 1.0 + 1e-9, 1e-9


@dataclass(frozen=True)
class Near:
    """Arms and obstacles that can come near the moving arms.

    Args:
        arms: Stationary arms.
        obstacles: Obstacles.
        near_pairs: Pairs of arms, and of arms and obstacles, that can come near each other. None: all pairs of moving
            arms and all pairs of moving arms and obstacles, without stationary arms.
        least_gap: All other pairs stay at least this far apart [m].
    """

    arms: tuple[str, ...]
    obstacles: tuple[str, ...]
    near_pairs: frozenset[frozenset[str]] | None
    least_gap: float


def find_near(
    scene: Scene,
    geometries: Mapping[str, ArmGeometry],
    obstacles: ObstacleGeometry,
    arms: tuple[str, ...],
    distance: float,
) -> Near:
    """Arms and obstacles that can come nearer than a distance to the moving arms in any configuration.

    Args:
        scene: The scene.
        geometries: Geometries of its arms.
        obstacles: Its obstacles, in their order.
        arms: The arms that move.
        distance: The distance [m].
    """
    if len(scene.arms) == 1 and len(scene.obstacles) <= FEW_OBSTACLES:
        return Near((), tuple(scene.obstacles), None, np.inf)
    others = [name for name in scene.arms if name not in set(arms)]
    balls = reach_balls(scene, geometries, arms)
    still = stationary_balls(scene, geometries, others)
    names = list(scene.obstacles)
    everyone = [*arms, *others, *names]
    boxes = obstacle_boxes(obstacles)
    gaps = np.concatenate([ball_gaps(balls, balls), ball_gaps(balls, still), box_gaps(balls, boxes)], axis=1)
    np.fill_diagonal(gaps, -np.inf)
    if len(names) <= FEW_OBSTACLES:
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


def reach_balls(scene: Scene, geometries: Mapping[str, ArmGeometry], arms: Sequence[str]) -> Array:
    """Balls that contain arms in every configuration: center and radius [m], shape (n, 4); see `reach_ball`."""
    own = [reach_ball(geometries[name]) for name in arms]
    return placed_balls(np.array(own).reshape(-1, 4), bases_of(scene, arms))


def stationary_balls(scene: Scene, geometries: Mapping[str, ArmGeometry], arms: Sequence[str]) -> Array:
    """Balls around arms in their configurations of the scene: center and radius [m], shape (n, 4)."""
    own = [placed_arm(geometries[name], scene.arms[name].q.tobytes()).ball for name in arms]
    return placed_balls(np.array(own).reshape(-1, 4), bases_of(scene, arms))


def bases_of(scene: Scene, arms: Sequence[str]) -> Array:
    """T_world_base of arms, shape (n, 4, 4)."""
    return np.array([scene.arms[name].base for name in arms]).reshape(-1, 4, 4)


def reach_ball(geometry: ArmGeometry) -> Array:
    """A ball that contains an arm in every configuration: center in the frame of its base and radius [m], shape (4,).

    The radius is infinite if a joint slides, because checked configurations need not be within limits.
    """
    balls = solid_reach(geometry)
    return np.array([*balls[0, :3], balls[:, 3].max()]) if len(balls) else np.array([0.0, 0.0, 0.0, _ROUNDING])


def solid_reach(geometry: ArmGeometry) -> Array:
    """Balls with a common center that contain each solid of an arm in every configuration, as `reach_ball`, (n, 4)."""
    return kept_in(geometry.kept, "reach", lambda: _solid_reach(geometry))


def _solid_reach(geometry: ArmGeometry) -> Array:
    tables = arm_tables(geometry)
    bodies, joints, poses = tables.bodies, tables.joints.tolist(), tables.joint_poses
    origins = poses[:, 9:].tolist()
    driven = [joint for joint, (_, _, column, _) in enumerate(joints) if joint and column >= 0]
    if any(joints[joint][1] for joint in driven):
        return np.tile([*origins[0], np.inf], (len(bodies.bodies), 1))
    above = {0: 0} | {joint: _carrier(joints, joints[joint][0]) for joint in driven}
    # The origin of a joint is fixed as long as it lies on the axes of all joints before it.
    axes = np.einsum("nij,nj->ni", poses[:, :9].reshape(-1, 3, 3), tables.joint_values[:, 12:15]).tolist()
    anchor = 0
    for joint in driven:
        before = above[joint]
        while before and _is_on_axis(origins[joint], origins[before], axes[before]):
            before = above[before]
        anchor = joint if not before else anchor
    center = origins[anchor]
    # The largest distance of each joint's origin from the center; the distance of two points on one link is constant.
    origins[0], beyond = center, {0: 0.0, anchor: 0.0}
    for joint in driven:
        before = above[joint]
        beyond.setdefault(joint, beyond[before] + math.dist(origins[joint], origins[before]))
    found = []
    rows = zip(bodies.bodies.tolist(), bodies.centers.tolist(), bodies.values[:, 15].tolist(), strict=True)
    for (_, carrier, *_), at, ball in rows:
        joint = _carrier(joints, carrier)
        radius = math.dist(at, origins[joint]) + beyond[joint] + ball
        found.append([*center, radius * _RELATIVE + _ROUNDING])
    return np.array(found).reshape(-1, 4)


def _carrier(joints: list[list[int]], joint: int) -> int:
    """The driven joint that carries a joint, 0 for the world."""
    while joint and joints[joint][2] < 0:
        joint = joints[joint][0]
    return joint


def _is_on_axis(point: list[float], origin: list[float], axis: list[float]) -> bool:
    """Whether a point is on the axis through an origin, to a picometer."""
    (x, y, z), (a, b, c) = (p - o for p, o in zip(point, origin, strict=True)), axis
    return math.hypot(b * z - c * y, c * x - a * z, a * y - b * x) < 1e-12


def placed_balls(balls: Array, bases: Array) -> Array:
    """Balls (n, 4) or (n, m, 4), each or each row moved by a transform of (n, 4, 4)."""
    centers = np.einsum("nij,n...j->n...i", bases[:, :3, :3], balls[..., :3])
    shift = bases[:, :3, 3] if balls.ndim == 2 else bases[:, None, :3, 3]
    return np.concatenate([centers + shift, balls[..., 3:]], axis=-1)


def obstacle_boxes(obstacles: ObstacleGeometry) -> Array:
    """Low and high corner of a box around each obstacle [m], infinite for a half-space, shape (n, 6)."""
    if not obstacles.counts:
        return np.zeros((0, 6))
    boxes, counts = boxes_of(obstacles), np.array(obstacles.counts)
    first = np.cumsum(counts) - counts
    low, high = np.minimum.reduceat(boxes[:, :3], first), np.maximum.reduceat(boxes[:, 3:], first)
    return np.concatenate([low, high], axis=1)


def ball_gaps(one: Array, two: Array) -> Array:
    """Gaps between balls [m], shape (n, m)."""
    return gaps_between(one[:, None], two[None])


def gaps_between(one: Array, two: Array) -> Array:
    """Gaps between each ball of one array and that of another one [m], shapes (..., 4)."""
    distances = np.linalg.norm(one[..., :3] - two[..., :3], axis=-1)
    return np.asarray(distances / _RELATIVE - one[..., 3] - two[..., 3] - _ROUNDING)


def near_balls(balls: Array, distance: float) -> NDArray[np.int64]:
    """Pairs of balls (n, 4) that are within a distance [m], ascending, shape (m, 2): sweep and prune along x."""
    low, high = balls[:, 0] - balls[:, 3] - distance - _ROUNDING, balls[:, 0] + balls[:, 3] + _ROUNDING
    order = np.argsort(low, kind="stable")
    # Those whose interval begins before the end of another one's, and after its start.
    ends = np.searchsorted(low[order], high[order], side="right")
    counts = ends - np.arange(len(order)) - 1
    one = np.repeat(np.arange(len(order)), counts)
    two = one + 1 + np.arange(len(one)) - np.repeat(np.cumsum(counts) - counts, counts)
    pairs = np.sort(np.column_stack([order[one], order[two]]), axis=1)
    pairs = pairs[gaps_between(balls[pairs[:, 0]], balls[pairs[:, 1]]) <= distance]
    return np.asarray(pairs[np.lexsort(pairs.T[::-1])], np.int64)


def box_gaps(balls: Array, boxes: Array) -> Array:
    """Gaps between balls and boxes [m], shape (n, m)."""
    center = balls[:, None, :3]
    outside = np.maximum(np.maximum(boxes[None, :, :3] - center, center - boxes[None, :, 3:]), 0.0)
    return np.asarray(np.linalg.norm(outside, axis=2) / _RELATIVE - balls[:, None, 3] - _ROUNDING)
