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
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from rr1plan.checks import Array, Seed, Value, as_generator, finite_number, known_name, of_kind
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.errors import InputError, RetimingError
from rr1plan.multi.execution.present_motions import PresentMotions
from rr1plan.multi.execution.running_plan import LATEST, Part, RunningPlan, Stop, part_of, stops_of
from rr1plan.multi.execution.single_arm_motions import Attempt, NewMotion, SingleArmMotions, joined
from rr1plan.multi.many_arms_result import ManyArmsResult
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.portfolio import plan_many_arms
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.schedule import Schedule
from rr1plan.path import Path
from rr1plan.planning import Budget
from rr1plan.report import Report
from rr1plan.scene.problem import GoalLike, Problem
from rr1plan.trajectory import Trajectory, of_joints
from rr1plan.validation import validate

# Numbers of tried evasive motions of each arm, and of random configurations to find a free one.
_STEPS_ASIDE, _SAMPLES = 12, 20
_FREEZE, _SHORTEST = 0.3, 0.1  # defaults [s]
_SAME = 1e-9  # largest difference of equal configurations, such as solutions of inverse kinematics [rad or m]
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
        verb = "yields" if len(self.blocked_by) == 1 else "yield"
        yielding = f", {', '.join(self.blocked_by)} {verb}" if self.blocked_by else ""
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
        plan: The running plan: a result of `plan_many_arms`, or `AddedMotion.plan`. The first call with a result
            converts it, which `RunningPlan.of(result)` does in advance.
        arm: The arm; it may still be moving.
        goal: Its new goal, which replaces the previous one: a goal, a configuration (nq,) or its name, or a list of
            alternatives.
        at: The time of the plan at which the goal is given [s].
        freeze: Time after `at` during which nothing changes [s].
        budget: Time budget (default: `freeze`, but at least 0.1 s); a part of it is reserved for the referee. Only its
            seconds are used, unless they are infinite: then its iterations limit the searches as in `plan_many_arms`,
            and how often others step aside.
        rng: Seed; unless time runs out, the same seed gives the same motion.

    Returns:
        The new plan, unchanged before `at + freeze` and certified by the referee from then on, or the reason why there
        is none.

    Raises:
        InputError: no plan, a time before its beginning, a goal that does not fit the arm.
        UnknownNameError: the plan does not move this arm.
    """
    of_kind("budget", budget, Budget, optional=True)
    at, freeze = finite_number("at", at), finite_number("freeze", freeze)
    budget = budget or Budget(max(freeze, _SHORTEST))
    watch = Stopwatch(budget.seconds, iterations=budget.iterations)
    if not isinstance(plan, RunningPlan):
        of_kind("plan", plan, ManyArmsResult)
        plan = RunningPlan.of(plan)
    known_name("arm", arm, plan.arms)
    if at + freeze > LATEST:
        raise InputError(f"at is {at} and freeze is {freeze}, expected times up to {LATEST:g} s")
    begin = plan.trajectory.start_time
    if at < begin or freeze < 0.0:
        raise InputError(
            f"at is {at} and freeze is {freeze}, expected a time of the plan from {begin:.3f} s on and a time >= 0"
        )
    watch = watch.with_deadline(watch.left - _reserve(plan, at + freeze, watch.left))
    with watch:
        return _Change(plan, arm, goal, at + freeze, as_generator(rng), watch).run()


def _reserve(plan: RunningPlan, now: float, seconds: float) -> float:
    """The part of a budget that is reserved for the referee and for kernel calls [s]."""
    reserve = min(_RESERVE * seconds, _MOST_RESERVE)
    if plan.torque_limits:
        reserve += _TORQUES * len(plan.arms) * max(0.0, plan.trajectory.end_time - now)
    return min(reserve, _MOST_RESERVED * seconds)


class _Change:
    """One change of a running plan: a new goal of an arm.

    Args:
        plan: The plan.
        arm: The arm.
        goal: Its new goal.
        now: Start of the change [s].
        rng: Source of random numbers.
        watch: Deadline.
    """

    def __init__(
        self, plan: RunningPlan, arm: str, goal: GoalLike, now: float, rng: np.random.Generator, watch: Stopwatch
    ) -> None:
        self.plan, self.arm, self.goal, self.now, self._rng, self._watch = plan, arm, goal, now, rng, watch
        self._present = PresentMotions(plan, now, watch.stop)
        self._search = SingleArmMotions(self._present, rng, watch)
        self._attempt = Attempt()

    def run(self) -> AddedMotion:
        """Wait, go around, or make others yield, in this order."""
        for changed, stage in self._proposals():
            result = self._result(changed, stage)
            if result is not None:
                return result
        attempt, late = self._attempt, "" if self._search.has_time() else f" in {self._watch.seconds:.2g} s"
        tried = f"no motion of {self.arm} among the others was found{late}"
        reason = attempt.reason or (tried if attempt.paths or attempt.blockers else self._too_late())
        blockers = tuple(sorted(attempt.blockers))
        if blockers:
            reason += f"; in its way: {', '.join(blockers)}"
        return AddedMotion(self.plan, reason=reason, blocked_by=blockers, seconds=self._watch.seconds)

    def _too_late(self) -> str:
        """The reason if no path of the arm was found, so that no arm is known to be in its way."""
        return f"no time was left for a path of {self.arm}, after {self._watch.seconds:.2g} s (option budget)"

    def _proposals(self) -> Iterator[tuple[dict[str, NewMotion], str]]:
        """Motions of the arm and of others that yield, with their stage, each only if those before fail."""
        attempt, search = self._attempt, self._search
        for new in search.motions(self.arm, self.goal, attempt, _SHARE):
            yield {self.arm: new}, new.stage
        if not attempt.goals:
            return
        kept = self._present_motion()
        if kept is not None:
            yield {self.arm: kept}, "wait"
        search.watch = self._watch.with_deadline(_SHARE_OF_YIELDING * self._watch.left)
        yielded = self._by_yielding()
        search.watch = self._watch
        if yielded is not None:
            yield yielded, "yield"
        yielded = self._after_all() if search.has_time() else None
        if yielded is not None:
            yield yielded, "yield" if len(yielded) > 1 else "wait"

    def _present_motion(self) -> NewMotion | None:
        """The motion that the arm has already, if it ends at one of its goals."""
        if not any(np.abs(q - self.plan.goal(self.arm)).max() <= _SAME for q in self._attempt.goals):
            return None
        old, parts = self.plan.trajectory, self._present.parts[self.arm]
        arrival = max([self.now, *(float(part.route.steps.times[-1]) for part in parts if part.route.segments)])
        return NewMotion(parts, old.cut(self.now, max(self.now, old.end_time)).select(self.arm), arrival)

    # ---- others yield --------------------------------------------------------------------------

    def _by_yielding(self) -> dict[str, NewMotion] | None:
        """Motions of the arm and of others that are retimed after it, or step aside for it and continue afterwards."""
        present, in_the_way = self._present, dict[str, None]()
        for stop, path in self._attempt.paths:
            others = present.others(self.arm)
            met = [other for other in others if len(present.blocked_times(path, stop.time, [other]).rows)]
            if not self._watch.goes_on():  # a diagram that was not completed blocks everything
                break
            in_the_way.update(dict.fromkeys(met))
            moving = [other for other in met if present.is_moving(other)]
            for victims in ([o] for o in moving) if len(moving) == 1 else [*([o] for o in moving), moving]:
                if not victims or not self._search.has_time():
                    continue
                new = self._search.timed(stop, path, [other for other in others if other not in victims])
                changed = None if new is None else self._after(new, victims)
                if changed is not None:
                    return changed
        self._attempt.blockers.update(in_the_way)
        for _ in range(int(min(_STEPS_ASIDE, self._watch.rounds))):
            for victim in in_the_way:
                if not self._search.has_time():
                    return None
                changed = self._stepping_aside(victim)
                if changed is not None:
                    return changed
        return None

    def _after(self, new: NewMotion, victims: list[str]) -> dict[str, NewMotion] | None:
        """Motions of others to their goals after a new one, one by one; None if one has none."""
        with self._present.restored():
            changed = {self.arm: new}
            self._present.replace(self.arm, new.parts)
            for victim in victims:
                del self._present.parts[victim]
            for victim in victims:
                found = self._search.first(victim, self.plan.goal(victim))
                if found is None:
                    return None
                changed[victim] = found
                self._present.replace(victim, found.parts)
            return changed

    def _stepping_aside(self, victim: str) -> dict[str, NewMotion] | None:
        """Another arm steps aside, the arm goes to its goal, and the other one to its own."""
        arm, present, search = self.arm, self._present, self._search
        with present.restored():
            stop = stops_of(self.plan, arm, self.now)[0]
            present.parts[arm] = (stop.before.until(stop.time), self._rest_at(stop))
            aside = self._random_configuration(victim)
            away = None if aside is None else search.first(victim, aside)
            if away is None:
                return None
            present.replace(victim, away.parts)
            new = search.first(arm, self.goal)
            if new is None:
                return None
            present.replace(arm, new.parts)
            there = Stop(away.arrival, away.parts[-1].path.goal, away.parts[-1].until(away.arrival), None)
            back = search.best_motion(victim, there, Attempt([self.plan.goal(victim)]))
            if back is None:
                return None
            whole = joined(away.trajectory, back.trajectory)
            return {arm: new, victim: NewMotion((*away.parts[:-1], *back.parts), whole, back.arrival)}

    def _after_all(self) -> dict[str, NewMotion] | None:
        """Motions that begin when all arms are at their goals, planned together: others step aside and return."""
        plan, start = self.plan, max(self.now, self.plan.trajectory.end_time)
        ends = {name: plan.goal(name) for name in plan.arms}
        problem = Problem(plan.scene, ends, {**ends, self.arm: self.goal}, arms=plan.arms)
        try:
            result = plan_many_arms(
                problem,
                margin=plan.margin,
                budget=Budget(self._watch.time_left, self._watch.iterations),
                retiming=plan.retiming,
                torque_limits=plan.torque_limits,
                rng=self._rng,
            )
        except RetimingError as error:
            self._attempt.reason = str(error)
            return None
        if result.trajectory is None:
            return None
        changed = {}
        for name, (part,) in RunningPlan.of(result).parts.items():
            if part.route.segments == 0:
                continue
            before = [old for old in plan.parts[name] if old.end > self.now]
            later = part.shifted(start)
            motion = plan.trajectory.cut(self.now, start).select(name)
            motion = joined(motion, result.trajectory.select(name).shifted(start))
            changed[name] = NewMotion(
                (*before[:-1], before[-1].until(start), later), motion, float(later.route.steps.times[-1])
            )
        return changed if self.arm in changed else None

    def _rest_at(self, stop: Stop) -> Part:
        """The arm remains at a stop."""
        agent = self._present.agent(self.arm, stop.q, stop.q)
        query = agent.query({}, 0.0)
        with checker_from_pool(query.scene, query.arms) as checker:
            path = AgentPath(agent, Path(agent.joint_names, np.array([stop.q, stop.q])), checker)
        return part_of(Schedule(path, ()), stop.time)

    def _random_configuration(self, arm: str) -> Array | None:
        """A random free configuration of an arm, more often one near its current configuration."""
        q = self.plan.configuration(arm, self.now)
        agent = self._present.agent(arm, q, q)
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

    def _result(self, changed: Mapping[str, NewMotion], stage: str) -> AddedMotion | None:
        """The new plan, if the referee certifies it; otherwise None."""
        plan = self.plan
        start = plan.trajectory.start_time
        trajectory = joined(plan.trajectory.cut(start, self.now), self._rest(changed))
        report = _report(trajectory.cut(max(start, self.now - _LEAD), trajectory.end_time), plan)
        yielding = tuple(sorted(set(changed) - {self.arm}))
        if not report.certified:
            said = "; ".join(map(str, report.violations[:2])) or "it cannot be decided"
            self._attempt.reason = f"the referee does not certify the motion that was found: {said}"
            self._attempt.blockers.update(yielding)
            return None
        over = {name: (part for part in plan.parts[name] if part.end <= self.now) for name in changed}
        parts = {name: (*over[name], *new.parts) for name, new in changed.items()}
        made = plan.with_parts(parts, trajectory, self.now)
        return AddedMotion(made, stage, "", yielding, changed[self.arm].arrival, report, self._watch.seconds)

    def _rest(self, changed: Mapping[str, NewMotion]) -> Trajectory:
        """The motion of all arms from the change on."""
        old, names = self.plan.trajectory, self.plan.trajectory.joint_names
        parts = [new.trajectory for new in changed.values()]
        staying = tuple(name for name in names if name.split("/", 1)[0] not in changed)
        end = max([new.arrival for new in changed.values()] + [self.now])
        if staying:
            parts.append(of_joints(old.cut(self.now, max(self.now, old.end_time)), staying))
        merged = Trajectory.merge(*parts)
        return of_joints(merged.cut(self.now, max(end, merged.end_time)), names)


def _report(motion: Trajectory, plan: RunningPlan) -> Report:
    """The referee's report, with the limits of a plan, on a motion that may begin with nonzero velocity."""
    jerk = plan.retiming == "ruckig"
    report = validate(motion, plan.scene, torque_limits=plan.torque_limits, jerk_limits=jerk)
    kept = tuple(v for v in report.violations if v.kind != "rest" or v.time != motion.start_time)
    return replace(report, violations=kept)
