"""Ctrl-C while the command line and its libraries are loaded: the process ends at once, with one line.

Nothing of the user's is half done then, and some libraries turn a KeyboardInterrupt into other errors, or abort. This
module is imported before all others, so it imports little itself.
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
            # A bar may have hidden the cursor.
            line = ("\x1b[?25h" if sys.stderr.isatty() else "") + "rr1plan: interrupted\n"
            os.write(sys.stderr.fileno(), line.encode())
    finally:
        # Also where nothing can be written.
        os._exit(INTERRUPTED)


class leaving_at_once:
    """Context in which Ctrl-C ends the process; without effect where it is ignored, and in other threads."""

    def __enter__(self) -> None:
        self._before: Any = signal.getsignal(signal.SIGINT)
        self._installed = callable(self._before) and _set_handler(leave)

    def __exit__(self, *_: object) -> None:
        if self._installed:
            _set_handler(self._before)


def _set_handler(handler: Any) -> bool:
    """Handle Ctrl-C; False outside of the main thread, the only one in which Python handles signals."""
    try:
        signal.signal(signal.SIGINT, handler)
    except ValueError:
        return False
    return True
