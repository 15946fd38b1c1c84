"""Motions of many arms on one clock: preflight, interaction groups, schedules, one certified trajectory.

    result = plan_many_arms(problem)

Each interaction group goes through the same stages until one solves it, under one deadline: timing on the fixed paths
of each arm alone, detours, eviction, and joint spaces of the few arms that stay in each other's way. The paths of a
group of up to four arms that still has no schedule are planned as one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from rr1plan.checks import Seed, as_generator, finite_number, known_name
from rr1plan.errors import InputError
from rr1plan.multi.hop_timing import HopTiming
from rr1plan.multi.improvement import PlanImprover
from rr1plan.multi.interaction import arms_in_reach, interaction_groups
from rr1plan.multi.plan_quality import PlanQuality
from rr1plan.multi.preflight import MARGINS, preflight
from rr1plan.multi.prioritized import PrioritizedPlanner, Statistics
from rr1plan.multi.schedule import Schedule
from rr1plan.multi.small_teams import plan_small_team
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.path import Path
from rr1plan.planning import Budget, PlanStatus, ProgressCallback, check_question
from rr1plan.scene.problem import Problem
from rr1plan.trajectory import Trajectory

_IMPROVEMENTS = 6  # rounds for each group
_SEARCH = "conflict_based_search"
_METHODS = ("portfolio", _SEARCH)


@dataclass(frozen=True)
class GroupResult:
    """What came of one interaction group.

    Args:
        arms: Its arms.
        stage: The last stage that was needed: "timing", "detours", "eviction" or "composite", or the method
            "conflict_based_search"; empty if none did.
        seconds: Wall time [s].
        reason: Why there is no answer, in words; empty if there is one.
        statistics: What was done.
        suboptimality: The sum of its arrivals is at most this multiple of the least on the roadmaps that were searched,
            on which each arm stops at each vertex; None: nothing is known.
    """

    arms: tuple[str, ...]
    stage: str
    seconds: float
    reason: str = ""
    statistics: Statistics = field(default_factory=Statistics)
    suboptimality: float | None = None

    @property
    def found(self) -> bool:
        """There is a schedule for all of its arms."""
        return not self.reason


@dataclass(frozen=True, eq=False)
class ManyArmsResult:
    """The answer to a problem of many arms.

    Args:
        status: How it ended.
        reason: Why there is no motion, in words.
        trajectory: All moving arms on one clock, columns in the order of the problem; or None.
        paths: The path of each arm.
        schedules: When each agent moves along its path; an agent is one arm, or a few that move as one.
        groups: What came of each interaction group.
        seconds: Wall time [s].
        makespan: When the last arm arrives [s].
        slowest_alone: Duration of the fastest motion found for the slowest arm alone [s].
        path_length: Sum of the lengths of all motions [rad].
        waiting: Sum of the times that arms rest before they arrive [s].
        first: The figures of the first plan, before `improvement`; None if there is no plan.
        improvements: Moves that were tried to improve it.
        history: (seconds, makespan [s]) of the first plan, and whenever the makespan got shorter.
    """

    status: PlanStatus
    reason: str = ""
    trajectory: Trajectory | None = None
    paths: Mapping[str, Path] = field(default_factory=dict)
    schedules: tuple[Schedule, ...] = ()
    groups: tuple[GroupResult, ...] = ()
    seconds: float = 0.0
    makespan: float = 0.0
    slowest_alone: float = 0.0
    path_length: float = 0.0
    waiting: float = 0.0
    first: PlanQuality | None = None
    improvements: int = 0
    history: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "paths", MappingProxyType(dict(self.paths)))

    @property
    def found(self) -> bool:
        """There is a motion."""
        return self.status is PlanStatus.FOUND

    def __bool__(self) -> bool:
        """The same as `found`."""
        return self.found

    @property
    def ratio(self) -> float:
        """Makespan over `slowest_alone`; 1 where nothing moves."""
        return PlanQuality(self.makespan, self.slowest_alone).ratio

    def __repr__(self) -> str:
        if not self.found:
            return f"ManyArmsResult({self.status.value}: {self.reason})"
        stages = ", ".join(dict.fromkeys(group.stage for group in self.groups))
        timing = f"{self.makespan:.3f} s, {self.ratio:.2f} times the slowest arm alone"
        return f"ManyArmsResult({len(self.paths)} arms, {timing}, by {stages})"


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
    """Plan the motions of all moving arms on one clock; between them, they are certified in continuous time.

    Args:
        problem: The problem. Arms that move without a goal may yield and come back.
        margin: Distance to keep beyond the scene's padding [m], as far as starts and goals have it (default: that of
            the problem, or 2 mm where it has none).
        budget: When to stop (default: 10 s); of iterations only the seconds count.
        improvement: How long to improve the first plan, within `budget`: seconds, and moves as iterations (default: not
            at all). Makespan first, then the sum of all arrivals; see `improvement.py`.
        method: "portfolio", or "conflict_based_search" for groups of up to 8 arms, with a bound on the sum of their
            arrivals (`GroupResult.suboptimality`) that holds before `improvement`.
        retiming: "blend" rounds corners where certified, "stop" stops at each, "ruckig" too and limits jerk.
        torque_limits: Whether the motion also has to keep the joints' effort limits.
        rng: Seed; where time does not run out, the same seed and number of moves give the same motion.
        progress: Called about ten times a second; False cancels.

    Returns:
        The motion, or why there is none: INVALID_START or INVALID_GOAL with the links that touch and how deep, or
        TIMEOUT with the arms that have no schedule, and those among which they have none.

    Raises:
        UnknownNameError: an unknown method or retiming.
        InputError: no problem, a margin below zero, a retiming that leaves the paths, a scene that cannot be checked,
            or too many arms for the method.
    """
    check_question(problem, budget, progress)
    if improvement is not None:
        check_question(problem, improvement, progress)
    known_name("method", method, _METHODS)
    timing = HopTiming(retiming, torque_limits)
    watch = Stopwatch((budget or Budget()).seconds, progress)
    generator = as_generator(rng)
    largest = finite_number("margin", (problem.margin or MARGINS[0]) if margin is None else margin)
    if largest < 0.0:
        raise InputError(f"margin is {largest}, expected a distance >= 0")
    near = arms_in_reach(problem.scene, problem.arms, largest)
    found = preflight(problem, near, largest, generator, timing)
    if found.status is not None:
        return ManyArmsResult(found.status, found.reason, seconds=watch.seconds)
    groups: list[GroupResult] = []
    schedules: list[Schedule] = []
    alone: dict[str, float] = {}
    for arms in interaction_groups(near):
        # Numbers of their own, so that a group is planned the same whatever the others are.
        numbers = np.random.default_rng(generator.integers(2**63))
        agents = [found.agents[arm] for arm in arms]
        if method == _SEARCH:
            began = watch.seconds
            team = plan_small_team(agents, near, found.margins, numbers, watch)
            seconds, bound = watch.seconds - began, team.suboptimality if team.schedules else None
            groups.append(GroupResult(arms, _SEARCH, seconds, team.reason, suboptimality=bound))
            schedules += team.schedules
            alone.update(team.alone)
            continue
        planner = PrioritizedPlanner(agents, near, found.margins, numbers, watch)
        groups.append(_solve(planner, arms, watch))
        schedules += planner.schedules.values()
        alone.update(planner.fastest_alone())
    unsolved = [group for group in groups if not group.found]
    if unsolved and not watch.cancelled:
        reason = f"not found in {watch.seconds:.3g} s: {'; '.join(group.reason for group in unsolved)}"
        return ManyArmsResult(PlanStatus.TIMEOUT, reason, groups=tuple(groups), seconds=watch.seconds)
    improver = PlanImprover(schedules, near, found.margins, alone, generator, watch)
    first, history = improver.quality, (watch.seconds, improver.quality.makespan)
    if improvement is not None:
        improver.run(improvement.seconds, improvement.iterations)
    if watch.cancelled:
        reason = "the progress callback returned False"
        return ManyArmsResult(PlanStatus.CANCELLED, reason, groups=tuple(groups), seconds=watch.seconds)
    schedules, quality = list(improver.schedules.values()), improver.quality
    return ManyArmsResult(
        PlanStatus.FOUND,
        trajectory=merged_trajectory(problem, schedules),
        paths=_paths_by_arm(problem, schedules),
        schedules=tuple(schedules),
        groups=tuple(groups),
        seconds=watch.seconds,
        makespan=quality.makespan,
        slowest_alone=quality.slowest_alone,
        path_length=quality.path_length,
        waiting=quality.waiting,
        # By the same bound, so that both ratios compare.
        first=replace(first, slowest_alone=quality.slowest_alone),
        improvements=improver.iterations,
        history=(history, *improver.history),
    )


def _solve(planner: PrioritizedPlanner, arms: tuple[str, ...], watch: Stopwatch) -> GroupResult:
    """Schedule a group, and make its makespan shorter."""
    began = watch.seconds
    solved = planner.run()
    if solved:
        planner.improve(_IMPROVEMENTS)
    reason = "" if solved else planner.reason
    return GroupResult(arms, planner.stage, watch.seconds - began, reason, planner.statistics)


def merged_trajectory(problem: Problem, schedules: list[Schedule]) -> Trajectory:
    """All schedules on one clock, columns in the order of the problem."""
    merged = Trajectory.merge(*(schedule.trajectory() for schedule in schedules))
    column = {name: i for i, name in enumerate(merged.joint_names)}
    order = [column[name] for name in problem.joint_names]
    return Trajectory.trusted(
        problem.joint_names, merged.breaks, np.ascontiguousarray(merged.coefficients[:, :, order])
    )


def _paths_by_arm(problem: Problem, schedules: list[Schedule]) -> dict[str, Path]:
    paths: dict[str, Path] = {}
    for schedule in schedules:
        agent, names = schedule.path.agent, schedule.path.path.joint_names
        first = 0
        for arm in agent.arms:
            count = problem.scene.arms[arm].robot.nq
            columns = slice(first, first + count)
            paths[arm] = Path(names[columns], schedule.path.path.waypoints[:, columns])
            first += count
    return {arm: paths[arm] for arm in problem.arms}
