"""Interface of all planners: Budget, Progress, PlanResult, Planner."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import (
    Array,
    Seed,
    Value,
    check_callback,
    counted,
    finite_array,
    number_array,
    of_kind,
    read_only,
    shown,
    whole_number,
)
from rr1plan.errors import InputError, NoPlanError
from rr1plan.path import Path
from rr1plan.progress import Progress as Progress
from rr1plan.progress import ProgressCallback as ProgressCallback
from rr1plan.scene.problem import Problem

_MOST_ITERATIONS = 2**62  # kernels count in 64 bits
CANCELLED = "the progress callback returned False"
"""Why the result of a cancelled search has no path."""
EACH_ARM_ALONE = "each arm has its own path, see `many_arms.paths`"
"""Why the result of a found plan of many arms has no path."""


class PlanStatus(StrEnum):
    """How a planning query ended; equal to the text of its value, as in files and JSON."""

    FOUND = "found"
    TIMEOUT = "timeout"
    INVALID_START = "invalid_start"
    INVALID_GOAL = "invalid_goal"
    INFEASIBLE = "infeasible"
    CANCELLED = "cancelled"


@dataclass(frozen=True)
class Budget:
    """Limits after which a planner stops, whichever is reached first.

    Args:
        seconds: Wall time [s], above zero (inf: no limit).
        iterations: Termination checks of the planner; None: no limit. A budget of iterations
            alone (seconds=inf) makes a plan reproducible to the byte.

    Raises:
        InputError: not a number, zero or less, NaN, or neither limit.
    """

    seconds: float = 10.0
    iterations: int | None = None

    def __post_init__(self) -> None:
        seconds = number_array("seconds of the budget", self.seconds, "a number")
        if seconds.ndim or not seconds > 0.0:
            raise InputError(f"seconds of the budget is {shown(self.seconds)}, expected a number above zero")
        object.__setattr__(self, "seconds", float(seconds))
        if self.iterations is not None:
            iterations = whole_number("iterations of the budget", self.iterations, 1, _MOST_ITERATIONS)
            object.__setattr__(self, "iterations", iterations)
        elif math.isinf(self.seconds):
            raise InputError("a budget needs seconds or iterations, got neither")


@dataclass(frozen=True, eq=False, repr=False)
class SearchTree(Value):
    """The graph that a planner explored.

    Args:
        vertices: Configurations [rad or m], shape (n, nq).
        edges: Indices of the two vertices of each edge, shape (m, 2).

    Raises:
        InputError: vertices of another shape or not finite, or edges that are not pairs of them.
    """

    vertices: Array
    edges: NDArray[np.int64]

    def __post_init__(self) -> None:
        vertices = finite_array("vertices of the tree", self.vertices, (None, None))
        edges = number_array("edges of the tree", self.edges)
        if edges.ndim != 2 or edges.shape[1] != 2:
            raise InputError(f"edges of the tree has shape {edges.shape}, expected (any, 2)")
        wrong = edges[(edges != np.floor(edges)) | ~((edges >= 0) & (edges < len(vertices)))]
        if wrong.size:
            raise InputError(f"an edge of the tree has the vertex {wrong[0]:g}, expected 0 to {len(vertices) - 1}")
        object.__setattr__(self, "vertices", read_only(vertices))
        object.__setattr__(self, "edges", read_only(edges.astype(np.int64)))


@dataclass(frozen=True, eq=False)
class PlanResult:
    """Result of a planner.

    Args:
        status: How it ended; a path exists exactly for FOUND.
        path: The path, every edge certified free, start exact, end at a goal; or None, also if each of many arms has
            its own.
        reason: Why there is no path, in words (which links touch what, which joint is out by how much); empty if one
            was found.
        planner: Name of the planner.
        seed: Seed that reproduces this result under the same budget of iterations.
        seconds: Wall time [s].
        iterations: Termination checks made.
        edges_checked: Edges checked by the collision checker.
        cost_history: (seconds, path length) whenever the best path improved.
        tree: The explored graph, if requested.
    """

    status: PlanStatus
    path: Path | None
    reason: str = ""
    planner: str = ""
    seed: int = 0
    seconds: float = 0.0
    iterations: int = 0
    edges_checked: int = 0
    cost_history: tuple[tuple[float, float], ...] = field(default_factory=tuple)
    tree: SearchTree | None = None

    def __repr__(self) -> str:
        said = (
            self.reason or EACH_ARM_ALONE
            if self.path is None
            else f"{counted(len(self.path), 'waypoint')}, length {self.path.length:.2f}"
        )
        by = f"{self.planner}, " if self.planner else ""  # none of a motion from a file
        return f"PlanResult({by}{self.status.value}: {said})"

    @property
    def found(self) -> bool:
        """Whether there is a path."""
        return self.status is PlanStatus.FOUND

    def __bool__(self) -> bool:
        """Same as `found`."""
        return self.found

    def path_or_raise(self) -> Path:
        """The path.

        Raises:
            NoPlanError: no path was found; the message is the reason.
        """
        if self.path is None:
            by = f"{self.planner}: " if self.planner else ""
            raise NoPlanError(f"{by}{self.status.value}: {self.reason or EACH_ARM_ALONE}")
        return self.path


@dataclass(frozen=True)
class Wait:
    """A rest of an arm before it arrives, in a plan of many arms.

    Args:
        arm: The arm.
        begin: When it stops [s], or 0.
        end: When it continues [s].
        others: The arms that it lets pass; empty if it rests for another reason.
    """

    arm: str
    begin: float
    end: float
    others: tuple[str, ...] = ()


@dataclass(frozen=True)
class PlannerInfo:
    """Name and one-line description of a planner, and whether it improves its path until the budget ends."""

    name: str
    description: str
    optimizing: bool = False


def check_plan_arguments(problem: object, budget: object, progress: object) -> None:
    """Check the types of a planner's arguments.

    Args:
        problem: Expected to be a `Problem`.
        budget: A `Budget` or None.
        progress: A `ProgressCallback` or None.

    Raises:
        InputError: an argument of another type.
    """
    of_kind("problem", problem, Problem)
    of_kind("budget", budget, Budget, optional=True)
    check_callback("progress", progress)


class Planner(ABC):
    """Base class of planners: settings in the constructor, the problem in `plan`.

    A planner has no state that changes its results: the same problem, seed and budget of iterations give the same path.
    Pass an instance wherever a planner's name is accepted, or register a name for it with `register_planner`.

    Attributes:
        name: Its name in results and messages; one line.
        keeps_shape: The shape of its paths is part of the result, such as a straight line of the tool: `plan_motion`
            does not shorten them.
    """

    name: str
    keeps_shape: bool = False

    @abstractmethod
    def plan(
        self,
        problem: Problem,
        *,
        budget: Budget | None = None,
        rng: Seed = None,
        progress: ProgressCallback | None = None,
    ) -> PlanResult:
        """Solve a problem.

        `rr1plan.plan` checks what your planner returns: a `PlanResult` whose path, if the status is `FOUND`, starts at
        `problem.start`, ends at a goal, and has edges that are free by `CollisionChecker(problem.scene, problem.arms,
        margin=problem.margin)`.

        Args:
            problem: The planning problem.
            budget: When to stop; None: the default `Budget()`.
            rng: Generator or seed of all random numbers.
            progress: Called about ten times a second with a `Progress`; if it returns False, the status is `CANCELLED`.
        """
