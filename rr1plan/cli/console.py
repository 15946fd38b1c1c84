"""Output of the commands: text for people, one JSON value for programs, progress on a terminal."""

from __future__ import annotations

import json
import logging
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from textwrap import fill
from typing import TYPE_CHECKING, Any, TextIO

from rich.console import Console as RichConsole

from rr1plan.cli.text_tables import table_lines
from rr1plan.errors import InputError
from rr1plan.progress_bar import Advance, no_progress, progress_bar

if TYPE_CHECKING:
    from rr1plan.planning import ProgressCallback

# What a progress bar calls the stages of planning.
_STAGES = {"set up": "preparing the scene", "shorten": "shortening", "retime": "retiming", "validate": "proving"}
# Width of a table that is not shown on a terminal.
_WIDEST = 10_000
# Width of a paragraph on a wide terminal or in a pipe.
_PARAGRAPH = 100
_BOLD, _PLAIN = "\x1b[1m", "\x1b[0m"


class Console:
    """Writes for a person, or with `--json` exactly one JSON value at the end.

    A closed pipe (`| head`) is not an error: the command continues without output, and its exit code does not change.

    Args:
        as_json: Print results as JSON only.
        quiet: No progress and no text, only errors, requested results, and the names in lists.

    Attributes:
        watch: Wall time of the command's stages.
        spelled: Converts option names in messages to those of the command line.
    """

    def __init__(self, as_json: bool = False, quiet: bool = False) -> None:
        self.as_json = as_json
        self.quiet = quiet
        self.watch = StageTimes()
        self.spelled: Callable[[str], str] = str
        self._out = RichConsole(highlight=False, soft_wrap=True)
        if not self._out.is_terminal:
            self._out.width = _WIDEST
        self._err = RichConsole(stderr=True, highlight=False, soft_wrap=True)
        self._has_reader = True
        self._out_is_taken = False

    def leave_stdout(self) -> None:
        """Write text for people to stderr from now on, because stdout gets the content of a file."""
        self._out_is_taken = True

    def say(self, text: str = "") -> None:
        """A line for people."""
        if self.as_json or self.quiet:
            return
        if self._out_is_taken:
            self._write_aside(f"{self.spelled(text)}\n")
        else:
            self.write(f"{self.spelled(text)}\n")

    def table(self, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """A table for people: as wide as the terminal, or one line per row if there is none."""
        if self.as_json or self.quiet:
            return
        names, *lines = table_lines(columns, rows, self._out.width)
        if self._out.is_terminal and not self._out.is_dumb_terminal:
            names = f"{_BOLD}{names}{_PLAIN}"
        self.write("".join(f"{line}\n" for line in (names, *lines)))

    def paragraph(self, text: str) -> None:
        """A text for people, wrapped to the width of the terminal."""
        self.say(fill(text, min(self._out.width, _PARAGRAPH), break_on_hyphens=False))

    def names(self, names: Sequence[str]) -> None:
        """Print only the names of a list, one per line, if `--quiet` was given."""
        if self.quiet and not self.as_json:
            self.write("".join(f"{name}\n" for name in names))

    def result(self, value: Mapping[str, Any] | Sequence[Any]) -> None:
        """The command's one result for programs."""
        if self.as_json:
            self.write(json.dumps(value, indent=2, allow_nan=False) + "\n")

    def error(self, message: str, code: int) -> None:
        """Report an error: on stderr for people, and as JSON for programs."""
        message = self.spelled(message)
        if self.as_json and self._has_reader:
            with suppress(InputError):
                self.write(json.dumps({"error": message, "exit_code": code}, indent=2) + "\n")
                return
        self.warn(message)

    def warn(self, message: str) -> None:
        """A line on stderr, above a progress bar that is active there."""
        if self._err.is_terminal:
            self._err.print(f"rr1plan: {message}", markup=False)
        else:
            self._write_aside(f"rr1plan: {message}\n")

    def _write_aside(self, text: str) -> None:
        """Write to stderr, if there is one."""
        if sys.stderr is None:
            return
        try:
            sys.stderr.write(text)
            sys.stderr.flush()
        except OSError:
            # There is no channel left to report this.
            _discard(sys.stderr)

    def write(self, text: str) -> None:
        """Write to standard output, at once.

        Raises:
            InputError: it cannot be written there.
        """
        if not self._has_reader:
            return
        if sys.stdout is None:
            raise InputError("cannot write to standard output: it is closed")
        try:
            sys.stdout.write(text)
            sys.stdout.flush()
        except OSError as error:
            self._has_reader = False
            _discard(sys.stdout)
            if not isinstance(error, BrokenPipeError):
                raise InputError(f"cannot write to standard output: {error.strerror}") from error

    @contextmanager
    def warnings(self) -> Iterator[None]:
        """Print warnings from the library's log on stderr."""
        logger = logging.getLogger("rr1plan")
        handler = logging.NullHandler() if self.quiet else _WarningPrinter(self)
        logger.addHandler(handler)
        try:
            yield
        finally:
            logger.removeHandler(handler)

    @contextmanager
    def progress(self, text: str) -> Iterator[Advance]:
        """A progress bar for work that may take more than a second; yields a function of the fraction done."""
        if self.as_json or self.quiet or not self._err.is_terminal:
            yield no_progress
            return
        with progress_bar(text, self._err) as advance:
            yield advance


def _discard(stream: TextIO) -> None:
    """Discard the rest of a stream's buffer, which would be written again when the process ends."""
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


class _WarningPrinter(logging.Handler):
    """Prints log records on a console, each message once: a scene may load the same file with other options."""

    def __init__(self, console: Console) -> None:
        super().__init__(logging.WARNING)
        self._console = console
        self._printed: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        """Print one record."""
        message = record.getMessage()
        if message not in self._printed:
            self._printed.add(message)
            self._console.warn(self._console.spelled(message))


class StageTimes:
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


def progress_callback(advance: Advance) -> ProgressCallback:
    """A callback for the progress of a library function that advances a progress bar."""
    return lambda progress: advance(progress.fraction, _STAGES.get(progress.stage, ""))


def milliseconds(seconds: float) -> str:
    """A time for people: "12.3 ms" or "4.56 s"."""
    return f"{seconds:.2f} s" if seconds >= 1.0 else f"{1e3 * seconds:.1f} ms"
