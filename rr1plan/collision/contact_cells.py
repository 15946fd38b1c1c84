"""Cells of a plane of configurations in which a pair of convex solids provably stays in contact.

A cell is a rectangle of two joint values, c_j - h_j <= q_j <= c_j + h_j. Let A and B be a checked pair, x a point, and
r_A, r_B the radii of the balls around x that lie in A and in B at the center c. Fix x in the frame of the last joint
that moves both. As q goes from c to any point of the cell, one joint after the other, the farthest joint first, x moves
in the frame of A by at most

    t_A = sum over the joints between that frame and A of w_j * rho_j,

where w_j is the displacement of the joint in half a cell, and rho_j the distance of x from its axis at c (1 for a
sliding joint): each joint turns x about an axis whose pose relative to the joint's parent is still that at c. A
rotation by w moves x by 2 rho sin(w / 2) <= w rho. While t_A <= r_A, x stays in the ball of radius r_A, which moves
with A, and likewise for B. So r_A > t_A and r_B > t_B prove that x is in both solids everywhere in the cell: they
touch. A pair with padding p is in contact within p, so r_A + p > t_A suffices, where a negative r_A is minus the
distance of x from A. This is the bound of Schwarzer, Saha and Latombe, "Adaptive dynamic collision checking" (2005),
reversed, for a point instead of a body. However x is found, the two inequalities are the proof; `_SLACK` is far above
their rounding.

The point is found by alternating projections onto A and B, each shrunk by its t (von Neumann; Bauschke and Borwein, "On
projection algorithms for solving convex feasibility problems", 1996).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.collision.coal_checker import CoalChecker
from rr1plan.collision.convex.interior_depth import Interior, interior_of
from rr1plan.model.arm_model import joint_axis
from rr1plan.model.scene_model import SceneModel

_SLACK = 1e-6  # [m]; the motion checker counts smaller gaps as contacts
_ROUNDS = 12
_AIM = 1.5  # times the required depth
_RELAXATION = 1.6
_FACES = 20  # cost of a pair's other operations, in faces
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Placed:
    """The joints of a scene at n configurations.

    Args:
        rotations, positions: World frame of each Pinocchio joint, (n or 1, 3, 3) and (n or 1, 3); 0 is the world.
    """

    rotations: list[Array]
    positions: list[Array]

    def rows(self, rows: NDArray[np.intp]) -> Placed:
        """The joints at some of the configurations."""
        return Placed(
            [R if len(R) == 1 else R[rows] for R in self.rotations],
            [p if len(p) == 1 else p[rows] for p in self.positions],
        )


class JointPlane:
    """Two moving joints, all others fixed: poses, and displacements across a cell.

    Args:
        model: The scene's model.
        q: Configuration of the moving arms [rad or m], shape (nq,).
        columns: The two columns of q that move.
    """

    def __init__(self, model: SceneModel, q: Array, columns: tuple[int, int]) -> None:
        self.model = model
        self._q, self._columns = np.array(q, dtype=np.float64), list(columns)
        joints = [joint_axis(model.model.joints[j]) for j in range(1, model.model.njoints)]
        self._slides, self._axes = [slides for slides, _ in joints], [axis for _, axis in joints]
        self._gains = np.array(
            [[gain * (c == k) for k in columns] for c, gain in zip(model.columns, model.gains, strict=True)]
        )

    def place(self, pairs: Array) -> Placed:
        """The joint frames at values of the two joints, shape (n, 2)."""
        q = np.repeat(self._q[None], len(pairs), axis=0)
        q[:, self._columns] = pairs
        values, model = self.model.full(q), self.model.model
        rotations, positions = [np.eye(3)[None]], [np.zeros((1, 3))]
        for j in range(1, model.njoints):
            parent, at, k = model.parents[j], model.jointPlacements[j], j - 1
            angle = values[:, k] if self._gains[k].any() else values[:1, k]
            R = rotations[parent] @ at.rotation
            p = positions[parent] + rotations[parent] @ at.translation
            if self._slides[k]:
                p = p + angle[:, None] * (R @ self._axes[k])
            else:
                R = R @ _rotations(self._axes[k], angle)
            rotations.append(R)
            positions.append(p)
        return Placed(rotations, positions)

    def moves(self, joint: int) -> bool:
        """Whether one of the two joints moves this Pinocchio joint."""
        return bool(self._gains[joint - 1].any())

    def joints_above(self, joint: int) -> tuple[int, ...]:
        """The Pinocchio joints from `joint` to the world that the two joints move."""
        chain = []
        while joint:
            chain += [joint] * self.moves(joint)
            joint = self.model.model.parents[joint]
        return tuple(chain)

    def turn(self, joints: tuple[int, ...], half: Array) -> float:
        """Largest total rotation of these joints in half a cell (2,) [rad]."""
        return float(sum(np.abs(self._gains[j - 1]) @ half for j in joints if not self._slides[j - 1]))

    def travel(self, placed: Placed, joints: tuple[int, ...], points: Array, half: Array) -> Array:
        """Largest displacement of world points (n, 3) by these joints in half a cell (2,), t in the proof, (n,)."""
        total = np.zeros(len(points))
        for j in joints:
            weight = float(np.abs(self._gains[j - 1]) @ half)
            if self._slides[j - 1]:
                total += weight
            else:
                axis = placed.rotations[j] @ self._axes[j - 1]
                total += weight * np.linalg.norm(np.cross(points - placed.positions[j], axis), axis=1)
        return total


def _rotations(axis: Array, angles: Array) -> Array:
    """Rotations about a unit axis (Rodrigues), shape (n, 3, 3)."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sin, cos = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.asarray(np.eye(3) + sin * K + (1.0 - cos) * (K @ K))


