"""Batches of problems over processes, with separate seeds and ordered results.

Problem i gets the i-th seed of `problem_seeds(rng, n)`, so results do not depend on the number of workers. Consecutive
problems are sent in chunks, so that shared values (a scene) are pickled once. If a worker process dies, the problems of
its chunks are planned again one by one, and only a problem that kills its process again fails.
"""

from __future__ import annotations

import logging
import math
import pickle
import signal
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from itertools import chain
from multiprocessing import get_context
from multiprocessing.sharedctypes import RawArray
from multiprocessing.synchronize import Event
from typing import Any, Literal, NamedTuple, TypeVar, overload

import numpy as np

from rr1plan.batch_worker import CANCELLED, Raised, Settings, Task, begin_worker, load_planner, raised, run_chunk
from rr1plan.checks import (
    Seed,
    Value,
    as_generator,
    check_callback,
    items_of,
    known_name,
    of_kind,
    true_or_false,
    whole_number,
)
from rr1plan.errors import BackendError, InputError
from rr1plan.motion_plan import MotionPlan
from rr1plan.multi.in_parallel import processors
from rr1plan.pipeline import check_many_arms_retiming
from rr1plan.planners import MANY_ARMS_PLANNERS, chosen_planner, is_own
from rr1plan.planning import Budget, Planner, PlanResult, Progress, ProgressCallback
from rr1plan.retiming import retiming_names
from rr1plan.scene.problem import Problem

logger = logging.getLogger(__name__)

_T = TypeVar("_T")
_CHUNKS_PER_WORKER = 4
_LONGEST_CHUNK = 32
_MOST_WORKERS = 10_000
# Polling interval of worker processes [s].
_POLL = 0.1


@dataclass(frozen=True, eq=False, repr=False)
class PlanFailure(Value):
    """Result of a problem that raised an exception, whose process died, or that was cancelled or not accepted.

    Args:
        problem: The problem.
        error: Name of the exception.
        reason: Its message.
        details: Its traceback in the worker process, if there is one.
    """

    problem: Problem
    error: str
    reason: str
    details: str = ""

    @property
    def status(self) -> str:
        """The name of the exception, where a `MotionPlan` has its `PlanStatus`, e.g. for tables of results."""
        return self.error

    @property
    def found(self) -> bool:
        """Always False; mirrors `MotionPlan.found` and `PlanResult.found`."""
        return False

    @property
    def valid(self) -> bool:
        """Always False; mirrors `MotionPlan.valid`."""
        return False

    def __bool__(self) -> bool:
        """Always False; mirrors `MotionPlan`."""
        return False


BatchResult = MotionPlan | PlanResult | PlanFailure
"""The result of `plan_many` for one problem."""


@overload
def plan_many(
    problems: Iterable[Problem],
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    full: Literal[True] = True,
    planner: str | Planner | None = None,
    retiming: str = "blend",
    budget: Budget | None = None,
    rng: Seed = None,
    progress: ProgressCallback | None = None,
) -> list[MotionPlan | PlanFailure]: ...


@overload
def plan_many(
    problems: Iterable[Problem],
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    full: Literal[False],
    planner: str | Planner | None = None,
    retiming: str = "blend",
    budget: Budget | None = None,
    rng: Seed = None,
    progress: ProgressCallback | None = None,
) -> list[PlanResult | PlanFailure]: ...


