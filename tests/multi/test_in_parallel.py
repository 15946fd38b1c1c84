"""Work on threads: results, progress, and errors."""

from __future__ import annotations

import threading
import time

import pytest

from rr1plan.multi.in_parallel import in_parallel
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.planning import Progress


def test_results_are_in_the_order_of_the_items() -> None:
    started: set[int] = set()

    def work(item: int) -> int:
        started.add(threading.get_ident())
        time.sleep(0.01 * (5 - item))
        return item * item

    for threads in (1, 3):
        started.clear()
        assert in_parallel(work, range(5), threads, Stopwatch(60.0)) == [0, 1, 4, 9, 16]
        assert (started == {threading.get_ident()}) == (threads == 1)
    assert in_parallel(work, [], 3, Stopwatch(60.0)) == []


def test_progress_may_cancel_while_threads_work() -> None:
    reports: list[Progress] = []

    def report(progress: Progress) -> bool:
        reports.append(progress)
        return len(reports) < 3

    watch = Stopwatch(60.0, report)
    assert in_parallel(lambda item: _wait(watch, item), range(4), 2, watch) == [0, 1, 2, 3]
    assert watch.cancelled
    assert watch.seconds < 30.0


def test_an_error_ends_all_threads() -> None:
    def fail(_: Progress) -> bool:
        raise ZeroDivisionError

    watch, before = Stopwatch(60.0, fail), threading.active_count()
    with pytest.raises(ZeroDivisionError):
        in_parallel(lambda item: _wait(watch, item), range(4), 2, watch)
    assert watch.cancelled
    assert threading.active_count() == before


def _wait(watch: Stopwatch, item: int) -> int:
    while watch.goes_on():
        time.sleep(0.01)
    return item
