"""The end of a process."""

from __future__ import annotations

import gc
import sys


def omit_collection() -> None:
    """Omit the collection of all libraries' objects when this process ends, which takes a quarter of a second.

    OMPL's binding reports remaining objects as leaks, so with OMPL they are collected.
    """
    if "ompl" not in sys.modules:
        gc.freeze()
