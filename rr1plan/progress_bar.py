"""Progress bars on stderr: on a terminal only, one at a time."""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Protocol


class Advance(Protocol):
    """A function that moves a bar."""

    def __call__(self, fraction: float, what: str = "") -> None:
        """Show the fraction done, and the current task if given."""
        ...


class _Terminal:
    """Whether a bar is drawn on the terminal."""

    taken = False


@contextmanager
def taken_terminal() -> Iterator[None]:
    """Suppress the library's bars within the block, for callers that use the terminal."""
    before, _Terminal.taken = _Terminal.taken, True
    try:
        yield
    finally:
        _Terminal.taken = before


@contextmanager
def progress_bar(text: str, console: Any) -> Iterator[Advance]:
    """Draw a bar on a rich console; yields a function of the fraction done."""
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(bar_width=24), TimeElapsedColumn())
    with taken_terminal(), Progress(*columns, console=console, transient=True, disable=console.is_dumb_terminal) as bar:
        task = bar.add_task(text, total=1.0)

        def advance(fraction: float, what: str = "") -> None:
            bar.update(task, completed=fraction, description=what or text)

        yield advance


@contextmanager
def library_bar(text: str) -> Iterator[Advance]:
    """Draw a bar on stderr; none in a pipe, next to another one, or in a worker process."""
    is_worker = multiprocessing.parent_process() is not None
    if _Terminal.taken or is_worker or sys.stderr is None or not sys.stderr.isatty():
        yield no_progress
        return
    from rich.console import Console

    with progress_bar(text, Console(stderr=True, highlight=False, soft_wrap=True)) as advance:
        yield advance


def no_progress(fraction: float, what: str = "") -> None:
    """Ignore progress."""
