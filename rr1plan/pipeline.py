"""From a problem to a certified trajectory: plan, shorten, retime, validate.

Each stage is a separate function that can be called alone; this module orders the stages, handles
their failures and measures their wall times.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

from rr1plan.checks import Seed, as_seed, known_name, true_or_false
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.collision.convex.convex_bodies import cut_meshes
from rr1plan.errors import CancelledError, InputError
from rr1plan.import_clock import import_clock
from rr1plan.motion_plan import MotionPlan
from rr1plan.planners import MANY_ARMS_PLANNERS, chosen_planner, planner_names
from rr1plan.planners.margin_search import halved_margin, plan_with_margin
from rr1plan.planners.shortcut import shorten as shorten_path
from rr1plan.planning import Budget, Planner, PlanResult, PlanStatus, Progress, ProgressCallback, check_plan_arguments
from rr1plan.planning_constants import MARGINS, SHORTCUTS
from rr1plan.retiming import retime, retiming_names
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem
from rr1plan.validation import validate
from rr1plan.validation.moving_scene import moving_scene

# Imports faster than this [s] only look up modules that are already loaded.
_NO_IMPORTS = 0.01
_MANY_ARMS, _ANYTIME = MANY_ARMS_PLANNERS
_LEAVES_PATHS = "ruckig_direct"
# Up to this many arms are planned in their joint space unless a planner is named.
_PLANNED_AS_ONE = 2


def plan_motion(
    problem: Problem,
    *,
    planner: str | Planner | None = None,
    retiming: str = "blend",
    shorten: bool = True,
    margin: float | None = None,
    torque_limits: bool = False,
    budget: Budget | None = None,
    rng: Seed = None,
    progress: ProgressCallback | None = None,
) -> MotionPlan:
    """Plan, shorten, retime and validate, in that order.

    If the referee rejects the trajectory (for example because a blend is too close to an obstacle to decide), the path
    is timed again with a stop at each waypoint, so that it stays on the certified edges.

    Args:
        problem: The problem.
        planner: A name of `planner_names()`, an instance of `Planner`, or a planner of `plan_many_arms`: "many_arms"
            plans a path for each arm and schedules them, "many_arms_anytime" improves the motion until the budget ends.
            Default: "rrt_connect" for one or two arms and for retiming "ruckig_direct", else "many_arms".
        retiming: A name of `retiming_names()`. Only the `ruckig` methods limit jerk, at the price of a stop at each
            waypoint; with the others the report names jerk as not checked.
        shorten: Whether to shorten the path; paths of planners with `keeps_shape` (such as the Cartesian one) never
            are, those of many arms always.
        margin: Distance to keep beyond the scene's padding [m] (default: that of the problem, or 2 mm if it has none),
            for an arm with tracking errors of a fraction of a millimeter. All elements that move relative to each other
            keep it along the whole motion. It is halved, up to seven times below the default, until the clearance of
            start and goal is twice as large and, for a goal pose, a configuration has it. If no path with it is found
            but one without, by a search that is sixteen times as short or in the last tenth of the budget (at most 1
            s), it is halved until a brief search finds a path, and is zero if none does. `motion.margin` is what was
            kept, `motion.problem.margin` what was given, which pages of the motion also plan with. Because of the
            halving, a larger margin may keep less than a smaller one: where the start has a clearance of 5 mm, a margin
            of 2 mm is kept, and one of 3 mm becomes 1.5 mm.
        torque_limits: Whether the motion also has to keep the joints' effort limits.
        budget: When to stop the planner (default: 10 s); "many_arms" counts only its seconds, unless they are infinite.
        rng: Seed; the same seed and a budget of iterations give the same motion; with "many_arms" the same seed does
            unless time runs out.
        progress: Called about ten times a second during planning and convex decomposition of moving meshes, and once at
            the beginning of each other stage; returns False to cancel.

    Returns:
        A `MotionPlan`; `found` says whether there is a path, `valid` whether its timed motion is proven.

    Raises:
        UnknownNameError: an unknown planner or retiming.
        PlannerError: a planner of your own raised an exception, or returned a path that does not solve the problem.
        InputError: a negative margin, or something other than a problem.
        RetimingError: the path cannot be timed under the limits (a torque limit below gravity).
    """
    imports = import_clock.read_once()
    seconds = {"imports": imports} if imports > _NO_IMPORTS else {}
    check_plan_arguments(problem, budget, progress)
    known_name("retiming", retiming, retiming_names())
    shorten, torque_limits = true_or_false("shorten", shorten), true_or_false("torque_limits", torque_limits)
    seed = as_seed(rng)
    if margin is not None:
        problem = problem.with_margin(margin)  # so that saved motions and their pages plan with it, too
    planner = default_planner(problem, retiming) if planner is None else _known_planner(planner)
    if isinstance(planner, str) and planner in MANY_ARMS_PLANNERS:
        check_many_arms_retiming(planner, retiming)
        return _plan_many_arms(problem, planner, retiming, torque_limits, seconds, margin, budget, seed, progress)
    chosen = chosen_planner(planner)
    try:
        with _timed(seconds, "set up", progress):
            _cut_meshes(problem.scene, progress)
            margin = halved_margin(problem, (problem.margin or MARGINS.default) if margin is None else margin)
    except CancelledError as error:
        return MotionPlan(problem, PlanResult(PlanStatus.CANCELLED, None, str(error), chosen.name), seconds)
    with _timed(seconds, "plan"):
        result, margin = plan_with_margin(problem, margin, chosen, budget or Budget(), seed, progress)
    if result.path is None:
        return MotionPlan(problem, result, seconds, margin)
    path, trajectory, report = result.path, None, None
    jerk_limits = retiming.startswith("ruckig")
    judge = partial(validate, torque_limits=torque_limits, jerk_limits=jerk_limits)
    with checker_from_pool(problem.scene, problem.arms, margin) as motions:
        try:
            if shorten and not chosen.keeps_shape:
                with _timed(seconds, "shorten", progress):
                    stream = seed ^ SHORTCUTS.stream
                    path = shorten_path(path, problem.scene, checker=motions, iterations=SHORTCUTS.tries, rng=stream)
            for method in (retiming,) if jerk_limits else dict.fromkeys((retiming, "stop")):
                with _timed(seconds, "retime", progress):
                    trajectory = retime(
                        path, problem.scene, method=method, checker=motions, torque_limits=torque_limits
                    )
                with _timed(seconds, "validate", progress):
                    report = judge(trajectory, problem.scene, problem, clearance=False)
                if report.valid:
                    break
        except CancelledError as error:
            result = replace(result, status=PlanStatus.CANCELLED, path=None, reason=str(error))
            return MotionPlan(problem, result, seconds, margin)
    return MotionPlan(problem, result, seconds, margin, path, trajectory, report, _judge=judge)


def _known_planner(planner: str | Planner) -> str | Planner:
    """The planner, after a check of its name."""
    return (
        known_name("planner", planner, (*planner_names(), *MANY_ARMS_PLANNERS)) if isinstance(planner, str) else planner
    )


def default_planner(problem: Problem, retiming: str) -> str:
    """The name of the planner that `plan_motion` uses if none is given."""
    as_one = len(problem.arms) <= _PLANNED_AS_ONE or retiming == _LEAVES_PATHS
    return "rrt_connect" if as_one else _MANY_ARMS


def check_many_arms_retiming(planner: str, retiming: str) -> None:
    """Reject a retiming that is impossible for the planners of many arms.

    Raises:
        InputError: it leaves the paths, and nothing else is certified between the arms.
    """
    if retiming == _LEAVES_PATHS:
        raise InputError(
            f"planner {planner!r} cannot use retiming {retiming!r}, which leaves the paths that are certified between "
            "the arms; use 'ruckig', which also limits jerk"
        )


def _plan_many_arms(
    problem: Problem,
    planner: str,
    retiming: str,
    torque_limits: bool,
    seconds: dict[str, float],
    margin: float | None,
    budget: Budget | None,
    seed: int,
    progress: ProgressCallback | None,
) -> MotionPlan:
    """Plan a path for each arm, schedule them, and validate the motion of all."""
    from rr1plan.multi.portfolio import plan_many_arms  # not needed for one arm

    try:
        with _timed(seconds, "set up", progress):
            _cut_meshes(problem.scene, progress)
        with _timed(seconds, "plan", progress):
            improvement = (budget or Budget()) if planner == _ANYTIME else None
            found = plan_many_arms(
                problem,
                margin=margin,
                budget=budget,
                improvement=improvement,
                retiming=retiming,
                torque_limits=torque_limits,
                rng=seed,
                progress=progress,
            )
        if found.trajectory is None:
            result = PlanResult(
                found.status, None, found.reason, planner, seed, seconds=found.seconds, iterations=found.improvements
            )
            return MotionPlan(problem, result, seconds, many_arms=found)
        with _timed(seconds, "validate", progress):
            judge = partial(validate, torque_limits=torque_limits, jerk_limits=retiming == "ruckig")
            report = judge(found.trajectory, problem.scene, problem, clearance=False)
    except CancelledError as error:
        return MotionPlan(problem, PlanResult(PlanStatus.CANCELLED, None, str(error), planner, seed), seconds)
    result = PlanResult(found.status, None, "", planner, seed, seconds=found.seconds, iterations=found.improvements)
    return MotionPlan(
        problem, result, seconds, _trajectory=found.trajectory, _report=report, many_arms=found, _judge=judge
    )


def _cut_meshes(scene: Scene, progress: ProgressCallback | None) -> None:
    """Decompose moving meshes into convex pieces, the only part of the warm-up that may take a minute."""
    began = time.perf_counter()

    def report(part: Progress) -> bool | None:
        return None if progress is None else progress(Progress("set up", time.perf_counter() - began, part.fraction))

    cut_meshes(scene, report)


def warm_up(problem: Problem, *, progress: ProgressCallback | None = None) -> None:
    """Warm up: build the tables of a problem's scene, for planning and for the referee, before its first query.

    Planning does this on demand, before the time budget starts for one or two arms, within it for more. Tables of a
    robot take 20 to 500 ms, by the vertices of its meshes, and serve all scenes in which the robot is; those of a scene
    take some milliseconds and are cached with it. Call it in advance when the latency of the first query matters.

    Args:
        problem: Any problem in the scene that moves the same arms.
        progress: Called about ten times a second during convex decomposition of moving meshes, the only part that
            may take long; False cancels.

    Raises:
        InputError: `problem` is not a `Problem`, or the scene cannot be checked.
        CancelledError: `progress` returned False.
    """
    check_plan_arguments(problem, None, progress)
    _cut_meshes(problem.scene, progress)
    with checker_from_pool(problem.scene, problem.arms, problem.margin) as motions:
        motions.warm_up()
    if len(problem.arms) > _PLANNED_AS_ONE:
        from rr1plan.multi.preflight import warm_up_agents  # not needed for one arm

        warm_up_agents(problem)
    moving_scene(problem.scene, problem.joint_names)


@contextmanager
def _timed(seconds: dict[str, float], stage: str, progress: ProgressCallback | None = None) -> Iterator[None]:
    """Report the beginning of a stage and add its wall time to `seconds`.

    Raises:
        CancelledError: `progress` returned False.
    """
    if progress is not None and progress(Progress(stage, sum(seconds.values()), 0.0)) is False:
        raise CancelledError(f"cancelled before stage {stage!r}")
    started = time.perf_counter()
    try:
        yield
    finally:
        seconds[stage] = seconds.get(stage, 0.0) + time.perf_counter() - started