def plan_many(
    problems: Iterable[Problem],
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    full: bool = True,
    planner: str | Planner | None = None,
    retiming: str = "blend",
    budget: Budget | None = None,
    rng: Seed = None,
    progress: ProgressCallback | None = None,
) -> Sequence[BatchResult]:
    """Solve many problems in parallel, each like `plan_motion` (or `plan`).

    Without an executor this spawns processes, so a script has to guard its main part with
    `if __name__ == "__main__":`. Ctrl-C stops the processes within about a tenth of a second, those that are starting
    or run a planner of OMPL within about two seconds.

    Args:
        problems: The problems. Those in one scene should share one `Scene` object and be consecutive.
        executor: Any `concurrent.futures.Executor` to use instead, e.g. of a Dask client (`client.get_executor()`) or
            of mpi4py. It is not shut down.
        workers: Number of processes (default: the processors that this process may use); with an executor, the number
            of its workers.
        full: Plan, shorten, retime and validate, as in `plan_motion`; or only plan, as in `plan`.
        planner: A name of `planner_names()`, "many_arms" as in `plan_motion`, or an instance of `Planner`, which is
            sent to the processes by pickle (default: that of `plan_motion`, or of `plan`).
        retiming: A name of `retiming_names()`.
        budget: When to stop the planner, for each problem (default: 10 s).
        rng: Seed of the batch, from which each problem gets a seed; `PlanResult.seed` of its result repeats it alone.
        progress: Called for each finished problem, with the finished fraction; it may return False to cancel. An
            executor's problems are reported when the whole chunk that contains them is finished.

    Returns:
        The results in the order of the problems, each a `MotionPlan` (or `PlanResult` if not `full`), or a
        `PlanFailure` if the problem raised an exception, its process died, the executor broke, was shut down or did
        not accept it, or the batch was cancelled.

    Raises:
        UnknownNameError: no such planner or retiming.
        InputError: something that is not a problem, no worker, a negative seed, a planner that cannot be pickled, an
            executor whose `submit` returns no future, "many_arms" with retiming "ruckig_direct" or without `full`.
        BackendError: the processes do not start.
        KeyboardInterrupt: Ctrl-C, after the processes have ended.
    """
    known_name("retiming", retiming, retiming_names())
    true_or_false("full", full)
    if isinstance(planner, str) and planner in MANY_ARMS_PLANNERS:
        check_many_arms_retiming(planner, retiming)
        if not full:
            raise InputError(f"planner {planner!r} makes trajectories, not paths; leave full=True")
    settings = Settings(full, _sent_planner(planner, executor), retiming, budget)
    check_callback("progress", progress)
    of_kind("budget", budget, Budget, optional=True)
    checked = _checked(problems, executor, workers)
    tasks = [Task(i, p, s) for i, (p, s) in enumerate(zip(checked, problem_seeds(rng, len(checked)), strict=True))]
    chunks = _chunks(tasks, workers or processors())
    board = _Board(checked, progress)
    if not chunks:
        return []
    if executor is not None:
        left = deque(chunks)
        lost = _work_off(executor, left, settings, board, len(chunks))
        if lost:
            lost += [_Lost(task, lost[-1].why) for task in chain.from_iterable(left)]
        for task, why in lost:
            board.note(task.number, why)
        return board.results()
    _work_in_processes(chunks, settings, board, min(workers or processors(), len(chunks)))
    return board.results()


def problem_seeds(rng: Seed, count: int) -> list[int]:
    """The seeds of the problems of `plan_many`; seed i does not depend on `count`."""
    sequence = as_generator(rng).bit_generator.seed_seq
    if not isinstance(sequence, np.random.SeedSequence):
        raise InputError(f"rng has a seed of kind {type(sequence).__name__}, expected numpy's SeedSequence")
    return [int(child.generate_state(1, np.uint64)[0]) for child in sequence.spawn(count)]


def _sent_planner(planner: str | Planner | None, executor: Executor | None) -> str | Planner | None:
    """The planner as it is sent to processes: a name that is known everywhere, or the planner itself.

    Raises:
        InputError: a planner that cannot be sent.
    """
    if planner is None or (isinstance(planner, str) and (planner in MANY_ARMS_PLANNERS or is_own(planner))):
        return planner
    chosen = chosen_planner(planner)
    if executor is None:
        try:
            pickle.dumps(chosen)
        except InputError:
            raise
        except Exception as error:
            raise _not_sent(chosen, error) from error
    return chosen


def _not_sent(planner: str | Planner | None, error: Exception) -> InputError:
    """The error about a planner that processes cannot load."""
    name = planner.name if isinstance(planner, Planner) else planner
    return InputError(
        f"planner {name!r} cannot be sent to other processes: {error}; "
        "define its class in a module, and keep what cannot be pickled out of it"
    )


