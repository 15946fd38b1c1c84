"""The command line: parse, run one command, turn every outcome into an exit code.

Exit codes: 0 done, 2 bad input, 3 no plan, 4 an invalid plan, 130 interrupted.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module

from rr1plan.cli.arguments import Shown, parse, spell_options
from rr1plan.cli.console import Console
from rr1plan.cli.parser import build_parser
from rr1plan.errors import NoPlanError, RetimingError, Rr1PlanError

OK, BAD_INPUT, NO_PLAN, INVALID_PLAN, INTERRUPTED = 0, 2, 3, 4, 130


def run(arguments: Sequence[str], started: float | None = None) -> int:
    """Run one command.

    Args:
        arguments: The words after `rr1plan`.
        started: When the process started, by `time.perf_counter` (default: now).

    Returns:
        The exit code.
    """
    console = Console("--json" in arguments, "--quiet" in arguments)
    try:
        return _run(arguments, console, time.perf_counter() if started is None else started)
    except KeyboardInterrupt:
        return _fail(console, "interrupted", INTERRUPTED)
    except (NoPlanError, RetimingError) as error:
        return _fail(console, str(error), NO_PLAN)
    except Rr1PlanError as error:
        return _fail(console, str(error), BAD_INPUT)


def _run(arguments: Sequence[str], console: Console, started: float) -> int:
    parser, commands = build_parser()
    try:
        options = parse(parser, commands, arguments)
    except Shown as shown:
        console.write(shown.text)
        return OK
    console.spelled = lambda text: spell_options(text, options.name, commands)
    module, function = options.command.split(".")
    with _leaving_at_once(), console.progress("loading"):
        command = getattr(import_module(f"rr1plan.cli.{module}"), function)
    console.watch.seconds["imports"] = time.perf_counter() - started
    with console.warnings():
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
