"""Motions from standard input, as a file for the readers."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rr1plan.errors import InputError
from rr1plan.files.file_access import MAX_BYTES

STANDARD_INPUT = "-"
_NAME = "standard input"


@contextmanager
def readable_file(name: str) -> Iterator[str]:
    """A file of that name; of "-", a temporary one with the content of standard input.

    Errors that name the temporary file name standard input instead.

    Raises:
        InputError: standard input is closed or empty, or cannot be read.
    """
    if name != STANDARD_INPUT:
        yield name
        return
    content = _content()
    with tempfile.TemporaryDirectory(prefix="rr1plan-") as folder:
        file = Path(folder) / f"motion{_suffix(content)}"
        file.write_bytes(content)
        try:
            yield str(file)
        except InputError as error:
            raise InputError(str(error).replace(str(file), _NAME)) from error


def _content() -> bytes:
    if sys.stdin is None:
        raise InputError(f"cannot read {_NAME}: it is closed")
    try:
        content = sys.stdin.buffer.read(MAX_BYTES + 1)  # the reader of the file rejects more
    except OSError as error:
        raise InputError(f"cannot read {_NAME}: {error.strerror}") from error
    if not content.strip():
        raise InputError(f"{_NAME} is empty, expected a motion")
    return content


def _suffix(content: bytes) -> str:
    """The suffix of the format: a JSON object, a table with commas in its first line, or YAML."""
    text = content.removeprefix(b"\xef\xbb\xbf").lstrip()
    if text.startswith(b"{"):
        return ".json"
    return ".csv" if b"," in text.partition(b"\n")[0] else ".yaml"
