"""Proof that no path of an arm of two joints leads from its start to a goal, by approximate cell decomposition.

The rectangle within the joint limits (a torus if joints have none) is divided into cells. A cell is full if one pair of
solids is provably in contact in the whole cell (`rr1plan.collision.contact_cells`); all others may contain free
configurations. A path is a connected set, so the cells it crosses meet in edges or corners. If no chain of cells that
are not full connects the start to a cell that may contain a goal, no path exists. Otherwise the cells that can change
this are quartered, down to the finest resolution, which is stated with the result.

Sources: Brooks and Lozano-Perez, "A subdivision algorithm in configuration space for findpath with rotation" (1985);
Zhu and Latombe, "New heuristic algorithms for efficient hierarchical path planning" (1991), from which the terms full,
empty and mixed cells are taken. A proof needs full cells only, so whether a cell is empty is only estimated: if empty
cells seem to connect the start to a goal, the search ends without a proof.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, Value
from rr1plan.collision import CollisionChecker
from rr1plan.collision.contact_cells import ContactCells
from rr1plan.model.joint_turns import rotary
from rr1plan.playback.cspace.cspace_cells import Mask, label_components
from rr1plan.playback.cspace.cspace_targets import NEAR, CellTargets, off_by
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene import Scene
from rr1plan.scene.problem import Goal

_COARSEST, _FINEST = 32, 2048  # cells along each axis
_MOST_EFFORT = 250_000  # of checking pairs in cells, see `ContactCells.effort`: a second or two
_BATCH = 4_000  # classified at once
_FULL, _EMPTY, _MIXED = 0, 1, 2
_QUARTERS = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
_AROUND = np.array([[i, j] for i in (-1, 0, 1) for j in (-1, 0, 1)])


@dataclass(frozen=True, eq=False, repr=False)
class Decomposition(Value):
    """Cells of the plane of two joints, at the resolution at which the search for a proof ended.

    Args:
        proves_no_path: No goal can be reached from the start.
        lower, upper: The rectangle that is decomposed [rad or m], shape (2,).
        periodic: Whether each axis is a full turn whose ends are the same place.
        full: Cells that are proven to be blocked, shape (n, n).
        reached: Cells that a path from the start may reach, shape (n, n).
        goal: Cells that may contain a goal, shape (n, n).
    """

    proves_no_path: bool
    lower: Array
    upper: Array
    periodic: tuple[bool, bool]
    full: Mask
    reached: Mask
    goal: Mask

    @property
    def resolution(self) -> int:
        """Cells along each axis at the finest resolution reached."""
        return len(self.full)


def decompose(
    scene: Scene, arm: str, start: Array, targets: Sequence[Goal], known: Sequence[Array]
) -> Decomposition | None:
    """Search for a proof that no path of an arm of two joints leads from its start to a goal.

    Args:
        scene: The scene.
        arm: The arm, which has two planning joints.
        start: The start [rad or m], shape (2,), free and within the limits.
        targets: What counts as the goal: any of these.
        known: Configurations known to reach it, each (2,); the search ends when one seems to be connected to the start.

    Returns:
        The decomposition; None if the ranges of the joints are neither intervals nor full turns.
    """
    robot = scene.arms[arm].robot
    domain = _domain(robot.limits, rotary(robot))
    if domain is None:
        return None
    contacts = ContactCells(CollisionChecker(scene, (arm,)), start, (0, 1))
    search = _Search(domain, contacts, CellTargets(contacts.plane, scene, arm, targets), start, known)
    while search.connect():
        search.refine()
    return search.result()


@dataclass(frozen=True, eq=False)
class _Domain:
    """The rectangle of two joints, and which of its axes are periodic."""

    lower: Array
    upper: Array
    periodic: tuple[bool, bool]

    def half(self, size: int) -> Array:
        return np.asarray((self.upper - self.lower) / (2 * size))

    def centers(self, cells: NDArray[np.intp], size: int) -> Array:
        return np.asarray(self.lower + (2 * cells + 1) * self.half(size))

    def cells_of(self, q: Array, size: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """An index of the cells that contain a configuration (2,), borders included."""
        rows, columns = (np.flatnonzero(mask) for mask in self._holds(q, size).T)
        first, second = np.meshgrid(rows, columns, indexing="ij")
        return first.ravel(), second.ravel()

    def _holds(self, q: Array, size: int) -> Mask:
        """For each axis, which of its intervals contain q, shape (size, 2)."""
        centers = self.centers(np.arange(size)[:, None], size)
        return off_by(centers, q, np.array(self.periodic)) <= self.half(size) + NEAR


def _domain(limits: Limits, turns: Mask) -> _Domain | None:
    endless = ~(np.isfinite(limits.lower) & np.isfinite(limits.upper))
    if (endless & ~turns).any():
        return None
    lower, upper = np.where(endless, -np.pi, limits.lower), np.where(endless, np.pi, limits.upper)
    return _Domain(lower, upper, (bool(endless[0]), bool(endless[1])))


class _Search:
    """Cells of one size, and their refinement."""

    def __init__(
        self, domain: _Domain, contacts: ContactCells, targets: CellTargets, start: Array, known: Sequence[Array]
    ) -> None:
        self.domain, self.contacts, self.targets = domain, contacts, targets
        self.start, self.known = start, known
        self.size, self.spent = _COARSEST, 0.0
        self.state = np.full((self.size, self.size), _MIXED, dtype=np.int8)
        self.goal = np.ones(self.state.shape, dtype=np.bool_)
        # Cells that may be quartered, and the pairs of solids that may touch in each.
        self.cells = np.argwhere(self.goal)
        self.near = np.ones((len(self.cells), contacts.pairs), dtype=np.bool_)
        self._classify()

    def connect(self) -> bool:
        """Compute the cells connected to the start; return whether refinement may lead to a proof and is allowed."""
        passable = label_components(self.state != _FULL, self.domain.periodic, diagonal=True)
        begin = self._parts(passable, self.start)
        self.reached = np.isin(passable, begin) if len(begin) else np.zeros(self.state.shape, dtype=np.bool_)
        self.proven = not (self.reached & self.goal).any()
        empty = label_components(self.state == _EMPTY, self.domain.periodic)
        joined = [np.intersect1d(self._parts(empty, self.start), self._parts(empty, q)) for q in self.known]
        if self.proven or any(len(parts) for parts in joined):
            return False
        self._choose(empty)
        may = self.size < _FINEST and self.spent + 4.0 * self._effort() <= _MOST_EFFORT
        return may and len(self.cells) > 0

    def _effort(self) -> float:
        """The effort of checking the pairs of solids in the cells."""
        return float((self.near @ self.contacts.effort).sum())

    def _parts(self, labels: NDArray[np.int32], q: Array) -> NDArray[np.int32]:
        """The components that contain a configuration."""
        found = np.unique(labels[self.domain.cells_of(q, self.size)])
        return found[found > 0]

    def _choose(self, empty: NDArray[np.int32]) -> None:
        """Select the cells that can change the result, to be quartered.

        These are connected sets of mixed cells that connect different components of seemingly empty cells, or contain
        the start or a goal; and seemingly empty cells that may contain a goal. Only reached cells are selected.
        """
        mixed = label_components(self.state == _MIXED, self.domain.periodic, diagonal=True)
        i, j = self.cells.T
        part, sides = mixed[i, j], empty[self._around()]
        highest, lowest = np.zeros(mixed.max() + 1, np.int32), np.full(mixed.max() + 1, empty.max() + 1, np.int32)
        np.maximum.at(highest, part, sides.max(axis=1))
        np.minimum.at(lowest, part, np.where(sides > 0, sides, empty.max() + 1).min(axis=1))
        decides = highest > lowest
        decides[part[self.goal[i, j]]] = True
        decides[self._parts(mixed, self.start)] = True
        chosen = self.reached[i, j] & np.where(part > 0, decides[part], self.goal[i, j])
        self.cells, self.near = self.cells[chosen], self.near[chosen]

    def _around(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """The cells and their neighbors, as an index into arrays of cells."""
        found = self.cells[:, None] + _AROUND
        first, second = (
            found[..., axis] % self.size if closes else found[..., axis].clip(0, self.size - 1)
            for axis, closes in enumerate(self.domain.periodic)
        )
        return first, second

    def refine(self) -> None:
        """Halve all cells, and classify the quarters of the chosen ones."""
        self.size *= 2
        self.state = self.state.repeat(2, axis=0).repeat(2, axis=1)
        self.goal = self.goal.repeat(2, axis=0).repeat(2, axis=1)
        self.cells = (2 * self.cells[:, None] + _QUARTERS).reshape(-1, 2)
        self.near = self.near.repeat(4, axis=0)
        self._classify()

    def _classify(self) -> None:
        self.spent += self._effort()
        half = self.domain.half(self.size)
        for first in range(0, len(self.cells), _BATCH):
            own = slice(first, first + _BATCH)
            i, j = self.cells[own].T
            centers = self.domain.centers(self.cells[own], self.size)
            full, self.near[own] = self.contacts.classify(centers, half, self.near[own])
            self.goal[i, j] = self.targets.may_hold(centers, half)
            self.state[i, j] = np.where(full, _FULL, np.where(self.near[own].any(axis=1), _MIXED, _EMPTY))
        i, j = self.cells.T
        state = self.state[i, j]
        open_ = (state == _MIXED) | ((state == _EMPTY) & self.goal[i, j])
        self.cells, self.near = self.cells[open_], self.near[open_]

    def result(self) -> Decomposition:
        """The result and its cells."""
        domain = self.domain
        full = self.state == _FULL
        return Decomposition(
            self.proven, domain.lower, domain.upper, domain.periodic, full, self.reached, self.goal & ~full
        )
