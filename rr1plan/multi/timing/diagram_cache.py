"""The coordination diagrams of a problem, each computed once, in parallel on threads."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from rr1plan.multi.agents import Agent
from rr1plan.multi.in_parallel import in_parallel
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.paths.path_memory import PathMemory
from rr1plan.multi.preflight import MARGINS, margins_up_to
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.coordination import (
    Blocked,
    boxes_intersect,
    coordination_diagram,
    ends_are_apart,
    ends_in_the_way,
)
from rr1plan.multi.timing.schedule import extended

_FEWEST = 3  # fewest diagrams for which threads are started


class DiagramCache:
    """Thread-safe cache of extended coordination diagrams of pairs of paths.

    Args:
        largest: Largest distance that two agents keep from each other in addition to the padding [m].
        watch: Deadline, after which new diagrams have no free cell and are not cached (default: none).
    """

    def __init__(self, largest: float = MARGINS[0], watch: Stopwatch | None = None) -> None:
        self._watch = watch or Stopwatch(np.inf)
        self._stop = self._watch.stop
        self._sizes = (*margins_up_to(largest), 0.0)
        self._margins: dict[tuple[Agent, Agent, bytes, bytes], float] = {}
        self._diagrams: dict[tuple[AgentPath, AgentPath], Blocked | None] = {}
        self._memory = PathMemory()

    def __len__(self) -> int:
        """Number of computed diagrams, both orders counted."""
        return len(self._diagrams)

    def margin(self, one: AgentPath, two: AgentPath) -> float:
        """The largest margin that the starts and the goals of two agents have [m].

        Args:
            one: A path of an agent.
            two: A path of another one.
        """
        key = one.agent, two.agent, one.goal.tobytes(), two.goal.tobytes()
        if key not in self._margins:
            last = self._sizes[-1]
            self._margins[key] = next((m for m in self._sizes[:-1] if ends_are_apart(one, two, m)), last)
        return self._margins[key]

    def may_touch(self, one: AgentPath, two: AgentPath) -> bool:
        """Whether boxes around the swept volumes of two agents intersect.

        Args:
            one: A path of an agent.
            two: A path of another one.
        """
        if ends_in_the_way(one, two, self._sizes[0]):
            return True
        for path in (one, two):
            if not path.has_boxes:
                self._memory.place(path, stop=self._stop)
        return boxes_intersect(one, two, self._sizes[0])

    def diagram(self, one: AgentPath, two: AgentPath) -> Blocked | None:
        """The extended diagram of two paths; None if all of it is free.

        Args:
            one: A path of an agent (rows).
            two: A path of another one (columns).
        """
        try:
            return self._diagrams[one, two]
        except KeyError:
            if not self._memory.place(one, two, stop=self._stop):
                return extended(np.ones((one.cells, two.cells), np.uint8))
            blocked = None
            if self.may_touch(one, two):
                blocked = coordination_diagram(one, two, self.margin(one, two), self._stop)
            both = None if blocked is None else extended(blocked)
            if self._stop[0]:
                return both
            self._diagrams[one, two] = both
            self._diagrams[two, one] = None if both is None else np.ascontiguousarray(both.T)
            return both

    def is_known_free(self, one: AgentPath, two: AgentPath) -> bool:
        """Whether the diagram of two paths has been computed, and all of it is free.

        Args:
            one: A path of an agent.
            two: A path of another one.
        """
        return (one, two) in self._diagrams and self._diagrams[one, two] is None

    def keep_only(self, paths: Iterable[AgentPath]) -> None:
        """Delete all diagrams except those between some paths; not while other threads use the cache.

        Args:
            paths: The paths.
        """
        kept = set(paths)
        self._diagrams = {both: found for both, found in self._diagrams.items() if kept.issuperset(both)}

    def prepare(self, pairs: Iterable[tuple[AgentPath, AgentPath]], threads: int) -> None:
        """Compute diagrams that will be needed, while time is left.

        Args:
            pairs: Pairs of paths.
            threads: Number of threads.
        """
        if threads < 2:
            return
        unknown = [both for both in pairs if both not in self._diagrams]
        missing = [both for both in unknown if self._watch.goes_on() and self.may_touch(*both)]
        if len(missing) < _FEWEST:
            return
        in_parallel(lambda both: self._watch.goes_on() and self.diagram(*both), missing, threads, self._watch)
