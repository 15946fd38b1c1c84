"""New goals for single arms while the others move: wait for them, go around them, or make them yield.

    added = add_motion(plan, "arm02", rp.PoseGoal("tool", point), at=now)
    if added:
        plan = added.plan

Nothing changes before `at + freeze`, because that part of the plan is already on its way to the drives. An arm that
moves at that time brakes on its path to the first gridpoint from which its new motion is possible; new paths are timed
around the remaining motions of all others (`safe_intervals.py`). If that fails, the arms in the way are retimed after
it, to their current goals. If that fails, too, the motion begins when all others have arrived, and all arms are planned
together.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np

from rr1plan.checks import Array, Seed, Value, as_generator, finite_number, known_name, of_kind
from rr1plan.collision.arm_groups import arms_in_reach
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.errors import InputError
from rr1plan.kernels.planner_kernels import CStruct
from rr1plan.multi.agents import Agent
from rr1plan.multi.execution.running_plan import Part, RunningPlan, Stop, part_of, stops_of
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.paths.hop_timing import HopTiming
from rr1plan.multi.paths.path_pool import PathPool
from rr1plan.multi.paths.placed_path import placed_configuration
from rr1plan.multi.portfolio import ManyArmsResult, plan_many_arms
from rr1plan.multi.preflight import MARGINS, affordable_margin
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.coordination import Blocked, are_apart, may_touch
from rr1plan.multi.timing.passing_order import closed_diagram
from rr1plan.multi.timing.safe_intervals import BlockedTimes, blocked_times, earliest_schedule
from rr1plan.multi.timing.schedule import Leg, Schedule
from rr1plan.object_cache import kept_in
from rr1plan.path import Path
from rr1plan.planners.goal_configurations import GoalSearch, check_start
from rr1plan.planning import Budget
from rr1plan.report import Report
from rr1plan.scene.problem import GoalLike, Problem
from rr1plan.trajectory import Trajectory
from rr1plan.validation import validate

# Numbers of tried detours from each stop, evasive motions, and goal configurations.
_DETOURS, _STEPS_ASIDE, _GOALS = 4, 12, 3
_SAMPLES = 20  # random configurations tried to find a free one
# A motion is good enough if it takes at most this times as long as the fastest one alone.
_GOOD_ENOUGH = 1.5
_FREEZE, _SHORTEST = 0.3, 0.1  # defaults [s]
_SAME = 1e-9  # largest difference of equal configurations, such as solutions of inverse kinematics [rad or m]
_LATEST = 1e7  # later times are rounded to more than a nanosecond [s]
# Share of the budget reserved for the referee and for kernel calls, and its upper bound [s].
_RESERVE, _MOST_RESERVE = 0.2, 0.1
# Additional reserve for the torques that the referee computes, for each second of an arm's motion [s], and the largest
# share of the budget that is reserved in all.
_TORQUES, _MOST_RESERVED = 0.01, 0.5
# Share of the budget for a motion that changes no other arm, and share of the rest for one to which single arms yield.
_SHARE, _SHARE_OF_YIELDING = 0.3, 0.6
# The referee begins this long before the change, so that it checks the transition between the motions [s].
_LEAD = 0.01


@dataclass(frozen=True, eq=False)
class AddedMotion(Value):
    """The outcome of `add_motion`.

    Args:
        plan: The new plan; the old one if none was found.
        stage: "wait", "detour" or "yield"; empty if nothing was found.
        reason: Why nothing was found, in words; empty if something was.
        blocked_by: Arms that are in the way; those that yield, if something was found.
        arrival: Time at which the arm reaches its new goal [s]; nan if nothing was found.
        report: The referee's report on the motion from the change on; None if nothing was found.
        seconds: Wall time [s].
    """

    plan: RunningPlan
    stage: str = ""
    reason: str = ""
    blocked_by: tuple[str, ...] = ()
    arrival: float = math.nan
    report: Report | None = None
    seconds: float = 0.0

    @property
    def found(self) -> bool:
        """Whether there is a new plan, certified by the referee."""
        return not self.reason

    def __bool__(self) -> bool:
        """The same as `found`."""
        return self.found

    def __repr__(self) -> str:
        if not self.found:
            return f"AddedMotion({self.reason})"
        yielding = f", {', '.join(self.blocked_by)} yield" if self.blocked_by else ""
        return f"AddedMotion(by {self.stage}{yielding}, there after {self.arrival:.3f} s)"


def add_motion(
    plan: RunningPlan | ManyArmsResult,
    arm: str,
    goal: GoalLike,
    *,
    at: float,
    freeze: float = _FREEZE,
    budget: Budget | None = None,
    rng: Seed = None,
) -> AddedMotion:
    """Give an arm a new goal while the others move.

    New motions keep the plan's retiming and torque limits, and `RunningPlan.margin` as far as starts and goals allow.
    If the plan limits jerk or torques, a moving arm does not brake on its path but moves on to its next planned stop.

    Args:
        plan: The running plan: a result of `plan_many_arms` or of `add_motion`.
        arm: The arm; it may still be moving.
        goal: Its new goal, which replaces the previous one: a goal, a configuration (nq,) or its name, or a list of
            alternatives.
        at: The time of the plan at which the goal is given [s].
        freeze: Time after `at` during which nothing changes [s].
        budget: Time budget (default: `freeze`, but at least 0.1 s); a part of it is reserved for the referee. Only its
            seconds are used.
        rng: Seed; unless time runs out, the same seed gives the same motion.

    Returns:
        The new plan, unchanged before `at + freeze` and certified by the referee from then on, or the reason why there
        is none.

    Raises:
        InputError: no plan, a time before its beginning, a goal that does not fit the arm.
        UnknownNameError: the plan does not move this arm.
    """
    if not isinstance(plan, RunningPlan):
        of_kind("plan", plan, ManyArmsResult)
        plan = RunningPlan.of(plan)
    of_kind("budget", budget, Budget, optional=True)
    known_name("arm", arm, plan.arms)
    at, freeze = finite_number("at", at), finite_number("freeze", freeze)
    if at + freeze > _LATEST:
        raise InputError(f"at is {at} and freeze is {freeze}, expected times up to {_LATEST:g} s")
    if at < plan.trajectory.start_time or freeze < 0.0:
        raise InputError(f"at is {at} and freeze is {freeze}, expected a time of the plan and a time >= 0")
    seconds = max(freeze, _SHORTEST) if budget is None else budget.seconds
    watch = Stopwatch(seconds - _reserve(plan, at + freeze, seconds))
    return _Change(plan, at + freeze, as_generator(rng), watch).run(arm, goal)


def _reserve(plan: RunningPlan, now: float, seconds: float) -> float:
    """The part of a budget that is reserved for the referee and for kernel calls [s]."""
    reserve = min(_RESERVE * seconds, _MOST_RESERVE)
    if plan.torque_limits:
        reserve += _TORQUES * len(plan.arms) * max(0.0, plan.trajectory.end_time - now)
    return min(reserve, _MOST_RESERVED * seconds)


@dataclass(frozen=True)
class _NewMotion:
    """A motion to a goal: an arm's parts from before the change on, and its trajectory from the change on."""

    parts: tuple[Part, ...]
    trajectory: Trajectory
    arrival: float
    stage: str = ""


