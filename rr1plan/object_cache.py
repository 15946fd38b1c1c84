"""Caches of values derived from an object."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

_T = TypeVar("_T")


def kept_in(store: dict[Any, Any], key: Any, make: Callable[[], _T], most: int | None = None) -> _T:
    """The cached value of a key, computed on first use.

    Args:
        store: The cache of an object.
        key: The key.
        make: Computes the value. Concurrent threads may each compute it; one value is kept.
        most: Most values in the cache (default: no limit). A full cache is cleared before the next value is added.
    """
    try:
        found: _T = store[key]
    except KeyError:
        if most is not None and len(store) >= most:
            store.clear()
        found = store[key] = make()
    return found
