"""What is made from an object and kept with it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

_T = TypeVar("_T")


def kept_in(store: dict[Any, Any], key: Any, make: Callable[[], _T], most: int | None = None) -> _T:
    """The value that an object keeps under a key, made when it is first needed.

    Args:
        store: Where the object keeps what is made from it.
        key: The key.
        make: Makes the value. Threads that need it at once may each make it; one is kept.
        most: How many values there may be (default: any number). A full store is emptied before it takes another.
    """
    try:
        found: _T = store[key]
    except KeyError:
        if most is not None and len(store) >= most:
            store.clear()
        found = store[key] = make()
    return found
