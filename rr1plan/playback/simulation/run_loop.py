"""Runs of a simulation: one thread at a time, callbacks after steps, pauses, and pacing by real time."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import Generic, TypeVar

from rr1plan.errors import InputError
from rr1plan.held_interrupts import HeldInterrupts
from rr1plan.thread_locks import per_process

# The simulation sleeps if it is ahead of real time by more than this [s].
_AHEAD = 0.002

_T = TypeVar("_T")


class RunLoop(Generic[_T]):
    """Takes steps, calls callbacks after each of them, and waits for real time.

    Args:
        dt: Time of a step [s].

    Attributes:
        wall: Wall time of all runs [s].
    """

    def __init__(self, dt: float) -> None:
        self._dt = dt
        self.wall = 0.0
        # By a key for each registration, because a callback may be registered twice.
        self._callbacks: dict[object, Callable[[_T], bool | None]] = {}
        # Those that were registered when the last step ended.
        self._due: list[tuple[object, Callable[[_T], bool | None]]] = []
        self._pause = threading.Event()
        # Interrupted in the middle of a step, controllers would be one step ahead of the joints, and records lack it.
        self._interrupts = HeldInterrupts()
        # Held during a run, by the thread `_runner`.
        self._turn = per_process(self, "_turn", threading.Lock)
        self._runner: int | None = per_process(self, "_runner", lambda: None)

    def add_callback(self, callback: Callable[[_T], bool | None]) -> Callable[[], None]:
        """Call a function after each step, until the returned function is called."""
        key = object()
        self._callbacks[key] = callback

        def remove() -> None:
            self._callbacks.pop(key, None)

        return remove

    def begin_steps(self, most: int) -> int:
        """Number of steps to take before callbacks are called, at most `most`."""
        return 1 if self._callbacks else most

    def end_steps(self) -> None:
        """Let `run` call the present callbacks; those that other threads add later miss these steps."""
        self._due = list(self._callbacks.items())

    def pause(self) -> None:
        """End the present run after its current step."""
        self._pause.set()

    @contextmanager
    def turn(self) -> Iterator[None]:
        """One thread runs the simulation at a time, and not from within a run.

        Raises:
            InputError: the thread is in a run already.
        """
        if self._runner == threading.get_ident():
            raise InputError(
                "step or run was called while the simulation runs, by a callback or a controller of it; take more "
                "steps when it has ended"
            )
        with self._turn:
            self._runner, began = threading.get_ident(), time.perf_counter()
            try:
                yield
            finally:
                self.wall += time.perf_counter() - began
                self._runner = None

    def run(self, simulation: _T, advance: Callable[[int], int], count: int, speed: float) -> bool:
        """Take steps in the present `turn`; returns whether all were taken.

        Args:
            simulation: Argument of the callbacks.
            advance: Takes up to a number of steps, from `begin_steps` to `end_steps`, and returns how many.
            count: Number of steps.
            speed: Upper bound on the real-time factor.
        """
        # A single step takes less time than handling Ctrl-C during it.
        with self._interrupts.installed() if count > 1 else nullcontext():
            return self._take(simulation, advance, count, speed)

    def _take(self, simulation: _T, advance: Callable[[int], int], count: int, speed: float) -> bool:
        self._pause.clear()
        began, done = time.perf_counter(), 0
        while done < count:
            # Waiting for real time, as callbacks, follows each single step.
            with self._interrupts:
                done += advance(1 if speed < float("inf") else count - done)
                for key, callback in self._due:
                    # An earlier one may have removed it.
                    if key in self._callbacks and callback(simulation) is False:
                        self._pause.set()
            ahead = done * self._dt / speed - (time.perf_counter() - began)
            if speed < float("inf") and ahead > _AHEAD:
                self._pause.wait(min(ahead, threading.TIMEOUT_MAX))
            if self._pause.is_set():
                break
        return not self._pause.is_set()
