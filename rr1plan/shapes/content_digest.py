"""Content hashes that are equal for equal values in any process."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np

from rr1plan.shapes import Mesh, PointCloud

_PLAIN = frozenset((float, int, str, bool, type(None)))


def value_hash(value: Any) -> str:
    """SHA-256 of nested values, arrays and shapes (hex)."""
    digest = hashlib.sha256()
    feed_digest(digest, value)
    return digest.hexdigest()


def feed_digest(digest: Any, value: Any) -> None:
    """Update a hash with nested values, arrays and shapes, each with its type and length."""
    parts: list[bytes] = []
    _collect(parts, value)
    digest.update(b"".join(parts))


def _collect(parts: list[bytes], value: Any) -> None:
    kind = type(value)
    if kind in _PLAIN:
        parts.append(f"{kind.__name__}:{value!r};".encode())
    elif isinstance(value, np.ndarray):
        parts.append(f"array{value.shape}{value.dtype.str}".encode())
        parts.append((value + value.dtype.type(0)).tobytes())  # -0.0 counts as 0.0
    elif isinstance(value, list | tuple):
        parts.append(f"list{len(value)}".encode())
        for item in value:
            _collect(parts, item)
    elif isinstance(value, dict):
        _collect(parts, sorted(value.items()))
    elif isinstance(value, Mesh | PointCloud):
        _collect(parts, [kind.__name__, *(getattr(value, n) for n in value.__dataclass_fields__)])
    else:
        parts.append(f"{kind.__name__}:{value!r};".encode())
