"""Checks before planning: invalid starts and goals, with the reason, and a configuration for each goal."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import numpy as np

from rr1plan.checks import Array, Seed, as_seed
from rr1plan.collision import CollisionChecker
from rr1plan.collision.arm_groups import arms_in_reach
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.multi.agents import Agent
from rr1plan.multi.goal_conflicts import GoalChoices, GoalConflicts
from rr1plan.multi.paths.hop_timing import BLENDED, HopTiming
from rr1plan.multi.paths.placed_path import box_around, placed_configuration
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.coordination import are_apart, cross_pairs
from rr1plan.planners import RrtConnect
from rr1plan.planners.collision_messages import contacts_without, describe_collision
from rr1plan.planners.goal_configurations import GoalSearch, GoalSet, check_start, joint_goals
from rr1plan.planners.joint_barriers import find_joint_barrier
from rr1plan.planning import CANCELLED, Budget, PlanStatus
from rr1plan.scene.problem import JointGoal, Problem
from rr1plan.scene.scene_content import largest_padding
from rr1plan.scene.subscene import subscene

MARGINS = (2e-3, 1e-3, 5e-4, 2.5e-4, 1e-4, 1e-5)
"""Distances to keep in addition to the padding [m]; an arm uses the largest one of which its ends have twice as much.

