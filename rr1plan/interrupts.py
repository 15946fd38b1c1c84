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
    if sys.stderr is not None:
        # A bar may have hidden the cursor.
        line = ("\x1b[?25h" if sys.stderr.isatty() else "") + "rr1plan: interrupted\n"
        try:  # noqa: SIM105  (contextlib is not imported here)
            os.write(sys.stderr.fileno(), line.encode())
        except OSError:
            pass
    os._exit(INTERRUPTED)


class leaving_at_once:
    """Context in which Ctrl-C ends the process; without effect where it is ignored, and in other threads."""

    def __enter__(self) -> None:
        self._before: Any = signal.getsignal(signal.SIGINT)
        if callable(self._before):
            self._install(leave)

    def __exit__(self, *_: object) -> None:
        if callable(self._before):
            self._install(self._before)

    @staticmethod
    def _install(handler: Any) -> None:
        try:  # noqa: SIM105
            signal.signal(signal.SIGINT, handler)
        except ValueError:
            # Python takes signals in its main thread only.
            pass
