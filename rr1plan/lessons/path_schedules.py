"""Schedules of two arms on given paths, as curves in their coordination diagram.

A point of the diagram is the progress of each arm on its path. Cells are blocked unless the arms are proven not to
touch anywhere on the two segments (`multi/timing/coordination.py`); a schedule is a curve through free cells from the
start of both paths to the end of both (O'Donnell and Lozano-Pérez, Deadlock-free and collision-free coordination of two
robot manipulators, ICRA 1989). Here each arm moves along its path at 1 rad/s, waits, or backs up; the fastest curve
comes from Dijkstra's algorithm on the cells.
"""

from __future__ import annotations

import heapq
import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rr1plan.checks import Array, finite_array, known_name, of_kind, read_only
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.timing.coordination import coordination_diagram
from rr1plan.path import Path
from rr1plan.planners.collision_messages import describe_collision
from rr1plan.playback.cspace.cspace_cells import label_components
from rr1plan.playback.cspace.cspace_grid import compute_grid
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem

_FORWARD = ((1, 1), (1, 0), (0, 1))
_ALL = (*_FORWARD, (-1, 0), (0, -1), (1, -1), (-1, 1), (-1, -1))
_TRAVEL = 1e-3  # cost of a radian of travel in addition to its time [s]: among equally fast curves, less motion wins


@dataclass(frozen=True, eq=False)
class PathPair:
    """Two paths and their coordination diagram.

    Args:
        arms: The two arms.
        configurations: Configurations of each arm at the ends of its segments [rad], shapes (m + 1, nq) and (n + 1,
            nq).
        lengths: Path length there [rad], shapes (m + 1,) and (n + 1,).
        blocked: Cells that are not proven free, shape (m + 2, n + 2): start, segments and goal of both paths.
    """

    arms: tuple[str, str]
    configurations: tuple[Array, Array]
    lengths: tuple[Array, Array]
    blocked: NDArray[np.bool_]

    @property
    def blocked_share(self) -> float:
        """Share of the cells between starts and goals that are blocked."""
        return float(self.blocked[1:-1, 1:-1].mean())

    def at(self, places: ArrayLike) -> tuple[Array, Array]:
        """Configurations of both arms at path lengths.

        Args:
            places: Path lengths of both arms [rad], shape (k, 2).

        Returns:
            Shapes (k, nq) each.
        """
        rows = finite_array("places", places, (None, 2))
        one, two = (
            np.column_stack([np.interp(rows[:, k], self.lengths[k], column) for column in self.configurations[k].T])
            for k in range(2)
        )
        return one, two

    def is_blocked(self, curve: PairCurve) -> bool:
        """Whether a curve of straight pieces crosses a cell that is not proven free."""
        for begin, end in itertools.pairwise(curve.places):
            shares = [np.array([0.0, 1.0])]
            for lengths, a, b in zip(self.lengths, begin, end, strict=True):
                shares.append((lengths - a) / (b - a) if b != a else np.zeros(0))
            crossings = np.unique(np.clip(np.concatenate(shares), 0.0, 1.0))
            inside = begin + 0.5 * (crossings[1:] + crossings[:-1])[:, None] * (end - begin)
            # On a border between two cells, it suffices that one of them is free.
            sides: list[list[NDArray[np.int64]]] = [
                [np.searchsorted(lengths, inside[:, k], "left"), np.searchsorted(lengths, inside[:, k], "right")]
                for k, lengths in enumerate(self.lengths)
            ]
            if np.logical_and.reduce([self.blocked[i, j] for i, j in itertools.product(*sides)]).any():
                return True
        return False


@dataclass(frozen=True, eq=False)
class PairCurve:
    """A schedule: the positions of both arms over time.

    Args:
        places: Path lengths of both arms [rad], shape (k, 2).
        times: The corresponding times [s], shape (k,).
    """

    places: Array
    times: Array

    @property
    def duration(self) -> float:
        """Arrival time of the last arm [s]."""
        return float(self.times[-1])


def path_pair(scene: Scene, one: tuple[str, ArrayLike], two: tuple[str, ArrayLike]) -> PathPair:
    """Two paths in a scene, and their diagram.

    Args:
        scene: The scene.
        one: An arm and the waypoints of its path [rad], shape (k, nq); corners are rounded where that is proven free.
        two: Another arm and its waypoints.

    Raises:
        UnknownNameError: no such arm.
        InputError: a path that is not free by itself, or arms that touch at both starts or at both goals.
    """
    of_kind("scene", scene, Scene)
    waypoints = {
        known_name("arm", name, scene.arms): finite_array("waypoints", q, (None, None)) for name, q in (one, two)
    }
    if len(waypoints) < 2:
        raise InputError(f"both paths are of arm {one[0]!r}, expected two arms")
    starts, goals = ({name: q[k] for name, q in waypoints.items()} for k in (0, -1))
    problem = Problem(scene, starts, goals)
    both = CollisionChecker(scene, problem.arms)
    for ends, q in (("starts", problem.start), ("goals", Problem(scene, goals, goals).start)):
        if not both.is_free(q):
            raise InputError(f"the arms cannot be at both {ends}: {describe_collision(both, q)}")
    paths = []
    for name, q in waypoints.items():
        agent = Agent(problem, [name])
        checker = CollisionChecker(agent.among({}), [name])
        if not checker.path_is_free(q):
            raise InputError(f"the path of arm {name!r} is not free, even without the other arm")
        paths.append(AgentPath(agent, Path(scene.joint_names([name]), q), checker))
    found = coordination_diagram(paths[0], paths[1])
    shape = (paths[0].cells, paths[1].cells)
    blocked = np.zeros(shape, np.bool_) if found is None else found.astype(np.bool_)
    points = [np.array([path.at(k) for k in range(path.segments + 1)]) for path in paths]
    lengths = [np.concatenate([[0.0], np.cumsum(path.grid.delta)]) for path in paths]
    return PathPair(
        (one[0], two[0]),
        (read_only(points[0]), read_only(points[1])),
        (read_only(lengths[0]), read_only(lengths[1])),
        read_only(blocked),
    )


