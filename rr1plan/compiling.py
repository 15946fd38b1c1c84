"""The one-time compilation: what has to be compiled, and several processes that do it side by side.

Numba is busy in Python for most of the time that it compiles, so that threads are no help. Helpers are processes of
their own that are told what to compile and keep the code on disk, where this one finds it; it compiles too. Whatever a
helper cannot do is done here: nothing depends on one. They end with the last function, and when this process does.
"""

from __future__ import annotations

import json
import logging
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from queue import Queue
from types import CodeType, FunctionType
from typing import IO, Any, cast

import numba

logger = logging.getLogger(__name__)

# More of them wait for each other most of the time.
_MOST_PROCESSES = 4
# Bytes of Python's code without the longest function, below which a helper is no sooner ready than the work is done.
_WORTH_A_HELPER = 20_000
# A helper that has not compiled its function by then has stopped for good [s].
_PATIENCE = 180.0
_GLANCE = 0.5
_HELPER = (
    "import json, sys; sys.path[:] = json.loads(sys.stdin.readline());"
    "import rr1plan.compiling; rr1plan.compiling.serve()"
)

_jobs: dict[str, Job] = {}
_told: list[str] = []
_one_at_a_time = threading.Lock()


@dataclass(frozen=True, eq=False)
class Job:
    """A function that gets machine code of its own.

    Args:
        function: The function.
        is_kept: Whether its code is on disk; None if it can be kept nowhere.
        build: Loads or compiles it.
        ahead: Compile it together with others as soon as one is needed; not for what few need.
    """

    function: Callable[..., Any]
    is_kept: Callable[[], bool | None]
    build: Callable[[], object]
    ahead: bool = True

    @property
    def name(self) -> str:
        """By which other processes find it."""
        return _name_of(self.function)

    @cached_property
    def _reach(self) -> tuple[int, list[Job]]:
        size, parts, ahead = 0, {self.function}, [self.function]
        needs: dict[str, Job] = {}
        while ahead:
            function = ahead.pop()
            size += len(cast(FunctionType, function).__code__.co_code)
            for callee in _callees(function) - parts:
                name = _name_of(callee)
                if name in _jobs:
                    needs[name] = _jobs[name]
                else:
                    parts.add(callee)
                    ahead.append(callee)
        return size, [needs[name] for name in sorted(needs)]

    @property
    def size(self) -> int:
        """Bytes of Python's code that become part of it: the time to compile it is about proportional."""
        return self._reach[0]

    @property
    def needs(self) -> list[Job]:
        """What it calls by address."""
        return self._reach[1]


def register(job: Job) -> None:
    """Make a function known to `compile_together`."""
    _jobs[job.name] = job


def tell(folder: Path | None) -> None:
    """Say once that something is compiled, before it is.

    Args:
        folder: Where the code is kept, if it can be.
    """
    if _told:
        return
    _told.append(str(folder))
    if folder is None:
        logger.warning("compiling for this machine takes up to a minute, in every process (no folder to keep code in)")
    else:
        logger.warning("compiling for this machine takes up to a minute, once (kept in %s)", folder)


def compile_ahead(job: Job) -> None:
    """Compile all that is known and not kept, if one of it is needed and several processes are sooner ready."""
    if not _may_start_processes():
        return
    with _one_at_a_time:
        missing = _missing([job, *(other for other in _jobs.values() if other.ahead)])
        helpers = _helpers_for(missing)
        if helpers:
            _Round(missing, None).work_off(helpers)


def compile_together(jobs: Iterable[Job], progress: Callable[[float], object] | None = None) -> None:
    """Compile functions in as many processes as are of use.

    Args:
        jobs: The functions; those that are kept are left out.
        progress: Called with the fraction that is done.
    """
    with _one_at_a_time:
        missing = _missing(jobs)
        _Round(missing, progress).work_off(_helpers_for(missing))


def all_jobs() -> list[Job]:
    """All functions that are known."""
    return list(_jobs.values())


