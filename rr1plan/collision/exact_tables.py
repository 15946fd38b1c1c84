"""The plain arrays that the exact kernel reads: those of what the arms carry, then those of the obstacles.

The former are made once for all scenes with the same arms, those of an obstacle once for all scenes that have it at the
same place, and a scene's tables once for all paddings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.collision.body_rows import FAR, BodyRows, flat, rows_of
from rr1plan.collision.carried import Carried
from rr1plan.collision.kernel_tables import ExactTables
from rr1plan.collision.layout import Layout
from rr1plan.collision.mesh_trees import joined_trees, mesh_tree
from rr1plan.collision.solids import is_concave
from rr1plan.collision.standing import Standing
from rr1plan.kernels.library import constants
from rr1plan.skeleton import Skeleton, joint_twist
from rr1plan.transforms import rotation_about

if TYPE_CHECKING:
    from rr1plan.collision.exact import CollisionChecker

_INTS = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class CarriedTables:
    """The tables of the bodies that arms carry; columns as in `ExactTables`."""

    joints: _INTS
    joint_values: Array
    joint_poses: Array
    rows: BodyRows
    chain: _INTS
    chain_reach: Array


def build_tables(checker: CollisionChecker) -> ExactTables:
    """Tables of the moving pairs of a checker, in the order of its `solid_pairs`, of a scene.

    Raises:
        InputError: a half-space or a point cloud that would be checked against another one.
    """
    pairs = checker.layout.pairs
    pairs.check_kinds(checker.solids)
    return _with_pairs(_bare_tables(checker), pairs.moving_rows, checker.solid_padding)


def build_resting_tables(checker: CollisionChecker) -> ExactTables | None:
    """The same of the pairs that do not move against each other; None if some cannot be measured by the kernel."""
    pairs = checker.layout.pairs
    if pairs.surfaceless[pairs.resting].all(axis=1).any():
        return None
    padding = checker.scene.checked_padding[pairs.resting_owner]
    return _with_pairs(_bare_tables(checker), pairs.resting_rows, padding)


def _with_pairs(bare: ExactTables, pairs: _INTS, padding: Array) -> ExactTables:
    return bare._replace(pairs=pairs, padding=padding)


def _bare_tables(checker: CollisionChecker) -> ExactTables:
    """Tables without pairs and padding."""
    kept = checker.scene.kept_for_any_padding
    found = kept.get(("tables", checker.arms))
    if not isinstance(found, ExactTables):
        found = kept["tables", checker.arms] = _joined_tables(checker.layout)
    return found


def _joined_tables(layout: Layout) -> ExactTables:
    carried = carried_tables(layout.carried)
    rows = _joined([carried.rows, *standing_rows(layout.standing)], len(carried.chain))
    meshes = joined_trees([mesh_tree(s.shape) for thing in layout.standing for s in thing.solids if is_concave(s.shape)])
    rows.bodies[rows.bodies[:, 0] == constants()["BODY_MESH"], 2] = np.arange(len(meshes.ranges))
    begins = np.concatenate([[0], np.cumsum(rows.degrees)]) + len(rows.corners) + 1
    return ExactTables(
        carried.joints,
        carried.joint_values,
        read_only(rows.bodies),
        read_only(rows.values),
        read_only(rows.corners),
        read_only(np.concatenate([begins, rows.neighbours])),
        carried.chain,
        carried.chain_reach,
        np.zeros((0, 3), np.int64),
        np.zeros(0),
        carried.joint_poses,
        read_only(rows.poses),
        read_only(rows.centres),
        meshes,
    )


def _joined(parts: list[BodyRows], links: int) -> BodyRows:
    """BodyRows as one; only the first of them have chains, of so many links."""
    names = ("bodies", "values", "corners", "degrees", "neighbours", "poses", "centres")
    joined = BodyRows(*(np.concatenate([getattr(rows, name) for rows in parts]) for name in names))
    before = np.cumsum([len(rows.corners) for rows in parts])[:-1]
    joined.bodies[:, 2:4] += np.repeat([0, *before], [len(rows.bodies) for rows in parts])[:, None]
    joined.bodies[len(parts[0].bodies) :, 4:] = links
    if len(joined.neighbours):
        joined.neighbours[:] += np.repeat([0, *before], [len(rows.neighbours) for rows in parts])
    return joined


def standing_rows(standing: Sequence[Standing]) -> list[BodyRows]:
    """The tables of obstacles, each made once; those that are new together, which takes hardly longer than one."""
    new = [thing for thing in standing if "rows" not in thing.kept]
    if new:
        made = rows_of([solid for thing in new for solid in thing.solids], flat(np.eye(4))[None])
        bodies = corners = links = 0
        for thing in new:
            last = bodies + len(thing.solids)
            rows = made.bodies[bodies:last] - np.array([0, 0, corners, corners, 0, 0])
            corners_end = corners + int(rows[:, 3].max(initial=0))
            degrees = made.degrees[corners:corners_end]
            links_end = links + int(degrees.sum())
            thing.kept["rows"] = BodyRows(
                rows,
                made.values[bodies:last],
                made.corners[corners:corners_end],
                degrees,
                made.neighbours[links:links_end] - corners,
                made.poses[bodies:last],
                made.centres[bodies:last],
            )
            bodies, corners, links = last, corners_end, links_end
    return [thing.kept["rows"] for thing in standing]


# ---- what is carried -------------------------------------------------------------------------------


@lru_cache(maxsize=64)
def carried_tables(carried: Carried) -> CarriedTables:
    """The tables of what the arms carry, made once."""
    joints, values, poses = _joint_tables(carried.skeleton)
    rows = rows_of(carried.solids, poses)
    chains = [carried.chains[group] for group in carried.groups]
    ends = np.cumsum([len(chain) for chain in chains], dtype=np.int64)
    rows.bodies[:, 4:] = np.column_stack([np.concatenate([[0], ends])[:-1], ends])
    reach = [
        chain_reach(joints, values, poses, chain, centre) for chain, centre in zip(chains, rows.centres, strict=True)
    ]
    return CarriedTables(
        read_only(joints),
        read_only(values),
        read_only(poses),
        rows,
        read_only(np.array([j for chain in chains for j in chain], dtype=np.int64)),
        read_only(np.array([r for one in reach for r in one], dtype=np.float64)),
    )


def _joint_tables(skeleton: Skeleton) -> tuple[_INTS, Array, Array]:
    """Joints, their values, and their world poses at q = 0; see `ExactTables`."""
    model = skeleton.model
    data = model.createData()
    # At q = 0.
    pin.forwardKinematics(model, data, np.array(skeleton.offsets))
    count = model.njoints
    joints, values, poses = np.zeros((count, 4), np.int64), np.zeros((count, 17)), np.zeros((count, 12))
    poses[0] = flat(np.eye(4))
    for j in range(1, count):
        twist = joint_twist(model.joints[j])
        prismatic = float(np.abs(twist[:3]).max()) > 0.5
        gain = float(skeleton.gains[j - 1])
        column = int(skeleton.columns[j - 1]) if gain != 0.0 else -1
        parent = int(model.parents[j])
        joints[j] = parent, prismatic, column, column >= 0 or joints[parent, 3]
        values[j, :12] = flat(model.jointPlacements[j].homogeneous)
        values[j, 12:15] = twist[:3] if prismatic else twist[3:]
        values[j, 15:] = gain, skeleton.offsets[j - 1]
        poses[j] = flat(data.oMi[j].homogeneous)
    return joints, values, poses


def chain_reach(joints: _INTS, values: Array, poses: Array, chain: tuple[int, ...], centre: Array) -> list[float]:
    """For each joint of a chain how far the centre of a body's ball, there at q = 0, can ever be from its axis [m]."""
    point = centre
    reach, beyond = [], 0.0
    for joint in chain[::-1]:
        axis = poses[joint, :9].reshape(3, 3) @ values[joint, 12:15]
        arm = point - poses[joint, 9:]
        reach.append(float(np.linalg.norm(_cross(axis, arm)) + beyond))
        # A prismatic joint carries what hangs on it to any distance.
        beyond += FAR if joints[joint, 1] else float(np.linalg.norm(arm))
        point = poses[joint, 9:]
    return reach[::-1]


def joint_motion(prismatic: bool, row: Array) -> Array:
    """T_parent_joint (4, 4) of a joint at q = 0, by its row of `joint_values`."""
    axis, rest = row[12:15], float(row[16])
    T, moved = np.eye(4), np.eye(4)
    T[:3, :3], T[:3, 3] = row[:9].reshape(3, 3), row[9:12]
    if prismatic:
        moved[:3, 3] = rest * axis
    else:
        moved[:3, :3] = rotation_about(axis, rest)
    return np.asarray(T @ moved)


def _cross(a: Array, b: Array) -> Array:
    """The cross product of two vectors; numpy's takes twenty times as long for one."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
