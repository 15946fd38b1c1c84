"""Sphere tables of the moving bodies: made once for an arm's geometry, and joined for the arms of a scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.collision.arm_geometry import ArmGeometry, ArmInstances
from rr1plan.collision.convex.bounding_spheres import SphereCover, cover
from rr1plan.collision.convex.convex_cores import NO_CORES, Cores, CoreTables, core_points, core_radius
from rr1plan.collision.convex.enclosing_ball import ball_reach, enclosing_ball
from rr1plan.collision.tables.arm_tables import ArmTables, arm_tables, joint_motion, moved
from rr1plan.kernels.planner_kernels import CStruct, constants
from rr1plan.model.kinematic_chain import turned_to
from rr1plan.object_cache import kept_in

_INTS = NDArray[np.int64]
_LANES = constants()["LANES"]
# No ball inside: a ball around the whole body is not inside it.
_NOTHING = -1e12
# Above the rounding error of corners in a joint's frame [m].
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class LinkSpheres:
    """Tables of the moving bodies, as in `arm_geometry.h`.

    Args:
        joints: Parent (0: the world), 1 for prismatic, column; row 0 is the world, shape (j, 3).
        joint_values: T_parent_joint with z along the axis (12) and gain, shape (j, 13).
        bodies: Joint, first and last sphere (the first is the ball around all), group; shape (b, 4).
        groups: Groups of bodies that one joint carries: joint, ball around all of them (for a single body, its own),
            first and last body, first and last entry of the chain; shape (g, 6).
        group_boxes: The box around each group in its joint's axes, low and high corner relative to the center of its
            ball [m], shape (g, 6).
        spheres: Center in the joint's frame, radius, radius of the ball inside [m]; those of bodies, then the balls
            around groups; shape (s, 5).
        chain: Joints above each group, root first.
        chain_reach: For each, largest distance of the group's points from the joint's axis, prismatic joints at zero
            [m].
        cores: The cores of the bodies, in their order.
        body: Index in `bodies` of each solid of the arms, -1 for fixed solids, shape (n,).
    """

    joints: _INTS
    joint_values: Array
    bodies: _INTS
    groups: _INTS
    group_boxes: Array
    spheres: Array
    chain: _INTS
    chain_reach: Array
    cores: CoreTables
    body: _INTS

    @cached_property
    def rounding(self) -> float:
        """Bound of the rounding error of a gap between two bodies [m]."""
        return 1e-9 + 1e-12 * float(np.abs(self.joint_values[:, 9:12]).sum())

    @cached_property
    def longest_chain(self) -> int:
        """The most joints above a group."""
        return int((self.groups[:, 5] - self.groups[:, 4]).max(initial=0))

    @cached_property
    def largest_group(self) -> int:
        """The most bodies of a group."""
        return int((self.groups[:, 3] - self.groups[:, 2]).max(initial=0))

    def struct(self) -> CStruct:
        """The tables as a C struct, with the cores of the bodies."""
        depths, blocks, reach = _chain_tables(self)
        return CStruct(
            "ArmGeometry",
            joint_count=len(self.joints),
            body_count=len(self.bodies),
            group_count=len(self.groups),
            joints=self.joints,
            placements=self.joint_values,
            bodies=self.bodies,
            groups=self.groups,
            group_boxes=self.group_boxes,
            spheres=self.spheres,
            chain=self.chain,
            depths=depths,
            group_blocks=blocks,
            reach=reach,
            group_stride=len(blocks) * _LANES,
            **self.cores.fields(),
        )


def _chain_tables(tables: LinkSpheres) -> tuple[_INTS, _INTS, Array]:
    """Number of driven joints above each joint, and the kernel's `group_blocks` and `reach`."""
    depths = np.zeros(len(tables.joints), np.int64)
    for j, parent in enumerate(tables.joints[1:, 0].tolist(), 1):
        depths[j] = depths[parent] + (parent > 0)
    group = np.repeat(np.arange(len(tables.groups)), tables.groups[:, 5] - tables.groups[:, 4])
    first = np.full(-(-len(tables.groups) // _LANES), len(tables.joints), np.int64)
    last = np.zeros_like(first)
    np.minimum.at(first, group // _LANES, tables.chain)
    np.maximum.at(last, group // _LANES, tables.chain + 1)
    rows = np.cumsum(last - first) - (last - first)
    reach = np.full((int((last - first).sum()), _LANES), -1.0)
    reach[rows[group // _LANES] + tables.chain - first[group // _LANES], group % _LANES] = tables.chain_reach
    return depths, np.column_stack([first, last, rows]), reach


# ---- all arms of a scene ---------------------------------------------------------------------------


def instance_spheres(instances: ArmInstances) -> LinkSpheres:
    """The tables of all moving arms, made once."""
    return kept_in(instances.kept, "spheres", lambda: _instance_spheres(instances))


def _instance_spheres(instances: ArmInstances) -> LinkSpheres:
    made = kept_in(instances.unplaced, "spheres", lambda: _joined_spheres(instances))
    values, row = made.joint_values.copy(), 1
    for geometry, base in zip(instances.geometries, instances.bases, strict=True):
        parents = arm_spheres(geometry).joints[1:, 0]
        roots = row + np.flatnonzero(parents == 0)
        values[roots, :12] = moved(base, values[roots, :12])
        row += len(parents)
    return replace(made, joint_values=read_only(values))


def _joined_spheres(instances: ArmInstances) -> LinkSpheres:
    """The tables of all arms, their bases at the origin."""
    joints, values = [np.zeros((1, 3), np.int64)], [np.zeros((1, 13))]
    bodies, groups, spheres = [np.zeros((0, 4), np.int64)], [np.zeros((0, 6), np.int64)], [np.zeros((0, 5))]
    group_boxes = [np.zeros((0, 6))]
    chains, reaches, body = [np.zeros(0, np.int64)], [np.zeros(0)], [np.zeros(0, np.int64)]
    cores, first_core = _SharedCores(), [np.zeros((0, 7), np.int64)]
    core_values = [np.zeros((0, 14))]
    # Joints, bodies, groups, spheres and chain entries of the previous arms.
    joint = row = group = sphere = link = 0
    for geometry, column in zip(instances.geometries, instances.first_column, strict=True):
        own = arm_spheres(geometry)
        rows = own.joints[1:].copy()
        rows[rows[:, 0] != 0, 0] += joint
        rows[:, 2] += column
        joints.append(rows)
        values.append(own.joint_values[1:])
        bodies.append(own.bodies + np.array([joint, sphere, sphere, group]))
        groups.append(own.groups + np.array([joint, sphere, row, row, link, link]))
        group_boxes.append(own.group_boxes)
        spheres.append(own.spheres)
        chains.append(own.chain + joint)
        reaches.append(own.chain_reach)
        body.append(np.where(own.body < 0, -1, own.body + row))
        first_core.append(own.cores.rows + cores.first(geometry, own.cores) + np.array([joint, 0, 0, 0, 0, 0, 0]))
        core_values.append(own.cores.values)
        joint, row, group = joint + len(rows), row + len(own.bodies), group + len(own.groups)
        sphere, link = sphere + len(own.spheres), link + len(own.chain)
    return LinkSpheres(
        read_only(np.concatenate(joints)),
        read_only(np.concatenate(values)),
        read_only(np.concatenate(bodies)),
        read_only(np.concatenate(groups)),
        read_only(np.concatenate(group_boxes)),
        read_only(np.concatenate(spheres)),
        read_only(np.concatenate(chains)),
        read_only(np.concatenate(reaches)),
        CoreTables(*map(read_only, (np.concatenate(first_core), np.concatenate(core_values), *cores.joined()))),
        read_only(np.concatenate(body)),
    )


class _SharedCores:
    """Points of cores with blocks and support tables, stored once for each geometry."""

    def __init__(self) -> None:
        self._first: dict[ArmGeometry, _INTS] = {}
        self._parts = [NO_CORES]
        self._end = np.zeros(7, np.int64)

    def first(self, geometry: ArmGeometry, cores: CoreTables) -> _INTS:
        """Offsets of the rows of a geometry's cores, shape (7,)."""
        if geometry not in self._first:
            self._first[geometry] = self._end.copy()
            self._parts.append(cores)
            points, blocks, words = len(cores.points), len(cores.blocks), len(cores.lowest)
            self._end += np.array([0, points, points, 0, blocks, words, 0])
        return self._first[geometry]

    def joined(self) -> tuple[Array, Array, _INTS]:
        """Points, blocks and support tables."""
        points, blocks, lowest = (
            np.concatenate(parts) for parts in zip(*(part[2:] for part in self._parts), strict=True)
        )
        return points, blocks, lowest


# ---- one arm, in the frame of its base -------------------------------------------------------------


def arm_spheres(geometry: ArmGeometry) -> LinkSpheres:
    """The tables of an arm's moving bodies, made once."""
    return kept_in(geometry.kept, "spheres", lambda: _arm_spheres(geometry))


@dataclass(frozen=True, eq=False)
class _Joints:
    """The driven joints alone, each turning about or sliding along its z axis.

    `carrier[j]` is the driven joint that carries joint j of the model (0: the world), and `offset[j]` the pose of joint
    j in the frame of that joint.
    """

    rows: _INTS
    values: Array
    carrier: list[int]
    offset: list[Array]


def _arm_spheres(geometry: ArmGeometry) -> LinkSpheres:
    joints = _driven_joints(arm_tables(geometry))
    body = np.where(geometry.groups > 0, np.cumsum(geometry.groups > 0) - 1, -1)
    moving = [solid for solid, group in zip(geometry.solids, geometry.groups, strict=True) if group > 0]
    bodies, spheres = np.zeros((len(moving), 4), np.int64), [np.zeros((0, 5))]
    chains: list[list[int]] = []
    reaches: list[list[float]] = []
    boxes = np.zeros((len(moving), 6))
    cores = Cores()
    first = 0
    for i, solid in enumerate(moving):
        T = joints.offset[solid.joint] @ solid.placement
        rows = _sphere_rows(cover(solid.shape), T)
        above = []
        joint = joints.carrier[solid.joint]
        while joint:
            above.append(joint)
            joint = int(joints.rows[joint, 0])
        bodies[i] = above[0], first, first + len(rows), 0
        spheres.append(rows)
        chains.append(above[::-1])
        cores.add(above[0], solid.shape, T)
        corners = core_points(solid.shape) @ T[:3, :3].T + T[:3, 3]
        boxes[i, :3] = corners.min(axis=0) - core_radius(solid.shape) - _ROUNDING
        boxes[i, 3:] = corners.max(axis=0) + core_radius(solid.shape) + _ROUNDING
        reaches.append(_reaches(joints, above, np.concatenate([rows[:, :3], corners])))
        first += len(rows)
    bodies, groups, all_spheres, chain, reach = _group(bodies, np.concatenate(spheres), chains, reaches)
    centers = all_spheres[groups[:, 1], :3]
    group_boxes = np.column_stack(
        [
            np.minimum.reduceat(boxes[:, :3], groups[:, 2]) - centers,
            np.maximum.reduceat(boxes[:, 3:], groups[:, 2]) - centers,
        ]
    )
    return LinkSpheres(
        read_only(joints.rows),
        read_only(joints.values),
        read_only(bodies),
        read_only(groups),
        read_only(group_boxes),
        read_only(all_spheres),
        read_only(chain),
        read_only(reach),
        cores.tables(),
        read_only(body),
    )


def group_rows(frames: list[int], chains: list[list[int]], reaches: list[list[float]]) -> tuple[_INTS, _INTS, Array]:
    """Groups of consecutive bodies on one joint.

    Args:
        frames: The joint that carries each body.
        chains: Joints above each body, root first.
        reaches: For each of those, largest distance of points of the body from the joint's axis [m].

    Returns:
        The kernel's `groups` without balls, its `chain` and its `chain_reach`.
    """
    begins = [b for b in range(len(frames)) if b == 0 or frames[b] != frames[b - 1]]
    rows = []
    chain: list[int] = []
    reach: list[float] = []
    for first, last in pairwise([*begins, len(frames)]):
        rows.append((frames[first], -1, first, last, len(chain), len(chain) + len(chains[first])))
        chain += chains[first]
        reach += np.max(reaches[first:last], axis=0).tolist()
    return np.array(rows, np.int64).reshape(-1, 6), np.array(chain, np.int64), np.array(reach, np.float64)


def _group(
    bodies: _INTS, spheres: Array, chains: list[list[int]], reaches: list[list[float]]
) -> tuple[_INTS, _INTS, Array, _INTS, Array]:
    """Bodies with their groups, the groups, spheres with the balls around groups, and the chains with their reach."""
    groups, chain, reach = group_rows(bodies[:, 0].tolist(), chains, reaches)
    rows = [spheres]
    for g, (_, _, first, last, _, _) in enumerate(groups.tolist()):
        bodies[first:last, 3] = g
        balls = bodies[first:last, 1]
        if last - first == 1:
            groups[g, 1] = balls[0]
            continue
        within = np.setdiff1d(np.arange(balls[0], bodies[last - 1, 2]), balls)
        groups[g, 1] = len(spheres) + len(rows) - 1
        ball = enclosing_ball(spheres[within, :4])
        # The balls around the bodies contain them too.
        ball[3] = min(ball[3], ball_reach(spheres[balls, :4], ball[:3]).max() * (1.0 + 1e-9))
        rows.append(np.array([[*ball, _NOTHING]]))
    return bodies, groups, np.concatenate(rows), chain, reach


def _driven_joints(tables: ArmTables) -> _Joints:
    rows, values = [(0, 0, 0)], [np.zeros(13)]
    carrier, offset = [0], [np.eye(4)]
    for (parent, prismatic, column, _), row in zip(tables.joints[1:].tolist(), tables.joint_values[1:], strict=True):
        T = offset[parent] @ joint_motion(prismatic, row)
        axis, gain = row[12:15], row[15]
        if column < 0:
            carrier.append(carrier[parent])
            offset.append(T)
            continue
        turn = turned_to(axis)
        rows.append((carrier[parent], prismatic, column))
        T = T @ turn
        values.append(np.array([*T[:3, :3].ravel(), *T[:3, 3], gain]))
        carrier.append(len(rows) - 1)
        offset.append(turn.T)
    return _Joints(np.array(rows, np.int64), np.array(values), carrier, offset)


def _sphere_rows(made: SphereCover, T: Array) -> Array:
    """The ball around a solid, then its spheres, in the frame of the joint that carries it."""
    centers = np.concatenate([made.ball[None, :3], made.centers])
    radii = np.array([made.ball[3], *made.radii])
    inner = np.array([_NOTHING, *np.maximum(made.inner, _NOTHING)])
    return np.column_stack([centers @ T[:3, :3].T + T[:3, 3], radii, inner])


def _reaches(joints: _Joints, above: list[int], points: Array) -> list[float]:
    """Largest distance of a body's points from the axis of each joint of its chain [m], root first."""
    reach = [float(np.hypot(points[:, 0], points[:, 1]).max())]
    beyond = float(np.linalg.norm(points, axis=1).max())
    for joint in above[:-1]:
        x, y, z = joints.values[joint, 9:12]
        reach.append(float(np.hypot(x, y)) + beyond)
        beyond += float(np.linalg.norm([x, y, z]))
    return [r * (1.0 + 1e-9) + 1e-9 for r in reach[::-1]]
