"""From a question to a proven motion: plan, shorten, retime, validate.

Every stage is a function of its own that can be called alone; this file only says in which order,
what happens when a stage refuses, and how long each took.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path as FilePath
from typing import Any, TypeVar

from rr1plan.checks import Seed, as_generator, counted, finite_number, known_name, true_or_false
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.collision.solids import cut_meshes
from rr1plan.errors import CancelledError, InputError, NoPlanError
from rr1plan.imports import import_clock
from rr1plan.multi.portfolio import ManyArmsResult, plan_many_arms
from rr1plan.path import Path
from rr1plan.planners import plan
from rr1plan.planners.goals import joint_goals
from rr1plan.planners.shortcut import shorten as shorten_path
from rr1plan.planning import Budget, PlanResult, PlanStatus, Progress, ProgressCallback, check_question
from rr1plan.problem import Problem
from rr1plan.report import Report
from rr1plan.retiming import retime, retiming_names
from rr1plan.scene import Scene
from rr1plan.trajectory import Trajectory
from rr1plan.validation import validate


@dataclass(frozen=True, eq=False)
class MotionPlan:
    """The answer to a problem, with all that led to it.

    Asking a plan that failed for its path, trajectory or report raises `NoPlanError` with the
    planner's reason; `solved` and `status` can be asked first.

    Args:
        problem: The question; None for a motion from a file that does not hold it.
        result: The planner's answer.
        seconds: Wall time of each stage [s], in order: "imports" (by the names of `rr1plan`, before the first
            question of the process), "set up" (of compiled code and of the scene, done once), "plan", "shorten",
            "retime", "validate".
        margin: Distance that was kept beyond the scene's padding while planning [m].
        changes: For a motion from a file: what differs between the scene that it was made in and `scene`.
        many_arms: What the planner "many_arms" found: paths by arm, stages, makespan; there is no `path` of all then.
    """

    problem: Problem | None
    result: PlanResult
    seconds: Mapping[str, float] = field(default_factory=dict)
    margin: float = 0.0
    _path: Path | None = None
    _trajectory: Trajectory | None = None
    _report: Report | None = None
    changes: tuple[str, ...] = ()
    _scene: Scene | None = None
    many_arms: ManyArmsResult | None = None

    @property
    def scene(self) -> Scene:
        """Where it happens."""
        if self._scene is not None:
            return self._scene
        assert self.problem is not None, "a plan without a problem is made with its scene"
        return self.problem.scene

    @property
    def status(self) -> PlanStatus:
        """How planning ended."""
        return self.result.status

    @property
    def solved(self) -> bool:
        """There is a trajectory, and the referee found nothing wrong with it."""
        return self._report is not None and self._report.valid

    def __bool__(self) -> bool:
        """The referee proved the motion: its report is certified, and nothing in it is violated."""
        return self._report is not None and self._report.certified

    @property
    def path(self) -> Path:
        """The path, shortened."""
        return self._path if self._path is not None else _present(self.result.path, self.result)

    @property
    def trajectory(self) -> Trajectory:
        """The timed motion."""
        return _present(self._trajectory, self.result)

    @property
    def report(self) -> Report:
        """The referee's verdict on the trajectory."""
        return _present(self._report, self.result)

    def __repr__(self) -> str:
        if self._report is None:
            return f"MotionPlan({self.result!r})"
        return f"MotionPlan({self.size()}, {self._report!r})"

    def __str__(self) -> str:
        if self._report is None:
            return f"no plan ({self.result.planner}, {self.status.value}): {self.result.reason}"
        stages = "".join(f"{name} {1e3 * seconds:.1f} ms, " for name, seconds in self.seconds.items())
        lines = [f"{self.size()}; {stages}".rstrip("; ,"), *(f"  changed      {change}" for change in self.changes)]
        return "\n".join([*lines, str(self._report)])

    def size(self) -> str:
        """What it consists of, in words: "57 waypoints, 2.31 rad long, 1.20 s in 112 quartic pieces"."""
        _, path, trajectory, _, _ = self._content()
        parts = [] if path is None else [f"{counted(len(path), 'waypoint')}, {path.length:.2f} rad long"]
        if trajectory is not None:
            kind = _DEGREES.get(trajectory.degree, f"degree-{trajectory.degree}")
            parts.append(f"{trajectory.duration:.3f} s in {counted(len(trajectory.coefficients), f'{kind} piece')}")
        return ", ".join(parts)

    def show(self, **options: Any) -> Any:
        """Open the motion in a live Meshcat page and print its address; options as in `rr1plan.playback.show`.

        End a script with `motion.show().wait()`, which keeps the page until it is closed.
        """
        from rr1plan import playback

        return playback.show(self.scene, self._trajectory, **self._picture(), **options)

    def save_html(self, file: str | FilePath, **options: Any) -> FilePath:
        """Write one self-contained page that plays the motion offline; options as in `save_html`."""
        from rr1plan import playback

        return playback.save_html(file, self.scene, self._trajectory, **self._picture(), **options)

    def save(self, file: str | FilePath, *, embed: bool = False) -> FilePath:
        """Write scene, problem, path, trajectory and report to one JSON file; read it with `rr1plan.load_motion`.

        Args:
            file: The file.
            embed: Put large meshes into the file, not into the folder "geometry" beside it; see `save_motion`.
        """
        from rr1plan.formats.plan_files import save_motion

        return save_motion(file, *self._content(), embed=embed)

    def to_json(self) -> str:
        """The text of a motion file that is whole by itself."""
        from rr1plan.formats.plan_files import motion_text

        return motion_text(*self._content())

    def _content(self) -> tuple[Scene, Path | None, Trajectory | None, Report | None, Problem | None]:
        path = self._path if self._path is not None else self.result.path
        if path is None:
            _present(self._trajectory, self.result)
        return self.scene, path, self._trajectory, self._report, self.problem

    def _picture(self) -> dict[str, Any]:
        _, path, _, report, problem = self._content()
        return {"path": path, "problem": problem, "report": report}