def _checked(problems: Iterable[Problem], executor: object, workers: int | None) -> list[Problem]:
    checked = list(items_of("problems", problems, "Problem"))
    for i, problem in enumerate(checked):
        if not isinstance(problem, Problem):
            raise InputError(f"problems[{i}] is {type(problem).__name__}, expected a Problem")
    if executor is not None and not isinstance(executor, Executor):
        has_one = callable(getattr(executor, "get_executor", None))
        hint = "; pass its get_executor()" if has_one else ""
        raise InputError(f"executor is {type(executor).__name__}, expected a concurrent.futures.Executor{hint}")
    if workers is not None:
        whole_number("workers", workers, 1, _MOST_WORKERS)
    return checked


def _chunks(tasks: Sequence[Task], workers: int) -> list[list[Task]]:
    size = min(_LONGEST_CHUNK, max(1, math.ceil(len(tasks) / (_CHUNKS_PER_WORKER * workers))))
    return [list(tasks[i : i + size]) for i in range(0, len(tasks), size)]


class _Board:
    """The results so far.

    Attributes:
        ended: A byte for each problem, 1 if it has ended; processes set it before they return the result.
    """

    def __init__(self, problems: list[Problem], progress: ProgressCallback | None) -> None:
        self.problems = problems
        self.progress = progress
        self.cancelled = False
        self.ended = RawArray("b", len(problems))
        self._reported = 0
        self._results: dict[int, BatchResult] = {}
        self._started = time.perf_counter()

    def note(self, index: int, result: Any) -> None:
        """Store the result of a problem, with its pickled copy of the problem replaced by the original."""
        if isinstance(result, MotionPlan):
            result = replace(result, problem=self.problems[index])
        elif isinstance(result, Raised):
            result = PlanFailure(self.problems[index], *result)
        self._results[index] = result
        self.ended[index] = 1
        self.report()

    def report(self) -> None:
        """Report each problem that has ended since the last call."""
        ended = bytes(self.ended).count(1)
        while self.progress is not None and self._reported < ended and not self.cancelled:
            self._reported += 1
            seconds = time.perf_counter() - self._started
            done = self._reported / len(self.problems)
            self.cancelled = self.progress(Progress("plan_many", seconds, done)) is False

    def results(self) -> list[BatchResult]:
        """All results in order; problems without one were cancelled."""
        results = self._results
        return [results[i] if i in results else PlanFailure(p, *CANCELLED) for i, p in enumerate(self.problems)]


class _Lost(NamedTuple):
    """A task that the executor did not do, and why."""

    task: Task
    why: Raised


_BROKE = Raised("BrokenExecutor", "the executor broke before this problem was done")


def _work_off(
    executor: Executor, chunks: deque[list[Task]], settings: Settings, board: _Board, at_once: int
) -> list[_Lost]:
    """Process all chunks, `at_once` of them at a time; return the tasks lost with a broken or closed executor.

    A chunk that cannot be pickled is tried again problem by problem.
    """
    pending: dict[Future[list[object]], list[Task]] = {}
    lost: list[_Lost] = []
    try:
        while (chunks or pending) and not board.cancelled:
            while chunks and len(pending) < at_once and not lost:
                chunk = chunks.popleft()
                future, refused = _submit(executor, chunk, settings, chunks, board)
                lost += refused
                if future is not None:
                    pending[future] = chunk
            if not pending:
                break
            # `wait` never returns a future that the shutdown of its executor cancelled.
            wait(pending, _POLL, return_when=FIRST_COMPLETED)
            for future in [future for future in pending if future.done()]:
                lost += _take(future, pending.pop(future), chunks, board)
            board.report()
        if isinstance(executor, _Pool) and board.cancelled:
            executor.stop.set()
            _keep_ended(pending, board)
    finally:
        for future in pending:
            future.cancel()
    return lost


def _keep_ended(pending: dict[Future[list[object]], list[Task]], board: _Board) -> None:
    """Store the results that were reported before the batch was cancelled; their chunks end at once."""
    for future, chunk in pending.items():
        with suppress(Exception):  # a chunk without results: it was not started, or its process died
            if not future.cancel():
                for task, result in zip(chunk, future.result(), strict=True):
                    if board.ended[task.number]:
                        board.note(task.number, result)


