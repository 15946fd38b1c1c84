"""`python -m rr1plan` and the `rr1plan` command."""

from __future__ import annotations

import signal
import sys
import time

from rr1plan.interrupts import INTERRUPTED, leaving_at_once

# The interpreter's start-up time is estimated by its processor time, which is close to its wall time.
_STARTED = time.perf_counter() - time.process_time()


def main() -> None:
    """Run the command line and exit with its code."""
    try:
        with leaving_at_once():
            import io

            from rr1plan.cli import run
            from rr1plan.shutdown import omit_collection

        for stream in (sys.stdout, sys.stderr):
            # A terminal that cannot encode a character shows its escape code.
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="backslashreplace")
        code = run(sys.argv[1:], _STARTED)
    except KeyboardInterrupt:
        # Ctrl-C between two handlers.
        code = INTERRUPTED
    # Ctrl-C during the interpreter's shutdown would print a traceback.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    omit_collection()
    sys.exit(code)


if __name__ == "__main__":
    main()
