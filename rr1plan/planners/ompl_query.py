"""A query to OMPL as arrays, its budget and counters, and its result; independent of OMPL."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rr1plan.checks import Array, finite_array
from rr1plan.errors import InputError
from rr1plan.planning import Budget, SearchTree


@dataclass(frozen=True, eq=False)
class OmplQuery:
    """A planning query as arrays.

    Args:
        lower: Lower bounds of the search space [rad or m], shape (n,).
        upper: Upper bounds, above the lower ones, shape (n,).
        start: Start configuration, shape (n,).
        goals: Alternative goal configurations, shape (k, n).
        state_valid: Whether a configuration (n,) is free; the array is reused after the call.
        edge_valid: Whether the straight line between two configurations is free; likewise.
    """

    lower: Array
    upper: Array
    start: Array
    goals: Array
    state_valid: Callable[[Array], bool]
    edge_valid: Callable[[Array, Array], bool]

    def checked(self) -> OmplQuery:
        """A validated copy of the query.

        Raises:
            InputError: wrong shapes, not finite, lower above upper bounds, or a state outside the bounds.
        """
        n = len(self.lower)
        lower, upper = (finite_array(name, getattr(self, name), (n,)) for name in ("lower", "upper"))
        start, goals = finite_array("start", self.start, (n,)), finite_array("goals", self.goals, (None, n))
        if n == 0 or len(goals) == 0:
            raise InputError(f"a query with {n} joints and {len(goals)} goals, expected at least one of each")
        if not (lower < upper).all():
            raise InputError(f"lower bounds {lower.tolist()} are not all below the upper ones {upper.tolist()}")
        states = np.vstack([start, goals])
        if (states < lower).any() or (states > upper).any():
            raise InputError("the start or a goal is outside the bounds")
        return OmplQuery(lower, upper, start, goals, self.state_valid, self.edge_valid)


# AORRTC may sample states forever between two termination checks. After the first number of states the search may be
# cancelled; the second one, which no planner needs, ends it.
_STATES, _MOST_STATES = 100, 5_000


@dataclass(eq=False)
class Watch:
    """Budget, counters and termination state of one search.

    Args:
        budget: When to stop.
        began: Start time (`time.perf_counter`) [s].
        goes_on: Called at each termination check; False cancels.

    Attributes:
        checks: Termination checks so far.
        over: Whether the search has to end.
        cancelled: Whether `goes_on` returned False.
        error: Exception raised by a callback.
        best_cost: Returns the cost of the best path; set while an optimizing planner runs.
        history: (seconds, cost) whenever the best cost improved.
    """

    budget: Budget
    began: float
    goes_on: Callable[[], bool] | None = None
    checks: int = 0
    over: bool = False
    cancelled: bool = False
    error: BaseException | None = None
    best_cost: Callable[[], float] | None = None
    history: list[tuple[float, float]] = field(default_factory=list)
    _states: int = 0

    def __post_init__(self) -> None:
        self.deadline = self.began + self.budget.seconds
        self.most = np.inf if self.budget.iterations is None else self.budget.iterations

    def is_over(self) -> bool:
        """The termination condition; updates counter, clock, cost and cancellation."""
        self.checks += 1
        self._states = 0
        if self.best_cost is not None:
            self.note(self.best_cost())
        if self.checks >= self.most or time.perf_counter() >= self.deadline:
            self.over = True
        self._check_cancelled()
        return self.over

    def _check_cancelled(self) -> None:
        """End the search if `goes_on` cancels it."""
        if self.goes_on is not None and not self.goes_on():
            self.over = self.cancelled = True

    def note(self, cost: float) -> None:
        """Append a cost to the history if it is the best."""
        if np.isfinite(cost) and (not self.history or cost < self.history[-1][1]):
            self.history.append((time.perf_counter() - self.began, float(cost)))

    def guarded(self, result: Callable[..., bool], failed: bool) -> Callable[..., bool]:
        """A callback that never raises: an exception is stored in `error` and ends the search."""

        def call(*arguments: Any) -> bool:
            if self.over:
                return failed
            try:
                return bool(result(*arguments))
            except BaseException as error:
                self.error, self.over = error, True
                return failed

        return call

    def in_time(self) -> bool:
        """Whether time is left for a state or edge check, for searches that rarely evaluate `is_over`."""
        self._states += 1
        if self._states % _STATES == 0:
            self._check_cancelled()
        if self._states >= _MOST_STATES or time.perf_counter() >= self.deadline:
            self.over = True
        return not self.over


@dataclass(frozen=True, eq=False)
class OmplResult:
    """Result of a search.

    Args:
        waypoints: The path from the start to a goal, shape (m, n), or None.
        difference: Distance from the explored graph to a goal without a path [rad or m], if known.
        tree: The explored graph, if requested.
    """

    waypoints: Array | None
    difference: float | None = None
    tree: SearchTree | None = None


@contextmanager
def interrupts_kept(watch: Watch) -> Iterator[None]:
    """End the search at its next callback upon Ctrl-C, instead of raising inside OMPL."""
    ours = threading.current_thread() is threading.main_thread()
    if not ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return

    def note(number: int, frame: object) -> None:
        watch.error, watch.over = KeyboardInterrupt(), True

    signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