def _submit(
    executor: Executor, chunk: list[Task], settings: Settings, chunks: deque[list[Task]], board: _Board
) -> tuple[Future[list[object]] | None, list[_Lost]]:
    """Submit a chunk. Returns its future, None if it is refused; and its tasks if the executor takes no more."""
    try:
        future = executor.submit(run_chunk, chunk, settings)
    except BrokenExecutor:
        return None, [_Lost(task, _BROKE) for task in chunk]
    except RuntimeError as error:  # it is shut down
        why = Raised(type(error).__name__, f"the executor accepted no more tasks: {error}")
        return None, [_Lost(task, why) for task in chunk]
    except Exception as error:  # it pickles here, or raises others
        _divide(chunk, chunks, board, error)
        return None, []
    if not isinstance(future, Future):
        raise InputError(f"executor.submit returned {type(future).__name__}, expected a concurrent.futures.Future")
    return future, []


def _take(future: Future[list[object]], chunk: list[Task], chunks: deque[list[Task]], board: _Board) -> list[_Lost]:
    """Store the results of a chunk; return its tasks if they were lost."""
    try:
        results = future.result()
    except BrokenExecutor:
        return [_Lost(task, _BROKE) for task in chunk]
    except CancelledError:
        for task in chunk:
            board.note(task.number, Raised("CancelledError", "the executor cancelled this problem"))
        return []
    except Exception as error:
        _divide(chunk, chunks, board, error)
        return []
    for task, result in zip(chunk, results, strict=True):
        board.note(task.number, result)
    return []


def _divide(chunk: list[Task], chunks: deque[list[Task]], board: _Board, error: Exception) -> None:
    """Try the problems of a failed chunk again one by one; store the error of a single one."""
    if len(chunk) > 1:
        chunks.extend([task] for task in chunk)
    else:
        board.note(chunk[0].number, raised(error))


def _work_in_processes(chunks: list[list[Task]], settings: Settings, board: _Board, workers: int) -> None:
    """Process all chunks in spawned processes; tasks lost with a process are repeated, each alone."""
    left = deque(chunks)
    while left and not board.cancelled:
        with _pool(workers, board, settings.planner) as pool:
            suspects = deque(task for task, _ in _work_off(pool, left, settings, board, workers))
        while suspects and not board.cancelled:
            with _pool(1, board, settings.planner) as pool:
                while suspects and not board.cancelled:
                    task = suspects.popleft()
                    if _work_off(pool, deque([[task]]), settings, board, 1):
                        logger.warning("problem %d killed the process that worked on it", task.number)
                        board.note(task.number, Raised("BrokenProcessPool", "the process that worked on it died"))
                        break


class _Pool(ProcessPoolExecutor):
    """A pool whose processes, started as tasks are submitted, ignore Ctrl-C from their first instruction on.

    Attributes:
        stop: The event that ends the processes.
    """

    stop: Event

    def submit(self, function: Callable[..., _T], /, *arguments: Any, **settings: Any) -> Future[_T]:
        with _interrupts_blocked():
            return super().submit(function, *arguments, **settings)


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Defer Ctrl-C to the end of the block; processes started in it inherit the signal mask."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _pool(workers: int, board: _Board, planner: str | Planner | None) -> Iterator[Executor]:
    """A pool of running processes, which know the planner; at the end they are stopped and joined."""
    context = get_context("spawn")
    stop = context.Event()
    pool = _Pool(workers, mp_context=context, initializer=begin_worker, initargs=(stop, board.ended))
    pool.stop = stop
    try:
        try:
            pool.submit(load_planner, pickle.dumps(planner)).result()
        except (AttributeError, ImportError) as error:
            raise _not_sent(planner, error) from error
        except (BrokenExecutor, RuntimeError) as error:
            raise BackendError(
                "worker processes do not start; they import the script that runs, so its main part "
                "has to be guarded: if __name__ == '__main__': ..."
            ) from error
        yield pool
    finally:
        # A starting process needs resources that disappear with this process.
        with _interrupts_blocked():
            stop.set()
            pool.shutdown(wait=True, cancel_futures=True)
