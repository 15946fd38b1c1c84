"""MuJoCo's warnings as lists, separate for simulations on different threads."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import mujoco

from rr1plan.thread_locks import per_process

# The list for warnings of the present thread. A thread that works for another one runs in a copy of its context.
_collector: ContextVar[list[str] | None] = ContextVar("_collector", default=None)
# All lists that are in use, for warnings of MuJoCo's own threads. MuJoCo has one handler for the process.
_collectors: list[list[str]] = []
_lock = per_process(sys.modules[__name__], "_lock", threading.Lock)


@contextmanager
def mujoco_warnings() -> Iterator[list[str]]:
    """Collect the warnings of this thread, which MuJoCo otherwise writes to MUJOCO_LOG.TXT in the working directory.

    A handler that the caller has installed is kept, and gets them instead.
    """
    found: list[str] = []
    with _lock:
        _collectors.append(found)
        if mujoco.get_mju_user_warning() is None:
            mujoco.set_mju_user_warning(_note)
    before = _collector.set(found)
    try:
        yield found
    finally:
        _collector.reset(before)
        with _lock:
            _collectors[:] = [other for other in _collectors if other is not found]
            if not _collectors and mujoco.get_mju_user_warning() is _note:
                mujoco.set_mju_user_warning(None)


def _note(text: str) -> None:
    own = _collector.get()
    for found in list(_collectors) if own is None else [own]:
        found.append(text)
