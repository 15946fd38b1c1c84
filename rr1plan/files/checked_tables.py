"""A strict view of nested tables from TOML, YAML or JSON, in which unread keys are errors.

Every error names the file, the line if known, and the entry, e.g.
"scene.toml:12: obstacles.shelf: unknown key 'boxx'. Did you mean 'box'?".
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, finite_array, shown
from rr1plan.errors import FormatError, InputError, UnknownNameError

# Synonyms of keys in robotics formats, for suggestions in error messages.
_SYNONYMS = (
    ("xyz", "position", "translation", "origin", "pose", "base"),
    ("quaternion", "rpy", "rotation", "orientation", "euler"),
    ("box", "size", "dimensions"),
    ("sphere", "radius"),
    ("length", "height"),
)


class Table:
    """A table of a file that records which keys were read.

    Args:
        data: The parsed mapping.
        file: The file, for messages.
        path: Keys from the top to this table.
        text: The file's text, in which lines are searched.
        top: The table of the whole file; None for that table.
    """

    def __init__(
        self, data: Any, file: str | Path, path: tuple[str, ...] = (), text: str = "", top: Table | None = None
    ) -> None:
        self.file = file
        self.path = path
        self.text = text
        self._top = top
        if not isinstance(data, Mapping) or not all(isinstance(key, str) for key in data):
            raise self.error(f"expected a table with named entries, got {shown(data)}")
        self._data = data
        self._asked: set[str] = set()
        self._known: list[str] = []  # once all keys are known

    def __contains__(self, key: str) -> bool:
        self._asked.add(key)
        return key in self._data

    @property
    def entries(self) -> Mapping[str, Any]:
        """All entries, as parsed."""
        return self._data

    def names(self) -> tuple[str, ...]:
        """All keys, without marking them as read."""
        return tuple(self._data)

    def raw(self, key: str, default: Any = None) -> Any:
        """The value as parsed."""
        return self._data[key] if key in self else default

    def spelled(self, key: str, earlier: str) -> str:
        """The key, or its earlier name if the file uses that one."""
        return earlier if earlier in self._data and key not in self._data else key

    def required(self, key: str) -> Any:
        """The value as parsed.

        Raises:
            FormatError: it is missing.
        """
        if key not in self:
            raise self.error(f"has no {key!r}, which is required{self._misspelt((key,))}")
        return self._data[key]

    def string(self, key: str, default: str | None = None) -> str:
        """Text; required when there is no default."""
        value = self.required(key) if default is None else self.raw(key, default)
        if not isinstance(value, str):
            raise self.error(f"expected text, got {shown(value)}", key)
        return value

    def number(self, key: str, default: float | None = None) -> float:
        """A finite number; required when there is no default."""
        value = self.required(key) if default is None else self.raw(key, default)
        if not is_number(value):
            raise self.error(f"expected a number, got {shown(value)}", key)
        if not abs(value) <= sys.float_info.max:  # also rejects NaN
            raise self.error(f"expected a finite number, got {shown(value)}", key)
        return float(value)

    def boolean(self, key: str, default: bool = False) -> bool:
        """True or false."""
        value = self.raw(key, default)
        if not isinstance(value, bool):
            raise self.error(f"expected true or false, got {shown(value)}", key)
        return value

    def numbers(self, key: str, shape: tuple[int | None, ...]) -> Array:
        """An array of finite numbers of a shape (None stands for any length); required."""
        value = self.required(key)
        check_numbers(value, lambda message: self.error(message, key))
        with self.blame(key):
            return finite_array(key, value, shape)

    def indices(self, key: str, shape: tuple[int | None, ...]) -> NDArray[np.int32]:
        """An array of whole numbers of a shape (None stands for any length); required."""
        values = self.numbers(key, shape)
        if (values != np.round(values)).any() or np.abs(values).max(initial=0.0) >= 2**31:
            raise self.error("expected whole numbers, none beyond 2**31", key)
        return values.astype(np.int32)

    def strings(self, key: str) -> tuple[str, ...]:
        """A list of texts, empty if it is missing."""
        value = self.raw(key, [])
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise self.error(f"expected a list of texts, got {shown(value)}", key)
        return tuple(value)

    def rows(self, key: str) -> list[Any]:
        """A list of anything, empty if it is missing."""
        value = self.raw(key, [])
        if not isinstance(value, list):
            raise self.error(f"expected a list, got {shown(value)}", key)
        return value

    def table(self, key: str) -> Table:
        """A table within this one, empty if it is missing."""
        return self.at(key, self.raw(key, {}))

    def at(self, place: str, data: Any) -> Table:
        """Data as a table at a place in this one, such as "goal" or "goal[0]", which is not marked as read."""
        return Table(data, self.file, (*self.path, place), self.text, self._top or self)

    def tables(self, key: str) -> list[Table]:
        """A list of tables, empty if it is missing."""
        return [self.at(f"{key}[{i}]", item) for i, item in enumerate(self.rows(key))]

    def one_of(self, kinds: Mapping[str, Any]) -> str:
        """The single key of `kinds` that is present.

        Raises:
            FormatError: none of them or several.
        """
        present = [kind for kind in kinds if kind in self]
        if len(present) != 1:
            got = " and ".join(present) if present else f"none (it has {', '.join(self._data) or 'no keys'})"
            raise self.error(f"expected exactly one of {', '.join(kinds)}; got {got}{self._misspelt(kinds)}")
        return present[0]

    def _misspelt(self, wanted: Iterable[str]) -> str:
        """End of a message about a missing key: a suggestion of a similar key that is present."""
        # Imported lazily, because it is rarely needed.
        from difflib import get_close_matches

        for key in self.unasked():
            synonyms = _synonyms(key, wanted)
            near = get_close_matches(key, wanted, n=1, cutoff=0.7) if synonyms is None else synonyms
            if near:
                return f". Did you mean {near[0]!r} where it says {key!r}?"
        return ""

    def unasked(self) -> tuple[str, ...]:
        """The unread keys."""
        return tuple(key for key in self._data if key not in self._asked)

    def finish(self, *later: str) -> None:
        """Reject unread keys.

        Args:
            later: Keys that are read later.

        Raises:
            FormatError: an unread key; the message suggests similar known keys.
        """
        self._known = known = sorted(self._asked.union(later))
        for key in self.unasked():
            if key in later:
                continue
            is_of_top = self._top is not None and key in self._top._known
            advice = f"A {key!r} of the whole file belongs before its first [table]." if is_of_top else ""
            raise self.error(str(UnknownNameError("key", key, known, advice, _synonyms(key, known))), key)

    def error(self, message: str, key: str | None = None) -> FormatError:
        """A FormatError that names the entry."""
        place = (*self.path, key) if key is not None else self.path
        where = ".".join(place) + ": " if place else ""
        return FormatError(where + message, self.file, line_of(self.text, place))

    def check_there(self, file: Path, key: str) -> None:
        """Reject the name of a missing file or of a folder, with the line that gives it."""
        if file.is_dir():
            raise self.error(f"is a folder, expected a file: {file}", key)
        if not os.path.lexists(file):
            slashes = "; a slash separates folders, not a backslash" if "\\" in str(file) else ""
            raise self.error(f"there is no such file: {file}{slashes}", key)

    @contextmanager
    def blame(self, key: str | None = None) -> Iterator[None]:
        """Re-raise errors of values as errors of this entry."""
        try:
            yield
        except FormatError:
            raise
        except InputError as error:
            raise self.error(str(error), key) from error


def _synonyms(key: str, wanted: Iterable[str]) -> list[str] | None:
    """The wanted keys that are synonyms of a key; None for a key without known synonyms."""
    for words in _SYNONYMS:
        if key in words:
            return [word for word in words if word in set(wanted)]
    return None


def is_number(value: Any) -> bool:
    """Whether a value is a number and not a bool (`yes` is one in YAML)."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def check_numbers(value: object, error: Callable[[str], FormatError]) -> None:
    """Require nested lists of numbers (NumPy would accept "1" and True)."""
    if isinstance(value, list):
        for item in value:
            check_numbers(item, error)
    elif not is_number(value):
        raise error(f"expected a list of numbers, got {shown(value)} in it")


