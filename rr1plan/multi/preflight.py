"""Before planning: starts and goals that cannot be, with the reason, and a configuration for each goal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rr1plan.checks import Array, Seed
from rr1plan.collision import CollisionChecker
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.multi.agents import Agent, subscene
from rr1plan.multi.coordination import are_apart
from rr1plan.multi.placed_path import placed_configuration
from rr1plan.planners.collision_messages import describe_collision
from rr1plan.planners.goals import GoalSearch, check_start, joint_goals
from rr1plan.planning import PlanStatus
from rr1plan.problem import Problem

MARGINS = (2e-3, 1e-3, 5e-4, 2.5e-4, 1e-4)
"""Distances to keep beyond the padding [m]: the largest is taken of which starts and goals have twice as much."""

# Changes of goal configurations that are tried to separate goals of different arms.
_REPAIRS = 200


@dataclass(frozen=True)
class Preflight:
    """What was found.

    Args:
        problem: The problem with a configuration as each goal; None if there is no answer to it.
        margins: Distance that each arm can keep from what stands still, beyond the padding [m].
        status: None, or why there is no answer.
        reason: The same in words.
    """

    problem: Problem | None
    margins: Mapping[str, float]
    status: PlanStatus | None = None
    reason: str = ""


def preflight(
    problem: Problem, near: Mapping[str, frozenset[str]], largest_margin: float = MARGINS[0], rng: Seed = None
) -> Preflight:
    """Check starts and goals: limits, contacts of each arm, contacts between arms; find configurations for poses.

    Args:
        problem: The problem.
        near: Of each moving arm those that it can meet.
        largest_margin: No arm needs to keep more [m].
        rng: Generator or seed of inverse kinematics.
    """
    margins: dict[str, float] = {}
    choices: dict[str, Array] = {}
    starts = problem.scene.split(problem.start, problem.arms)
    agents = {arm: Agent(problem, [arm]) for arm in problem.arms}
    for arm in problem.arms:
        question = agents[arm].question({}, 0.0)
        with checker_from_pool(question.scene, question.arms) as checker:
            most = 2.0 * largest_margin
            if checker.limit_violations(question.start) or checker.clearance(question.start, most) <= 0.0:
                reason = check_start(question, checker)
                if reason:
                    return Preflight(None, margins, PlanStatus.INVALID_START, f"{arm}: {reason}")
            goals = joint_goals(question)
            if goals is None or len(goals) > 1 or not _is_usable(checker, goals[0]):
                found = GoalSearch(question, checker, rng).find()
                if found.status is not None:
                    return Preflight(None, margins, found.status, f"{arm}: {found.reason}")
                goals = found.configurations
            choices[arm] = goals
            room = min(
                checker.moving_clearance(question.start, most), *(checker.moving_clearance(q, most) for q in goals)
            )
            margins[arm] = next((m for m in (largest_margin, *MARGINS) if 2.0 * m <= room and m <= largest_margin), 0.0)
    touching = _first_contact(agents, starts, near)
    if touching is not None:
        return Preflight(None, margins, PlanStatus.INVALID_START, f"the starts exclude each other: {touching}")
    goal = _choose_goals(agents, choices, near)
    touching = _first_contact(agents, goal, near)
    if touching is not None:
        tried = "" if all(len(c) == 1 for c in choices.values()) else " in all combinations tried"
        return Preflight(None, margins, PlanStatus.INVALID_GOAL, f"the goals exclude each other{tried}: {touching}")
    if all(len(problem.goal[arm]) == 1 and hasattr(problem.goal[arm][0], "q") for arm in problem.arms):
        return Preflight(problem, margins)
    start = {arm: starts[arm] for arm in problem.arms}
    return Preflight(Problem(problem.scene, start, goal, problem.arms), margins)


def _is_usable(checker: CollisionChecker, q: Array) -> bool:
    return checker.within_limits(q) and checker.clearance(q, 1e-3) > 0.0


def _first_contact(
    agents: Mapping[str, Agent], postures: Mapping[str, Array], near: Mapping[str, frozenset[str]]
) -> str | None:
    """Which links of two arms touch, how deep, in words; None if no arms do."""
    placed = {arm: placed_configuration(agent.bodies, postures[arm]) for arm, agent in agents.items()}
    for one, agent in agents.items():
        for two in near[one]:
            if one > two or are_apart(agent, placed[one], agents[two], placed[two]):
                continue
            scene = subscene(agent.problem.scene, {one: postures[one], two: postures[two]}, obstacles=False)
            checker = CollisionChecker(scene)
            q = scene.configuration()
            owners = [{scene.owner(c.a), scene.owner(c.b)} for c in checker.contacts(q)]
            if {one, two} in owners:
                return describe_collision(checker, q)
    return None


def _choose_goals(
    agents: Mapping[str, Agent], choices: Mapping[str, Array], near: Mapping[str, frozenset[str]]
) -> dict[str, Array]:
    """A configuration for each arm so that those of neighbors are apart, as far as can be: min-conflicts repair."""
    picked = dict.fromkeys(agents, 0)
    if all(len(found) == 1 for found in choices.values()):
        return {arm: choices[arm][0] for arm in agents}
    placed = {arm: [placed_configuration(agents[arm].bodies, q) for q in found] for arm, found in choices.items()}

    def conflicts(arm: str, k: int) -> int:
        return sum(
            not are_apart(agents[arm], placed[arm][k], agents[other], placed[other][picked[other]])
            for other in near[arm]
        )

    for _ in range(_REPAIRS):
        bad = [arm for arm in agents if conflicts(arm, picked[arm])]
        movable = [arm for arm in bad if len(choices[arm]) > 1]
        if not movable:
            break
        for arm in movable:
            picked[arm] = int(np.argmin([conflicts(arm, k) for k in range(len(choices[arm]))]))
    return {arm: choices[arm][picked[arm]] for arm in agents}
