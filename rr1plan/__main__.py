"""`python -m rr1plan` and the `rr1plan` command."""

from __future__ import annotations

import signal
import sys
import time

from rr1plan.interrupts import INTERRUPTED, leaving_at_once

# The interpreter's own start, which hardly waits, is counted by its processor time.
_STARTED = time.perf_counter() - time.process_time()


def main() -> None:
    """Run the command line and leave with its exit code."""
    try:
        with leaving_at_once():
            import gc
            import io

            from rr1plan.cli import run

        for stream in (sys.stdout, sys.stderr):
            # A terminal without a character shows its code.
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="backslashreplace")
        code = run(sys.argv[1:], _STARTED)
    except KeyboardInterrupt:
        # Ctrl-C between the two that handle it.
        code = INTERRUPTED
    # Nothing is left to interrupt but the interpreter's end, which would answer with a traceback.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    # Else the interpreter looks through all objects of all libraries before it ends, for a quarter of a second.
    # OMPL's binding prints what is left then as leaks, so it is left to be collected.
    if "ompl" not in sys.modules:
        gc.freeze()
    sys.exit(code)


if __name__ == "__main__":
    main()
