"""Xacro: a robot written as macros, expanded to URDF by the optional package xacrodoc.

A xacro file is a program: it reads files and evaluates expressions. Load only those you trust. It is expanded in a
process with limits of time and memory, so that an endless one (`${10**10**10}`) is an error. Includes must be regular
files.
"""

from __future__ import annotations

import importlib.util
import json
import logging
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rr1plan.checks import file_path, positive_number, resolved_path, shown
from rr1plan.errors import BackendError, FormatError, InputError, MissingPackageError
from rr1plan.files.file_access import read_bytes
from rr1plan.files.xml_reader import MAX_BYTES
from rr1plan.robot.mesh_lookup import folders_above, folders_in, package_name

XacroArguments = Mapping[str, str | float | bool]
"""Values of arguments by name."""
log = logging.getLogger(__name__)

_SECONDS = 60.0
_MEMORY = 4 * 1024**3
_WORKER = "import sys; sys.path[:] = sys.argv[1:]; from rr1plan.robot.xacro_worker import main; main()"
# ANSI escape sequences.
_COLOR = re.compile(r"\x1b\[[\d;]*m")


def expand_xacro(
    file: str | Path,
    *,
    package_dirs: Sequence[str | Path] = (),
    arguments: XacroArguments | None = None,
    seconds: float = _SECONDS,
) -> str:
    """Expand a xacro file to URDF; `package://` names are unchanged.

    Args:
        file: The xacro file. It is trusted code.
        package_dirs: Folders of packages, or folders that contain them, in which `$(find package)` searches before the
            folders around the file.
        arguments: Values of its `xacro:arg`; names that it neither declares nor reads are reported in the log.
        seconds: Time limit [s].

    Raises:
        MissingPackageError: xacrodoc is not installed (`pip install 'rr1plan[xacro]'`).
        InputError: arguments that are not a mapping from names to values.
        FormatError: the file cannot be read or expanded within the time limit and 4 GiB of memory.
        BackendError: there is no Python interpreter to start (in a frozen program).
    """
    if importlib.util.find_spec("xacro") is None or importlib.util.find_spec("xacrodoc") is None:
        raise MissingPackageError("xacrodoc", "reading xacro files", "xacro")
    positive_number("seconds", seconds)
    file = file_path(file)
    read_bytes(file, MAX_BYTES)
    given = _texts(arguments)
    request = {
        "file": str(file),
        "packages": _packages((*package_dirs, *folders_above(resolved_path(file).parent))),
        "arguments": given,
        "bytes": _MEMORY,
        "seconds": seconds,
    }
    response = _run_worker(file, request, seconds)
    if "package" in response:
        package = response["package"]
        raise FormatError(
            f"refers to the package {package!r}, which is not found; name the folder that holds "
            f"it with option package_dirs or, where the arm itself needs nothing from it, an empty folder {package!r}",
            file,
        )
    if "error" in response:
        raise FormatError(f"cannot be expanded: {response['error']}", file)
    unread = ", ".join(map(repr, sorted(given.keys() - set(response["arguments"]))))
    if unread:
        known = ", ".join(response["arguments"]) or "none"
        log.warning("%s: has no xacro argument %s, which has no effect; it has %s", file, unread, known)
    return str(response["urdf"])


def _packages(folders: Sequence[str | Path]) -> dict[str, str]:
    """The given folders and the folders in them by the names in their package.xml, else by their own names.

    Of folders with the same name, the first one is meant.
    """
    known: dict[str, str] = {}
    named: dict[str, str] = {}
    for given in map(resolved_path, folders):
        for folder in (given, *folders_in(given)):
            known.setdefault(folder.name, str(folder))
            if name := package_name(folder):
                named.setdefault(name, str(folder))
    return known | named


def _texts(arguments: XacroArguments | None) -> dict[str, str]:
    if arguments is not None and not isinstance(arguments, Mapping):
        raise InputError(f"xacro_arguments is {shown(arguments)}, expected a mapping of names to values")
    return {str(name): argument_text(value) for name, value in (arguments or {}).items()}


def argument_text(value: object) -> str:
    """The value of an argument as a xacro file reads it: true and false in lower case, all else as Python prints it."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def _run_worker(file: Path, request: dict[str, Any], seconds: float) -> dict[str, Any]:
    """The response of the worker process."""
    if getattr(sys, "frozen", False) or not sys.executable:
        raise BackendError("a frozen program has no Python to expand xacro files with; try the URDF: xacro FILE > URDF")
    try:
        done = subprocess.run(
            [sys.executable, "-c", _WORKER, *sys.path],
            input=json.dumps(request).encode(),
            capture_output=True,
            timeout=seconds,
            check=False,
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
    except subprocess.TimeoutExpired as error:
        raise FormatError(f"is not expanded within {seconds:g} s; a macro or expression may never end", file) from error
    except OSError as error:
        raise BackendError(f"{sys.executable} does not start, to expand {file}: {error}") from error
    said = _COLOR.sub("", done.stderr.decode(errors="replace")).strip()
    try:
        response: dict[str, Any] = json.loads(done.stdout)
    except ValueError as error:
        raise FormatError(f"cannot be expanded: xacro ended with {done.returncode} and says {said!r}", file) from error
    if said:
        log.warning("%s: xacro says: %s", file, said)
    return response
