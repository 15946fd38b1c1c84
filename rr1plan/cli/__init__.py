"""The command line: parse, run one command, turn every outcome into an exit code.

Exit codes: 0 done, 2 bad input, 3 no plan, 4 an invalid plan or a failed replay, 130 interrupted.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from importlib import import_module

from rr1plan.cli.arguments import Shown, parse, spell_options
from rr1plan.cli.console import Console
from rr1plan.cli.exit_codes import BAD_INPUT, INVALID_PLAN, NO_PLAN, OK
from rr1plan.cli.parser import build_parser
from rr1plan.errors import NoPlanError, RetimingError, Rr1PlanError, missing_libraries_named
from rr1plan.interrupts import INTERRUPTED, interrupted_by_termination, leaving_at_once
from rr1plan.progress_bar import taken_terminal

__all__ = ["BAD_INPUT", "INTERRUPTED", "INVALID_PLAN", "NO_PLAN", "OK", "run"]


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
    except ImportError as error:
        if _is_interrupted(error):
            return _fail(console, "interrupted", INTERRUPTED)
        raise


def _run(arguments: Sequence[str], console: Console, started: float) -> int:
    parser, commands = build_parser()
    try:
        options = parse(parser, commands, arguments)
    except Shown as shown:
        console.write(shown.text)
        return OK
    console.spelled = lambda text: spell_options(text, options.name, commands)
    module, function = options.command.split(".")
    with leaving_at_once(), console.progress("loading"), missing_libraries_named():
        command = getattr(import_module(f"rr1plan.cli.{module}"), function)
    console.watch.seconds["imports"] = time.perf_counter() - started
    with interrupted_by_termination(), console.warnings(), taken_terminal():
        code: int = command(options, console)
    return code


def _is_interrupted(error: ImportError) -> bool:
    """Whether Ctrl-C ended the import, as libraries in C++ that a command imports when it runs report it."""
    cause: BaseException | None = error
    while isinstance(cause, ImportError):
        cause = cause.__cause__
    return isinstance(cause, KeyboardInterrupt)


def _fail(console: Console, message: str, code: int) -> int:
    console.error(message, code)
    return code
