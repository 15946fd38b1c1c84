"""What the commands say: text for people, one JSON value for programs, progress on a terminal."""

from __future__ import annotations

import json
import logging
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from rich.console import Console as RichConsole
from rich.markup import escape
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

Advance = Callable[[float], None]


class Console:
    """Speaks to a person, or with `--json` prints exactly one JSON value at the end.

    Args:
        as_json: Print results as JSON only.
        quiet: No progress and no text, only errors and results asked for.
    """

    def __init__(self, as_json: bool = False, quiet: bool = False) -> None:
        self.as_json = as_json
        self.quiet = quiet
        self._out = RichConsole(highlight=False, soft_wrap=True)
        self._err = RichConsole(stderr=True, highlight=False, soft_wrap=True)

    def say(self, text: str = "") -> None:
        """A line for people."""
        if not self.as_json and not self.quiet:
            self._out.print(text, markup=False)

    def table(self, title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """A table for people."""
        if self.as_json or self.quiet:
            return
        table = Table(title=title or None, title_justify="left", header_style="bold", box=None, pad_edge=False)
        for column in columns:
            table.add_column(column)
        for row in rows:
            table.add_row(*(escape(cell) for cell in row))
        self._out.print(table)

    def result(self, value: Mapping[str, Any] | Sequence[Any]) -> None:
        """The command's one result for programs."""
        if self.as_json:
            sys.stdout.write(json.dumps(value, indent=2, allow_nan=False) + "\n")

    def error(self, message: str, code: int) -> None:
        """What went wrong: on stderr for people, and as JSON for programs."""
        if self.as_json:
            sys.stdout.write(json.dumps({"error": message, "exit_code": code}, indent=2) + "\n")
        else:
            self._err.print(f"rr1plan: {message}", markup=False)

    @contextmanager
    def warnings(self) -> Iterator[None]:
        """Print on stderr what the library warns of in its log."""
        logger = logging.getLogger("rr1plan")
        handler = logging.NullHandler() if self.quiet else _WarningPrinter(self._err)
        logger.addHandler(handler)
        try:
            yield
        finally:
            logger.removeHandler(handler)

    @contextmanager
    def progress(self, text: str) -> Iterator[Advance]:
        """A bar for work that may take more than a second; yields a function that takes the fraction done."""
        if self.as_json or self.quiet or not self._err.is_terminal:
            yield _nothing
            return
        columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(bar_width=24), TimeElapsedColumn())
        with Progress(*columns, console=self._err, transient=True) as bar:
            task = bar.add_task(text, total=1.0)
            yield lambda fraction: bar.update(task, completed=fraction)


def _nothing(_: float) -> None:
    """Progress that nobody sees."""


class _WarningPrinter(logging.Handler):
    """Prints log records on a console, above a bar that is running there."""

    def __init__(self, out: RichConsole) -> None:
        super().__init__(logging.WARNING)
        self._out = out

    def emit(self, record: logging.LogRecord) -> None:
        """Print one."""
        self._out.print(f"rr1plan: {record.getMessage()}", markup=False)


class Stopwatch:
    """Wall time of named stages, in order."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time what happens inside."""
        started = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - started


def milliseconds(seconds: float) -> str:
    """A time for people: "12.3 ms" or "4.56 s"."""
    return f"{seconds:.2f} s" if seconds >= 1.0 else f"{1e3 * seconds:.1f} ms"
