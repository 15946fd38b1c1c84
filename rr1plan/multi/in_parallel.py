"""Work on threads, with results in the order of the items, so that threads do not change a plan."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from typing import TypeVar

from rr1plan.multi.stopwatch import Stopwatch

_POLL = 0.05  # time between two checks of the clock while threads work [s]

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def in_parallel(
    work: Callable[[_Item], _Result], items: Sequence[_Item], threads: int, watch: Stopwatch
) -> list[_Result]:
    """Results of a function for some items, computed on threads, or on this one if one thread is enough.

    Progress is reported meanwhile. Ctrl-C, or an error of the progress callback, cancels the clock, so that the threads
    end soon.

    Args:
        work: The function; it has to end soon after the clock is cancelled.
        items: Its arguments.
        threads: Largest number of threads.
        watch: Stopwatch of the search.
    """
    threads = min(threads, len(items))
    if threads < 2:
        return [work(item) for item in items]
    with ThreadPoolExecutor(threads) as executor:
        futures = [executor.submit(work, item) for item in items]
        try:
            while wait(futures, _POLL).not_done:
                watch.goes_on()
        except BaseException:
            watch.cancel()
            raise
        return [future.result() for future in futures]


def processors() -> int:
    """Number of processors available to this process."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
