"""The arrays that the exact kernel reads: rows of the moving arms, then rows of solids that do not move.

Rows of an arm are shared by all arms with its geometry, and a scene's tables by all margins.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.collision.arm_geometry import ArmInstances, arm_instances
from rr1plan.collision.collision_geometry import CollisionGeometry, SolidPairs
from rr1plan.collision.convex.mesh_trees import NO_MESHES, MeshTree
from rr1plan.collision.obstacle_geometry import ObstacleGeometry
from rr1plan.collision.tables.arm_tables import instance_tables
from rr1plan.collision.tables.body_tables import FAR, BodyTables
from rr1plan.collision.tables.obstacle_tables import FixedSolids
from rr1plan.kernels.planner_kernels import CStruct
from rr1plan.object_cache import kept_in

_INTS = NDArray[np.int64]
# Smallest capacity for open pairs and intervals of the exact kernel; a power of two.
_QUEUE = 1 << 15
# Initial capacity for the coefficients of a curve.
_TERMS = 8


class ExactTables(NamedTuple):
    """Bodies and pairs for the exact kernel (`exact_tables.h`).

    Args:
        joints: Parent, 1 for prismatic, column (or -1), 1 if this joint or one above it is driven; row 0 is the world,
            shape (n, 4).
        joint_values: T_parent_joint (12), axis (3), gain, offset; shape (n, 17).
        bodies: Kind, joint, first and last corner (for a mesh its number), first and last entry of its chain;
            shape (b, 6).
        body_values: T_joint_body (12), center of its ball in the joint's frame (3), radius of the ball, radius around
            the core, center (3) and half sizes (3) of its box in its own frame, size (3; for a half-space its normal),
            offset of a half-space; shape (b, 27).
        corners: Corner points of all bodies of kind BODY_CORNERS, centers of the cells of BODY_CELLS, shape (c, 3).
        links: Neighbors of corner i are links[links[i] : links[i + 1]].
        chain: Driven joints above each body, root first.
        chain_reach: For each of these joints, bound of the distance of the body's ball center from the joint's axis
            [m].
        pairs: Body, body (the half-space or cloud, if there is one), number of joints that their chains share; shape
            (p, 3).
        padding: Distance to keep [m], shape (p,).
        joint_poses: World poses of joints at q = 0: rotation row by row, then origin; shape (n, 12).
        poses: Likewise for bodies, shape (b, 12).
        centers: Centers of their balls, shape (b, 3).
        meshes: Triangles of all bodies of kind BODY_MESH.
    """

    joints: _INTS
    joint_values: Array
    bodies: _INTS
    body_values: Array
    corners: Array
    links: _INTS
    chain: _INTS
    chain_reach: Array
    pairs: _INTS
    padding: Array
    joint_poses: Array
    poses: Array
    centers: Array
    meshes: MeshTree

    def levers(self, body: int, travel: Array) -> Iterator[tuple[int, float]]:
        """The column of each driven joint above a body, root first, and a bound of the displacement for its change.

        Args:
            body: Index of the body.
            travel: Largest absolute value that each column of q takes [rad or m], shape (nq,).

        Returns:
            Columns and levers [m/rad, or m/m].
        """
        *_, first, behind = self.bodies[body].tolist()
        radius = float(self.body_values[body, 15])
        for k in range(first, behind):
            _, slides, column, _ = self.joints[self.chain[k]].tolist()
            gain = abs(float(self.joint_values[self.chain[k], 15]))
            reach = float(self.chain_reach[k])
            if not slides and reach >= FAR:  # a prismatic joint follows, whose travel counts here
                reach = self._stretched(body, k, travel)
            yield column, gain * (1.0 if slides else reach + radius)

    def _stretched(self, body: int, k: int, travel: Array) -> float:
        """Bound of the distance of a body's ball center from joint k of the chain [m]: all links between in a line."""
        behind = int(self.bodies[body, -1])
        reach = float(np.linalg.norm(self.body_values[body, 12:15]))
        for joint in self.chain[k + 1 : behind].tolist():
            _, slides, column, _ = self.joints[joint].tolist()
            reach += float(np.linalg.norm(self.joint_values[joint, 9:12]))
            if slides:
                gain, offset = np.abs(self.joint_values[joint, 15:]).tolist()
                reach += gain * min(float(travel[column]), FAR) + offset
        return reach

    def pair_levers(self, travel: Array) -> Array:
        """Bounds of the relative displacement of each pair's bodies for a change of each column, shape (p, nq).

        Args:
            travel: Largest absolute value that each column of q takes [rad or m], shape (nq,).

        Returns:
            Levers [m/rad, or m/m].
        """
        rows = np.zeros((len(self.pairs), len(travel)))
        for row, (first, second, shared) in zip(rows, self.pairs.tolist(), strict=True):
            for body in (first, second):
                if 0 <= body < len(self.bodies):
                    # Joints that carry both bodies do not move them relative to each other.
                    for column, lever in islice(self.levers(body, travel), shared, None):
                        row[column] += lever
        return rows


def build_tables(geometry: CollisionGeometry, fixed: FixedSolids, padding: Array) -> ExactTables:
    """Tables of the pairs that move relative to each other.

    Args:
        geometry: The moving arms and their pairs.
        fixed: The solids that do not move.
        padding: Distance to keep for each pair [m], shape (m,).

    Raises:
        InputError: a half-space or a point cloud that would have to be checked against another one.
    """
    geometry.check_kinds()
    return _tables(geometry.instances, fixed, geometry.pairs.moving_rows, padding)


