"""The command line: parse, run one command, turn every outcome into an exit code.

Exit codes: 0 done, 2 bad input, 3 no plan, 4 an invalid plan, 130 interrupted.
"""

from __future__ import annotations

import os
import re
import signal
import sys
import threading
from argparse import Namespace
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module

from rr1plan.cli.console import Console
from rr1plan.cli.parser import build_parser
from rr1plan.errors import NoPlanError, RetimingError, Rr1PlanError

# Until Python 3.14 argparse takes these negative numbers for options, but not with a space before them.
_SMALL = re.compile(r"-(\d+\.?\d*|\.\d+)e[+-]?\d+$", re.IGNORECASE)
OK, BAD_INPUT, NO_PLAN, INVALID_PLAN, INTERRUPTED = 0, 2, 3, 4, 130


def run(arguments: Sequence[str]) -> int:
    """Run one command.

    Args:
        arguments: What stands after `rr1plan`.

    Returns:
        The exit code.
    """
    options = build_parser().parse_args([f" {word}" if _SMALL.match(word) else word for word in arguments])
    console = Console(as_json=options.json, quiet=options.quiet)
    try:
        with console.warnings():
            code = _run_command(options, console)
    except KeyboardInterrupt:
        return _fail(console, "interrupted", INTERRUPTED)
    except (NoPlanError, RetimingError) as error:
        return _fail(console, str(error), NO_PLAN)
    except Rr1PlanError as error:
        return _fail(console, str(error), BAD_INPUT)
    except BrokenPipeError:
        # The reader of our output has left (`| head`); nothing more can be said to it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK
    return code


def _run_command(options: Namespace, console: Console) -> int:
    module, function = options.command.split(".")
    with _leaving_at_once(), console.progress("loading"):
        command = getattr(import_module(f"rr1plan.cli.{module}"), function)
    code: int = command(options, console)
    return code


@contextmanager
def _leaving_at_once() -> Iterator[None]:
    """End the process on Ctrl-C while libraries are loaded: some turn it into other errors, or abort.

    Nothing of the user's is half done then.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def leave(*_: object) -> None:
        os.write(sys.stderr.fileno(), b"\x1b[?25h" if sys.stderr.isatty() else b"")
        os.write(sys.stderr.fileno(), b"rr1plan: interrupted\n")
        os._exit(INTERRUPTED)

    before = signal.signal(signal.SIGINT, leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _fail(console: Console, message: str, code: int) -> int:
    console.error(message, code)
    return code
