"""The first view of the page: a direction from which the motion is visible.

Directions around the arms are compared by the part of the motion that is hidden from a camera there. Points of the
moving links, of the tool along its path, and of the hands at the start, middle and end of the motion should be visible.
Rays from these points to the camera are intersected with the obstacles, for hands also with the links of all arms.
Boxes, balls, cylinders and capsules are exact; links are boxes; meshes and point clouds are sampled into a depth buffer
for each direction, which bounds their computation time. Mostly transparent obstacles hide nothing. Among equally
unobstructed directions, one half from the front and a little above is preferred.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, counted, finite_array, known_name, shape_of
from rr1plan.errors import InputError
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere
from rr1plan.transforms import inverse as inverse_pose

if TYPE_CHECKING:
    from rr1plan.robot import Robot
    from rr1plan.scene import Scene
    from rr1plan.trajectory import Trajectory

Mask = NDArray[np.bool_]
Point = tuple[float, float, float]

VIEWS: dict[str, Point] = {
    "front": (0.0, -1.0, 0.0),
    "back": (0.0, 1.0, 0.0),
    "left": (-1.0, 0.0, 0.0),
    "right": (1.0, 0.0, 0.0),
    "top": (0.0, 0.0, 1.0),
    "corner": (1.0, -1.0, 0.8),
}

_INSTANTS = 9  # of the motion, at which links and tools should be visible
_MOST_ARMS = 6  # considered; if more move, a sample of them
_MOVED = 1e-3  # of the arm's extent: a displacement beyond it counts as motion of a link
_REACH = 0.05  # of the same: beyond it the arms count as reaching to one side
_COSTS = {"links": 0.9, "tool": 0.5, "hand": 0.5}  # if all points of a kind are hidden
_HAND = 0.25  # share of the motion's radius: links nearer to the hand belong to it and do not hide it
# From the front; not exactly from the side, where the task would be seen edge-on.
_TURNS = np.radians([48, -48, 28, -28, 70, -70, 115, -115, 132, -132, 150, -150, 168, -168])
_HEIGHTS = np.radians([27.0, 40.0, 55.0, 72.0])  # above the horizon
_BATCHES = 7  # in which views are checked for occlusion by links
_DISTANCE = 5.5  # of the camera, in radii of the motion; the page adapts it to its window
_SOLID = 0.5  # opacity from which an obstacle occludes
_SAMPLES = 20_000  # of surfaces in the depth buffer
_CELLS = 25  # of the depth buffer along the radius of the motion


def check_view(view: Any) -> Point | None:
    """A view as a direction in world coordinates, from which the camera looks; None stays None.

    Args:
        view: A name of `VIEWS`; azimuth from +x towards +y and elevation above the xy plane [rad], shape (2,); or a
            direction in world coordinates, shape (3,).

    Raises:
        UnknownNameError: no such name.
        InputError: numbers that are neither angles nor a direction.
    """
    if view is None:
        return None
    if isinstance(view, str):
        return VIEWS[known_name("view", view, VIEWS)]
    if shape_of(view) == (2,):
        azimuth, elevation = finite_array("view", view, (2,)).tolist()
        if abs(azimuth) > 2.0 * math.pi or abs(elevation) > 0.5 * math.pi + 1e-3:
            raise InputError(
                f"view is azimuth {azimuth:g} and elevation {elevation:g}, expected angles [rad] of at most 2 pi and "
                f"pi / 2; for degrees try {math.radians(azimuth):.3g} and {math.radians(elevation):.3g}"
            )
        flat = math.cos(elevation)
        return (flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation))
    if len(shape_of(view)) == 1 and shape_of(view) != (3,):
        count = counted(shape_of(view)[0], "number")
        raise InputError(f"view has {count}, expected two angles, or three numbers that are a direction")
    x, y, z = finite_array("view", view, (3,)).tolist()
    if math.hypot(x, y, z) < 1e-9:
        raise InputError(f"view is the direction {x:g} {y:g} {z:g}, expected one that is not zero")
    return (x, y, z)


class Camera(NamedTuple):
    """The first view of a page.

    Args:
        direction: Direction from the target to the camera, in world coordinates.
        target: The point at which it looks, in world coordinates [m].
    """

    direction: Point
    target: Point


def choose_camera(scene: Scene, motion: Trajectory | None = None, ends: Iterable[tuple[str, object]] = ()) -> Camera:
    """A camera that sees most of the motion, or of the arms if there is none.

    Args:
        scene: The arms and obstacles.
        motion: The motion to be played, or None.
        ends: Without a motion: the drawn configurations of a query, each an arm and its configuration [rad or m], shape
            (nq,). Without either, the arms have their configurations in the scene.
    """
    sights = _sights(scene, *_configurations(scene, motion, ends))
    turn, height = (grid.ravel() for grid in np.meshgrid(_TURNS, _HEIGHTS))
    azimuth = sights.front + turn
    directions = np.column_stack([np.cos(height) * np.cos(azimuth), np.cos(height) * np.sin(azimuth), np.sin(height)])
    # A little occlusion is better than an unusual direction.
    cost = 0.07 * np.abs(np.abs(turn) - _TURNS[0]) + 0.04 * (turn < 0.0) + 0.3 * (height - _HEIGHTS[0])
    if len(sights.points) == 0:
        return Camera(_as_point(directions[np.argmin(cost)]), (0.0, 0.0, 0.0))
    low, high = sights.points.min(axis=0), sights.points.max(axis=0)
    target, radius = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low)) or 1.0
    eyes = target + _DISTANCE * radius * directions
    hidden = behind_obstacles(scene, sights.points, eyes)
    cost += hidden @ sights.costs
    order = np.argsort(cost, kind="stable")
    best, least = order[0], math.inf
    # Links only add to the cost: directions already worse than the best complete one need no check of links.
    for few in np.array_split(order, _BATCHES):
        if cost[few[0]] >= least:
            break
        total = cost[few] + (_behind_links(sights, eyes[few], _HAND * radius) & ~hidden[few]) @ sights.costs
        if total.min() < least:
            best, least = few[np.argmin(total)], float(total.min())
    return Camera(_as_point(directions[best]), _as_point(target))


def _as_point(at: Array) -> Point:
    x, y, z = at.tolist()
    return (x, y, z)


# ---- visible points ----------------------------------------------------------------------------


class _Sights(NamedTuple):
    """The points of the motion that should be visible, and the links that may hide them.

    Args:
        points: Points in world coordinates [m], shape (n, 3).
        costs: Cost of each point if hidden, shape (n,).
        hands: For each point the instant at which links may hide it, -1 if links are ignored, shape (n,).
        boxes: Half edges of boxes around the shapes of links, shape (b, 3).
        box_poses: Their poses at each instant, T_world_box, shape (b, instants, 4, 4).
        front: Azimuth toward which the arms reach [rad].
    """

    points: Array
    costs: Array
    hands: NDArray[np.int_]
    boxes: Array
    box_poses: Array
    front: float


def _sights(scene: Scene, configurations: list[dict[str, Array]], moved: list[str]) -> _Sights:
    moved = [moved[k] for k in np.unique(np.linspace(0, len(moved) - 1, _MOST_ARMS).astype(int))] if moved else []
    others = [name for name in scene.arms if name not in moved]
    rows: list[tuple[Array, str, int]] = []
    boxes: list[Array] = []
    box_poses: list[Array] = []
    reach = np.zeros(2)
    for name in [*moved, *others][:_MOST_ARMS]:
        arm = scene.arms[name]
        poses = [arm.robot.link_poses(configuration[name]) for configuration in configurations]
        parts = _link_boxes(arm.robot)
        placed = np.array([[arm.base @ at[link] @ T for at in poses] for link, T, _ in parts])
        placed = placed.reshape(-1, len(poses), 4, 4)
        boxes += [half for _, _, half in parts]
        box_poses += list(placed)
        if name not in moved:
            continue
        tools = (arm.base @ np.array([at[arm.robot.tool] for at in poses]))[:, :3, 3]
        middles = placed[..., :3, 3].swapaxes(0, 1)
        size = float(np.linalg.norm(np.vstack([middles.reshape(-1, 3), tools]) - arm.base[:3, 3], axis=1).max()) or 1.0
        moves = np.ptp(middles, axis=0).max(axis=-1) > _MOVED * size if len(poses) > 1 else np.full(len(parts), True)
        rows += [(middles[::2, moves].reshape(-1, 3), "links", -1), (tools, "tool", -1)]
        for instant in sorted({0, len(poses) // 2, len(poses) - 1}):
            near = np.argsort(np.linalg.norm(middles[instant] - tools[instant], axis=-1))[:2]
            rows.append((np.vstack([tools[[instant]], middles[instant, near]]), "hand", instant))
        reach += (tools[:, :2] - arm.base[:2, 3]).mean(axis=0) / len(moved) / size
    return _Sights(
        np.concatenate([points for points, _, _ in rows] or [np.zeros((0, 3))]),
        np.concatenate(
            [np.full(len(p), _COSTS[kind] / max(1, len(p) * len(moved))) for p, kind, _ in rows] or [np.zeros(0)]
        ),
        np.concatenate([np.full(len(p), instant) for p, _, instant in rows] or [np.zeros(0, dtype=int)]),
        np.array(boxes).reshape(-1, 3),
        np.array(box_poses).reshape(-1, len(configurations), 4, 4),
        math.atan2(reach[1], reach[0]) if np.linalg.norm(reach) > _REACH else -0.5 * math.pi,
    )


def _configurations(
    scene: Scene, motion: Trajectory | None, ends: Iterable[tuple[str, Any]]
) -> tuple[list[dict[str, Array]], list[str]]:
    """The configuration of every arm at each instant, and the arms that move (all if there is no motion)."""
    if not scene.arms or motion is None:
        rest = {name: arm.q for name, arm in scene.arms.items()}
        asked = [(name, np.asarray(q, dtype=float)) for name, q in ends]
        return [rest | {name: q} for name, q in asked] or [rest], list(dict(asked)) or list(rest)
    names, q = scene.joint_names(), scene.configuration()
    columns = [names.index(joint) for joint in motion.joint_names]
    configurations = []
    for t in np.linspace(motion.breaks[0], motion.breaks[-1], _INSTANTS):
        q[columns] = motion(float(t))
        configurations.append(scene.split(q.copy()))
    return configurations, [name for name in scene.arms if name in motion.arms]


def _link_boxes(robot: Robot) -> list[tuple[str, Array, Array]]:
    """Boxes around the shapes of links: the link, T_link_box and half edges [m]."""
    boxes = []
    for link in robot.links:
        for g in link.collisions or link.visuals:
            middle, half = _box_around(g.shape)
            T = g.pose.copy()
            T[:3, 3] += T[:3, :3] @ middle
            boxes.append((link.name, T, half))
    return boxes


def _box_around(shape: Shape) -> tuple[Array, Array]:
    """Center and half edges of the box around a shape, in its coordinates [m]."""
    match shape:
        case Box():
            return np.zeros(3), 0.5 * np.array(shape.size)
        case Sphere():
            return np.zeros(3), np.full(3, shape.radius)
        case Cylinder():
            return np.zeros(3), np.array([shape.radius, shape.radius, 0.5 * shape.length])
        case Capsule():
            return np.zeros(3), np.array([shape.radius, shape.radius, 0.5 * shape.length + shape.radius])
        case HalfSpace():
            return np.zeros(3), np.zeros(3)
        case Mesh() | PointCloud():
            points = shape.vertices if isinstance(shape, Mesh) else shape.points
            low, high = points.min(axis=0), points.max(axis=0)
            return 0.5 * (low + high), 0.5 * (high - low)


# ---- occlusion ---------------------------------------------------------------------------------


def behind_obstacles(scene: Scene, points: Array, eyes: Array) -> Mask:
    """Which points (n, 3) obstacles hide from a camera at each of the eyes (v, 3), shape (v, n)."""
    hidden = np.zeros((len(eyes), len(points)), dtype=bool)
    low, high = points.min(axis=0), points.max(axis=0)
    middle, radius = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low)) or 1.0
    triangles: list[Array] = []
    surfaces: list[tuple[Array, float]] = []
    for obstacle in scene.obstacles.values():
        for g in obstacle.geometries:
            if g.color is not None and g.color[3] < _SOLID:
                continue
            T = obstacle.pose @ g.pose
            if isinstance(g.shape, Mesh):
                triangles.append(_apply(T, g.shape.vertices)[g.shape.faces])
            elif isinstance(g.shape, PointCloud):
                surfaces.append((_apply(T, g.shape.points), g.shape.resolution))
            else:
                inverse = inverse_pose(T)
                local = _apply(inverse, points)
                hidden |= _meets(g.shape, local, _apply(inverse, eyes)[:, None] - local)
    if triangles:
        surfaces.append(_sample(np.concatenate(triangles), middle, 4.0 * radius))
    for samples, spacing in surfaces:
        for view, eye in enumerate(eyes):
            hidden[view] |= _behind_samples(points, samples, eye, middle, max(2.0 * spacing, radius / _CELLS))
    return hidden


def _behind_links(sights: _Sights, eyes: Array, near: float) -> Mask:
    """Which points at hands are hidden by links from each of the eyes (v, 3), shape (v, n); near links do not count."""
    hidden = np.zeros((len(eyes), len(sights.points)), dtype=bool)
    (at,) = np.nonzero(sights.hands >= 0)
    points, instants = sights.points[at], sights.hands[at]
    for half, poses in zip(sights.boxes, sights.box_poses, strict=True):
        T = poses[instants]
        turn = T[:, :3, :3]
        local = np.einsum("nji,nj->ni", turn, points - T[:, :3, 3])
        far = np.linalg.norm(points - T[:, :3, 3], axis=-1) > near
        d = np.einsum("nji,vnj->vni", turn, eyes[:, None] - points)
        hidden[:, at] |= _overlaps(*_slabs(local, d, half)) & far
    return hidden


def _apply(T: Array, points: Array) -> Array:
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])


def _meets(shape: Shape, points: Array, d: Array) -> Mask:
    """Which segments from points (n, 3) along d (v, n, 3), in the shape's coordinates, hit the shape, shape (v, n)."""
    match shape:
        case Box():
            return _overlaps(*_slabs(points, d, 0.5 * np.array(shape.size)))
        case Sphere():
            return _meets_ball(points, d, shape.radius)
        case Cylinder():
            return _meets_cylinder(points, d, shape.radius, shape.length)
        case Capsule():
            end = np.array([0.0, 0.0, 0.5 * shape.length])
            balls = _meets_ball(points - end, d, shape.radius) | _meets_ball(points + end, d, shape.radius)
            return balls | _meets_cylinder(points, d, shape.radius, shape.length)
        case _:  # a half-space, which the page draws as its floor or as a transparent plane
            return np.zeros(d.shape[:2], dtype=bool)


