"""A question to OMPL in plain arrays, the watch over its search, and the answer; nothing here knows OMPL."""

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
class Question:
    """A question in plain arrays.

    Args:
        lower: Bounds of the search space [rad or m], shape (n,).
        upper: Its other bounds, above the first, shape (n,).
        start: Where to start, shape (n,).
        goals: Where to end, any of them, shape (k, n).
        state_valid: Whether a configuration (n,) is free; the array is reused after the call.
        edge_valid: Whether the straight line between two configurations is free; likewise.
    """

    lower: Array
    upper: Array
    start: Array
    goals: Array
    state_valid: Callable[[Array], bool]
    edge_valid: Callable[[Array, Array], bool]

    def checked(self) -> Question:
        """The same question, its numbers checked and copied.

        Raises:
            InputError: wrong shapes, not finite, bounds the wrong way round, or a state outside them.
        """
        n = len(self.lower)
        lower, upper = (finite_array(name, getattr(self, name), (n,)) for name in ("lower", "upper"))
        start, goals = finite_array("start", self.start, (n,)), finite_array("goals", self.goals, (None, n))
        if n == 0 or len(goals) == 0:
            raise InputError(f"a question of {n} joints and {len(goals)} goals, expected at least one of each")
        if not (lower < upper).all():
            raise InputError(f"lower bounds {lower.tolist()} are not all below the upper ones {upper.tolist()}")
        states = np.vstack([start, goals])
        if (states < lower).any() or (states > upper).any():
            raise InputError("the start or a goal is outside the bounds")
        return Question(lower, upper, start, goals, self.state_valid, self.edge_valid)


@dataclass(eq=False)
class Watch:
    """Counts and clock of one search, and what stopped it.

    Args:
        budget: When to stop.
        began: When the clock started (`time.perf_counter`) [s].
        goes_on: Asked at each check; False cancels.

    Attributes:
        checks: Termination checks so far.
        over: The search has to end.
        cancelled: Because `goes_on` said so.
        error: What a callback raised.
        best_cost: Tells the cost of the best path so far; set while a planner searches that knows it.
        history: (seconds, cost) whenever it improved.
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

    def __post_init__(self) -> None:
        self.deadline = self.began + self.budget.seconds
        self.most = np.inf if self.budget.iterations is None else self.budget.iterations

    def look(self) -> None:
        """One termination check: count, clock, cost, and whether it is cancelled."""
        self.checks += 1
        if self.best_cost is not None:
            self.note(self.best_cost())
        if self.checks >= self.most or time.perf_counter() >= self.deadline:
            self.over = True
        if self.goes_on is not None and not self.goes_on():
            self.over = self.cancelled = True

    def note(self, cost: float) -> None:
        """Remember a better cost."""
        if np.isfinite(cost) and (not self.history or cost < self.history[-1][1]):
            self.history.append((time.perf_counter() - self.began, float(cost)))

    def guarded(self, answer: Callable[..., bool], failed: bool) -> Callable[..., bool]:
        """A callback that never raises: what it raised is kept and ends the search."""

        def call(*arguments: Any) -> bool:
            if self.over:
                return failed
            try:
                return bool(answer(*arguments))
            except BaseException as error:
                self.error, self.over = error, True
                return failed

        return call

    def is_over(self) -> bool:
        """Whether to stop; the termination condition."""
        self.look()
        return self.over

    def in_time(self) -> bool:
        """Whether an edge or state may still be checked: a search that looks rarely still ends in time."""
        if time.perf_counter() >= self.deadline:
            self.over = True
        return not self.over


@dataclass(frozen=True, eq=False)
class Answer:
    """What a search found.

    Args:
        waypoints: The path from the start to a goal, shape (m, n), or None.
        difference: How near to a goal it came otherwise [rad], if known.
        tree: What was explored, when asked for.
    """

    waypoints: Array | None
    difference: float | None = None
    tree: SearchTree | None = None


@contextmanager
def interrupts_kept(watch: Watch) -> Iterator[None]:
    """Let Ctrl-C end the search at its next callback instead of raising inside of OMPL."""
    ours = threading.current_thread() is threading.main_thread()
    if not ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return

    def note(number: int, frame: Any) -> None:
        watch.error, watch.over = KeyboardInterrupt(), True

    signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
