"""Nested dictionaries as TOML text; floats as `repr`, so that they read back to the last bit."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from rr1plan.errors import InputError

_BARE = re.compile(r"[A-Za-z0-9_-]+\Z")
_ESCAPES = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\t": "\\t", "\r": "\\r"}


def to_toml(data: Mapping[str, object]) -> str:
    """TOML text of nested mappings, lists, texts, numbers and booleans.

    Raises:
        InputError: a value that TOML cannot represent, or NaN.
    """
    lines: list[str] = []
    _table(data, (), lines, depth=2)
    return "\n".join(lines).strip() + "\n"


def _table(data: Mapping[str, object], path: tuple[str, ...], lines: list[str], depth: int) -> None:
    """Plain entries first, then tables: as [headers] down to `depth`, inline below."""
    below = {k: v for k, v in data.items() if isinstance(v, Mapping) and v and len(path) < depth}
    lists = {k: v for k, v in data.items() if path and isinstance(v, list) and v and isinstance(v[0], Mapping)}
    plain = {k: v for k, v in data.items() if k not in below and k not in lists}
    if path and (plain or lists or not below):
        lines.append("")
        lines.append(f"[{'.'.join(toml_key(p) for p in path)}]")
    lines += [f"{toml_key(key)} = {_value(value)}" for key, value in plain.items()]
    for key, rows in lists.items():
        lines.append(f"{toml_key(key)} = [")
        lines += [f"  {_value(row)}," for row in rows]
        lines.append("]")
    for key, table in below.items():
        _table(table, (*path, key), lines, depth)


def toml_key(key: str) -> str:
    """A key, in quotes if it needs them."""
    return key if _BARE.match(key) else toml_text(key)


def toml_text(value: str) -> str:
    """A text in quotes."""
    escaped = "".join(_ESCAPES.get(c, f"\\u{ord(c):04X}" if ord(c) < 32 or ord(c) == 127 else c) for c in value)
    return f'"{escaped}"'


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        if math.isnan(value):
            raise InputError("a NaN cannot be written to a TOML file")
        return repr(float(value))
    if isinstance(value, str):
        return toml_text(value)
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    if isinstance(value, Mapping):
        inner = ", ".join(f"{toml_key(k)} = {_value(v)}" for k, v in value.items())
        return "{ " + inner + " }" if inner else "{}"
    raise InputError(f"TOML has no form for {value!r}")
