"""Motions of one arm of a running plan to another goal, timed among the motions of all others."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from rr1plan.checks import Array
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.errors import RetimingError
from rr1plan.multi.agents import Agent
from rr1plan.multi.execution.present_motions import PresentMotions
from rr1plan.multi.execution.running_plan import Part, Stop, part_of, stops_of
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.paths.path_pool import PathPool
from rr1plan.multi.preflight import TO_CHOSEN, affordable_margin
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.safe_intervals import BlockedTimes, earliest_schedule
from rr1plan.multi.timing.schedule import Leg, Schedule
from rr1plan.object_cache import kept_in
from rr1plan.planners.goal_configurations import GoalSearch, check_start, joint_goals
from rr1plan.retiming.timed_pieces import Pieces, concatenate
from rr1plan.scene.problem import GoalLike
from rr1plan.trajectory import Trajectory

# Numbers of tried detours from each stop, and goal configurations; rounds of further solutions of inverse kinematics if
# all touch others at their goals.
_DETOURS, _GOALS, _MORE_GOALS = 4, 3, 6
# A motion is good enough if it takes at most this times as long as the fastest one alone.
_GOOD_ENOUGH = 1.5


@dataclass(frozen=True)
class NewMotion:
    """A motion of an arm to a goal.

    Args:
        parts: Its parts, from before the change on.
        trajectory: Its trajectory from the change on.
        arrival: When it reaches the goal [s].
        stage: "wait" on the straight path, or "detour".
    """

    parts: tuple[Part, ...]
    trajectory: Trajectory
    arrival: float
    stage: str = ""


@dataclass
class Attempt:
    """What is found out while a motion of one arm is searched for.

    Args:
        goals: Configurations of its goal; empty if the goal is impossible.
        chosen: Whether other configurations may reach the goal, too.
        paths: The paths found, with the stop at which each begins.
        alone: Duration of the fastest motion from that stop [s].
        reason: Why no motion is possible, as text; empty if unknown.
        blockers: Arms that are in the way.
    """

    goals: list[Array] = field(default_factory=list)
    chosen: bool = False
    paths: list[tuple[Stop, AgentPath]] = field(default_factory=list)
    alone: float = math.inf
    reason: str = ""
    blockers: set[str] = field(default_factory=set)


class SingleArmMotions:
    """Searches for motions of single arms among the present motions of all others.

    Args:
        present: The present motions.
        rng: Source of random numbers.
        watch: Deadline.

    Attributes:
        watch: Like the argument; may be replaced.
    """

    def __init__(self, present: PresentMotions, rng: np.random.Generator, watch: Stopwatch) -> None:
        self.watch = watch
        self._present, self._plan, self._rng = present, present.plan, rng
        # Paths remain valid when others change their motions.
        self._pools: dict[tuple[str, bytes, bytes], PathPool] = {}

    def has_time(self, until: float = math.inf) -> bool:
        """Whether time is left before the deadline, and before a time of the stopwatch [s]."""
        return self.watch.goes_on() and self.watch.seconds < until

    def first(self, arm: str, goal: GoalLike) -> NewMotion | None:
        """The first motion of an arm to a goal that is found, or None."""
        return next(self.motions(arm, goal, Attempt()), None)

    def motions(self, arm: str, goal: GoalLike, attempt: Attempt, share: float = 1.0) -> Iterator[NewMotion]:
        """Motions of an arm to a goal, the best one from each stop from which there is one.

        Args:
            arm: The arm.
            goal: Its goal.
            attempt: Collects what is found out.
            share: Share of the remaining time that may be used.
        """
        stops = stops_of(self._plan, arm, self._present.now)
        attempt.goals = self._goals(self._present.agent(arm, stops[0].q, goal), attempt)
        until = self.watch.seconds + share * self.watch.left
        for stop in stops if attempt.goals else ():
            if self._is_safe_until(stop, arm, attempt):
                best = self.best_motion(arm, stop, attempt, until)
                if best is not None:
                    yield best
            if not self.has_time(until):
                break

    def best_motion(self, arm: str, stop: Stop, attempt: Attempt, until: float = math.inf) -> NewMotion | None:
        """The motion from a stop that arrives first, on the straight path to a goal or on detours around others.

        Args:
            arm: The arm.
            stop: The stop.
            attempt: The goals; collects what is found out.
            until: When the search ends, on the stopwatch [s].
        """
        pool, best = self._pool(arm, stop, attempt.goals), None
        known = len(pool.paths)
        for number in range(known + 1 + _DETOURS):
            if not self.has_time(until):
                break
            if number < known:
                path = pool.paths[number]
            elif (found := self._new_path(pool, attempt, number - known, stop.time)) is not None:
                path = found
            elif pool.paths:
                continue
            else:
                break
            attempt.paths.append((stop, path))
            if path.segments:
                attempt.alone = min(attempt.alone, path.fastest)
            new = self.timed(stop, path, self._present.others(arm))
            if new is not None and (best is None or new.arrival < best.arrival):
                best = replace(new, stage="wait" if path is pool.paths[0] else "detour")
            if best is not None and best.arrival - stop.time <= _GOOD_ENOUGH * attempt.alone:
                break
        return best

    def timed(self, stop: Stop, path: AgentPath, others: Iterable[str]) -> NewMotion | None:
        """The earliest motion from a stop along a path among those of some others; None if none is found in time."""
        blocked = self._present.blocked_times(path, stop.time, others)
        since = BlockedTimes(blocked.rows, blocked.begin - stop.time, blocked.end - stop.time)
        schedule = earliest_schedule(path, since, self.watch.goes_on)
        if schedule is None:
            return None
        later = Schedule(path, tuple(Leg(leg.departure + stop.time, leg.begin, leg.end) for leg in schedule.legs))
        parts = [stop.before.until(stop.time), part_of(later, stop.time)]
        motion = schedule.trajectory().shifted(stop.time)
        if stop.braking is not None:
            motion = joined(stop.braking, motion)
        return NewMotion(tuple(parts), motion, stop.time + schedule.arrival)

    def _pool(self, arm: str, stop: Stop, goals: list[Array]) -> PathPool:
        """The known paths from a stop to some goals."""

        def empty() -> PathPool:
            agent = self._present.agent(arm, stop.q, goals)
            return PathPool(agent, affordable_margin(agent, goals[0], self._plan.margin), self._rng, self.watch)

        return kept_in(self._pools, (arm, stop.q.tobytes(), np.array(goals).tobytes()), empty)

    def _new_path(self, pool: PathPool, attempt: Attempt, number: int, time: float) -> AgentPath | None:
        """Another path: the straight line if there is none yet, then around others, or a random detour."""
        others: dict[str, Array | None] = {}
        if pool.paths and number in (1, 2):
            # Around their goals, or where they are then.
            ends = [pool.agent.start, *attempt.goals]
            others = self._present.apart_from(pool.agent, ends, math.inf if number == 1 else time)
        try:
            path, reason = pool.add(others, detour=bool(pool.paths) and not others, patient=not pool.paths)
        except RetimingError as error:
            path, reason = None, str(error)
        if not pool.paths:
            only = TO_CHOSEN if pool.impossible and attempt.chosen else ""
            attempt.reason = f"{pool.agent.arms[0]}: {only}{reason}"
        return path

    def _is_safe_until(self, stop: Stop, arm: str, attempt: Attempt) -> bool:
        """Whether a braking arm stays clear of others that relied on its original motion; False if time runs out."""
        if stop.braking is None:
            return True
        occupied, now = stop.before.occupancy, self._present.now
        for other in self._present.others(arm):
            blocked = self._present.blocked_times(stop.before.path, now, [other])
            if not self.has_time():
                return False
            for row, enter, leave in zip(*occupied, strict=True):
                begins, ends = blocked.of(int(row))
                if leave > now and ((begins < leave) & (ends > max(enter, now))).any():
                    attempt.blockers.add(other)
                    return False
        return True

    def _goals(self, agent: Agent, attempt: Attempt) -> list[Array]:
        """Configurations of an arm's goal without contact with the others at their goals, nearest first."""
        query = agent.query({}, 0.0)
        (arm,) = agent.arms
        with checker_from_pool(query.scene, query.arms) as checker:
            blocked = check_start(query, checker)
            if blocked:
                attempt.reason = f"{arm}: {blocked}"
                return []
            search = GoalSearch(query, checker, self._rng)
            found = search.find()
            if found.status is not None:
                attempt.reason = f"{arm}: {found.reason}"
                return []
            free, in_the_way = self._clear(agent, found.configurations)
            for _ in range(_MORE_GOALS):
                if free or not self.has_time():
                    break
                free, _ = self._clear(agent, search.more())
        if not free:
            attempt.reason = f"the goal of {arm} is not clear of the final configurations of others"
            attempt.blockers |= in_the_way
        tried, given = free[:_GOALS], joint_goals(query)
        attempt.chosen = given is None or not all(any(np.array_equal(q, goal) for goal in tried) for q in given)
        return tried

    def _clear(self, agent: Agent, configurations: Array) -> tuple[list[Array], set[str]]:
        """Those of some configurations (k, nq) without contact with the others at their goals, nearest first.

        Returns:
            The configurations, shape (nq,) each, and the arms that the remaining ones touch.
        """
        free, in_the_way = [], set[str]()
        for q in sorted(configurations, key=lambda q: float(np.abs(q - agent.start).max())):
            touched = self._present.touched_at_end(agent, q)
            in_the_way |= touched
            if not touched:
                free.append(np.asarray(q))
        return free, in_the_way


def joined(one: Trajectory, two: Trajectory) -> Trajectory:
    """Two motions joined; the second begins at the configuration and time at which the first ends."""
    if one.duration == 0.0:
        return two
    if two.duration == 0.0:
        return one
    pieces = concatenate([Pieces(np.diff(motion.breaks), motion.coefficients) for motion in (one, two)])
    return Trajectory(one.joint_names, np.concatenate([one.breaks, two.breaks[1:]]), pieces.coefficients)