@dataclass(frozen=True, eq=False)
class _Side:
    """One solid of a pair: its interior, its frame, and the joints that move it relative to the other one."""

    interior: Interior
    joint: int
    placement: Array
    joints: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class _Body:
    """A solid at n configurations.

    Args:
        side: The solid.
        plane: The joints that move.
        placed: Their frames.
        half: Half a cell [rad or m], shape (2,).
        margin: A point this far outside still counts as inside [m].
        rotation, position: World pose of the solid, shapes (n, 3, 3) and (n, 3).
    """

    side: _Side
    plane: JointPlane
    placed: Placed
    half: Array
    margin: float
    rotation: Array
    position: Array

    def rows(self, rows: NDArray[np.intp]) -> _Body:
        """The solid at some of the configurations."""
        placed = self.placed.rows(rows)
        return replace(self, placed=placed, rotation=self.rotation[rows], position=self.position[rows])

    @property
    def center(self) -> Array:
        """A point inside at each configuration, shape (n, 3)."""
        return np.asarray(self.position + self.rotation @ self.side.interior.center)

    def travel(self, points: Array) -> Array:
        """The bound t of the proof at points (n, 3) [m], shape (n,)."""
        return self.plane.travel(self.placed, self.side.joints, points, self.half)

    def most_travel(self) -> Array:
        """Upper bound of t for all points of the solid [m], shape (n,)."""
        turn = self.plane.turn(self.side.joints, self.half)
        return self.travel(self.center) + (turn * self.side.interior.radius if turn else 0.0)

    def holds(self, points: Array) -> Mask:
        """Whether points (n, 3) provably stay inside throughout their cells, shape (n,)."""
        depths = self.side.interior.depths(self._local(points), self.margin)
        return np.asarray(depths + self.margin > self.travel(points) + _SLACK)

    def nearest(self, points: Array) -> Array:
        """Points (n, 3) moved inside, deeper than required, as projections reach a border only in the limit."""
        wanted = _AIM * self.travel(points) + 2.0 * _SLACK - self.margin
        local = self._local(points)
        inside = self.side.interior.nearest(local, np.maximum(wanted, 0.0))
        away = local - inside
        share = np.minimum(1.0, np.maximum(-wanted, 0.0) / np.maximum(np.linalg.norm(away, axis=1), 1e-300))
        moved = inside + share[:, None] * away
        return np.asarray(self.position + np.einsum("nij,nj->ni", self.rotation, moved))

    def _local(self, points: Array) -> Array:
        return np.asarray(np.einsum("nji,nj->ni", self.rotation, points - self.position))