def _slabs(points: Array, d: Array, half: Array) -> tuple[Array, Array]:
    """The part of each segment with all coordinates within +-half: from and to, as fractions, (v, n)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (-half - points) / d, (half - points) / d
    return np.minimum(first, second).max(axis=-1), np.maximum(first, second).min(axis=-1)


def _overlaps(start: Array, end: Array) -> Mask:
    return np.asarray((start <= end) & (end > 0.0) & (start < 1.0))


def _meets_ball(points: Array, d: Array, radius: float) -> Mask:
    part = np.clip(-(points * d).sum(axis=-1) / np.maximum((d * d).sum(axis=-1), 1e-12), 0.0, 1.0)
    return np.asarray(((points + part[..., None] * d) ** 2).sum(axis=-1) <= radius**2)


def _meets_cylinder(points: Array, d: Array, radius: float, length: float) -> Mask:
    across, flat = points[:, :2], d[..., :2]
    a, b = np.maximum((flat * flat).sum(axis=-1), 1e-12), (across * flat).sum(axis=-1)
    discriminant = b * b - a * ((across * across).sum(axis=-1) - radius**2)
    root = np.sqrt(np.maximum(discriminant, 0.0))
    start, end = _slabs(points[:, 2:], d[..., 2:], np.array([0.5 * length]))
    meets = _overlaps(np.maximum((-b - root) / a, start), np.minimum((-b + root) / a, end))
    return np.asarray(meets & (discriminant >= 0.0))


def _sample(triangles: Array, middle: Array, reach: float) -> tuple[Array, float]:
    """Points on triangles (n, 3, 3) near the motion, equally dense everywhere, and their spacing [m]."""
    rng = np.random.default_rng(0)
    a, b, c = triangles.transpose(1, 0, 2)
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=-1) + 1e-15
    drawn = rng.choice(len(areas), 3 * _SAMPLES, p=areas / areas.sum())
    u, v = rng.random((2, len(drawn), 1))
    fold = u + v > 1.0
    u, v = np.where(fold, 1.0 - u, u), np.where(fold, 1.0 - v, v)
    samples = a[drawn] + u * (b - a)[drawn] + v * (c - a)[drawn]
    near = samples[(np.abs(samples - middle) < reach).all(axis=-1)]
    density = len(drawn) / areas.sum() * min(1.0, _SAMPLES / max(1, len(near)))
    return near[:_SAMPLES], float(density**-0.5)


def _behind_samples(points: Array, samples: Array, eye: Array, middle: Array, cell: float) -> Mask:
    """Which points (n, 3) have a sample of a surface between them and the eye, by a depth buffer; shape (n,)."""
    axis = eye - middle
    far = float(np.linalg.norm(axis))
    axis = axis / far
    right = np.cross([0.0, 0.0, 1.0], axis)
    right = right / np.linalg.norm(right)
    frame = np.column_stack([right, np.cross(axis, right), axis])

    def seen(at: Array) -> tuple[Array, Array]:
        local = (at - middle) @ frame
        local = local[local[:, 2] < 0.99 * far]
        return local[:, :2] * (far / (far - local[:, 2:])), local[:, 2]

    places, depths = seen(points)
    corner = places.min(axis=0)
    size = ((places.max(axis=0) - corner) / cell).astype(int) + 1
    cells = ((places - corner) / cell).astype(int)
    places, nearer = seen(samples)
    held = np.floor((places - corner) / cell).astype(int)
    inside = ((held >= 0) & (held < size)).all(axis=1)
    buffer = np.full(size, -np.inf)
    np.maximum.at(buffer, tuple(held[inside].T), nearer[inside])
    # Within two cells of a surface a point may be on it.
    return np.asarray(buffer[tuple(cells.T)] > depths + 2.0 * cell)