def serve() -> None:
    """Be a helper: compile the functions whose names come in, until no more can come."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    names: Queue[str] = Queue()
    threading.Thread(target=_listen, args=(names,), daemon=True).start()
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    # What others print is no answer.
    os.dup2(2, 1)
    try:
        answers.write("ready\n")
        while True:
            name = names.get()
            import_module(name.partition(":")[0])
            _jobs[name].build()
            answers.write(f"{name}\n")
    finally:
        os._exit(1)


def _listen(names: Queue[str]) -> None:
    """Pass on what comes in, and end the process when nobody is there any more."""
    for line in sys.stdin:
        names.put(line.strip())
    os._exit(0)


class _Round:
    """Functions that this process and helpers work off, those first on which most depends.

    Args:
        jobs: The functions, none of them kept.
        progress: Called with the fraction that is done.
    """

    def __init__(self, jobs: list[Job], progress: Callable[[float], object] | None) -> None:
        ranks = _ranks(jobs)
        self._waiting = sorted(jobs, key=lambda job: -ranks[job])
        self._open = set(jobs)
        self._total = sum(job.size for job in jobs)
        self._progress = progress
        self._changed = threading.Condition()
        self._helpers: list[subprocess.Popen[str]] = []
        self._ended = False

    def work_off(self, helpers: int) -> None:
        """Compile all of them, with so many helpers."""
        threads = [threading.Thread(target=self._employ, daemon=True) for _ in range(helpers)]
        try:
            for thread in threads:
                thread.start()
            while (job := self._take()) is not None:
                job.build()
                self._settle(job)
        finally:
            self._dismiss()
            for thread in threads:
                if thread.ident is not None:
                    thread.join()

    def _take(self) -> Job | None:
        """What this process compiles next; None when all is done. Helpers that say nothing for long are sent away."""
        waited = 0.0
        while self._open:
            self._tell_progress()
            with self._changed:
                job = self._next()
                if job is not None or not self._open:
                    return job
                # In short pieces, as Ctrl-C does not end one everywhere.
                waited = 0.0 if self._changed.wait(_GLANCE) else waited + _GLANCE
            if waited > _PATIENCE:
                logger.info("processes that compile have stopped; going on without them")
                self._dismiss()
        self._tell_progress()
        return None

    def _next(self) -> Job | None:
        """Take the first function that calls none that is still open."""
        for job in self._waiting:
            if self._open.isdisjoint(job.needs):
                self._waiting.remove(job)
                return job
        return None

    def _settle(self, job: Job) -> None:
        with self._changed:
            self._open.discard(job)
            self._changed.notify_all()

    def _tell_progress(self) -> None:
        if self._progress is not None:
            self._progress(1.0 - sum(job.size for job in list(self._open)) / max(1, self._total))

    def _employ(self) -> None:
        """Have a helper compile what is next, until it fails or nothing is left."""
        job = None
        try:
            helper = self._hire()
            while helper is not None and (job := self._take_for_helper()) is not None:
                if not _ask(helper, job.name) or not job.is_kept():
                    return
                self._settle(job)
        except OSError as error:
            logger.info("no process to compile with: %s", error)
        finally:
            if job is not None:
                self._give_back(job)

    def _hire(self) -> subprocess.Popen[str] | None:
        """A helper that is up, or None."""
        with self._changed:
            if self._ended:
                return None
            helper = _start_helper()
            self._helpers.append(helper)
        return helper if _ask(helper, json.dumps(sys.path)) else None

    def _take_for_helper(self) -> Job | None:
        with self._changed:
            while self._waiting and not self._ended:
                job = self._next()
                if job is not None:
                    return job
                self._changed.wait()
        return None

    def _give_back(self, job: Job) -> None:
        """Let somebody else compile what a helper did not, unless it did."""
        with self._changed:
            if job in self._open:
                self._waiting.insert(0, job)
            self._changed.notify_all()

    def _dismiss(self) -> None:
        """End all helpers."""
        with self._changed:
            self._ended = True
            for helper in self._helpers:
                helper.kill()
            self._changed.notify_all()
        for helper in self._helpers:
            # Also closes its pipes.
            with helper:
                pass


def _start_helper() -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-W", "ignore", "-c", _HELPER],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
    )


def _ask(helper: subprocess.Popen[str], line: str) -> bool:
    """Send a line; False if there is no answer because the helper ended."""
    pipe, answers = cast(IO[str], helper.stdin), cast(IO[str], helper.stdout)
    pipe.write(f"{line}\n")
    pipe.flush()
    return bool(answers.readline())


def _missing(jobs: Iterable[Job]) -> list[Job]:
    """Those that are not on disk and can be, with all such that they call."""
    found: dict[Job, None] = {}
    ahead = list(jobs)
    while ahead:
        job = ahead.pop()
        if job not in found and job.is_kept() is False:
            found[job] = None
            ahead += job.needs
    return list(found)


def _ranks(jobs: list[Job]) -> dict[Job, int]:
    """What has to be compiled one after the other from each on: its own size, and the most of those that call it."""
    callers: dict[Job, list[Job]] = {job: [] for job in jobs}
    for job in jobs:
        for callee in job.needs:
            if callee in callers:
                callers[callee].append(job)
    ranks: dict[Job, int] = {}

    def rank(job: Job) -> int:
        if job not in ranks:
            ranks[job] = job.size + max((rank(caller) for caller in callers[job]), default=0)
        return ranks[job]

    return {job: rank(job) for job in jobs}


def _helpers_for(jobs: list[Job]) -> int:
    """How many further processes are of use."""
    sizes = [job.size for job in jobs]
    if not jobs or sum(sizes) - max(sizes) < _WORTH_A_HELPER or not _may_start_processes():
        return 0
    return min(_processors(), _MOST_PROCESSES, len(jobs)) - 1


def _may_start_processes() -> bool:
    """Whether `sys.executable` is a Python to start, and this process not one of many that do the same."""
    name = Path(sys.executable or "").name.lower()
    return name.startswith("python") and not getattr(sys, "frozen", False) and multiprocessing.parent_process() is None


def _processors() -> int:
    """Processors that this process may use; NUMBA_NUM_THREADS, where it is set, says how many it should."""
    there = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(there, int(numba.config.NUMBA_NUM_THREADS))


def _name_of(function: Callable[..., Any]) -> str:
    return f"{function.__module__}:{function.__qualname__}"


def _callees(function: Callable[..., Any]) -> set[Callable[..., Any]]:
    """Functions that a function names, of those that are compiled."""
    plain = cast(FunctionType, function)
    names: set[str] = set()
    codes = [plain.__code__]
    while codes:
        code = codes.pop()
        names.update(code.co_names)
        codes += [inner for inner in code.co_consts if isinstance(inner, CodeType)]
    callees = (getattr(plain.__globals__.get(name), "__wrapped__", None) for name in names)
    return {callee for callee in callees if isinstance(callee, FunctionType) and callee is not function}