class ContactCells:
    """Certifies cells of two joints in which some checked pair stays in contact.

    Args:
        checker: Collision checker of the scene and the moving arm.
        q: The configuration in which two columns are replaced [rad or m], shape (nq,).
        columns: These two columns.
        pairs: Indices of the checker's `solid_pairs` to test (default: all).
    """

    def __init__(
        self, checker: CoalChecker, q: Array, columns: tuple[int, int], pairs: Sequence[int] | None = None
    ) -> None:
        self.plane = JointPlane(checker.model, q, columns)
        chains, chosen = _chains(checker), slice(None) if pairs is None else list(pairs)
        solid_pairs, padding = checker.solid_pairs[chosen].tolist(), checker.solid_padding[chosen].tolist()
        self._pairs: list[tuple[_Side, _Side, float]] = []
        for (a, b), most in zip(solid_pairs, padding, strict=True):
            shared = set(chains[a]) & set(chains[b])
            first, second = (self._side(checker, i, chains[i], shared) for i in (a, b))
            self._pairs.append((first, second, most))

    def _side(self, checker: CoalChecker, solid: int, chain: tuple[int, ...], shared: set[int]) -> _Side:
        own = checker.solids[solid]
        joints = tuple(j for j in chain if j not in shared and self.plane.moves(j))
        return _Side(interior_of(own.shape), own.joint, own.placement, joints)

    @property
    def pairs(self) -> int:
        """Number of tested pairs of solids."""
        return len(self._pairs)

    @property
    def effort(self) -> Array:
        """Approximate relative cost of each pair: 1 for round solids and boxes, more for meshes, shape (pairs,)."""
        faces = [max(a.interior.faces, b.interior.faces) for a, b, _ in self._pairs]
        return np.asarray((_FACES + np.array(faces, dtype=np.float64)) / (_FACES + 1.0))

    def classify(self, centers: Array, half: Array, near: Mask) -> tuple[Mask, Mask]:
        """Certify cells.

        Args:
            centers: Centers of the cells [rad or m], shape (n, 2).
            half: Half their size [rad or m], shape (2,).
            near: The pairs to test, shape (n, pairs).

        Returns:
            Which cells are proven to be blocked, shape (n,); and which of the tested pairs may touch somewhere in a
            cell, shape (n, pairs). That the others do not touch is an estimate, not a proof.
        """
        placed = self.plane.place(centers)
        blocked, still = np.zeros(len(centers), dtype=np.bool_), near.copy()
        for k, (a, b, padding) in enumerate(self._pairs):
            rows = np.flatnonzero(near[:, k] & ~blocked)
            if len(rows):
                own = placed.rows(rows)
                sides = (self._body(a, own, len(rows), half, padding), self._body(b, own, len(rows), half, 0.0))
                reach = a.interior.radius + b.interior.radius + padding
                blocked[rows], still[rows, k] = _test_cells(*sides, reach)
        return blocked, still

    def _body(self, side: _Side, placed: Placed, count: int, half: Array, margin: float) -> _Body:
        R, p = placed.rotations[side.joint], placed.positions[side.joint]
        rotation = np.broadcast_to(R @ side.placement[:3, :3], (count, 3, 3))
        position = np.broadcast_to(p + R @ side.placement[:3, 3], (count, 3))
        return _Body(side, self.plane, placed, half, margin, rotation, position)


def _test_cells(a: _Body, b: _Body, reach: float) -> tuple[Mask, Mask]:
    """Decide for each cell whether two solids provably stay in contact throughout, and whether they may touch at all.

    Args:
        a: One solid.
        b: The other.
        reach: Sum of their radii and the padding [m].
    """
    most = a.most_travel() + b.most_travel()
    may = ~(np.linalg.norm(a.center - b.center, axis=1) > reach + most + _SLACK)
    certain = np.zeros(len(may), dtype=np.bool_)
    rows = np.flatnonzero(may)
    if len(rows):
        certain[rows], may[rows] = _search(a.rows(rows), b.rows(rows), most[rows])
    return certain, may


def _search(a: _Body, b: _Body, most: Array) -> tuple[Mask, Mask]:
    """Over-relaxed alternating projections, until a point proves the contact of each configuration."""
    certain, may = np.zeros(len(most), dtype=np.bool_), np.ones(len(most), dtype=np.bool_)
    rows = np.arange(len(most))
    a, b = (a, b) if np.isfinite(a.side.interior.radius) else (b, a)
    x = last = a.center
    for step in range(_ROUNDS):
        projected = (a if step % 2 else b).nearest(x)
        middle, x = 0.5 * (x + projected), x + _RELAXATION * (projected - x)
        proven = a.holds(middle) & b.holds(middle)
        certain[rows[proven]] = True
        gap, last = np.linalg.norm(projected - last, axis=1), projected
        if proven.any():
            left = np.flatnonzero(~proven)
            rows, x, last, middle, gap = rows[left], x[left], last[left], middle[left], gap[left]
            a, b = a.rows(left), b.rows(left)
    # Shrinking the solids by the target depths has widened the gap between them.
    near = gap <= _AIM * _AIM * (a.travel(middle) + b.travel(middle)) + most[rows]
    # Projections onto a non-convex solid may end at a point although another part of the solid is nearer.
    may[rows] = near if a.side.interior.convex and b.side.interior.convex else True
    return certain, may


def columns_between(checker: CoalChecker) -> list[frozenset[int]]:
    """For each of the checker's `solid_pairs`, the columns of q that change the relative pose of its solids."""
    chains, columns = _chains(checker), checker.model.columns
    return [
        frozenset(int(columns[joint - 1]) for joint in set(chains[a]) ^ set(chains[b]))
        for a, b in checker.solid_pairs.tolist()
    ]


def _chains(checker: CoalChecker) -> list[tuple[int, ...]]:
    """The driven joints above each solid, root first; none for obstacles."""
    instances = checker.geometry.instances
    chains = [instances.chains[group] for group in instances.groups]
    return chains + [()] * (len(checker.solids) - len(chains))
