"""Output of the command `plan` about many arms, and its figures."""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING

from rr1plan.checks import counted, known_name
from rr1plan.cli.console import Console, milliseconds
from rr1plan.errors import InputError
from rr1plan.motion_plan import MotionPlan
from rr1plan.pipeline import default_planner
from rr1plan.planners import MANY_ARMS_PLANNERS
from rr1plan.scene.problem import Problem

if TYPE_CHECKING:
    from rr1plan.multi.many_arms_result import ManyArmsResult
    from rr1plan.multi.timing.schedule import Schedule
    from rr1plan.playback.schedules.timeline import Timeline

_MOST = 8  # waits or groups that are printed


def check_many_arms_options(options: Namespace, problem: Problem) -> None:
    """Reject, before any work, options that have no effect on many arms, and figures that the motion will not have.

    Raises:
        InputError: unshortened paths or iterations for a planner of many arms that has none; a diagram for a motion
            without such a planner, of one arm, or of an arm and itself.
        UnknownNameError: no such arm moves.
    """
    planner = options.planner or default_planner(problem, options.retiming)
    if planner in MANY_ARMS_PLANNERS and options.no_shorten:
        raise InputError(f"--no-shorten has no effect with --planner {planner}, whose paths are always shortened")
    if planner == MANY_ARMS_PLANNERS[0] and options.iterations is not None and math.isfinite(options.seconds):
        raise InputError(f"--iterations has no effect with --planner {planner}, except with --seconds inf")
    if options.diagram is None:
        return
    if planner not in MANY_ARMS_PLANNERS:
        raise InputError("option diagram needs the schedules of option planner many_arms")
    if len(problem.arms) < 2:
        raise InputError(f"option diagram needs two arms that move, got {problem.arms[0]!r} alone")
    for name in options.pair or ():
        known_name("moving arm", name, problem.arms)
    if options.pair and options.pair[0] == options.pair[1]:
        raise InputError(f"option pair names {options.pair[0]!r} twice, expected two arms")


def draw_figures(motion: MotionPlan, options: Namespace, console: Console) -> dict[str, str]:
    """Draw the requested figures that the plan has; returns the files."""
    files = {}
    if options.timeline is not None:
        files["time line"] = str(motion.timeline().save(options.timeline))
    if options.diagram is not None:
        one, two = options.pair or _most_delayed(motion)
        if _agent_of(motion, one) is _agent_of(motion, two):
            console.warn(f"{one} and {two} move as one, in their joint space: there is no diagram of them")
        else:
            files["diagram"] = str(motion.coordination_diagram(one, two).save(options.diagram))
    return files


def _most_delayed(motion: MotionPlan) -> tuple[str, str]:
    """The arm that waits longest for another, and the other; without waits the first two that do not move as one."""
    waits = [wait for wait in motion.timeline().waits if wait.others]
    if waits:
        longest = max(waits, key=lambda wait: wait.end - wait.begin)
        return longest.arm, longest.others[0]
    assert motion.many_arms is not None, "checked before planning"
    agents = [schedule.arms for schedule in motion.many_arms.separated.schedules]
    return (agents[0][0], agents[1][0]) if len(agents) > 1 else (agents[0][0], agents[0][-1])


def _agent_of(motion: MotionPlan, arm: str) -> Schedule:
    """The schedule that moves an arm."""
    assert motion.many_arms is not None, "checked before planning"
    return next(schedule for schedule in motion.many_arms.separated.schedules if arm in schedule.arms)


def kept_margin(motion: MotionPlan) -> float:
    """The margin of a plan [m]; for many arms, whose pairs have different margins, the smallest clearance."""
    if motion.many_arms is None:
        return motion.margin
    margins = motion.report.margins
    return min((margins[name].value for name in ("clearance", "self_clearance") if name in margins), default=math.inf)


def say_many(motion: MotionPlan, console: Console) -> None:
    """Print the summary of a plan of many arms: makespan, groups, waits."""
    many = motion.many_arms
    if many is None or console.as_json or console.quiet:
        return
    console.say(
        f"{counted(len(many.paths), 'arm')}: makespan {many.makespan:.3f} s, "
        f"{many.ratio:.2f} times the slowest arm alone; {many.quality.waiting:.3f} s of waiting"
    )
    say_groups(many, console)
    _say_waits(motion.timeline(), console)


def say_groups(many: ManyArmsResult, console: Console) -> None:
    """Print the groups that took longest, those without schedules first."""
    groups = sorted(many.groups, key=lambda group: (group.found, -len(group.arms), -group.seconds))
    for group in groups[:_MOST]:
        who = ", ".join(group.arms) if len(group.arms) <= _MOST else counted(len(group.arms), "arm")
        how = f"scheduled by {group.stage}" if group.found else f"not scheduled: {group.reason}"
        console.say(f"  group        {who}: {how}, {milliseconds(group.seconds)}")
    if len(groups) > _MOST:
        console.say(f"               and {counted(len(groups) - _MOST, 'group')} more")


def _say_waits(line: Timeline, console: Console) -> None:
    waits = sorted(line.waits, key=lambda wait: wait.begin - wait.end)
    for wait in waits[:_MOST]:
        whom = f" for {', '.join(wait.others)}" if wait.others else ""
        console.say(f"  waits        {wait.arm}{whom}, {wait.end - wait.begin:.3f} s from {wait.begin:.3f} s on")
    if len(waits) > _MOST:
        console.say(f"               and {counted(len(waits) - _MOST, 'wait')} more")


def many_values(motion: MotionPlan) -> Mapping[str, object]:
    """A plan of many arms as plain values, for JSON; nothing for other motions."""
    many = motion.many_arms
    if many is None:
        return {}
    groups = [
        {"arms": list(g.arms), "found": g.found, "stage": g.stage, "reason": g.reason, "seconds": g.seconds}
        for g in many.groups
    ]
    if not many.found:
        return {"many_arms": {"groups": groups}}
    waits = [{"arm": w.arm, "begin": w.begin, "end": w.end, "others": list(w.others)} for w in motion.timeline().waits]
    return {"many_arms": {**asdict(many.quality), "ratio": many.ratio, "groups": groups, "waits": waits}}
