"""Plans an interaction group by one method after the other, until one schedules all of its agents.

Groups of three to sixteen arms are planned one arm after the other in space and time (`space_time.py`) first; of two to
four, in their joint space, which takes milliseconds. Then they are coupled in time windows (`coupled_windows.py`), or
move one arm at a time (`sequential_moves.py`). If these fail, and in larger groups, agents are scheduled one after the
other (`prioritized.py`), in turn with further rounds of both. The effort of the rounds grows.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from rr1plan.checks import Array
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.errors import RetimingError
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.search.coupled_windows import CoupledWindows
from rr1plan.multi.search.group_schedules import GroupSchedules
from rr1plan.multi.search.prioritized import PrioritizedPlanner
from rr1plan.multi.search.retreats import RetreatSearch
from rr1plan.multi.search.sequential_moves import SequentialMoves
from rr1plan.multi.search.space_time import SpaceTimeSearch
from rr1plan.path import Path

NO_TIME = "no time was left to schedule it"
"""Reason of a group whose search did not begin."""
COUPLED_FIRST = 16
"""Largest number of agents of a group that is planned together before coordination diagrams are computed."""
PLANNED_AS_ONE = 4
"""Largest number of agents of a group whose joint space is searched."""
# Smallest number of agents of a group that is planned in space and time; for two, their joint space is faster.
_IN_TIME_FROM = 3
_ATTEMPTS = 3  # attempts at a path in the joint space of a few arms
_STATIONARY = 0.7  # fraction of the other arms that an arm's initial path avoids in later rounds of windows
_ROUNDS_OF_SAME_EFFORT = 4  # rounds of windows and sequential moves until their effort is doubled
_ROUNDS_FIRST = 8  # rounds of windows and sequential moves before coordination diagrams are computed
# Evictions per agent between two rounds of windows and sequential moves.
_EVICTIONS = 3
# Improvement of a path stops this close to the duration of the slowest arm alone [ratio].
_CLOSE = 1.05


class GroupPlanner:
    """Plans the motions of one interaction group.

    Args:
        group: The agents of the group and their schedules, which it changes.

    Attributes:
        group: Like the argument.
        threads: Number of threads that compute diagrams.
    """

    def __init__(self, group: GroupSchedules) -> None:
        self.group = group
        self.threads = 1
        self._rng, self._watch = group.rng, group.watch
        self._prioritized = PrioritizedPlanner(group)

    def run(self, rounds: float = math.inf) -> bool:
        """Schedule all agents; returns whether this succeeded in time.

        Args:
            rounds: Largest number of rounds of windows and sequential moves.
        """
        group = self.group
        if not self._watch.goes_on():
            group.reason = NO_TIME
            return False
        effort = 0
        if not group.schedules and 1 < len(group.agents) <= COUPLED_FIRST:
            effort = int(min(rounds, _ROUNDS_FIRST))
            if self._plan_together(effort):
                return True
        found = effort < rounds and self._watch.goes_on() and not group.impossible and self._plan_apart(effort, rounds)
        if not found and not group.reason:
            group.reason = group.why_unscheduled()
        return found

    def improve(self, rounds: int) -> None:
        """Reduce the makespan: make the paths of several arms faster, then reschedule the agent that arrives last.

        Args:
            rounds: How often to reschedule.
        """
        group = self.group
        self._hasten()
        for _ in range(rounds if len(group.agents) > 1 else 0):
            if group.makespan <= group.good_enough() or not self._watch.goes_on():
                break
            self._prioritized.reschedule_last()

    def _plan_together(self, rounds: int) -> bool:
        """Search for motions of all arms as one agent, or in windows; returns whether all agents are scheduled."""
        count = len(self.group.agents)
        few = count <= PLANNED_AS_ONE
        if (count >= _IN_TIME_FROM and self._plan_in_time()) or (few and self._plan_few()):
            return True
        for effort in range(rounds):
            if self.group.impossible or not self._watch.goes_on():
                return False
            if self._couple(effort) or self._move_in_turn(effort) or (few and self._plan_as_one(effort + 1)):
                return True
            if effort == 0 and not few:
                self.group.prove_separated()  # the planner of the joint space of a few arms does it, too
        return False

    def _plan_apart(self, effort: int, rounds: float) -> bool:
        """Schedule agents one by one, with windows and sequential moves in between; returns whether this succeeded.

        Args:
            effort: Number of the first round.
            rounds: Number of the round before which the search ends.
        """
        group = self.group
        group.prepare_diagrams(self.threads)
        if not group.time_first_paths():
            group.set_stage_at_least("timing")
            return True
        while effort < rounds and self._watch.goes_on():
            if self._prioritized.schedule_all(group.statistics.evictions + _EVICTIONS * len(group.agents)):
                return True
            if not self._watch.goes_on():
                break
            if self._couple(effort) or self._move_in_turn(effort):
                return True
            effort += 1
        return False

    def _hasten(self) -> None:
        """Make the paths of agents of several arms faster."""
        group, began = self.group, time.perf_counter()
        enough, closest = group.good_enough(), group.slowest_alone() * _CLOSE
        for agent in [agent for agent in group.agents if len(agent.arms) > 1]:
            before = group.schedules[agent]
            if before.arrival <= enough or not self._watch.goes_on():
                continue
            with suppress(RetimingError):
                path = group.pools[agent].add_refined(before.path, closest)
                others = group.scheduled_neighbors(agent)
                found = group.timed(path, others) if path.fastest < before.arrival else None
                if found is not None and found.arrival < before.arrival:
                    group.schedules[agent] = found
        group.statistics.add_time("paths", began)

    # ---- all arms as one agent ---------------------------------------------------------------

    def _plan_in_time(self) -> bool:
        """Plan arms one after the other in space and time; returns whether this succeeded."""
        group, began = self.group, time.perf_counter()
        pool = group.pool_of(group.arms)
        paths = {arm: alone.paths[0].path.waypoints for arm, alone in group.alone.items()}
        points = SpaceTimeSearch(pool.agent, paths, pool.margin, self._rng, self._watch).solve()
        if points is not None:
            with suppress(RetimingError):
                pool.add_shortened(Path(pool.agent.joint_names, points))
        group.statistics.add_time("space-time", began)
        return group.adopt([pool], "space-time")

    def _plan_few(self) -> bool:
        """Plan a few agents as one; returns whether a path was found."""
        limit, pool = self.group.time_limit(), self.group.pool_of(self.group.arms)
        for _ in range(_ATTEMPTS):
            if self.group.add_path(pool) is None or min(path.fastest for path in pool.paths) <= limit:
                break
        return self.group.adopt([pool], "composite")

    def _plan_as_one(self, effort: int) -> bool:
        """Search for a path in the joint space of all arms; returns whether one was found."""
        pool = self.group.pool_of(self.group.arms)
        return self.group.add_path(pool, effort) is not None and self.group.adopt([pool], "composite")

    def _move_in_turn(self, effort: int) -> bool:
        """Plan all arms as one agent that moves one arm at a time via retreats; returns whether this succeeded."""
        if not self._watch.goes_on():
            return False
        group, began = self.group, time.perf_counter()
        pool, single = group.pool_of(group.arms), {arm: group.agent_of([arm]) for arm in group.arms}
        goal = np.concatenate([group.alone[arm].paths[0].goal for arm in pool.agent.arms])
        retreats = RetreatSearch(pool.agent, goal, single, group.near, pool.margin, self._rng, self._watch)
        moves = SequentialMoves(pool.agent, goal, retreats, pool.margin, self._rng, self._watch)
        for points in moves.paths(effort // _ROUNDS_OF_SAME_EFFORT):
            with suppress(RetimingError):
                pool.add_shortened(Path(pool.agent.joint_names, points))
            if min((path.fastest for path in pool.paths), default=math.inf) <= group.slow_from():
                break
        group.statistics.add_time("sequential", began)
        return group.adopt([pool], "sequential")

    # ---- windows -----------------------------------------------------------------------------

    def _couple(self, effort: int) -> bool:
        """Couple arms in time windows around their conflicts; returns whether all agents have a schedule."""
        group, began = self.group, time.perf_counter()
        margin = group.pool_of(group.arms).margin
        starts = {arm: self._first_guess(arm, effort).path.waypoints for arm in group.alone}
        windows = CoupledWindows(starts, group.agent_of, margin, self._rng, self._watch)
        solved = windows.solve(effort // _ROUNDS_OF_SAME_EFFORT)
        group.statistics.windows += windows.windows
        group.statistics.add_time("windows", began)
        if not solved:
            return False
        # Sets of arms that shared no window are timed separately, or all arms move as one agent as in the windows.
        arms, sets = group.arms, windows.coupled_sets()
        found = self._adopt_windows(windows, sets)
        if len(sets) == 1 or (found and group.makespan <= group.slow_from()):
            return found
        separate = group.snapshot()
        arrival = group.makespan if found else math.inf
        as_one = self._adopt_windows(windows, [arms])
        if as_one and group.makespan > arrival:
            group.restore(separate)
        return found or as_one

    def _first_guess(self, arm: str, effort: int) -> AgentPath:
        """Initial path of an arm for windows: its first, or in later rounds one around starts or goals of others."""
        group, pool = self.group, self.group.alone[arm]
        if effort == 0:
            return pool.paths[0]
        stationary: dict[str, Array | None] = {}
        for other in sorted(group.near[arm] & group.alone.keys()):
            theirs = group.alone[other]
            q = theirs.paths[0].goal if effort % 2 else theirs.agent.start
            # A random subset of the others varies the paths between rounds.
            if self._rng.random() < _STATIONARY and pool.ends_are_apart_from(theirs.agent, q):
                stationary[other] = q
        path, _ = pool.add(stationary) if stationary else (None, "")
        return path or pool.paths[0]

    def _adopt_windows(self, windows: CoupledWindows, sets: Sequence[tuple[str, ...]]) -> bool:
        pools = []
        for arms in sets:
            pool, path = self.group.pool_of(arms), windows.path(arms)
            query = pool.agent.query({}, pool.margin)
            with checker_from_pool(query.scene, query.arms, pool.margin) as checker:
                if not checker.path_is_free(path):
                    return False
            try:
                pool.add_shortened(path)
            except RetimingError:
                return False
            pools.append(pool)
        # Without windows, the first paths are free of conflicts as they are.
        return self.group.adopt(pools, "windows" if windows.windows else "timing")