def fastest_curve(pair: PathPair, *, first: str | None = None, back_up: bool = False) -> PairCurve | None:
    """The fastest schedule, or None if there is none.

    Args:
        pair: The paths.
        first: The arm that passes a blocked region first (default: whichever is faster).
        back_up: Whether arms may move backwards on their paths.

    Raises:
        UnknownNameError: no such arm.
    """
    free = ~pair.blocked
    if first is not None:
        free &= ~_barred(pair, pair.arms.index(known_name("arm", first, pair.arms)))
    cells = _search(pair, free, _ALL if back_up else _FORWARD)
    return None if cells is None else _curve(pair, cells)


def unscheduled_curve(pair: PathPair) -> PairCurve:
    """Both arms at once and without waiting, whether they touch or not.

    Args:
        pair: The paths.
    """
    ends = [float(lengths[-1]) for lengths in pair.lengths]
    times = np.array(sorted({0.0, *ends}))
    return PairCurve(np.minimum(times[:, None], np.array(ends)), times)


def can_get_out_of_the_way(scene: Scene, pair: PathPair, first: str, *, resolution: int = 120) -> bool:
    """Whether the other arm, however fast, can avoid one that moves along its path without regard to it.

    Prioritized planning plans one arm first, as if it were alone, and the other one around its motion (Erdmann and
    Lozano-Pérez, On multiple moving objects, 1987). The other arm's configuration space changes while the first one
    moves; its reachable set is propagated from slice to slice on a grid.

    Args:
        scene: The scene.
        pair: The paths; the other arm may leave its own.
        first: The arm that is planned first.
        resolution: Cells along each axis of the other arm's configuration space.

    Raises:
        UnknownNameError: no such arm.
    """
    k = pair.arms.index(known_name("arm", first, pair.arms))
    other = pair.arms[1 - k]
    start, goal = pair.configurations[1 - k][[0, -1]]
    reached: NDArray[np.bool_] | None = None
    for q in pair.configurations[k]:
        grid = compute_grid(scene.with_configuration(first, q), other, resolution=resolution)
        if reached is None:
            reached = np.zeros(grid.free.shape, np.bool_)
            reached[grid.cell(start)] = True
        labels = label_components(grid.free, grid.periodic)
        reached = np.isin(labels, np.unique(labels[reached & grid.free])) & grid.free
        if not reached.any():
            return False
    return bool(reached is not None and reached[grid.cell(goal)])


def _barred(pair: PathPair, first: int) -> NDArray[np.bool_]:
    """Cells that a curve must not cross if one arm goes first: a ray from the largest blocked region."""
    labels = label_components(pair.blocked, (False, False))
    bars = np.zeros_like(pair.blocked)
    if labels.max(initial=0) == 0:
        return bars
    largest = int(np.argmax(np.bincount(labels.ravel())[1:])) + 1
    rows, columns = np.nonzero(labels == largest)
    middle = len(rows) // 2
    if first == 0:
        bars[: rows[middle] + 1, columns[middle]] = True
    else:
        bars[rows[middle], : columns[middle] + 1] = True
    return bars


def _search(
    pair: PathPair, free: NDArray[np.bool_], moves: tuple[tuple[int, int], ...]
) -> list[tuple[int, int]] | None:
    """Corners of cells from the start of both paths to the end of both; None if they are not connected.

    A corner is a pair of segment ends. A step crosses a free cell or runs along the border of two, one of which is
    free.
    """
    one, two = pair.lengths
    goal = (len(one) - 1, len(two) - 1)
    best: dict[tuple[int, int], float] = {(0, 0): 0.0}
    before: dict[tuple[int, int], tuple[int, int]] = {}
    queue: list[tuple[float, tuple[int, int]]] = [(0.0, (0, 0))]
    while queue:
        cost, (i, j) = heapq.heappop(queue)
        if (i, j) == goal:
            found = [goal]
            while found[-1] in before:
                found.append(before[found[-1]])
            return found[::-1]
        if cost > best[i, j]:
            continue
        for a, b in moves:
            k, m = i + a, j + b
            if not (0 <= k <= goal[0] and 0 <= m <= goal[1]) or not _is_open(free, i, j, a, b):
                continue
            far, high = abs(float(one[k] - one[i])), abs(float(two[m] - two[j]))
            new = cost + max(far, high) + _TRAVEL * (far + high)
            if new < best.get((k, m), np.inf):
                best[k, m], before[k, m] = new, (i, j)
                heapq.heappush(queue, (new, (k, m)))
    return None


def _is_open(free: NDArray[np.bool_], i: int, j: int, a: int, b: int) -> bool:
    """Whether the step from corner (i, j), where cells i, i + 1 and j, j + 1 meet, by (a, b) stays in a free cell."""
    rows = (i + (a > 0),) if a else (i, i + 1)
    columns = (j + (b > 0),) if b else (j, j + 1)
    return bool(free[np.ix_(rows, columns)].any())


def _curve(pair: PathPair, corners: list[tuple[int, int]]) -> PairCurve:
    """The schedule through corners, each arm at 1 rad/s where it moves."""
    places = np.column_stack([pair.lengths[k][[corner[k] for corner in corners]] for k in range(2)])
    times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(places, axis=0)).max(axis=1))])
    return PairCurve(read_only(places), read_only(times))