Even the smallest is ten times the clearance that the referee cannot distinguish from contact.
"""

TO_CHOSEN = "to the goal configurations that were chosen, "
"""Before a reason that says nothing about other configurations that reach the goals."""

# Planner iterations after which one of several goal configurations of an arm counts as not reached.
_ITERATIONS = 2000
# How often further configurations of poses and regions are searched, if all of them exclude each other.
_MORE_GOALS = 7


@dataclass(frozen=True)
class Preflight:
    """The result of the checks before planning.

    Args:
        agents: The agent of each arm, in a problem whose goals are configurations; empty if planning is impossible.
        margins: Distance that each arm can keep from stationary objects in addition to the padding [m].
        status: Why there is no solution; None if planning can start.
        reason: The reason as text.
        chosen: Arms whose goal configuration was chosen among several.
        choices: Their other goal configurations; None if planning is impossible.
    """

    agents: Mapping[str, Agent]
    margins: Mapping[str, float]
    status: PlanStatus | None = None
    reason: str = ""
    chosen: frozenset[str] = frozenset()
    choices: GoalChoices | None = None


def preflight(
    problem: Problem,
    near: Mapping[str, frozenset[str]],
    largest_margin: float = MARGINS[0],
    rng: Seed = None,
    timing: HopTiming = BLENDED,
    watch: Stopwatch | None = None,
) -> Preflight:
    """Check starts and goals: limits, contacts of each arm, contacts between arms; find configurations for poses.

    Args:
        problem: The problem.
        near: For each moving arm, the arms that it can touch.
        largest_margin: Upper bound of the margins [m].
        rng: Generator or seed of inverse kinematics.
        timing: Retiming of the agents' motions.
        watch: Deadline, after which the status is TIMEOUT (default: none).

    Raises:
        RetimingError: a joint that has to move has no limit.
    """
    watch = watch or Stopwatch(np.inf)
    agents = {arm: Agent(problem, [arm], timing) for arm in problem.arms}
    for arm, agent in agents.items():
        if not watch.goes_on():
            return _too_late(watch)
        query = agent.query({}, 0.0)
        with checker_from_pool(query.scene, query.arms) as checker:
            blocked = "" if _is_usable(checker, query.start) else check_start(query, checker)
            # Stationary arms may be in collision, too: then the message is not about this arm only.
            subject = "" if blocked and contacts_without(checker, query.start, [arm]) else f"{arm}: "
        if blocked:
            return Preflight({}, {}, PlanStatus.INVALID_START, f"{subject}{blocked}")
    touching = _first_contact(agents, {arm: agent.start for arm, agent in agents.items()}, near)
    if touching is not None:
        return Preflight({}, {}, PlanStatus.INVALID_START, f"the starts exclude each other: {touching}")

    def reach(arm: str, q: Array) -> PlanStatus:
        query = agents[arm].query({}, 0.0)
        ends = {arm: query.start}, {arm: q}
        budget = Budget(watch.time_left, _ITERATIONS)
        planned = RrtConnect().plan(
            Problem(query.scene, *ends, arms=(arm,)), budget=budget, rng=0, progress=watch.let_planner_go_on
        )
        return PlanStatus.FOUND if planned.found or not watch.goes_on() else planned.status

    goal, status, reason, choices = _goal_choices(agents, near, rng, watch, reach)
    if status is not None:
        return Preflight({}, {}, status, reason)
    for arm, agent in agents.items():
        agent.check_limits(np.stack([agent.start, goal[arm]]))
    return with_goal(problem, agents, goal, choices, largest_margin, watch)


def with_other_goals(
    problem: Problem,
    found: Preflight,
    arms: Iterable[str],
    largest_margin: float,
    rng: np.random.Generator,
    watch: Stopwatch,
) -> Preflight | None:
    """The same result with random other goal configurations of some arms; None if none without contact are found.

    Args:
        problem: The problem.
        found: The result of `preflight`.
        arms: The arms.
        largest_margin: Upper bound of the margins [m].
        rng: Source of random numbers.
        watch: Deadline.
    """
    goal = found.choices.other(arms, rng) if found.choices is not None else None
    if goal is None:
        return None
    other = with_goal(problem, found.agents, goal, found.choices, largest_margin, watch)
    return other if other.status is None else None


def with_goal(
    problem: Problem,
    agents: Mapping[str, Agent],
    goal: Mapping[str, Array],
    choices: GoalChoices | None,
    largest_margin: float,
    watch: Stopwatch,
) -> Preflight:
    """The agents in a problem with some goal configurations, and their margins.

    Args:
        problem: The problem.
        agents: The agent of each arm.
        goal: One of the goal configurations of each arm, shape (nq,).
        choices: All goal configurations.
        largest_margin: Upper bound of the margins [m].
        watch: Deadline, after which the status is TIMEOUT.
    """
    margins = {}
    for arm, agent in agents.items():
        if not watch.goes_on():
            return _too_late(watch)
        margins[arm] = affordable_margin(agent, goal[arm], largest_margin)
    of_joints = {arm for arm, goals in problem.goal.items() if len(goals) == 1 and isinstance(goals[0], JointGoal)}
    chosen = frozenset(problem.goal) - of_joints
    if not chosen:
        return Preflight(agents, margins, choices=choices)
    starts = {arm: agent.start for arm, agent in agents.items()}
    plain = Problem(problem.scene, starts, goal, arms=problem.arms).with_margin(problem.margin)
    made = {arm: Agent(plain, [arm], agent.timing) for arm, agent in agents.items()}
    return Preflight(made, margins, chosen=chosen, choices=choices)


def no_path_to_any_goal(problem: Problem, arms: Iterable[str], goes_on: Callable[[], bool]) -> str:
    """Why one of some arms provably reaches none of its goals; empty if that is not proven.

    A proof needs goals that are configurations: a pose may be reached in others than those found.

    Args:
        problem: The problem.
        arms: The arms; the others are ignored.
        goes_on: Whether time is left.
    """
    agent = Agent(problem, arms)
    query = agent.query({}, 0.0)
    with checker_from_pool(query.scene, query.arms) as checker:
        for arm in agent.arms:
            reasons: dict[str, None] = {}
            for goal in problem.goal[arm]:
                # The others at their starts: only joints of this arm count.
                q = agent.start.copy()
                if isinstance(goal, JointGoal):
                    q[agent.columns[arm]] = goal.q
                barrier = find_joint_barrier(checker, agent.start, q, goes_on=goes_on)
                if barrier is None:
                    break
                reasons[str(barrier)] = None
            else:
                return f"{', '.join(agent.arms)}: no path exists: {'; '.join(reasons)}"
    return ""


def warm_up_agents(problem: Problem) -> None:
    """Build what planning the arms of a problem one by one reads: the tables of each, and those of pairs that can meet.

    Args:
        problem: The problem.
    """
    agents = {arm: Agent(problem, [arm]) for arm in problem.arms}
    for agent in agents.values():
        query = agent.query({}, MARGINS[0])
        with checker_from_pool(query.scene, query.arms, MARGINS[0]) as checker:
            checker.warm_up()
    for one, others in arms_in_reach(problem.scene, problem.arms, MARGINS[0]).items():
        for two in others:
            if one < two:
                cross_pairs(agents[one], agents[two], MARGINS[0])


def _too_late(watch: Stopwatch) -> Preflight:
    if watch.cancelled:
        return Preflight({}, {}, PlanStatus.CANCELLED, CANCELLED)
    advice = "allow more time, or build tables in advance (warm_up)"
    reason = f"starts and goals took all of {watch.seconds:.3g} s to check: {advice}"
    return Preflight({}, {}, PlanStatus.TIMEOUT, reason)


def goal_configurations(
    agents: Mapping[str, Agent], near: Mapping[str, frozenset[str]], rng: Seed = None
) -> tuple[dict[str, Array], PlanStatus | None, str]:
    """A goal configuration for each arm, without contact between arms.

    Args:
        agents: The agent of each arm.
        near: For each arm, the arms that it can touch.
        rng: Generator or seed of inverse kinematics.

    Returns:
        The configurations, None and an empty text; or no configurations, the status and the reason.
    """
    # Without more rounds: a seeded problem must not change, and problems draw other goals.
    return _goal_choices(agents, near, rng, Stopwatch(np.inf), lambda arm, q: PlanStatus.FOUND, rounds=0)[:3]


def _goal_choices(
    agents: Mapping[str, Agent],
    near: Mapping[str, frozenset[str]],
    rng: Seed,
    watch: Stopwatch,
    reach: Callable[[str, Array], PlanStatus],
    rounds: int = _MORE_GOALS,
) -> tuple[dict[str, Array], PlanStatus | None, str, GoalChoices | None]:
    """As `goal_configurations`, and all goal configurations.

    Args:
        agents: The agent of each arm.
        near: For each arm, the arms that it can touch.
        rng: Generator or seed of inverse kinematics.
        watch: Deadline, after which the status is TIMEOUT.
        reach: As for `GoalChoices`.
        rounds: How often configurations of poses and regions are searched again if all of them exclude each other.
    """
    found, seeds, status, reason = _first_goals(agents, rng, watch)
    if status is not None:
        return {}, status, reason, None
    choices = GoalChoices(GoalConflicts(agents, found, near), reach)
    chosen = choices.first()
    touching = _first_contact(agents, chosen, near)
    if touching is None:
        return chosen, None, "", choices
    # The repair of conflicts is incomplete, and configurations that were not reached are only hard to reach.
    # If all arms have a single configuration, no other combination exists.
    only_one = all(len(several) == 1 for several in found.values())
    combined, complete = (None, True) if only_one else choices.conflicts.combination(watch)
    if combined is None and complete and rounds:
        sampled = {arm: agents[arm] for arm in seeds if joint_goals(agents[arm].query({}, 0.0)) is None}
        for further in _further_goals(sampled, seeds, rounds, watch):
            found |= {arm: np.concatenate([found[arm], new]) for arm, new in further.items()}
            choices = GoalChoices(GoalConflicts(agents, found, near), reach)
            combined, complete = choices.conflicts.combination(watch)
            if combined is not None or not complete:
                break
        # Further configurations may be missing because no time was left to search for them.
        complete = complete and (not sampled or watch.goes_on())
    if combined is not None:
        choices.use(combined)
        return combined, None, "", choices
    if watch.cancelled:
        return {}, PlanStatus.CANCELLED, CANCELLED, None
    if not complete:
        reason = f"no goal configurations that leave room for each other were found: {touching}"
        return {}, PlanStatus.TIMEOUT, reason, None
    tried = "" if all(len(several) == 1 for several in found.values()) else " in all combinations tried"
    # This includes arms without a goal, which return to their start.
    staying = [
        f"{arm} ends where it starts"
        for arm, agent in agents.items()
        if f"'{arm}/" in touching and np.array_equal(chosen[arm], agent.start)
    ]
    reason = "; ".join([f"the goals exclude each other{tried}: {touching}", *staying])
    return {}, PlanStatus.INVALID_GOAL, reason, None


def _first_goals(
    agents: Mapping[str, Agent], rng: Seed, watch: Stopwatch
) -> tuple[dict[str, Array], dict[str, int], PlanStatus | None, str]:
    """Goal configurations of each arm, shape (k, nq), and the seeds of their searches; or status and reason."""
    found: dict[str, Array] = {}
    seeds: dict[str, int] = {}
    for arm, agent in agents.items():
        if not watch.goes_on():
            late = _too_late(watch)
            return {}, {}, late.status, late.reason
        own = _only_goal(agent)
        if own is None:
            seeds[arm] = as_seed(rng)
            with _goal_search(agent, seeds[arm]) as search:
                own = search.find()
        if own.status is not None:
            return {}, {}, own.status, f"{arm}: {own.reason}"
        found[arm] = own.configurations
    return found, seeds, None, ""


def _only_goal(agent: Agent) -> GoalSet | None:
    """The goal configuration of one arm, if there is one only and it is usable; otherwise None."""
    query = agent.query({}, 0.0)
    goals = joint_goals(query)
    if goals is None or len(goals) > 1:
        return None
    with checker_from_pool(query.scene, query.arms) as checker:
        return GoalSet(goals) if _is_usable(checker, goals[0]) else None


@contextmanager
def _goal_search(agent: Agent, seed: int) -> Iterator[GoalSearch]:
    """A search for goal configurations of one arm."""
    query = agent.query({}, 0.0)
    with checker_from_pool(query.scene, query.arms) as checker:
        yield GoalSearch(query, checker, seed)


def _further_goals(
    agents: Mapping[str, Agent], seeds: Mapping[str, int], rounds: int, watch: Stopwatch
) -> Iterator[dict[str, Array]]:
    """Further configurations of poses and regions; few of infinitely many leave room for another arm near them.

    Args:
        agents: The agent of each arm with such goals.
        seeds: The seed with which the first configurations were found.
        rounds: Largest number of rounds.
        watch: Deadline.
    """
    with ExitStack() as open_searches:
        searches: dict[str, GoalSearch] = {}
        for arm, agent in agents.items():
            searches[arm] = open_searches.enter_context(_goal_search(agent, seeds[arm]))
            searches[arm].find()  # the same as before
        for _ in range(rounds):
            further: dict[str, Array] = {}
            for arm, search in searches.items():
                new = search.more(turned_copies=False) if watch.goes_on() else np.empty((0, 0))
                if len(new):
                    further[arm] = new
            searches = {arm: searches[arm] for arm in further}
            if not further:
                break
            yield further


def margins_up_to(largest: float) -> tuple[float, ...]:
    """The margins to try in turn [m]: the largest one, its halves above those of `MARGINS`, and smaller ones of these.

    Args:
        largest: The largest margin [m].
    """
    halves = [largest]
    while halves[-1] > 2.0 * MARGINS[0]:
        halves.append(0.5 * halves[-1])
    return (*halves, *(m for m in MARGINS if m < halves[-1]))


def affordable_margin(agent: Agent, goal: Array, largest: float) -> float:
    """The largest margin such that an agent has twice as much clearance at its start and goal [m].

    Args:
        agent: The agent.
        goal: Its goal configuration, shape (nq,).
        largest: Upper bound [m].
    """
    query = agent.query({}, 0.0)
    with checker_from_pool(query.scene, query.arms) as checker:
        room = min(checker.moving_clearance(q, 2.0 * largest) for q in (agent.start, goal)) if largest > 0.0 else 0.0
    return next((m for m in margins_up_to(largest) if 2.0 * m <= room), 0.0)


def _is_usable(checker: CollisionChecker, q: Array) -> bool:
    """Whether q is within the limits and surely free of contacts, including contacts between stationary objects."""
    least = 2.0 * checker.tolerance  # with nearly as much, no motion from q can be proven
    return checker.static_is_free and checker.within_limits(q) and checker.clearance(q, 1e-3) > least


def _first_contact(
    agents: Mapping[str, Agent], configurations: Mapping[str, Array], near: Mapping[str, frozenset[str]]
) -> str | None:
    """A description of a contact between two arms, with links and depth; None if there is none."""
    names = tuple(agents)
    placed = [placed_configuration(agents[arm].bodies, configurations[arm]) for arm in names]
    boxes = np.array([box_around(agents[arm].bodies, at) for arm, at in zip(names, placed, strict=True)])
    number = {arm: i for i, arm in enumerate(names)}
    # Sorted: sets have another order in each process, and the first contact is the one that is named.
    pairs = [(number[one], number[two]) for one in names for two in sorted(near[one]) if one < two]
    rows = np.array(pairs, np.int64).reshape(-1, 2)
    first, second = boxes[rows[:, 0]], boxes[rows[:, 1]]
    gaps = np.maximum(first[:, 0] - second[:, 1], second[:, 0] - first[:, 1]).max(axis=1)
    whole = agents[names[0]].problem.scene
    for i, j in rows[gaps <= largest_padding(whole)].tolist():
        one, two = names[i], names[j]
        if are_apart(agents[one], placed[i], agents[two], placed[j]):
            continue
        scene = subscene(whole, {one: configurations[one], two: configurations[two]}, obstacles=False)
        checker = CollisionChecker(scene)
        q = scene.configuration()
        owners = [{scene.owner(c.a), scene.owner(c.b)} for c in checker.contacts(q)]
        if {one, two} in owners:
            return describe_collision(checker, q)
    return None