_T = TypeVar("_T")
# The time [s] in which nothing is imported but names of loaded modules are looked up.
_NO_IMPORTS = 0.01
_MARGIN = 0.002  # [m]
_MANY_ARMS = "many_arms"
# Arms that are planned in their joint space unless a planner is named, at most.
_PLANNED_AS_ONE = 2
# Tried to shorten a path that is going to be driven: seconds of motion are worth milliseconds of thought.
_SHORTCUTS = 48
_DEGREES = {0: "constant", 1: "linear", 2: "quadratic", 3: "cubic", 4: "quartic", 5: "quintic"}


def _present(value: _T | None, result: PlanResult) -> _T:
    if value is None:
        if not result.solved:
            result.path_or_raise()
        raise NoPlanError(result.reason or f"{result.planner}: there is a path, but it was not timed")
    return value


def plan_motion(
    problem: Problem,
    *,
    planner: str | None = None,
    retiming: str = "blend",
    shorten: bool = True,
    margin: float | None = None,
    torque_limits: bool = False,
    budget: Budget | None = None,
    rng: Seed = None,
    progress: ProgressCallback | None = None,
) -> MotionPlan:
    """Plan, shorten, retime and validate: the whole line, in that order.

    When the referee refuses the timed motion (a blend that grazes an obstacle too closely to decide),
    the path is timed again with a stop at each waypoint, which stays on the certified edges.

    Args:
        problem: The question.
        planner: A name of `planner_names()`, or "many_arms", which plans arms apart, each on a path of its own, and
            schedules them among each other (`rr1plan.multi.plan_many_arms`). Default: "rrt_connect" for one or two
            arms, which are planned as one; "many_arms" for more.
        retiming: A name of `retiming_names()`. Only the `ruckig` methods limit jerk, at the price of a stop at each
            waypoint; with the others the report names jerk as not checked.
        shorten: Whether to shorten the path; the Cartesian planner's is left as it is.
        margin: Distance to keep beyond the scene's padding [m] (default: that of the problem, or 2 mm where it has
            none): a proof of zero clearance is little use to an
            arm that tracks to a fraction of a millimeter. It is halved until start and goal have
            twice as much, and given up when no configuration found for a goal in space has it.
        torque_limits: Whether the motion also has to keep the joints' effort limits.
        budget: When the planner has to stop (default: 10 s).
        rng: Seed; the same seed and a budget of iterations give the same motion.
        progress: Called about ten times a second while a path is searched for and while meshes that move are cut into
            convex pieces, and once at the begin of each other stage; False cancels.

    Returns:
        A `MotionPlan`; `solved` says whether there is a proven trajectory.

    Raises:
        UnknownNameError: a planner or retiming nobody knows.
        InputError: a margin below zero, or no problem at all.
        RetimingError: the path cannot be timed under the limits (a torque limit below gravity).
    """
    imports = import_clock.read_once()
    seconds = {"imports": imports} if imports > _NO_IMPORTS else {}
    generator = as_generator(rng)
    check_question(problem, budget, progress)
    known_name("retiming", retiming, retiming_names())
    if planner is None:
        planner = "rrt_connect" if len(problem.arms) <= _PLANNED_AS_ONE else _MANY_ARMS
    if planner == _MANY_ARMS:
        if retiming != "blend" or torque_limits:
            raise InputError(f"planner {_MANY_ARMS!r} times motions itself, by 'blend' and without torque limits")
        return _plan_many_arms(problem, seconds, margin, budget, generator, progress)
    shorten, torque_limits = true_or_false("shorten", shorten), true_or_false("torque_limits", torque_limits)
    try:
        with _timed(seconds, "set up", progress):
            _cut_meshes(problem.scene, progress)
            margin = affordable_margin(problem, (problem.margin or _MARGIN) if margin is None else margin)
            roomy = problem.with_margin(margin)
            set_up(roomy)
    except CancelledError as error:
        return MotionPlan(problem, PlanResult(PlanStatus.CANCELLED, None, str(error), planner), seconds)
    with _timed(seconds, "plan"):
        result = plan(roomy, planner, budget, generator, progress)
        if margin > 0.0 and result.status in (PlanStatus.INVALID_GOAL, PlanStatus.INFEASIBLE):
            margin = 0.0
            result = plan(problem.with_margin(0.0), planner, budget, generator, progress)
    if result.path is None:
        return MotionPlan(problem, result, seconds, margin)
    path, trajectory, report = result.path, None, None
    jerk_limits = retiming.startswith("ruckig")
    with checker_from_pool(problem.scene, problem.arms, margin) as motions:
        try:
            if shorten and planner != "cartesian":
                with _timed(seconds, "shorten", progress):
                    path = shorten_path(path, motions, rng=generator, iterations=_SHORTCUTS)
            for method in (retiming,) if jerk_limits else dict.fromkeys((retiming, "stop")):
                with _timed(seconds, "retime", progress):
                    trajectory = retime(path, problem.scene, method, checker=motions, torque_limits=torque_limits)
                with _timed(seconds, "validate", progress):
                    report = validate(
                        trajectory, problem.scene, problem, torque_limits=torque_limits, jerk_limits=jerk_limits
                    )
                if report.valid:
                    break
        except CancelledError as error:
            result = replace(result, status=PlanStatus.CANCELLED, path=None, reason=str(error))
            return MotionPlan(problem, result, seconds, margin)
    return MotionPlan(problem, result, seconds, margin, path, trajectory, report)


