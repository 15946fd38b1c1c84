"""Ctrl-C during the import of the command line and its libraries: the process exits with one line.

No work is lost at that time, and some libraries turn a KeyboardInterrupt into other errors, or abort. This module is
imported before all others, so it imports few modules itself.

Later a request to end, as from `timeout` or when a terminal is closed, has the effect of Ctrl-C: temporary files are
removed, and a mirror reports.
"""

from __future__ import annotations

import os
import signal
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

INTERRUPTED = 130


def leave(*_: object) -> None:
    """End the process with exit code 130 and a line on stderr."""
    try:
        if sys.stderr is not None:
            # A progress bar may have hidden the cursor.
            line = ("\x1b[?25h" if sys.stderr.isatty() else "") + "rr1plan: interrupted\n"
            os.write(sys.stderr.fileno(), line.encode())
    finally:
        # Exit even if writing fails.
        os._exit(INTERRUPTED)


class leaving_at_once:
    """Context in which Ctrl-C exits the process; no effect if SIGINT is ignored, or in other threads."""

    def __enter__(self) -> None:
        self._before: object = signal.getsignal(signal.SIGINT)
        self._installed = callable(self._before) and _set_handler(signal.SIGINT, leave)

    def __exit__(self, *_: object) -> None:
        if self._installed:
            _set_handler(signal.SIGINT, self._before)


class interrupted_by_termination:
    """Context in which SIGTERM and SIGHUP have the effect of Ctrl-C, even if SIGINT is ignored."""

    def __enter__(self) -> None:
        numbers = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
        self._installed = [
            number
            for number in numbers
            if signal.getsignal(number) == signal.SIG_DFL and _set_handler(number, _interrupt)
        ]

    def __exit__(self, *_: object) -> None:
        for number in self._installed:
            _set_handler(number, signal.SIG_DFL)


def _interrupt(number: int, frame: Any) -> None:
    handler = signal.getsignal(signal.SIGINT)
    (handler if callable(handler) else signal.default_int_handler)(number, frame)


def _set_handler(number: int, handler: Any) -> bool:
    """Set the handler of a signal; False outside the main thread, where Python does not allow it."""
    try:
        signal.signal(number, handler)
    except ValueError:
        return False
    return True
