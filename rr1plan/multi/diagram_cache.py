"""Coordination diagrams of paths that are in use: each is computed once, and forgotten with its paths."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from rr1plan.multi.agent_path import AgentPath
from rr1plan.multi.coordination import Blocked, coordination_diagram, ends_exclude
from rr1plan.multi.preflight import MARGINS
from rr1plan.multi.schedule import extended

# Distances to keep between agents beyond the padding [m]: the largest that their starts and their goals have.
_MARGINS = (*MARGINS, 0.0)


class DiagramCache:
    """Extended diagrams of pairs of paths; an entry lives as long as both of its paths."""

    def __init__(self) -> None:
        self._diagrams: WeakKeyDictionary[AgentPath, WeakKeyDictionary[AgentPath, Blocked | None]]
        self._diagrams = WeakKeyDictionary()
        # Paths of an agent share their ends, so a margin found for two agents holds for all of their paths.
        self._margins: dict[frozenset[tuple[str, ...]], float] = {}

    def diagram(self, one: AgentPath, two: AgentPath) -> Blocked | None:
        """The extended diagram (rows: of the first path); None where all of it is free.

        Args:
            one: A path of an agent.
            two: A path of another agent of the same problem.
        """
        row = self._diagrams.setdefault(one, WeakKeyDictionary())
        if two not in row:
            blocked = self._compute(one, two)
            row[two] = blocked
            self._diagrams.setdefault(two, WeakKeyDictionary())[one] = (
                None if blocked is None else np.ascontiguousarray(blocked.T)
            )
        return row[two]

    def _compute(self, one: AgentPath, two: AgentPath) -> Blocked | None:
        agents = frozenset((one.agent.arms, two.agent.arms))
        largest = self._margins.get(agents, _MARGINS[0])
        blocked = None
        for margin in _MARGINS:
            if margin > largest:
                continue
            blocked = coordination_diagram(one, two, margin)
            self._margins[agents] = margin
            if not ends_exclude(blocked):
                break
        return None if blocked is None else extended(blocked)