def line_of(text: str, place: tuple[str, ...]) -> int | None:
    """The approximate line [1-based] of a TOML table or key, by text search."""
    for depth in range(len(place), 0, -1):
        header = r"\s*\.\s*".join(_key_pattern(part) for part in place[:depth])
        found = _nth_header(text, header, place[depth - 1])
        if found is None:
            continue
        start = text.count("\n", 0, found.end()) + 1
        if depth == len(place):
            return start
        body = text[found.end() :]
        following = re.search(r"^\s*\[", body, re.MULTILINE)
        body = body[: following.start()] if following else body
        inner = re.search(rf"^\s*{_key_pattern(place[depth])}\s*[.=]", body, re.MULTILINE)
        return start if inner is None else start + body.count("\n", 0, inner.start(0) + len(inner[0]))
    for depth in range(len(place), 0, -1):  # keys with dots outside of tables
        keys = r"\s*\.\s*".join(_key_pattern(part) for part in place[:depth])
        found = re.search(rf"^\s*\[*\s*{keys}\s*[.=]", text, re.MULTILINE)
        if found is not None:
            return text.count("\n", 0, found.end()) + 1
    return None


def _nth_header(text: str, header: str, last: str) -> re.Match[str] | None:
    """The header of a table; for an array of tables, the one with the index in the last part of its path."""
    index = re.search(r"\[(\d+)\]$", last)
    if index is None:
        return re.search(rf"^\s*\[\[?\s*{header}\s*\]", text, re.MULTILINE)
    tables = re.finditer(rf"^\s*\[\[\s*{header}\s*\]", text, re.MULTILINE)
    return next(islice(tables, int(index[1]), None), None)


def _key_pattern(part: str) -> str:
    name = re.escape(re.sub(r"\[\d+\]$", "", part))
    return rf"[\"']?{name}[\"']?"
