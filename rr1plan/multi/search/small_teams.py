"""Conflict-based search for a group of a few arms: roadmaps that grow until there is a plan on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from rr1plan.checks import Array
from rr1plan.errors import InputError
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.path_pool import PathPool
from rr1plan.multi.paths.placed_path import placed_configuration
from rr1plan.multi.preflight import MARGINS
from rr1plan.multi.search.arm_roadmap import ArmRoadmap, build_roadmap
from rr1plan.multi.search.conflict_based_search import ConflictBasedSearch, schedule_of
from rr1plan.multi.search.relative_conflicts import RelativeConflicts
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.coordination import are_apart
from rr1plan.multi.timing.schedule import Schedule
from rr1plan.retiming.path_blends import clean

MOST_ARMS = 8
"""Arms of a group, at most."""

SUBOPTIMALITY = 1.1
"""Largest ratio of the sum of arrivals to the minimum on the roadmaps."""

# Samples of the roadmaps, and nodes of the search on them; the last ones have all of the time.
_ROUNDS = ((50, 500), (200, 2000), (800, 10**9))


@dataclass(frozen=True)
class TeamPlan:
    """A plan of a group of arms.

    Args:
        schedules: One for each arm; none if no plan was found.
        alone: Duration of the fastest known motion of each arm alone [s].
        suboptimality: The sum of arrivals is at most this multiple of the least on the arms' roadmaps.
        reason: Why there is no plan, in words.
    """

    schedules: tuple[Schedule, ...] = ()
    alone: Mapping[str, float] = field(default_factory=dict)
    suboptimality: float = 1.0
    reason: str = ""


def plan_small_team(
    agents: Sequence[Agent],
    near: Mapping[str, frozenset[str]],
    margins: Mapping[str, float],
    rng: np.random.Generator,
    watch: Stopwatch,
    suboptimality: float = SUBOPTIMALITY,
) -> TeamPlan:
    """Plan the motions of a few arms by conflict-based search.

    Args:
        agents: The agent of each arm.
        near: Of each arm those that it can meet.
        margins: Distance that each arm keeps from what stands still, beyond the padding [m].
        rng: Where random numbers come from.
        watch: Says when to give up.
        suboptimality: The sum of arrivals may be this multiple of the least on the roadmaps, at least 1.

    Raises:
        InputError: too many arms.
    """
    arms = [agent.arms[0] for agent in agents]
    if len(arms) > MOST_ARMS:
        raise InputError(
            f"conflict-based search is for groups of up to {MOST_ARMS} arms that can meet, here are {len(arms)}; "
            "use method 'portfolio'"
        )
    paths: dict[str, Array] = {}
    alone: dict[str, float] = {}
    for agent, arm in zip(agents, arms, strict=True):
        path, reason = PathPool(agent, margins[arm], rng, watch).add({}, patient=True)
        if path is None:
            return TeamPlan(reason=f"{arm}: {reason}")
        paths[arm], alone[arm] = clean(path.path.waypoints), path.fastest
    goals = {arm: points[-1] for arm, points in paths.items()}
    conflicts = RelativeConflicts(_margin_between(agents, goals, near))
    reason = "no time was left"
    for samples, nodes in _ROUNDS:
        roadmaps: dict[str, ArmRoadmap] = {}
        for agent, arm in zip(agents, arms, strict=True):
            made = build_roadmap(agent, goals[arm], margins[arm], samples, [paths[arm]], watch.goes_on)
            if made is None:
                return TeamPlan(reason=f"{', '.join(arms)}: {reason}")
            roadmaps[arm] = made
        found = ConflictBasedSearch(roadmaps, near, conflicts, watch, suboptimality).run(nodes)
        if found.moves is not None:
            schedules = tuple(schedule_of(roadmaps[arm], found.moves[arm]) for arm in arms)
            return TeamPlan(schedules, alone, found.suboptimality)
        reason = f"no plan after {found.nodes} nodes of a search on roadmaps of {samples} samples"
    return TeamPlan(reason=f"{', '.join(arms)}: {reason}")


def _margin_between(agents: Sequence[Agent], goals: Mapping[str, Array], near: Mapping[str, frozenset[str]]) -> float:
    """The largest margin that all starts have from each other, and all goals [m]."""
    ends = [{agent.arms[0]: agent.start for agent in agents}, goals]
    placed = [{a.arms[0]: placed_configuration(a.bodies, end[a.arms[0]]) for a in agents} for end in ends]
    for margin in MARGINS:
        if all(
            are_apart(a, at[a.arms[0]], b, at[b.arms[0]], margin)
            for a, b in combinations(agents, 2)
            if b.arms[0] in near[a.arms[0]]
            for at in placed
        ):
            return margin
    return 0.0
