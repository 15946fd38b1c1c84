"""The exceptions of rr1plan.

    Rr1PlanError
    ├── InputError (ValueError)       a wrong call: says what, got, expected, what to try
    │   ├── UnknownNameError          an unknown name; lists similar ones
    │   └── FormatError               a file that is not valid in its format
    ├── NoPlanError                   no path was found; raised only on request
    ├── RetimingError                 a path that cannot be timed under the limits
    ├── CancelledError                a progress callback cancelled work without partial results
    ├── MissingPackageError (ImportError)   an optional package; names the extra to install
    ├── InstallationError (ImportError)     a compiled part, or a library of the system, is missing
    ├── PlannerError                  a caller's planner raised an exception, or returned an invalid result
    ├── ControllerError               a controller raised an exception, or returned no set-points
    ├── HardwareError                 an arm that does not execute its commands
    │   ├── SerialLineError           a serial line that stops, or carries garbage
    │   └── StalledJointError         a joint that does not follow its steps
    └── BackendError                  a library failed unexpectedly

A failed search is a value (`PlanResult.status`), an invalid argument is an exception.
"""

from __future__ import annotations

import copyreg
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

_LONGEST_SHOWN = 80  # [characters]
_LONGEST_REASON = 400  # [characters]


def shown(value: object) -> str:
    """A value for messages: its repr, truncated if it is long, or its type if it has none."""
    try:
        text = repr(value)
    except Exception:  # an int of 5,000 digits, a list 3,000 deep, an object of a caller's own class
        return f"a {type(value).__name__}"
    return text if len(text) <= _LONGEST_SHOWN else f"{text[: _LONGEST_SHOWN - 3]}..."


def reason_of(error: Exception) -> str:
    """The message of a library's error, truncated if it is long, or its type if it has none."""
    text = str(error)
    return (text if len(text) <= _LONGEST_REASON else f"{text[: _LONGEST_REASON - 3]}...") or type(error).__name__


class Rr1PlanError(Exception):
    """Base of all exceptions of rr1plan."""

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle and copy by message and attributes: constructors of subclasses take other arguments."""
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]  # not in its stub


class InputError(Rr1PlanError, ValueError):
    """An invalid argument: the message names it, what was got and what was expected."""


class UnknownNameError(InputError):
    """An unknown name.

    Args:
        kind: Kind of the name, e.g. "joint".
        name: The unknown name.
        known: All known names.
        advice: A hint, in a sentence.
        near: Known names to suggest (default: those with similar spelling).
    """

    def __init__(
        self, kind: str, name: str, known: Iterable[str], advice: str = "", near: Iterable[str] | None = None
    ) -> None:
        self.kind = kind
        self.name = name
        self.known = tuple(known)
        if near is None:
            # Imported lazily, because it is rarely needed.
            import difflib

            # Compared without case, so that "UR5" suggests "ur5".
            folded: dict[str, list[str]] = {}
            for one in self.known:
                folded.setdefault(one.casefold(), []).append(one)
            wanted = name[:200].casefold() if isinstance(name, str) else ""
            near = [one for key in difflib.get_close_matches(wanted, folded, n=3, cutoff=0.5) for one in folded[key]]
        hint = f" Did you mean {' or '.join(map(repr, near))}?" if near else ""
        listed = ", ".join(self.known[:30]) + (f" and {more} more" if (more := len(self.known) - 30) > 0 else "")
        advice = f" {advice}" if advice else ""
        super().__init__(f"unknown {kind} {shown(name)}.{hint} Known: {listed or 'none'}.{advice}")


class FormatError(InputError):
    """A malformed file.

    Args:
        message: The error, and what to try.
        file: The file, if there is one.
        line: The line [1-based], if it is known.
    """

    def __init__(self, message: str, file: str | Path | None = None, line: int | None = None) -> None:
        self.file = None if file is None else str(file)
        self.line = line
        where = "" if file is None else f"{file}{'' if line is None else f':{line}'}: "
        super().__init__(where + message)


class NoPlanError(Rr1PlanError):
    """There is no path; the message is the planner's reason."""


class PlannerError(Rr1PlanError):
    """A caller's planner raised an exception, or returned a path that does not solve the problem."""


class ControllerError(Rr1PlanError):
    """A controller of a simulation raised an exception, or returned something other than a set-point."""


class HardwareError(Rr1PlanError):
    """A real arm is not where it should be, or does not execute its commands; nothing more is sent to it."""


class SerialLineError(HardwareError):
    """A serial line that stops, accepts only part of a frame, or carries bytes that are not a frame."""


class StalledJointError(HardwareError):
    """A joint that does not execute its steps, or whose encoder does not follow them; the message names it."""


class RetimingError(Rr1PlanError):
    """A path that cannot be timed under the limits; the message names the joint or the waypoints."""


class CancelledError(Rr1PlanError):
    """A progress callback returned False and cancelled work without partial results."""


class MissingPackageError(Rr1PlanError, ImportError):
    """An optional package is not installed.

    Args:
        package: The missing package.
        extra: The extra of rr1plan that installs it, if there is one.
        purpose: The feature that needs it.
        advice: How to install it (default: with pip).
    """

    def __init__(self, package: str, purpose: str, extra: str | None = None, *, advice: str | None = None) -> None:
        advice = advice or f"try: pip install '{f'rr1plan[{extra}]' if extra else package}'"
        super().__init__(f"{purpose} needs the package {package!r}; {advice}")


class InstallationError(Rr1PlanError, ImportError):
    """A compiled part of rr1plan, or a library of the system, is missing or of another version.

    The message says how to build or install it.
    """


# Packages of Debian and Fedora with libraries that required wheels expect of the system: Pinocchio's, GNU OpenMP.
_SYSTEM_PACKAGES = {"libgomp.so.1": ("libgomp1", "libgomp")}


@contextmanager
def missing_libraries_named() -> Iterator[None]:
    """Imports that fail because a library of the system is missing raise an error that names it.

    Raises:
        InstallationError: such an import.
    """
    try:
        yield
    except ImportError as error:
        found = re.match(r"(\S+): cannot open shared object file", str(error))
        if found is None:
            raise
        advice = "install it with the package manager of the system"
        if packages := _SYSTEM_PACKAGES.get(found[1]):
            advice = "try: apt-get install {} (Debian, Ubuntu) or dnf install {} (Fedora)".format(*packages)
        message = f"a required package needs the system library {found[1]}, which is missing; {advice}"
        raise InstallationError(message) from error


class BackendError(Rr1PlanError):
    """An unexpected failure of a library, raised `from` the original exception."""
