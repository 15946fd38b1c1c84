"""The plain arrays that the exact kernel reads: rows of the moving arms, then rows of solids that do not move.

Rows of an arm are shared by all arms with its geometry, and a scene's tables by all margins.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.collision.arm_instances import ArmInstances, arm_instances
from rr1plan.collision.collision_geometry import CollisionGeometry, SolidPairs
from rr1plan.collision.obstacle_geometry import ObstacleGeometry
from rr1plan.collision.tables.arm_tables import instance_tables
from rr1plan.collision.tables.body_tables import BodyTables
from rr1plan.collision.tables.kernel_tables import ExactTables
from rr1plan.collision.tables.obstacle_tables import FixedSolids
from rr1plan.object_cache import kept_in

_INTS = NDArray[np.int64]


def build_tables(geometry: CollisionGeometry, fixed: FixedSolids, padding: Array) -> ExactTables:
    """Tables of the pairs that move against each other.

    Args:
        geometry: The moving arms and their pairs.
        fixed: The solids that do not move.
        padding: Distance to keep of each pair [m], shape (m,).

    Raises:
        InputError: a half-space or a point cloud that would be checked against another one.
    """
    geometry.check_kinds()
    return _tables(geometry.instances, fixed, geometry.pairs.moving_rows, padding)


def build_static_tables(tables: ExactTables, pairs: SolidPairs, padding: Array) -> ExactTables | None:
    """Tables of the pairs that do not move against each other; None if the kernel cannot measure some of them.

    Args:
        tables: Those of the pairs that move.
        pairs: All pairs.
        padding: Distance to keep of each static pair [m], shape (m,).
    """
    if pairs.surfaceless[pairs.static].all(axis=1).any():
        return None
    return tables._replace(pairs=pairs.static_rows, padding=padding)


def build_fixed_tables(things: Sequence[ObstacleGeometry], pairs: _INTS, padding: Array) -> ExactTables | None:
    """Tables of objects that do not move; None if some pairs cannot be measured by the kernel.

    Args:
        things: The objects.
        pairs: Pairs of their solids, numbered object after object [index], shape (m, 2).
        padding: Distance to keep of each [m], shape (m,).
    """
    surfaceless = np.array([kind for thing in things for kind in thing.rows.surfaceless], np.bool_)[pairs]
    if surfaceless.all(axis=1).any():
        return None
    turned = np.where(surfaceless[:, :1], pairs[:, ::-1], pairs)
    rows = np.column_stack([turned, np.zeros(len(pairs), np.int64)])
    return _tables(arm_instances((), ()), FixedSolids(things), rows, padding)


def _tables(instances: ArmInstances, fixed: FixedSolids, pairs: _INTS, padding: Array) -> ExactTables:
    arms = instance_tables(instances)
    bodies, meshes = fixed.add_bodies(arms.bodies, len(arms.chain))
    if bodies.corners is arms.bodies.corners:  # no obstacle has any
        links = kept_in(instances.kept, "links", lambda: _links(bodies))
    else:
        links = _links(bodies)
    return ExactTables(
        arms.joints,
        arms.joint_values,
        bodies.bodies,
        bodies.values,
        bodies.corners,
        links,
        arms.chain,
        arms.chain_reach,
        pairs,
        padding,
        arms.joint_poses,
        bodies.poses,
        bodies.centers,
        meshes,
    )


def _links(bodies: BodyTables) -> _INTS:
    """The `links` of `ExactTables`."""
    begins = np.concatenate([[0], np.cumsum(bodies.degrees)]) + len(bodies.corners) + 1
    return read_only(np.concatenate([begins, bodies.neighbors]))
