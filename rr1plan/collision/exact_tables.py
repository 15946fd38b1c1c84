"""The plain arrays that the exact kernel reads: rows of the moving arms, then rows of fixed bodies.

Rows of an arm are shared by all arms with its geometry, rows of an obstacle by all scenes that have it at the same
place, and a scene's tables by all paddings.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.collision.arm_instances import ArmInstances, arm_instances
from rr1plan.collision.arm_tables import instance_tables
from rr1plan.collision.body_tables import BodyTables
from rr1plan.collision.collision_geometry import CollisionGeometry
from rr1plan.collision.kernel_tables import ExactTables
from rr1plan.collision.mesh_trees import joined_trees, mesh_tree
from rr1plan.collision.obstacle_geometry import ObstacleGeometry, obstacle_bodies
from rr1plan.collision.solids import is_concave
from rr1plan.kept import kept_in
from rr1plan.kernels.library import constants

if TYPE_CHECKING:
    from rr1plan.collision.coal_checker import CoalChecker

_INTS = NDArray[np.int64]


def build_tables(checker: CoalChecker) -> ExactTables:
    """Tables of the moving pairs of a checker, in the order of its `solid_pairs`.

    Raises:
        InputError: a half-space or a point cloud that would be checked against another one.
    """
    geometry = checker.geometry
    geometry.check_kinds()
    return _with_pairs(_bare_tables(geometry), geometry.pairs.moving_rows, checker.solid_padding)


def build_static_tables(checker: CoalChecker) -> ExactTables | None:
    """The same of the pairs that do not move against each other; None if some cannot be measured by the kernel."""
    geometry = checker.geometry
    pairs = geometry.pairs
    if pairs.surfaceless[pairs.static].all(axis=1).any():
        return None
    return _with_pairs(_bare_tables(geometry), pairs.static_rows, checker.padding[pairs.static_owner])


def build_fixed_tables(things: Sequence[ObstacleGeometry], pairs: _INTS, padding: Array) -> ExactTables | None:
    """Tables of solids that do not move; None if some pairs cannot be measured by the kernel.

    Args:
        things: The solids.
        pairs: Pairs of them, numbered thing after thing [index], shape (m, 2).
        padding: Distance to keep of each [m], shape (m,).
    """
    surfaceless = np.array([kind for thing in things for kind in thing.surfaceless], np.bool_)[pairs]
    if surfaceless.all(axis=1).any():
        return None
    turned = np.where(surfaceless[:, :1], pairs[:, ::-1], pairs)
    rows = np.column_stack([turned, np.zeros(len(pairs), np.int64)])
    return _with_pairs(_joined_tables(arm_instances((), ()), things), rows, padding)


def _with_pairs(bare: ExactTables, pairs: _INTS, padding: Array) -> ExactTables:
    return bare._replace(pairs=pairs, padding=padding)


def _bare_tables(geometry: CollisionGeometry) -> ExactTables:
    """Tables without pairs and padding."""
    return kept_in(geometry.kept, "exact", lambda: _joined_tables(geometry.instances, geometry.obstacles))


def _joined_tables(instances: ArmInstances, obstacles: Sequence[ObstacleGeometry]) -> ExactTables:
    arms = instance_tables(instances)
    bodies = _joined([arms.bodies, *obstacle_bodies(obstacles)], len(arms.chain))
    meshes = [mesh_tree(s.shape) for thing in obstacles for s in thing.solids if is_concave(s.shape)]
    bodies.bodies[bodies.bodies[:, 0] == constants()["BODY_MESH"], 2] = np.arange(len(meshes))
    begins = np.concatenate([[0], np.cumsum(bodies.degrees)]) + len(bodies.corners) + 1
    return ExactTables(
        arms.joints,
        arms.joint_values,
        read_only(bodies.bodies),
        read_only(bodies.values),
        read_only(bodies.corners),
        read_only(np.concatenate([begins, bodies.neighbors])),
        arms.chain,
        arms.chain_reach,
        np.zeros((0, 3), np.int64),
        np.zeros(0),
        arms.joint_poses,
        read_only(bodies.poses),
        read_only(bodies.centers),
        joined_trees(meshes),
    )


def _joined(parts: list[BodyTables], links: int) -> BodyTables:
    """Concatenated tables; only bodies of the first have a chain, of `links` links."""
    names = ("bodies", "values", "corners", "degrees", "neighbors", "poses", "centers")
    joined = BodyTables(*(np.concatenate([getattr(rows, name) for rows in parts]) for name in names))
    before = np.cumsum([len(rows.corners) for rows in parts])[:-1]
    joined.bodies[:, 2:4] += np.repeat([0, *before], [len(rows.bodies) for rows in parts])[:, None]
    joined.bodies[len(parts[0].bodies) :, 4:] = links
    if len(joined.neighbors):
        joined.neighbors[:] += np.repeat([0, *before], [len(rows.neighbors) for rows in parts])
    return joined