@dataclass
class _Attempt:
    """The attempted motions of one arm.

    Args:
        goals: Configurations of its goal; empty if the goal is impossible.
        paths: The paths found, with the stop at which each begins.
        alone: Duration of the fastest motion from that stop [s].
    """

    goals: list[Array] = field(default_factory=list)
    paths: list[tuple[Stop, AgentPath]] = field(default_factory=list)
    alone: float = math.inf


class _Change:
    """One change of a running plan.

    Args:
        plan: The plan.
        now: Start of the change [s].
        rng: Source of random numbers.
        watch: Deadline.
    """

    def __init__(self, plan: RunningPlan, now: float, rng: np.random.Generator, watch: Stopwatch) -> None:
        self.plan, self.now, self._rng, self._watch = plan, now, rng, watch
        self._near = arms_in_reach(plan.scene, plan.arms, plan.margin)
        self._margins = (plan.margin, *(m for m in MARGINS if m < plan.margin))
        # Motions of the others from now on; those of yielding arms are changed.
        self._parts: dict[str, tuple[Part, ...]] = {
            name: tuple(part for part in parts if part.end > now) for name, parts in plan.parts.items()
        }
        self._diagrams: dict[tuple[AgentPath, AgentPath], Blocked | None] = {}
        self._placements: dict[tuple[tuple[str, ...], bytes], CStruct] = {}
        self._pools: dict[tuple[str, bytes, bytes], PathPool] = {}
        self._reason = ""
        self._blockers: set[str] = set()

    def run(self, arm: str, goal: GoalLike) -> AddedMotion:
        """Wait, go around, or make others yield, in this order."""
        attempt = _Attempt()
        for new in self._motions(arm, goal, attempt, _SHARE):
            result = self._result(arm, {arm: new}, new.stage)
            if result is not None:
                return result
        if attempt.goals and (kept := self._present_motion(arm, attempt.goals)) is not None:
            result = self._result(arm, {arm: kept}, "wait")
            if result is not None:
                return result
        if attempt.goals:
            watch = self._watch
            self._watch = watch.with_deadline(_SHARE_OF_YIELDING * watch.left)
            yielded = self._by_yielding(arm, goal, attempt)
            self._watch = watch
            result = None if yielded is None else self._result(arm, yielded, "yield")
            if result is None and self._has_time():
                yielded = self._after_all(arm, goal)
                if yielded is not None:
                    result = self._result(arm, yielded, "yield" if len(yielded) > 1 else "wait")
            if result is not None:
                return result
        late = "" if self._has_time() else f" in {self._watch.seconds:.2g} s"
        reason = self._reason or f"no motion of {arm} among the others was found{late}"
        if self._blockers:
            reason += f"; in its way: {', '.join(sorted(self._blockers))}"
        return AddedMotion(
            self.plan, reason=reason, blocked_by=tuple(sorted(self._blockers)), seconds=self._watch.seconds
        )

    # ---- one arm ---------------------------------------------------------------------------

    def _by_itself(self, arm: str, goal: GoalLike) -> _NewMotion | None:
        """A motion among those of the others, or None."""
        return next(self._motions(arm, goal, _Attempt()), None)

    def _motions(self, arm: str, goal: GoalLike, attempt: _Attempt, share: float = 1.0) -> Iterator[_NewMotion]:
        """Motions among those of the others, the best one from each stop from which there is one.

        Args:
            arm: The arm.
            goal: Its goal.
            attempt: Collects the goals and paths that are found.
            share: Share of the remaining time that may be used.
        """
        stops = stops_of(self.plan, arm, self.now)
        attempt.goals = self._goals(self._agent(arm, stops[0].q, goal))
        until = self._watch.seconds + share * self._watch.left
        for stop in stops if attempt.goals else ():
            if self._is_safe_until(stop, arm):
                best = self._best_motion(arm, stop, attempt, until)
                if best is not None:
                    yield best
            if not self._has_time(until):
                break

    def _present_motion(self, arm: str, goals: list[Array]) -> _NewMotion | None:
        """The motion that an arm has already, if it ends at one of some goals."""
        if not any(np.abs(q - self.plan.goal(arm)).max() <= _SAME for q in goals):
            return None
        old, parts = self.plan.trajectory, self._parts[arm]
        arrival = max(self.now, *(float(part.route.steps.times[-1]) for part in parts if part.route.segments))
        motion = old.select(arm).cut(self.now, max(self.now, old.end_time))
        return _NewMotion(parts, motion, arrival)

    def _has_time(self, until: float = math.inf) -> bool:
        return self._watch.goes_on() and self._watch.seconds < until

    def _best_motion(self, arm: str, stop: Stop, attempt: _Attempt, until: float) -> _NewMotion | None:
        """The motion from a stop that arrives first, on the straight path to a goal or on detours around others."""
        pool, best = self._pool(arm, stop, attempt.goals), None
        known = len(pool.paths)
        for number in range(known + 1 + _DETOURS):
            if not self._has_time(until):
                break
            if number < known:
                path = pool.paths[number]
            elif (found := self._new_path(arm, pool, attempt.goals, number - known, stop.time)) is not None:
                path = found
            elif pool.paths:
                continue
            else:
                break
            attempt.paths.append((stop, path))
            if path.segments:
                attempt.alone = min(attempt.alone, path.fastest)
            new = self._timed(stop, path, self._others(arm))
            if new is not None and (best is None or new.arrival < best.arrival):
                best = replace(new, stage="wait" if path is pool.paths[0] else "detour")
            if best is not None and best.arrival - stop.time <= _GOOD_ENOUGH * attempt.alone:
                break
        return best

    def _pool(self, arm: str, stop: Stop, goals: list[Array]) -> PathPool:
        """The known paths from a stop to some goals; they remain valid when others change their motions."""

        def empty() -> PathPool:
            agent = self._agent(arm, stop.q, goals)
            return PathPool(agent, affordable_margin(agent, goals[0], self.plan.margin), self._rng, self._watch)

        return kept_in(self._pools, (arm, stop.q.tobytes(), np.array(goals).tobytes()), empty)

    def _new_path(self, arm: str, pool: PathPool, goals: list[Array], number: int, time: float) -> AgentPath | None:
        """Another path: the straight line if there is none yet, then around others, or a random detour."""
        others = self._stationary_arms(pool.agent, goals, number, time) if pool.paths else {}
        path, reason = pool.add(others, detour=bool(pool.paths) and not others, patient=not pool.paths)
        if not pool.paths:
            self._reason = f"{arm}: {reason}"
        return path

    def _timed(self, stop: Stop, path: AgentPath, others: Iterable[str]) -> _NewMotion | None:
        """The earliest motion from a stop along a path, given the motions of some others."""
        blocked = self._blocked_times(path, stop.time, others)
        since = BlockedTimes(blocked.rows, blocked.begin - stop.time, blocked.end - stop.time)
        schedule = earliest_schedule(path, since)
        if schedule is None:
            return None
        later = Schedule(path, tuple(Leg(leg.departure + stop.time, leg.begin, leg.end) for leg in schedule.legs))
        parts = [stop.before.until(stop.time), part_of(later, stop.time)]
        motion = schedule.trajectory().shifted(stop.time)
        if stop.braking is not None:
            motion = _joined(stop.braking, motion)
        return _NewMotion(tuple(parts), motion, stop.time + schedule.arrival)

    def _is_safe_until(self, stop: Stop, arm: str) -> bool:
        """Whether a braking arm stays clear of others that relied on its original motion."""
        if stop.braking is None:
            return True
        occupied = stop.before.occupancy
        for other in self._others(arm):
            blocked = self._blocked_times(stop.before.path, self.now, [other])
            for row, enter, leave in zip(*occupied, strict=True):
                begins, ends = blocked.of(int(row))
                if leave > self.now and ((begins < leave) & (ends > max(enter, self.now))).any():
                    self._blockers.add(other)
                    return False
        return True

    def _agent(self, arm: str, q: Array, goal: GoalLike) -> Agent:
        """An arm that moves from a configuration to a goal, without the others of the plan."""
        starts = {name: self.plan.configuration(name, self.now) for name in self.plan.arms}
        problem = Problem(self.plan.scene, {**starts, arm: q}, {arm: goal}, arms=self.plan.arms)
        return Agent(problem, [arm], HopTiming(self.plan.retiming, self.plan.torque_limits))

    def _goals(self, agent: Agent) -> list[Array]:
        """Configurations of an arm's goal without contact with the others at their goals, nearest first."""
        query = agent.query({}, 0.0)
        (arm,) = agent.arms
        with checker_from_pool(query.scene, query.arms) as checker:
            blocked = check_start(query, checker)
            if blocked:
                self._reason = f"{arm}: {blocked}"
                return []
            found = GoalSearch(query, checker, self._rng).find()
        if found.status is not None:
            self._reason = f"{arm}: {found.reason}"
            return []
        free, in_the_way = [], set()
        for q in sorted(found.configurations, key=lambda q: float(np.abs(q - agent.start).max())):
            placed = self._placed(agent, q)
            touching = {other for other in self._others(arm) if not self._is_apart(agent, placed, other)}
            in_the_way |= touching
            if not touching:
                free.append(np.asarray(q))
        if not free:
            self._reason = f"the goal of {arm} is not clear of the final configurations of others"
            self._blockers |= in_the_way
        return free[:_GOALS]

    def _is_apart(self, agent: Agent, placed: CStruct, other: str) -> bool:
        theirs = self._parts[other][-1].path
        return are_apart(agent, placed, theirs.agent, self._placed(theirs.agent, theirs.goal))

    def _placed(self, agent: Agent, q: Array) -> CStruct:
        """The bodies of an arm in a configuration, cached."""
        return kept_in(self._placements, (agent.arms, q.tobytes()), lambda: placed_configuration(agent.bodies, q))

    def _stationary_arms(self, agent: Agent, goals: list[Array], number: int, time: float) -> dict[str, Array | None]:
        """Configurations of others that a path should avoid, by `number`: none, their goals, current ones, or none."""
        stationary: dict[str, Array | None] = {}
        if number not in (1, 2):
            return stationary
        for other in self._others(agent.arms[0]):
            theirs = self._parts[other][-1].path
            where = theirs.goal if number == 1 else self.plan.configuration(other, time)
            there = self._placed(theirs.agent, where)
            ends = (self._placed(agent, end) for end in (agent.start, *goals))
            if all(are_apart(agent, end, theirs.agent, there, self.plan.margin) for end in ends):
                stationary[other] = where
        return stationary

    # ---- among the others --------------------------------------------------------------------

    def _others(self, arm: str) -> list[str]:
        return [other for other in self.plan.arms if other in self._near[arm] and other in self._parts]

    def _blocked_times(self, path: AgentPath, time: float, others: Iterable[str]) -> BlockedTimes:
        """Times at which parts of a path are blocked for an arm by others."""
        found = []
        for other in others:
            for part in self._parts[other]:
                if part.end <= time:
                    continue
                blocked = self._diagram(path, part, time)
                if blocked is not None:
                    found.append((blocked, part.occupancy))
        return blocked_times(path, found)

    def _diagram(self, path: AgentPath, part: Part, time: float) -> Blocked | None:
        """The diagram with the largest margin that the arm and the other one have at rest."""
        key = (path, part.path)
        if key not in self._diagrams and not may_touch(path, part.path, self.plan.margin):
            self._diagrams[key] = None
        if key not in self._diagrams:
            one, two = path.agent, part.path.agent
            now = self.plan.configuration(two.arms[0], time)
            pairs = [(path.start, now), (path.goal, part.path.goal)] if math.isinf(part.end) else [(path.start, now)]
            placed = [(self._placed(one, a), self._placed(two, b)) for a, b in pairs]
            margin = next((m for m in self._margins if all(are_apart(one, a, two, b, m) for a, b in placed)), 0.0)
            self._diagrams[key] = closed_diagram(path, part.path, margin)
        return self._diagrams[key]

    # ---- others yield --------------------------------------------------------------------------

    def _by_yielding(self, arm: str, goal: GoalLike, attempt: _Attempt) -> dict[str, _NewMotion] | None:
        """Motions of the arm and of others that are retimed after it, or step aside for it and continue afterwards."""
        in_the_way: dict[str, None] = {}
        for stop, path in attempt.paths:
            met = [o for o in self._others(arm) if len(self._blocked_times(path, stop.time, [o]).rows)]
            in_the_way.update(dict.fromkeys(met))
            moving = [o for o in met if self._moves(o)]
            for victims in ([o] for o in moving) if len(moving) == 1 else [*([o] for o in moving), moving]:
                if not victims or not self._has_time():
                    continue
                new = self._timed(stop, path, [o for o in self._others(arm) if o not in victims])
                changed = None if new is None else self._after(arm, new, victims)
                if changed is not None:
                    return changed
        self._blockers.update(in_the_way)
        for _ in range(_STEPS_ASIDE):
            for victim in in_the_way:
                if not self._has_time():
                    return None
                changed = self._stepping_aside(arm, goal, victim)
                if changed is not None:
                    return changed
        return None

    def _moves(self, arm: str) -> bool:
        """Whether an arm has not reached its goal when the change begins."""
        return not np.array_equal(self.plan.configuration(arm, self.now), self.plan.goal(arm))

    def _after(self, arm: str, new: _NewMotion, victims: list[str]) -> dict[str, _NewMotion] | None:
        """Motions of others to their goals after a new one, one by one; None if one has none."""
        with self._trying():
            changed = {arm: new}
            self._use(arm, new)
            for victim in victims:
                del self._parts[victim]
            for victim in victims:
                found = self._by_itself(victim, self.plan.goal(victim))
                if found is None:
                    return None
                changed[victim] = found
                self._use(victim, found)
            return changed

    def _stepping_aside(self, arm: str, goal: GoalLike, victim: str) -> dict[str, _NewMotion] | None:
        """Another arm steps aside, the arm goes to its goal, and the other one to its own."""
        with self._trying():
            stop = stops_of(self.plan, arm, self.now)[0]
            self._parts[arm] = (stop.before.until(stop.time), self._rest_at(arm, stop))
            aside = self._random_configuration(victim)
            away = None if aside is None else self._by_itself(victim, aside)
            if away is None:
                return None
            self._use(victim, away)
            new = self._by_itself(arm, goal)
            if new is None:
                return None
            self._use(arm, new)
            there = Stop(away.arrival, away.parts[-1].path.goal, away.parts[-1].until(away.arrival), None)
            back = self._best_motion(victim, there, _Attempt([self.plan.goal(victim)]), math.inf)
            if back is None:
                return None
            whole = _joined(away.trajectory, back.trajectory)
            return {arm: new, victim: _NewMotion((*away.parts[:-1], *back.parts), whole, back.arrival)}

    def _after_all(self, arm: str, goal: GoalLike) -> dict[str, _NewMotion] | None:
        """Motions that begin when all arms are at their goals, planned together: others step aside and return."""
        plan, start = self.plan, max(self.now, self.plan.trajectory.end_time)
        ends = {name: plan.goal(name) for name in plan.arms}
        problem = Problem(plan.scene, ends, {**ends, arm: goal}, arms=plan.arms)
        result = plan_many_arms(
            problem,
            margin=plan.margin,
            budget=Budget(self._watch.time_left),
            retiming=plan.retiming,
            torque_limits=plan.torque_limits,
            rng=self._rng,
        )
        if result.trajectory is None:
            return None
        changed = {}
        for name, (part,) in RunningPlan.of(result).parts.items():
            if part.route.segments == 0:
                continue
            before = [old for old in plan.parts[name] if old.end > self.now]
            later = part.shifted(start)
            motion = plan.trajectory.select(name).cut(self.now, start)
            motion = _joined(motion, result.trajectory.select(name).shifted(start))
            changed[name] = _NewMotion(
                (*before[:-1], before[-1].until(start), later), motion, float(later.route.steps.times[-1])
            )
        return changed if arm in changed else None

    @contextmanager
    def _trying(self) -> Iterator[None]:
        """Restore the motions of others at the end of the block."""
        parts, blockers, reason = dict(self._parts), set(self._blockers), self._reason
        try:
            yield
        finally:
            self._parts, self._blockers, self._reason = parts, blockers, reason

    def _use(self, arm: str, new: _NewMotion) -> None:
        self._parts[arm] = tuple(part for part in new.parts if part.end > self.now)

    def _rest_at(self, arm: str, stop: Stop) -> Part:
        """An arm that remains at a stop."""
        agent = self._agent(arm, stop.q, stop.q)
        query = agent.query({}, 0.0)
        with checker_from_pool(query.scene, query.arms) as checker:
            path = AgentPath(agent, Path(agent.joint_names, np.array([stop.q, stop.q])), checker)
        return part_of(Schedule(path, ()), stop.time)

    def _random_configuration(self, arm: str) -> Array | None:
        """A random free configuration of an arm, more often one near its current configuration."""
        q = self.plan.configuration(arm, self.now)
        agent = self._agent(arm, q, q)
        limits, query = agent.limits, agent.query({}, 0.0)
        low = np.where(np.isfinite(limits.lower), limits.lower, -np.pi)
        high = np.where(np.isfinite(limits.upper), limits.upper, np.pi)
        with checker_from_pool(query.scene, query.arms, self.plan.margin) as checker:
            for _ in range(_SAMPLES):
                other = q + self._rng.random() * (self._rng.uniform(low, high) - q)
                if checker.is_free(other):
                    return np.asarray(other)
        return None

    # ---- the new plan --------------------------------------------------------------------------

    def _result(self, arm: str, changed: Mapping[str, _NewMotion], stage: str) -> AddedMotion | None:
        """The new plan, if the referee certifies it; otherwise None."""
        plan = self.plan
        start = plan.trajectory.start_time
        trajectory = _joined(plan.trajectory.cut(start, self.now), self._rest(changed))
        report = _report(trajectory.cut(max(start, self.now - _LEAD), trajectory.end_time), plan)
        yielding = tuple(sorted(set(changed) - {arm}))
        if not report.certified:
            said = "; ".join(map(str, report.violations[:2])) or "it cannot be decided"
            self._reason = f"the referee does not certify the motion that was found: {said}"
            self._blockers.update(yielding)
            return None
        over = {name: (part for part in plan.parts[name] if part.end <= self.now) for name in changed}
        parts = {name: (*over[name], *new.parts) for name, new in changed.items()}
        made = plan.with_parts(parts, trajectory, self.now)
        return AddedMotion(made, stage, "", yielding, changed[arm].arrival, report, self._watch.seconds)

    def _rest(self, changed: Mapping[str, _NewMotion]) -> Trajectory:
        """The motion of all arms from the change on."""
        old, names = self.plan.trajectory, self.plan.trajectory.joint_names
        parts = [new.trajectory for new in changed.values()]
        staying = [i for i, name in enumerate(names) if name.split("/", 1)[0] not in changed]
        end = max([new.arrival for new in changed.values()] + [self.now])
        if staying:
            later = old.cut(self.now, max(self.now, old.end_time))
            parts.append(Trajectory(tuple(names[i] for i in staying), later.breaks, later.coefficients[:, :, staying]))
        merged = Trajectory.merge(*parts)
        merged = merged.cut(self.now, max(end, merged.end_time))
        columns = [merged.joint_names.index(name) for name in names]
        return Trajectory(names, merged.breaks, merged.coefficients[:, :, columns])


def _report(motion: Trajectory, plan: RunningPlan) -> Report:
    """The referee's report, with the limits of a plan, on a motion that may begin with nonzero velocity."""
    jerk = plan.retiming == "ruckig"
    report = validate(motion, plan.scene, torque_limits=plan.torque_limits, jerk_limits=jerk)
    kept = tuple(v for v in report.violations if v.kind != "rest" or v.time != motion.start_time)
    return replace(report, violations=kept)


def _joined(one: Trajectory, two: Trajectory) -> Trajectory:
    """Two motions joined; the second begins at the configuration and time at which the first ends."""
    if one.duration == 0.0:
        return two
    if two.duration == 0.0:
        return one
    terms = max(one.coefficients.shape[1], two.coefficients.shape[1])
    c = [np.pad(t.coefficients, ((0, 0), (0, terms - t.coefficients.shape[1]), (0, 0))) for t in (one, two)]
    breaks = np.concatenate([one.breaks, two.breaks[1:]])
    return Trajectory(one.joint_names, breaks, np.concatenate(c))
