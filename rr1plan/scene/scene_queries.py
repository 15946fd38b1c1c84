"""Reading and writing of the named queries of a scene file.

    [queries.reach]
    start = "home"                                              # or numbers; default: the scene's configuration
    goal = { frame = "tool", position = [-0.3, 0.25, 0.2] }     # a goal, a name, numbers, or a list of those

    [queries.swap]                                              # several arms
    starts = { left = "home" }
    goals = { left = [0.1, 0, 0, 0, 1, 0], right = "home" }
    margin = 0.01                                               # beyond the scene's padding [m]; default: 0

A goal table has `frame` and either `position` (and `quaternion`, wxyz) or the corners `lower` and
`upper` of a region.
"""

from __future__ import annotations

from typing import Any

from rr1plan.checks import shown
from rr1plan.files.checked_tables import Table, check_numbers, is_number
from rr1plan.scene import Scene
from rr1plan.scene.problem import Goal, JointGoal, PoseGoal, Problem, RegionGoal


def read_queries(queries: Table, scene: Scene) -> dict[str, Problem]:
    """The problems of a table of queries."""
    return {name: read_query(queries.table(name), scene) for name in queries.names()}


def read_query(entry: Table, scene: Scene) -> Problem:
    """One problem."""
    for key in ("goal", "start"):
        value = entry.entries.get(key)  # not as read: beside `goals`, `start` has no effect
        if isinstance(value, dict) and not scene.arms.keys().isdisjoint(value):
            raise entry.error(f"names arms; with several arms the key is '{key}s'", key)
    if entry.one_of({"goal": None, "goals": None}) == "goal":
        goal, start = read_goal(entry, "goal"), _read_start(entry, "start")
    else:
        goals, starts = entry.table("goals"), entry.table("starts")
        goal = {arm: read_goal(goals, arm) for arm in goals.names()}
        start = {arm: _read_start(starts, arm) for arm in starts.names()}
    arms, margin = entry.strings("arms") or None, entry.number("margin", 0.0)
    entry.finish()
    if "goal" in entry and arms is None and len(scene.arms) > 1:
        raise entry.error(f"names no arm; with several arms ({', '.join(scene.arms)}) the key is 'goals'", "goal")
    with entry.blame():
        return Problem(scene, start, goal, arms=arms).with_margin(margin)


def problem_entries(problem: Problem) -> dict[str, object]:
    """Entries from which `read_query` makes the same problem again."""
    starts = {arm: problem.start[columns].tolist() for arm, columns in problem.columns.items()}
    goals = {arm: [_goal_entry(goal) for goal in alternatives] for arm, alternatives in problem.goal.items()}
    arms = list(problem.arms)
    entries: dict[str, object] = {"arms": arms}
    if problem.margin > 0.0:
        entries["margin"] = problem.margin
    if len(arms) > 1:
        return entries | {"starts": starts, "goals": goals}
    only = goals[arms[0]]
    return entries | {"start": problem.start.tolist(), "goal": only[0] if len(only) == 1 else only}


def _read_start(entry: Table, key: str) -> Any:
    value = entry.raw(key)
    if value is None or isinstance(value, str):
        return value
    if not isinstance(value, list):
        raise entry.error(f"expected a configuration's name or its numbers, got {shown(value)}", key)
    return entry.numbers(key, (None,))


def read_goal(entry: Table, key: str, frame: str = "tool") -> Any:
    """A goal, or a list of alternatives.

    Args:
        entry: The table that contains it.
        key: Its key.
        frame: The frame of poses and regions that do not name one.

    Raises:
        FormatError: the key is missing, or its value is not a goal.
    """
    value = entry.required(key)
    if isinstance(value, list) and value and not any(is_number(v) for v in value):
        return [_one_goal(entry, f"{key}[{i}]", item, frame) for i, item in enumerate(value)]
    return _one_goal(entry, key, value, frame)


def _one_goal(entry: Table, place: str, value: object, frame: str) -> Any:
    if isinstance(value, str):
        return value
    if isinstance(value, list):
        check_numbers(value, lambda message: entry.error(message, place))
        return [float(v) if is_number(v) else v for v in value]
    if not isinstance(value, dict):
        known = "a configuration's name, its numbers, a table of a pose or region, or a list of alternatives"
        raise entry.error(f"expected {known}, got {shown(value)}", place)
    table = entry.at(place, value)
    frame = table.string("frame", frame)
    quaternion = table.numbers("quaternion", (4,)) if "quaternion" in table else None
    tolerance = table.number("orientation_tolerance", 1e-3)
    goal: PoseGoal | RegionGoal
    with table.blame():
        if table.one_of({"position": None, "lower": None}) == "position":
            position = table.numbers("position", (3,))
            goal = PoseGoal(
                frame,
                position,
                quaternion,
                position_tolerance=table.number("position_tolerance", 1e-4),
                orientation_tolerance=tolerance,
            )
        else:
            goal = RegionGoal(
                frame,
                table.numbers("lower", (3,)),
                table.numbers("upper", (3,)),
                quaternion,
                orientation_tolerance=tolerance,
            )
    table.finish()
    return goal


def _goal_entry(goal: Goal) -> Any:
    if isinstance(goal, JointGoal):
        return goal.q.tolist()
    entry: dict[str, Any] = {"frame": goal.frame}
    if isinstance(goal, PoseGoal):
        entry["position"] = goal.position.tolist()
        entry["position_tolerance"] = goal.position_tolerance
    else:
        entry |= {"lower": goal.lower.tolist(), "upper": goal.upper.tolist()}
    if goal.quaternion is not None:
        entry["quaternion"] = goal.quaternion.tolist()
    return entry | {"orientation_tolerance": goal.orientation_tolerance}
