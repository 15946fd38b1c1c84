"""Interaction groups of arms on their paths, by boxes around swept volumes or by coordination diagrams."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

from rr1plan.collision.arm_groups import interaction_groups
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.diagram_cache import DiagramCache


def meeting_groups(
    paths: Mapping[str, AgentPath],
    near: Mapping[str, frozenset[str]],
    diagrams: DiagramCache,
    *,
    exactly: bool = False,
    watch: Stopwatch | None = None,
) -> list[tuple[str, ...]]:
    """Groups of arms whose paths may collide: arms of different groups never touch, whatever their timing.

    Args:
        paths: The path of each arm; arms that move as one share it.
        near: For each arm, the arms that it can touch at all.
        diagrams: Coordination diagrams of the problem.
        exactly: Whether to use coordination diagrams instead of boxes around swept volumes.
        watch: After its deadline, all remaining pairs count as pairs that may collide.
    """
    meets = (lambda a, b: diagrams.diagram(a, b) is not None) if exactly else diagrams.may_touch
    found: dict[str, list[str]] = {arm: [] for arm in paths}
    for one, two in combinations(paths, 2):
        if two not in near[one]:
            continue
        late = watch is not None and not watch.goes_on()
        if paths[one] is paths[two] or late or meets(paths[one], paths[two]):
            found[one].append(two)
            found[two].append(one)
    return interaction_groups(found)
