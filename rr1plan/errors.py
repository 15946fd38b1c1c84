"""Every exception rr1plan raises on purpose, in one tree.

    Rr1PlanError
    ├── InputError (ValueError)       a wrong call: says what, got, expected, what to try
    │   ├── UnknownNameError          a name nobody knows; lists the near ones
    │   └── FormatError               a file that cannot be read as what it claims to be
    ├── NoPlanError                   "no answer", only when asked for as an exception
    ├── RetimingError                 a path that cannot be given times under the limits
    ├── CancelledError                a progress callback ended work that has no answer without its end
    ├── MissingPackageError (ImportError)   an optional package; names the extra to install
    ├── InstallationError (ImportError)     a part of rr1plan that the build makes is missing or broken
    ├── PlannerError                  a planner of the caller's own raised something, or its answer is none
    └── BackendError                  a library failed in a way we did not foresee

"No answer" is a value (`PlanResult.status`), a wrong call is an exception.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

_LONGEST_SHOWN = 80  # [characters]


def shown(value: object) -> str:
    """A value as messages show it: its repr, cut where it is long, or its type where it has none."""
    try:
        text = repr(value)
    except Exception:  # an int of 5,000 digits, a list 3,000 deep, an object of a caller's own class
        return f"a {type(value).__name__}"
    return text if len(text) <= _LONGEST_SHOWN else f"{text[: _LONGEST_SHOWN - 3]}..."


class Rr1PlanError(Exception):
    """Base of everything rr1plan raises on purpose."""


class InputError(Rr1PlanError, ValueError):
    """A wrong call: the message names the thing, what was got and what was expected."""


class UnknownNameError(InputError):
    """A name nobody knows.

    Args:
        kind: What the name should have named, e.g. "joint".
        name: The name that was given.
        known: All names that would have been right.
        advice: What else to try, a sentence.
        near: Those of them that may be meant (default: those that are spelled nearly alike).
    """

    def __init__(
        self, kind: str, name: str, known: Iterable[str], advice: str = "", near: Iterable[str] | None = None
    ) -> None:
        self.kind = kind
        self.name = name
        self.known = tuple(known)
        if near is None:
            # Loaded in every process otherwise, and few make mistakes.
            import difflib

            near = difflib.get_close_matches(name[:200], self.known, n=3, cutoff=0.5) if isinstance(name, str) else []
        hint = f" Did you mean {' or '.join(map(repr, near))}?" if near else ""
        listed = ", ".join(self.known[:30]) + (", ..." if len(self.known) > 30 else "")
        advice = f" {advice}" if advice else ""
        super().__init__(f"unknown {kind} {shown(name)}.{hint} Known: {listed or 'none'}.{advice}")


class FormatError(InputError):
    """A file that cannot be read as what it claims to be.

    Args:
        message: What is wrong, and what to try.
        file: The file, when there is one.
        line: The line [1-based], when it is known.
    """

    def __init__(self, message: str, file: str | Path | None = None, line: int | None = None) -> None:
        self.file = None if file is None else str(file)
        self.line = line
        where = "" if file is None else f"{file}{'' if line is None else f':{line}'}: "
        super().__init__(where + message)


class NoPlanError(Rr1PlanError):
    """Raised by `path_or_raise` when there is no path; the message is the planner's reason."""


class PlannerError(Rr1PlanError):
    """A planner of the caller's own raised something, or returned a path that is no answer to the problem."""


class RetimingError(Rr1PlanError):
    """A path that cannot be given times under the limits; names the joint or the place."""


class CancelledError(Rr1PlanError):
    """A progress callback returned False, and the work it ended has no answer without its end."""


class MissingPackageError(Rr1PlanError, ImportError):
    """An optional package is not installed.

    Args:
        package: The package that is missing.
        extra: The rr1plan extra that brings it, when there is one.
        purpose: What it is needed for.
    """

    def __init__(self, package: str, purpose: str, extra: str | None = None) -> None:
        what = f"rr1plan[{extra}]" if extra else package
        super().__init__(f"{purpose} needs the package {package!r}; try: pip install '{what}'")


class InstallationError(Rr1PlanError, ImportError):
    """A part of rr1plan that its build makes is missing, or does not fit the rest; says how to build it."""


class BackendError(Rr1PlanError):
    """A library failed in a way we did not foresee; raised `from` the original."""
