"""Tables of arms that move independently, and of the pairs between some of them and the others (`timed_arms.h`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.collision.convex.enclosing_ball import ball_reach
from rr1plan.collision.tables.exact_tables import ExactTables
from rr1plan.kernels.planner_kernels import constants

_INTS = NDArray[np.int64]
_ROUNDING = 1.0 + 1e-9


class TimedPairs(NamedTuple):
    """Pairs between the own arms and the others that must not touch.

    Args:
        tables: The exact kernel's tables; boxes around all bodies that one joint carries come after the bodies, and
            pairs of boxes after the pairs of bodies.
        rows: Own body, other arm, first and last pair of bodies of each pair, shape (p, 4).
        owner: The pair of solids of each pair of bodies.
        arm_of_body: The arm of each body, -1 for none.
        first_box: Number of bodies that are not boxes.
    """

    tables: ExactTables
    rows: _INTS
    owner: _INTS
    arm_of_body: _INTS
    first_box: int


def build_timed_pairs(
    tables: ExactTables, pairs: _INTS, padding: Array, arms: _INTS, own: NDArray[np.bool_]
) -> TimedPairs:
    """Pairs of bodies that own arms and others carry, sorted, with boxes around groups of them.

    Args:
        tables: The bodies.
        pairs: Body, body, number of joints that move both, shape (p, 3); only pairs between an own arm and another arm
            are used.
        padding: Distance to keep for each pair [m], shape (p,).
        arms: The arm of each body, -1 for none, shape (b,).
        own: Which arms are own arms.
    """
    boxes, box_of, chains = _boxes(tables, arms)
    one, two = arms[pairs[:, 0]], arms[pairs[:, 1]]
    is_own = np.append(own, False)  # the last entry is for bodies without an arm
    chosen = np.flatnonzero((one >= 0) & (two >= 0) & (is_own[one] != is_own[two]))
    one_is_own = is_own[one[chosen]]
    own_body = np.where(one_is_own, pairs[chosen, 0], pairs[chosen, 1])
    other_body = np.where(one_is_own, pairs[chosen, 1], pairs[chosen, 0])
    own_box, other_box, arm = box_of[own_body], box_of[other_body], arms[other_body]
    order = np.lexsort((other_body, own_body, other_box, own_box, arm))
    chosen, own_box, other_box, arm = chosen[order], own_box[order], other_box[order], arm[order]
    count = len(chosen)
    new = np.ones(count, np.bool_)
    new[1:] = (np.diff(own_box) != 0) | (np.diff(other_box) != 0)
    begins = np.flatnonzero(new)
    ends = np.append(begins[1:], count)[: len(begins)]
    first_box = len(tables.bodies)
    rows = np.zeros((count + len(begins), 4), np.int64)
    rows[:count, 0], rows[:count, 1] = own_body[order], arm
    rows[count:] = np.column_stack([own_box[begins] + first_box, arm[begins], begins, ends])
    most = np.maximum.reduceat(padding[chosen], begins) if count else np.zeros(0)
    box_pairs = np.column_stack(
        [own_box[begins] + first_box, other_box[begins] + first_box, np.zeros(len(begins), np.int64)]
    )
    kept = boxes._replace(
        pairs=np.concatenate([pairs[chosen], box_pairs]), padding=np.concatenate([padding[chosen], most])
    )
    return TimedPairs(kept, rows, chosen, np.concatenate([arms, chains]), first_box)


def _boxes(tables: ExactTables, arms: _INTS) -> tuple[ExactTables, _INTS, _INTS]:
    """The tables with a box around all bodies of an arm that one joint carries.

    Returns:
        The tables; the number of each body's box; the arm of each box.
    """
    kind = constants()["BODY_BOX"]
    bodies, values = tables.bodies, tables.body_values
    carried = np.flatnonzero(arms >= 0)
    keys, numbers = np.unique(np.column_stack([arms[carried], bodies[carried, 1]]), axis=0, return_inverse=True)
    box_of = np.full(len(bodies), -1)
    box_of[carried] = numbers.ravel()
    low, high = _corners(tables)
    rows, box_values, chain, reach = [], [], list(tables.chain), list(tables.chain_reach)
    for number, (_, joint) in enumerate(keys.tolist()):
        members = np.flatnonzero(box_of == number)
        lowest, highest = low[members].min(axis=0), high[members].max(axis=0)
        center, half = 0.5 * (lowest + highest), 0.5 * (highest - lowest) * _ROUNDING
        balls = values[members, 12:16]
        first, last = bodies[members[0], 4:].tolist()
        # At most as far from an axis as another center on the same joint can be, plus their distance.
        offset = float(np.linalg.norm(balls[0, :3] - center)) * _ROUNDING
        rows.append([kind, joint, 0, 0, len(chain), len(chain) + last - first])
        chain += tables.chain[first:last].tolist()
        reach += (tables.chain_reach[first:last] + offset).tolist()
        radius = float(ball_reach(balls, center).max()) * _ROUNDING
        box_values.append([*np.eye(3).ravel(), *center, *center, radius, 0.0, *np.zeros(3), *half, *half, 0.0])
    count = len(keys)
    new_values = np.array(box_values).reshape(count, 27)
    R, t = tables.joint_poses[keys[:, 1], :9].reshape(-1, 3, 3), tables.joint_poses[keys[:, 1], 9:]
    centers = np.einsum("nij,nj->ni", R, new_values[:, 12:15]) + t
    return (
        tables._replace(
            bodies=np.concatenate([bodies, np.array(rows, np.int64).reshape(count, 6)]),
            body_values=np.concatenate([values, new_values]),
            chain=np.array(chain, np.int64),
            chain_reach=np.array(reach),
            poses=np.concatenate([tables.poses, np.column_stack([R.reshape(-1, 9), centers])]),
            centers=np.concatenate([tables.centers, centers]),
        ),
        box_of,
        keys[:, 0],
    )


def _corners(tables: ExactTables) -> tuple[Array, Array]:
    """Low and high corner of a box around each body in the axes of its joint [m], shapes (b, 3)."""
    values = tables.body_values
    rotation = values[:, :9].reshape(-1, 3, 3)
    center = values[:, 9:12] + np.einsum("nij,nj->ni", rotation, values[:, 17:20])
    half = np.einsum("nij,nj->ni", np.abs(rotation), values[:, 20:23])
    is_point = tables.bodies[:, 0] == constants()["BODY_POINT"]
    center[is_point], half[is_point] = values[is_point, 12:15], values[is_point, 15:16]
    return center - half, center + half
