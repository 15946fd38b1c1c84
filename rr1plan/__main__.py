"""`python -m rr1plan` and the `rr1plan` command."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line and leave with its exit code."""
    try:
        from rr1plan.cli import run

        code = run(sys.argv[1:])
    except KeyboardInterrupt:
        # Ctrl-C while the command line itself is being loaded.
        code = 130
    sys.exit(code)


if __name__ == "__main__":
    main()
