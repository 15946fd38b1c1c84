"""Content hashes that are equal for equal values in any process."""

from __future__ import annotations

from typing import Any

import numpy as np

from rr1plan.shapes import Mesh, PointCloud


def feed_digest(digest: Any, value: Any) -> None:
    """Update a hash with nested values, arrays and shapes, each with its type and length."""
    if isinstance(value, Mesh | PointCloud):
        feed_digest(digest, [type(value).__name__, *(getattr(value, n) for n in value.__dataclass_fields__)])
    elif isinstance(value, np.ndarray):
        digest.update(f"array{value.shape}{value.dtype.str}".encode())
        digest.update(np.ascontiguousarray(value + value.dtype.type(0)).tobytes())  # -0.0 counts as 0.0
    elif isinstance(value, list | tuple):
        digest.update(f"list{len(value)}".encode())
        for item in value:
            feed_digest(digest, item)
    elif isinstance(value, dict):
        feed_digest(digest, sorted(value.items()))
    else:
        digest.update(f"{type(value).__name__}:{value!r};".encode())
