"""Locks of objects that several threads may use: at most one thread at a time is in an object's exclusive methods.

A forked process has only the thread that forked. A lock that another thread held would never be released there, and a
pool would wait for threads that do not exist, so both are created again, see `per_process`.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cached_property, wraps
from typing import Any, Self, TypeVar, cast, overload
from weakref import ref

_Method = TypeVar("_Method", bound=Callable[..., Any])
_T = TypeVar("_T")
# For each object or module, how to create the attributes that belong to the threads of one process. Not a
# `WeakKeyDictionary`, whose entries are removed by Python code, in which Python drops a Ctrl-C.
_factories: dict[ref[Any], dict[str, Callable[[], Any]]] = {}


def per_process(owner: Any, attribute: str, create: Callable[[], _T]) -> _T:
    """The value for an attribute that belongs to the threads of one process; forked processes get a new value.

    Args:
        owner: The object or module, which can be referred to weakly and compares by identity.
        attribute: Name of its attribute, to which the caller assigns the value.
        create: Creates a value, without referring to the owner.
    """
    _factories.setdefault(ref(owner, _factories.pop), {})[attribute] = create
    return create()


def _renew() -> None:
    for reference, factories in _factories.copy().items():
        owner = reference()
        if owner is None:
            continue
        for attribute, create in factories.items():
            setattr(owner, attribute, create())


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew)


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
