"""Worker process that expands a xacro file with limits of memory and time.

Run by `rr1plan.robot.xacro`; imports nothing from the package, so that it starts fast.
"""

from __future__ import annotations

import errno
import json
import os
import stat
import sys
from pathlib import Path
from typing import Any


def main() -> None:
    """Read a request (JSON) from standard input and write the URDF, or the error, to standard output."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # output of the file goes to the log
    request = json.loads(sys.stdin.buffer.read())
    _bound(request["bytes"], request["seconds"])
    try:
        arguments = _Arguments(request["arguments"])
        urdf = _expand(request, arguments)
        answer: dict[str, Any] = {"urdf": urdf, "arguments": sorted(arguments.read)}
    except Exception as error:  # xacro evaluates Python expressions, which may raise anything
        answer = _error_response(error)
    json.dump(answer, answers)
    answers.flush()


def _bound(memory: int, seconds: float) -> None:
    """Limit memory [bytes] and processor time [s], if the system can."""
    try:
        import resource
    except ImportError:
        return
    for limit, most in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_CPU, int(seconds) + 1)):
        _, hard = resource.getrlimit(limit)
        resource.setrlimit(limit, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


class _Arguments(dict[str, str]):
    """Values of arguments by name.

    Attributes:
        read: The names that the file declares or reads.
    """

    def __init__(self, values: dict[str, str]) -> None:
        super().__init__(values)
        self.read: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.read.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.read.add(name)
        return super().__getitem__(name)


def _expand(request: dict[str, Any], arguments: _Arguments) -> str:
    import xacro
    import xacrodoc
    from xacrodoc import packages

    sys.addaudithook(_refuse_special_files)
    packages.update_package_cache(request["packages"])
    xacro.init_stacks(request["file"])  # relative includes are relative to it
    file = Path(request["file"])
    document = xacrodoc.XacroDoc.from_file(file, subargs=arguments, resolve_packages=False)
    return str(document.dom.toxml())


def _refuse_special_files(event: str, arguments: tuple[object, ...]) -> None:
    """Reject opening of FIFOs and devices, which a file may include or load: reading them may never end."""
    if event != "open" or not isinstance(arguments[0], str | bytes):
        return
    try:
        mode = Path(os.fsdecode(arguments[0])).stat().st_mode
    except (OSError, ValueError):
        return  # the caller's open reports the error
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise OSError(errno.EINVAL, "is a FIFO or device, expected a regular file", os.fsdecode(arguments[0]))


def _error_response(error: Exception) -> dict[str, str]:
    """The response for an error of xacro, which wraps others."""
    from xacrodoc.packages import PackageNotFoundError

    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, PackageNotFoundError):
        cause = cause.__context__
    if cause is not None:
        return {"package": str(cause.args[0])}
    inner: Any = error
    while getattr(inner, "exc", None) is not None:
        inner = inner.exc
    if isinstance(inner, FileNotFoundError):  # xacro's own message says it twice
        return {"error": f"there is no file {inner.filename!r}, which it includes or loads"}
    return {"error": f"{type(inner).__name__}: {' '.join(str(error).split())}"[:2000]}