def build_static_tables(tables: ExactTables, pairs: SolidPairs, padding: Array) -> ExactTables | None:
    """Tables of the pairs with a fixed relative pose; None if the kernel cannot measure some of them.

    Args:
        tables: Tables of the moving pairs.
        pairs: All pairs.
        padding: Distance to keep for each static pair [m], shape (m,).
    """
    if pairs.surfaceless[pairs.static].all(axis=1).any():
        return None
    return tables._replace(pairs=pairs.static_rows, padding=padding)


def build_fixed_tables(objects: ObstacleGeometry, pairs: _INTS, padding: Array) -> ExactTables | None:
    """Tables of objects that do not move; None if the kernel cannot measure some pairs.

    Args:
        objects: The objects.
        pairs: Pairs of their solids, numbered object after object [index], shape (m, 2).
        padding: Distance to keep for each [m], shape (m,).
    """
    surfaceless = objects.surfaceless[pairs]
    if surfaceless.all(axis=1).any():
        return None
    turned = np.where(surfaceless[:, :1], pairs[:, ::-1], pairs)
    rows = np.column_stack([turned, np.zeros(len(pairs), np.int64)])
    return _tables(arm_instances((), ()), FixedSolids(objects), rows, padding)


def arm_exact_tables(instances: ArmInstances) -> ExactTables:
    """Tables of moving arms without surroundings and pairs, made once."""
    return kept_in(instances.kept, "exact tables", lambda: _arm_exact_tables(instances))


def _arm_exact_tables(instances: ArmInstances) -> ExactTables:
    arms = instance_tables(instances)
    bodies = arms.bodies
    return ExactTables(
        arms.joints,
        arms.joint_values,
        bodies.bodies,
        bodies.values,
        bodies.corners,
        kept_in(instances.unplaced, "links", lambda: _links(bodies)),
        arms.chain,
        arms.chain_reach,
        np.zeros((0, 3), np.int64),
        np.zeros(0),
        arms.joint_poses,
        bodies.poses,
        bodies.centers,
        NO_MESHES,
    )


def _tables(instances: ArmInstances, fixed: FixedSolids, pairs: _INTS, padding: Array) -> ExactTables:
    arms, alone = instance_tables(instances), arm_exact_tables(instances)
    bodies, meshes = fixed.add_bodies(arms.bodies, len(arms.chain))
    return alone._replace(
        bodies=bodies.bodies,
        body_values=bodies.values,
        corners=bodies.corners,
        links=alone.links if bodies.corners is arms.bodies.corners else _links(bodies),
        pairs=pairs,
        padding=padding,
        poses=bodies.poses,
        centers=bodies.centers,
        meshes=meshes,
    )


def _links(bodies: BodyTables) -> _INTS:
    """The `links` of `ExactTables`."""
    begins = np.concatenate([[0], np.cumsum(bodies.degrees)]) + len(bodies.corners) + 1
    return read_only(np.concatenate([begins, bodies.neighbors]))


def exact_struct(tables: ExactTables, columns: int, like: CStruct | None = None) -> CStruct:
    """The exact kernel's tables as a C struct.

    Args:
        tables: The tables.
        columns: Number of columns of q.
        like: A struct for the same arms, at any base poses; changing a copy of it is faster.
    """
    fields = {
        "body_count": len(tables.bodies),
        "pair_count": len(tables.pairs),
        "bodies": tables.bodies,
        "shapes": tables.body_values,
        "placements": tables.joint_values,
        "corners": tables.corners,
        "links": tables.links,
        "pairs": tables.pairs,
        "padding": tables.padding,
        "meshes": _no_meshes() if tables.meshes is NO_MESHES else CStruct("MeshTables", **vars(tables.meshes)),
    }
    if like is not None:
        return like.copied(**fields)
    return CStruct(
        "ExactTables",
        joint_count=len(tables.joints),
        column_count=columns,
        joints=tables.joints,
        chain=tables.chain,
        chain_reach=tables.chain_reach,
        **fields,
    )


@cache
def _no_meshes() -> CStruct:
    return CStruct("MeshTables", **vars(NO_MESHES))


def exact_scratch(tables: ExactTables, columns: int, terms: int = _TERMS, pairs: int = 0) -> CStruct:
    """Memory that the exact kernel writes, except the queue for curves; see `EdgeKernel`.

    Args:
        tables: The tables; the poses of fixed bodies are copied from them.
        columns: Number of columns of q.
        terms: Number of coefficients of the longest curve.
        pairs: Most pairs of other tables with the same bodies for which the memory has to suffice.
    """
    stride = len(tables.joints) + 1
    scratch = CStruct(
        "ExactScratch",
        travel_stride=stride,
        queue_size=max(_QUEUE, 1 << (16 * len(tables.pairs)).bit_length()),
        joint_poses=tables.joint_poses.copy(),
        poses=tables.poses.copy(),
        centers=tables.centers.copy(),
    )
    scratch.give_room(
        directions=max(len(tables.pairs), pairs),
        travel=len(tables.bodies) * stride,
        coefficients=terms * columns,
        q=columns,
        reach=columns,
        placed_at=len(tables.bodies),
    )
    return scratch


def arm_exact_struct(instances: ArmInstances) -> CStruct:
    """The struct of moving arms without surroundings, as a template for those of their scenes."""

    def make() -> CStruct:
        tables, columns = arm_exact_tables(instances), sum(len(g.arm_model.joint_names) for g in instances.geometries)
        elsewhere = kept_in(instances.unplaced, "exact struct", lambda: exact_struct(tables, columns))
        return exact_struct(tables, columns, elsewhere)

    return kept_in(instances.kept, "exact struct", make)
