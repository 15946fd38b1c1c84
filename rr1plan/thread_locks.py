"""Locks of objects that several threads may use: at most one thread at a time is in an object's exclusive methods."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, wraps
from typing import Any, Self, TypeVar, cast, overload

_Method = TypeVar("_Method", bound=Callable[..., Any])
_T = TypeVar("_T")


def exclusive(method: _Method) -> _Method:
    """A method that holds the lock of its object, `_lock` (a `threading.RLock`): other threads wait for its end."""

    @wraps(method)
    def locked(self: Any, *args: Any, **kwargs: Any) -> Any:
        with self._lock:
            return method(self, *args, **kwargs)

    return cast("_Method", locked)


class ExclusiveCache(cached_property[_T]):
    """A cached property that is computed and stored while the lock of its object is held, see `exclusive`.

    If another thread changes the object, values computed before the change are not stored after it. The lock of
    `cached_property` itself, which all objects of a class share in Python 3.11, is not used: with it, two threads could
    each hold one of both locks and wait for the other.
    """

    @overload
    def __get__(self, instance: None, owner: type[Any] | None = None) -> Self: ...

    @overload
    def __get__(self, instance: object, owner: type[Any] | None = None) -> _T: ...

    def __get__(self, instance: Any, owner: type[Any] | None = None) -> Self | _T:
        """The value."""
        if instance is None:
            return self
        with instance._lock:
            kept, name = instance.__dict__, self.attrname
            if name not in kept:
                kept[name] = self.func(instance)
            value: _T = kept[name]
            return value
