"""A limit of the memory of bodies placed along paths: megabytes for an arm, hundreds for a path of many arms."""

from __future__ import annotations

from threading import RLock

import numpy as np
from numpy.typing import NDArray

from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.paths.placed_path import NEVER
from rr1plan.thread_locks import exclusive, per_process

_MOST_BYTES = 700_000_000


class PathMemory:
    """Paths whose bodies are placed; if they take too much memory, those that were not used for longest are released.

    Threads may share it.
    """

    def __init__(self) -> None:
        self._bytes: dict[AgentPath, int] = {}  # in the order of their last use
        self._total = 0
        self._lock = per_process(self, "_lock", RLock)

    def place(self, *paths: AgentPath, stop: NDArray[np.int64] = NEVER) -> bool:
        """Place the bodies along some paths; returns whether that was not stopped.

        Args:
            paths: The paths, which are released last.
            stop: A flag, shape (1,). Once another thread sets it, the rest is skipped.
        """
        if not all(path.place(stop) for path in paths):
            return False
        self._keep(paths)
        return True

    @exclusive
    def _keep(self, paths: tuple[AgentPath, ...]) -> None:
        for path in paths:
            self._total -= self._bytes.pop(path, 0)
            self._bytes[path] = path.placed_bytes
            self._total += self._bytes[path]
        if self._total <= _MOST_BYTES:
            return
        # Some may have been released elsewhere.
        self._bytes = {path: path.placed_bytes for path in self._bytes}
        self._total = sum(self._bytes.values())
        for path in list(self._bytes)[: -len(paths)]:
            if self._total <= _MOST_BYTES:
                break
            self._total -= self._bytes.pop(path)
            path.release()
