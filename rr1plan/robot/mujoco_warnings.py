"""MuJoCo's warnings as a list."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco


@contextmanager
def mujoco_warnings() -> Iterator[list[str]]:
    """Collect MuJoCo's warnings, which it otherwise writes to MUJOCO_LOG.TXT in the working directory.

    A handler that the caller has installed is kept, and gets them instead.
    """
    found: list[str] = []
    before = mujoco.get_mju_user_warning()
    if before is not None:
        yield found
        return
    mujoco.set_mju_user_warning(found.append)
    try:
        yield found
    finally:
        mujoco.set_mju_user_warning(None)
