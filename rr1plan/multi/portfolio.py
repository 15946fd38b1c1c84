"""Motions of many arms on one clock: preflight, interaction groups, schedules, one certified trajectory.

    result = plan_many_arms(problem)

Each arm is first planned alone. Arms whose paths cannot collide keep their paths; the others form groups by their swept
volumes, and groups are merged if a later path of one may collide with another. Each group goes through the same stages
until one solves it, under one deadline: for up to four arms, their joint space; for up to sixteen, time windows in
which conflicting arms are coupled, and moves of one arm at a time; then timing on the fixed paths of each arm alone,
detours and eviction. Groups are planned in parallel threads; the random numbers of a group depend on its arms only, so
threads do not change the result.

A goal configuration of each arm is chosen before the search. If a group has no schedule after a few rounds, its arms
with several goals, or several solutions of inverse kinematics, get other ones. Conflict-based search chooses among all
of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np

from rr1plan.checks import Array, Seed, as_generator, known_name, number_from_zero, of_kind
from rr1plan.collision.arm_groups import arms_in_reach, interaction_groups
from rr1plan.multi.agents import Agent
from rr1plan.multi.in_parallel import in_parallel, processors
from rr1plan.multi.interaction import meeting_groups
from rr1plan.multi.many_arms_result import GroupResult, ManyArmsResult
from rr1plan.multi.paths.hop_timing import HopTiming
from rr1plan.multi.paths.path_pool import PathPool
from rr1plan.multi.preflight import (
    MARGINS,
    TO_CHOSEN,
    Preflight,
    no_path_to_any_goal,
    preflight,
    with_goal,
    with_other_goals,
)
from rr1plan.multi.search.agent_schedules import AgentSchedules
from rr1plan.multi.search.group_planner import COUPLED_FIRST, NO_TIME, GroupPlanner
from rr1plan.multi.search.group_schedules import GroupSchedules
from rr1plan.multi.search.improvement import PlanImprover
from rr1plan.multi.search.nearer_goals import NearerGoals
from rr1plan.multi.search.small_teams import plan_small_team
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.diagram_cache import DiagramCache
from rr1plan.multi.timing.schedule import Schedule
from rr1plan.path import Path
from rr1plan.planning import CANCELLED, Budget, PlanStatus, ProgressCallback, check_plan_arguments
from rr1plan.scene.problem import Problem
from rr1plan.trajectory import Trajectory, of_joints

_IMPROVEMENTS = 6  # rounds for each group
# Rounds of a search with goal configurations chosen among several, doubled after this many combinations.
_ROUNDS_OF_GOALS, _COMBINATIONS = 1, 3
_SEARCH = "conflict_based_search"
_METHODS = ("portfolio", _SEARCH)
# Time reserved for work that cannot be interrupted, at the end of a search and after it [s], and the largest share of
# the budget. Like the preflight, that work grows with the number of arms and the load of the machine, so from then on
# at least this multiple of the preflight's time is reserved.
_RESERVE, _MOST_RESERVE, _PREFLIGHTS = 0.1, 0.05, 3.0


def plan_many_arms(
    problem: Problem,
    *,
    margin: float | None = None,
    budget: Budget | None = None,
    improvement: Budget | None = None,
    method: str = "portfolio",
    retiming: str = "blend",
    torque_limits: bool = False,
    rng: Seed = None,
    progress: ProgressCallback | None = None,
) -> ManyArmsResult:
    """Plan the motions of all moving arms on one clock, certified between the arms in continuous time.

    Args:
        problem: The problem. Moving arms without a goal may yield and return.
        margin: Distance to keep in addition to the scene's padding [m], as far as starts, goals and narrow passages
            between stationary objects allow (default: the margin of the problem, or 2 mm if it has none). Arms planned
            as one keep at most the smallest of their margins.
        budget: When to stop (default: 10 s). Only its seconds count, unless they are infinite: then its iterations
            limit the searches for the first path of each arm, and the rounds of each group: one, and another for each
            doubling beyond 2,000 iterations.
        improvement: How long to improve the first plan, within `budget`: seconds, and attempts as iterations (default:
            not at all). Makespan first, then the sum of all arrival times. Nearer goal configurations are searched.
        method: "portfolio", or "conflict_based_search" for groups of up to 8 arms, with a bound on the sum of their
            arrival times (`GroupResult.suboptimality`) that holds before `improvement`, for the goal configurations
            that were found.
        retiming: "blend" rounds corners where certified, "stop" stops at corners, "ruckig" stops at them and limits
            jerk.
        torque_limits: Whether the motion also has to keep the joints' effort limits.
        rng: Seed; unless time runs out, the same seed and number of attempts give the same motion.
        progress: Called about ten times a second; False cancels.

    Returns:
        The motion, or why there is none. The status is then INVALID_START or INVALID_GOAL with the links in contact and
        their depth, INFEASIBLE with the joint of an arm that cannot pass stationary objects or other arms, TIMEOUT with
        the arms that have no schedule and the arms among which none was found, or CANCELLED.

    Raises:
        UnknownNameError: an unknown method or retiming.
        InputError: not a problem, a margin below zero, a retiming that leaves the paths, a scene that cannot be
            checked, or too many arms for the method.
        RetimingError: a joint that has to move has no limit of velocity or acceleration, or for "ruckig" of jerk.
    """
    check_plan_arguments(problem, budget, progress)
    of_kind("improvement", improvement, Budget, optional=True)
    known_name("method", method, _METHODS)
    timing = HopTiming(retiming, torque_limits)
    budget = budget or Budget()
    seconds = budget.seconds
    watch = Stopwatch(seconds - min(_RESERVE, _MOST_RESERVE * seconds), progress, budget.iterations)
    generator = as_generator(rng)
    largest = number_from_zero("margin", (problem.margin or MARGINS[0]) if margin is None else margin)
    near = arms_in_reach(problem.scene, problem.arms, largest)
    if not watch.goes_on() and watch.cancelled:
        return ManyArmsResult(PlanStatus.CANCELLED, CANCELLED, seconds=watch.seconds)
    found = preflight(problem, near, largest, generator, timing, watch)
    if found.status is not None:
        return ManyArmsResult(found.status, found.reason, seconds=watch.seconds)
    reserve = min(max(_RESERVE, _PREFLIGHTS * watch.seconds), _MOST_RESERVE * seconds)
    watch = watch.with_deadline(seconds - reserve - watch.seconds)
    # Random numbers depend on the arm alone, so that its path does not depend on the others.
    seeds = {arm: int(generator.integers(2**63)) for arm in problem.arms}
    task = _Task(problem, near, largest, seeds, watch)
    if method == _SEARCH:
        diagrams = DiagramCache(largest, watch)
        with watch:
            groups, schedules, alone, impossible = _search_small_teams(task, found)
        found, schedules = _with_chosen_goals(task, found, schedules)
    else:
        with watch:
            found, search, groups = _search_groups(task, found)
        diagrams, impossible = search.diagrams, search.impossible
        schedules = [schedule for planner in search.planners for schedule in planner.group.schedules.values()]
        # Without a solution no time is left for the bounds.
        solved = search.planners if all(group.found for group in groups) else []
        alone = {arm: bound for planner in solved for arm, bound in planner.group.fastest_alone().items()}
    if impossible:
        return ManyArmsResult(PlanStatus.INFEASIBLE, impossible, groups=tuple(groups), seconds=watch.seconds)
    unsolved = [group for group in groups if not group.found]
    if unsolved and not watch.cancelled:
        agent = Agent(problem, [arm for group in unsolved for arm in group.arms], timing)
        reason = f"not found in {watch.seconds:.3g} s: {_why_unsolved(unsolved, agent.unlimited_joints)}"
        return ManyArmsResult(PlanStatus.TIMEOUT, reason, groups=tuple(groups), seconds=watch.seconds)
    agents = [*found.agents.values(), *(schedule.path.agent for schedule in schedules)]
    plan = AgentSchedules(agents, found.margins, near, diagrams, watch)
    plan.schedules = {schedule.path.agent: schedule for schedule in schedules}
    goals = {arm: NearerGoals(Agent(problem, [arm], timing), seeds[arm]) for arm in found.chosen}
    improver = PlanImprover(plan, alone, generator, goals)
    first, planned_after = improver.quality, watch.seconds
    if improvement is not None:
        with watch:
            improver.run(improvement.seconds, improvement.iterations)
    if watch.cancelled:
        return ManyArmsResult(PlanStatus.CANCELLED, CANCELLED, groups=tuple(groups), seconds=watch.seconds)
    schedules, quality = list(plan.schedules.values()), improver.quality
    for schedule in schedules:
        schedule.path.release()  # megabytes for each arm
    return ManyArmsResult(
        PlanStatus.FOUND,
        trajectory=merged_trajectory(problem, schedules),
        paths=_paths_by_arm(problem, schedules),
        schedules=tuple(schedules),
        groups=tuple(groups),
        seconds=watch.seconds,
        quality=quality,
        # With the same bound, so that both ratios are comparable.
        first=replace(first, slowest_alone=quality.slowest_alone),
        improvements=improver.iterations,
        history=((planned_after, first.makespan), *improver.history),
    )


def _why_unsolved(groups: Sequence[GroupResult], unlimited: Sequence[str]) -> str:
    """Why some groups have no schedule.

    Args:
        groups: The groups.
        unlimited: Their joints without limits.
    """
    late = [arm for group in groups if group.reason == NO_TIME for arm in group.arms]
    reasons = [group.reason for group in groups if group.reason != NO_TIME]
    if late:
        reasons.append(f"no time was left to schedule {', '.join(late)}")
    if unlimited:
        reasons.append(f"{', '.join(unlimited)} did not move, because they have no limits (option limits)")
    return "; ".join(reasons)


@dataclass(frozen=True)
class _Task:
    """Input of the searches.

    Args:
        problem: The problem.
        near: For each arm, the arms that it can touch at all.
        margin: Largest distance that arms keep from each other in addition to the padding [m].
        seeds: Seed of each arm.
        watch: Deadline.
    """

    problem: Problem
    near: Mapping[str, frozenset[str]]
    margin: float
    seeds: Mapping[str, int]
    watch: Stopwatch

    def rng(self, arms: Sequence[str]) -> np.random.Generator:
        """Random numbers of some arms."""
        return np.random.default_rng([self.seeds[arm] for arm in arms])

    def no_path(self, found: Preflight, arms: Sequence[str], reason: str) -> str:
        """Why some arms provably reach none of their goals; empty if that is not proven.

        Args:
            found: The agents of the arms, each with a goal configuration.
            arms: The arms.
            reason: Why they have no path to these goal configurations.
        """
        if found.chosen.isdisjoint(arms):
            return f"{', '.join(arms)}: {reason}"
        return no_path_to_any_goal(self.problem, arms, self.watch.goes_on)


def _search_groups(task: _Task, found: Preflight) -> tuple[Preflight, _GroupSearch, list[GroupResult]]:
    """Plan all groups, with other goal configurations of arms without a schedule if they have several.

    The effort spent on a combination of goal configurations is limited, and grows. It is counted in rounds, so that the
    result does not depend on the speed of the machine.

    Returns:
        The preflight with the goal configurations and margins of the last search, this search, and the result of each
        group.
    """
    rng, now, attempt = task.rng(task.problem.arms), found, 0
    failed: list[GroupResult] = []  # of the last search that was not cut short by the deadline
    while True:
        search = _GroupSearch(task, now)
        search.rounds = min(_ROUNDS_OF_GOALS << attempt // _COMBINATIONS, task.watch.rounds)
        groups = search.run()
        kept = replace(now, margins=search.margins)
        unsolved = [arm for group in groups if not group.found for arm in group.arms]
        if not unsolved or search.impossible:
            return kept, search, groups
        if not task.watch.goes_on():
            return kept, search, failed or groups
        failed = groups
        if found.choices is None or found.choices.several.isdisjoint(unsolved) or search.rounds >= task.watch.rounds:
            return kept, search, groups  # the same goal configurations again, or no more rounds
        attempt += 1
        other = None
        if attempt % _COMBINATIONS:
            other = with_other_goals(task.problem, found, unsolved, task.margin, rng, task.watch)
        if other is None:
            attempt += -attempt % _COMBINATIONS
        now = other or found


def _search_small_teams(
    task: _Task, found: Preflight
) -> tuple[list[GroupResult], list[Schedule], dict[str, float], str]:
    """Conflict-based search of each group, up to the first that is impossible.

    Returns:
        The results, all schedules, for each arm the duration of its motion alone [s], and why arms of the last group
        provably have no path; empty if that is not proven.
    """
    groups: list[GroupResult] = []
    schedules: list[Schedule] = []
    alone: dict[str, float] = {}
    goals = {} if found.choices is None else found.choices.configurations
    for arms in interaction_groups(task.near):
        began = task.watch.seconds
        team = plan_small_team(
            [found.agents[arm] for arm in arms],
            goals,
            task.near,
            found.margins,
            task.margin,
            task.rng(arms),
            task.watch,
            partial(task.no_path, found),
        )
        stage = "" if team.reason else _SEARCH
        bound = team.suboptimality if team.schedules else None
        groups.append(GroupResult(arms, stage, task.watch.seconds - began, team.reason, suboptimality=bound))
        if team.impossible:
            return groups, schedules, alone, team.impossible
        schedules += team.schedules
        alone.update(team.alone)
    return groups, schedules, alone, ""


def _with_chosen_goals(task: _Task, found: Preflight, schedules: list[Schedule]) -> tuple[Preflight, list[Schedule]]:
    """The preflight and schedules with agents whose goals are the ends of the schedules, for paths of improvements.

    Conflict-based search chooses among all goal configurations, whichever the preflight has chosen.
    """
    ends: dict[str, Array] = {}
    for schedule in schedules:
        ends |= schedule.path.agent.split(schedule.path.goal)
    if not found.chosen or len(ends) < len(found.agents):
        return found, schedules
    aimed = with_goal(task.problem, found.agents, ends, found.choices, task.margin, task.watch)
    if aimed.status is not None:
        return found, schedules  # no time is left for improvements
    problem = next(iter(aimed.agents.values())).problem
    return aimed, [
        Schedule(schedule.path.of(Agent(problem, schedule.arms, schedule.path.agent.timing)), schedule.legs)
        for schedule in schedules
    ]


class _GroupSearch:
    """Plans interaction groups in parallel, and merges groups whose paths turn out to meet.

    Args:
        task: The problem, seeds and deadline.
        found: The agents of the problem's arms, each with a goal configuration.

    Attributes:
        rounds: Largest number of rounds for small groups in which arms have several goal configurations.
        planners: One for each group.
        diagrams: Coordination diagrams, shared by all groups.
        impossible: Why some arms provably have no path; empty if that is not proven.
    """

    def __init__(self, task: _Task, found: Preflight) -> None:
        self._task, self._found, self._near, self._watch = task, found, task.near, task.watch
        self._several = frozenset() if found.choices is None else found.choices.several
        self._pools = {
            arm: PathPool(agent, found.margins[arm], np.random.default_rng(task.seeds[arm]), task.watch)
            for arm, agent in found.agents.items()
        }
        self.rounds: float = math.inf
        self.planners: list[GroupPlanner] = []
        self.diagrams = DiagramCache(task.margin, task.watch)
        self.impossible = ""

    @property
    def margins(self) -> dict[str, float]:
        """Distance that each arm keeps from stationary objects in addition to the padding [m]."""
        return {arm: pool.margin for arm, pool in self._pools.items()}

    def run(self) -> list[GroupResult]:
        """Plan all groups. Returns the result of each."""
        without = self._first_paths()
        if without:
            return without
        self.planners = [self._planner(group) for group in self._groups()]
        results: dict[GroupPlanner, GroupResult] = {}
        waiting = list(self.planners)
        while waiting:
            results |= self._solve_all(waiting)
            if not all(results[planner].found for planner in self.planners):
                break
            waiting = self._join_meeting()
        return [self._proven(results[planner], planner.group.impossible) for planner in self.planners]

    def _proven(self, result: GroupResult, impossible: bool) -> GroupResult:
        """The result of arms without a motion, which notes a proof that there is none to their goal configurations."""
        if result.found or not impossible:
            return result
        self.impossible = self._task.no_path(self._found, result.arms, result.reason)
        return replace(result, reason=self.impossible or f"{', '.join(result.arms)}: {TO_CHOSEN}{result.reason}")

    def _first_paths(self) -> list[GroupResult]:
        """Find the first path of each arm. Returns the first failure, if any."""
        without = []
        for arm, pool in self._pools.items():
            began = self._watch.seconds
            path, reason = (
                pool.add({}, patient=True) if self._watch.goes_on() else (None, "no time was left for its path")
            )
            if path is None:
                reason = reason if pool.impossible else f"{arm}: {reason}"
                failed = GroupResult((arm,), "", self._watch.seconds - began, reason)
                without.append(self._proven(failed, pool.impossible))
                break
        return without

    def _groups(self) -> list[tuple[str, ...]]:
        """Arms whose first paths may collide, by boxes; in large groups by diagrams, which are needed there anyway."""
        paths = {arm: pool.paths[0] for arm, pool in self._pools.items()}
        groups = []
        for group in meeting_groups(paths, self._near, self.diagrams, watch=self._watch):
            own = {arm: paths[arm] for arm in group}
            if len(group) <= COUPLED_FIRST:
                groups.append(group)
                continue
            pairs = [(own[a], own[b]) for a, b in combinations(own, 2) if b in self._near[a]]
            self.diagrams.prepare(pairs, processors())
            groups += meeting_groups(own, self._near, self.diagrams, exactly=True, watch=self._watch)
        return groups

    def _planner(self, group: tuple[str, ...]) -> GroupPlanner:
        pools = [self._pools[arm] for arm in group]
        return GroupPlanner(GroupSchedules(pools, self._near, self.diagrams, self._task.rng(group), self._watch))

    def _solve_all(self, planners: list[GroupPlanner]) -> dict[GroupPlanner, GroupResult]:
        """Plan some groups, small ones first, so that a hard group takes no time from them; on threads if several meet.

        Returns:
            The result of each group.
        """
        several = [planner for planner in planners if len(planner.group.agents) > 1]
        threads = min(processors(), len(several))
        for planner in planners:
            planner.threads = processors() // max(1, threads)
        ordered = sorted(planners, key=lambda planner: len(planner.group.agents))
        return dict(zip(ordered, in_parallel(self._solve, ordered, threads, self._watch), strict=True))

    def _solve(self, planner: GroupPlanner) -> GroupResult:
        """Schedule a group and reduce its makespan."""
        group, began = planner.group, self._watch.seconds
        # Large groups continue to repair their schedules instead, because each round of theirs takes long.
        may_change = len(group.arms) <= COUPLED_FIRST and not self._several.isdisjoint(group.arms)
        solved = planner.run(self.rounds if may_change else self._watch.rounds)
        if solved:
            planner.improve(_IMPROVEMENTS)
        reason = "" if solved else group.reason
        return GroupResult(group.arms, group.stage, self._watch.seconds - began, reason, group.statistics)

    def _join_meeting(self) -> list[GroupPlanner]:
        """Merge groups whose present paths, such as detours, meet. Returns the groups to be planned again."""
        owner = {arm: planner for planner in self.planners for arm in planner.group.arms}
        paths = {arm: s.path for p in self.planners for agent, s in p.group.schedules.items() for arm in agent.arms}
        again: list[GroupPlanner] = []
        for group in meeting_groups(paths, self._near, self.diagrams, exactly=True, watch=self._watch):
            first, *others = dict.fromkeys(owner[arm] for arm in group)
            # Arms that meet may already be in one group.
            if not others:
                continue
            for other in others:
                first.group.join(other.group)
                self.planners.remove(other)
                owner.update(dict.fromkeys(other.group.arms, first))
            again.append(first)
        return list(dict.fromkeys(planner for planner in again if planner in self.planners))


def merged_trajectory(problem: Problem, schedules: list[Schedule]) -> Trajectory:
    """All schedules on one clock, columns in the order of the problem."""
    return of_joints(Trajectory.merge(*(schedule.trajectory() for schedule in schedules)), problem.joint_names)


def _paths_by_arm(problem: Problem, schedules: list[Schedule]) -> dict[str, Path]:
    paths: dict[str, Path] = {}
    for schedule in schedules:
        whole = schedule.path.path
        for arm, columns in schedule.path.agent.columns.items():
            paths[arm] = Path(whole.joint_names[columns], whole.waypoints[:, columns])
    return {arm: paths[arm] for arm in problem.arms}