def _plan_many_arms(
    problem: Problem,
    seconds: dict[str, float],
    margin: float | None,
    budget: Budget | None,
    rng: Seed,
    progress: ProgressCallback | None,
) -> MotionPlan:
    """Plan arms apart and schedule them, then validate the motion of all."""
    try:
        with _timed(seconds, "set up", progress):
            _cut_meshes(problem.scene, progress)
        with _timed(seconds, "plan", progress):
            found = plan_many_arms(problem, margin=margin, budget=budget, rng=rng, progress=progress)
        if found.trajectory is None:
            result = PlanResult(found.status, None, found.reason, _MANY_ARMS, seconds=found.seconds)
            return MotionPlan(problem, result, seconds, many_arms=found)
        with _timed(seconds, "validate", progress):
            report = validate(found.trajectory, problem.scene, problem)
    except CancelledError as error:
        return MotionPlan(problem, PlanResult(PlanStatus.CANCELLED, None, str(error), _MANY_ARMS), seconds)
    reason = "every arm has a path of its own, in `many_arms.paths`"
    result = PlanResult(found.status, None, reason, _MANY_ARMS, seconds=found.seconds)
    return MotionPlan(problem, result, seconds, _trajectory=found.trajectory, _report=report, many_arms=found)


def _cut_meshes(scene: Scene, progress: ProgressCallback | None) -> None:
    """Make the convex pieces of meshes that move: the one part of the preparation that may take a minute."""
    began = time.perf_counter()

    def told(fraction: float) -> bool | None:
        return None if progress is None else progress(Progress("set up", time.perf_counter() - began, fraction))

    cut_meshes(scene, told)


def set_up(problem: Problem, progress: ProgressCallback | None = None) -> None:
    """Warm up: build the collision tables of a problem's scene before its first query.

    Planning does it where it has not been done, in a millisecond or two; do it ahead where the first answer is waited
    for. What is made is kept with the scene.

    Args:
        problem: Any problem in the scene that moves the same arms.
        progress: Called about ten times a second while meshes that move are cut into convex pieces, the one part that
            may take long; False cancels.

    Raises:
        InputError: no problem, or a scene that cannot be checked.
        CancelledError: `progress` returned False.
    """
    check_question(problem, None, progress)
    _cut_meshes(problem.scene, progress)
    with checker_from_pool(problem.scene, problem.arms, problem.margin) as motions:
        motions.set_up()


def affordable_margin(problem: Problem, margin: float) -> float:
    """The margin [m], halved until start and goal have twice as much beyond their padding, 0 after a few halvings.

    Halvings, because a scene keeps one checker for each margin. Of several configurations as goals the one with most
    counts; of other goals it is not known ahead. Elements that do not move against each other do not count.

    Raises:
        InputError: below zero or not finite.
    """
    margin = finite_number("margin", margin)
    if margin < 0.0:
        raise InputError(f"margin is {margin}, expected a distance >= 0")
    with checker_from_pool(problem.scene, problem.arms) as checker:
        clearance = checker.moving_clearance(problem.start, 2.0 * margin)
        goals = joint_goals(problem)
        if goals is not None:
            clearance = min(clearance, max(checker.moving_clearance(q, clearance) for q in goals))
    return next((part for part in (margin * 0.5**k for k in range(6)) if 2.0 * part <= clearance), 0.0)


@contextmanager
def _timed(seconds: dict[str, float], stage: str, progress: ProgressCallback | None = None) -> Iterator[None]:
    """Add the wall time of a stage to the table, after its begin was reported.

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
