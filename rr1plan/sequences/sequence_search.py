"""The search for a sequence's motions: if a segment has a choice, the rest of the sequence decides.

A free motion may end at several goals and configurations. They are tried nearest first: the segments up to the next
free motion are planned from there, then the free motion itself, then the rest. On failure the search backtracks to the
last choice (depth-first search). Free motions get few iterations at first and more in each further round, so that a
hard or impossible one does not use up the budget while other candidates are easy.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from rr1plan.checks import Array, Seed, as_generator, counted
from rr1plan.collision import CollisionChecker
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.errors import InputError
from rr1plan.motion_plan import MotionPlan
from rr1plan.path import Path
from rr1plan.pipeline import plan_motion
from rr1plan.planners.cartesian import CartesianPlanner
from rr1plan.planners.collision_messages import describe_collision
from rr1plan.planners.goal_configurations import GoalSearch, check_start
from rr1plan.planning import Budget, Planner, PlanStatus, Progress, ProgressCallback
from rr1plan.retiming import retime
from rr1plan.scene import Scene
from rr1plan.scene.problem import JointGoal, PoseGoal, Problem
from rr1plan.scene.unlocked_joints import unlocked_scene
from rr1plan.sequences.grippers import (
    closing_value,
    finger_contacts,
    gripper_values,
    only_gripper_joint,
    opening_value,
)
from rr1plan.sequences.segments import Attach, Detach, FreeMotion, MoveGripper, Pause, Segment, StraightLine
from rr1plan.sequences.sequence import Sequence, goals_by_arm, goals_of_links
from rr1plan.sequences.stages import (
    changed_scene,
    is_last_release,
    released_scene,
    resolved_change,
    scene_of_changes,
)
from rr1plan.trajectory import Trajectory

# Configurations of one goal, and of all goals of a free motion.
_MOST_PER_GOAL, _MOST_CANDIDATES = 8, 200
# Iterations of a free motion in the first round, and their growth factor per round.
_FIRST_EFFORT, _MORE_EFFORT = 3000, 5


@dataclass(frozen=True, eq=False)
class PlannedSegment:
    """A planned segment.

    Args:
        segment: The segment.
        trajectory: The motion of its joints, from time zero; None if nothing moves.
        seconds: Duration [s].
        motion: Path, scene and margin of a planned motion.
    """

    segment: Segment
    trajectory: Trajectory | None = None
    seconds: float = 0.0
    motion: MotionPlan | None = None


@dataclass(eq=False)
class _FreeLeg:
    """A free motion to one configuration, planned after the segments that follow it.

    Args:
        number: Index of the segment.
        problem: The motion.
        motion: The plan, once there is one.
    """

    number: int
    problem: Problem
    motion: MotionPlan | None = None


@dataclass
class _Failures:
    """The reasons why a segment failed, and their counts."""

    first: str
    status: PlanStatus
    count: int = 1


@dataclass(frozen=True, eq=False)
class SequenceSearchResult:
    """Outcome of the search.

    Args:
        status: Status of the search.
        steps: The planned segments; empty unless found.
        reason: Why there are no steps.
        failed: Index of the last segment that failed; None if none did.
    """

    status: PlanStatus
    steps: tuple[PlannedSegment, ...] = ()
    reason: str = ""
    failed: int | None = None


class _Stopped(Exception):
    """The budget ended, or the search was cancelled."""

    def __init__(self, status: PlanStatus, reason: str) -> None:
        super().__init__(reason)
        self.status, self.reason = status, reason


class SequenceSearch:
    """Searches for the motions of a sequence.

    Args:
        sequence: The sequence.
        planner: The planner of free motions.
        retiming: The retiming of all motions.
        budget: Budget of the search.
        rng: Seed of all random numbers.
        progress: Called before each attempt; False cancels.
    """

    def __init__(
        self,
        sequence: Sequence,
        planner: str | Planner,
        retiming: str,
        budget: Budget,
        rng: Seed,
        progress: ProgressCallback | None,
    ) -> None:
        self._sequence, self._planner, self._retiming, self._progress = sequence, planner, retiming, progress
        self._rng = as_generator(rng)
        self._budget, self._began = budget, time.monotonic()
        self._iterations_left = math.inf if budget.iterations is None else budget.iterations
        # Failures of this round and of the previous one, by segment.
        self._failures: dict[int, _Failures] = {}
        self._earlier: dict[int, _Failures] = {}
        self._effort = _FIRST_EFFORT

    def run(self) -> SequenceSearchResult:
        """Search until there is a motion for each segment, no candidate is left, or the budget ends."""
        try:
            while True:
                steps = self._extend(0, self._sequence.scene, None)
                if steps is not None:
                    return SequenceSearchResult(PlanStatus.FOUND, steps)
                if not any(found.status is PlanStatus.TIMEOUT for found in self._failures.values()):
                    return self._failed(None)
                self._earlier, self._failures = self._failures, {}
                self._effort *= _MORE_EFFORT
        except _Stopped as stopped:
            return self._failed(stopped)

    def _failed(self, stopped: _Stopped | None) -> SequenceSearchResult:
        """The outcome without a motion, naming the last segment that any candidate reached."""
        failures = self._earlier | self._failures
        if stopped is not None and (stopped.status is PlanStatus.CANCELLED or not failures):
            return SequenceSearchResult(stopped.status, reason=stopped.reason)
        last = max(failures)
        found, label = failures[last], self._sequence.segments[last].label
        reason = f"segment {last + 1} ({label}) not found: {found.first}"
        others = [
            f"segment {k + 1} in {counted(other.count, 'candidate')}"
            for k, other in sorted(failures.items())
            if k != last
        ]
        if found.count > 1 or others:
            failed = [*others, f"segment {last + 1} in {counted(found.count, 'candidate')}"]
            reason += f" (failed: {', '.join(failed)})"
        if stopped is not None:
            reason += f"; {stopped.reason}"
        status = found.status if stopped is None else stopped.status
        return SequenceSearchResult(status, reason=reason, failed=last)

    # ---- depth-first search ------------------------------------------------------------------

    def _extend(self, k: int, scene: Scene, pending: _FreeLeg | None) -> tuple[PlannedSegment, ...] | None:
        """Planned segments from k on, preceded by the pending free motion; None if there are none."""
        segments = self._sequence.segments
        if pending is not None and (k == len(segments) or isinstance(segments[k], FreeMotion)):
            if not self._plan_leg(pending):
                return None
            pending = None
        if k == len(segments):
            return ()
        segment = segments[k]
        if isinstance(segment, FreeMotion):
            return self._extend_free(k, segment, scene)
        for step, after in self._options(k, segment, scene):
            rest = self._extend(k + 1, after, pending)
            if rest is not None:
                return (step, *rest)
        return None

    def _extend_free(self, k: int, segment: FreeMotion, scene: Scene) -> tuple[PlannedSegment, ...] | None:
        self._go_on(k)
        goals = {arm: goals_of_links(scene, arm, own) for arm, own in goals_by_arm(segment, scene).items()}
        problem = Problem(_allowing(scene, segment), None, goals)
        for q in self._candidates(k, problem):
            leg = _FreeLeg(k, _to_configuration(problem, q))
            rest = self._extend(k + 1, _placed(scene, problem.arms, q), leg)
            if rest is not None:
                assert leg.motion is not None, "the leg is planned before what follows the next choice"
                return (
                    PlannedSegment(segment, leg.motion.trajectory, leg.motion.trajectory.duration, leg.motion),
                    *rest,
                )
        return None

    def _candidates(self, k: int, problem: Problem) -> list[Array]:
        """Free configurations at the goals, nearest first."""
        with checker_from_pool(problem.scene, problem.arms) as checker:
            blocked = check_start(problem, checker)
            if blocked:
                self._fail(k, PlanStatus.INVALID_START, blocked)
                return []
            search = GoalSearch(
                problem, checker, self._seed(), max_per_goal=_MOST_PER_GOAL, max_composites=_MOST_CANDIDATES
            )
            found = search.find()
            if found.status is not None:
                self._fail(k, found.status, _why_no_goal(problem, checker, found.reason))
        return list(found.configurations)

    def _plan_leg(self, leg: _FreeLeg) -> bool:
        """Plan a free motion unless it has been planned already."""
        if leg.motion is None:
            leg.motion = self._plan(leg.number, leg.problem, self._planner)
        return leg.motion.valid

    # ---- segments with given paths -----------------------------------------------------------

    def _options(
        self, k: int, segment: StraightLine | MoveGripper | Attach | Detach | Pause, scene: Scene
    ) -> Iterator[tuple[PlannedSegment, Scene]]:
        """The candidates for a segment, each with the scene after it."""
        self._go_on(k)
        if isinstance(segment, StraightLine):
            arm = scene.only_arm(segment.arm)
            for goal in self._line_goals(segment, scene, arm):
                problem = Problem(_allowing(scene, segment), None, {arm: goal})
                motion = self._plan(k, problem, CartesianPlanner())
                if motion.valid:
                    q = motion.trajectory(motion.trajectory.end_time)
                    yield (
                        PlannedSegment(segment, motion.trajectory, motion.trajectory.duration, motion),
                        _placed(scene, (arm,), q),
                    )
        elif isinstance(segment, MoveGripper):
            moved = self._move_gripper(k, segment, scene)
            if moved is not None:
                yield moved
        elif isinstance(segment, Pause):
            if self._is_free_at_rest(k, scene):
                yield PlannedSegment(segment, seconds=segment.seconds), scene
        else:
            try:
                change = resolved_change(segment, scene)
                after = changed_scene(scene, change)
            except InputError as error:
                self._fail(k, PlanStatus.INFEASIBLE, str(error))
                return
            if all(
                self._is_free_at_rest(k, unchecked) for unchecked in self._unchecked_scenes(k, change, scene, after)
            ):
                yield PlannedSegment(change), after

    def _unchecked_scenes(self, k: int, change: Attach | Detach, scene: Scene, after: Scene) -> Iterator[Scene]:
        """The scenes at segment k that no segment with a duration checks: releases at the end, changes only."""
        segments = self._sequence.segments
        if isinstance(change, Detach) and is_last_release(change, segments[k + 1 :]):
            yield released_scene(scene, change)
        if k + 1 == len(segments) and all(isinstance(segment, Attach | Detach) for segment in segments):
            changes = [segment for segment in segments if isinstance(segment, Attach | Detach)]
            yield scene_of_changes(after, [c.obstacle if isinstance(c, Attach) else c.name for c in changes])

    def _is_free_at_rest(self, k: int, scene: Scene) -> bool:
        """Whether a scene is free in its configuration; records the reason if not."""
        if not scene.arms:
            return True
        q: Array = scene.configuration()
        with checker_from_pool(scene, tuple(scene.arms)) as checker:
            free = checker.is_free(q)
            if not free:
                self._fail(k, PlanStatus.INFEASIBLE, f"collision: {describe_collision(checker, q)}")
        return free

    def _line_goals(self, segment: StraightLine, scene: Scene, arm: str) -> list[PoseGoal]:
        if segment.offset is None:
            return goals_of_links(scene, arm, segment.goal)
        tool = scene.arms[arm].robot.tool
        T = scene.link_poses()[f"{arm}/{tool}"].copy()
        T[:3, 3] += T[:3, :3] @ segment.offset if segment.axes == "tool" else segment.offset
        return [PoseGoal(tool, T)]

    def _move_gripper(self, k: int, segment: MoveGripper, scene: Scene) -> tuple[PlannedSegment, Scene] | None:
        """The motion of a gripper while its arm rests."""
        name = scene.only_arm(segment.arm)
        arm = scene.arms[name]
        try:
            values = gripper_target(segment, scene, name)
            moved = arm.robot.with_locked_joints(values)
        except InputError as error:
            self._fail(k, PlanStatus.INFEASIBLE, str(error))
            return None
        joints = tuple(values)
        own = unlocked_scene(_allowing(scene, segment), {name: joints})
        if segment.around is not None:
            own = replace(own, allowed=own.allowed | finger_contacts(arm.robot, name, segment.around))
        start = own.arms[name].q
        end = start.copy()
        end[-len(joints) :] = list(values.values())
        after = replace(scene, arms={**scene.arms, name: replace(arm, robot=moved)})
        columns = own.joint_names([name])
        checker = CollisionChecker(own, [name])
        if not checker.is_free(start):
            self._fail(k, PlanStatus.INVALID_START, f"the start is in collision: {describe_collision(checker, start)}")
            return None
        if not checker.edge_is_free(start, end):
            contact = checker.first_contact(start, end)
            where = end if contact is None else contact.q + 1e-3 * (end - start)
            self._fail(k, PlanStatus.INFEASIBLE, f"collision: {describe_collision(checker, where)}")
            return None
        trajectory = retime(Path(columns, [start, end]), own, method=self._retiming, checker=checker)
        if 0.0 < trajectory.duration < segment.seconds:
            trajectory = trajectory.stretched(segment.seconds / trajectory.duration)
        return PlannedSegment(segment, trajectory, max(trajectory.duration, segment.seconds)), after

    # ---- budget, failures --------------------------------------------------------------------

    def _plan(self, k: int, problem: Problem, planner: str | Planner) -> MotionPlan:
        """Plan a motion within the rest of the budget, and record the reason for a failure."""
        self._go_on(k)
        left = self._budget.seconds - (time.monotonic() - self._began)
        iterations = int(min(self._effort, self._iterations_left))
        motion = plan_motion(
            problem,
            planner=planner,
            retiming=self._retiming,
            budget=Budget(max(left, 1e-3), iterations),
            rng=self._seed(),
            progress=self._progress,
        )
        self._iterations_left -= motion.result.iterations
        if motion.status is PlanStatus.CANCELLED:
            raise _Stopped(PlanStatus.CANCELLED, motion.result.reason)
        if not motion.found:
            self._fail(k, motion.status, motion.result.reason)
        elif not motion.valid:
            self._fail(k, PlanStatus.INFEASIBLE, motion.report.violations[0].message)
        return motion

    def _go_on(self, k: int) -> None:
        """Stop if the budget has ended or the caller cancels."""
        seconds = time.monotonic() - self._began
        label = f"segment {k + 1} ({self._sequence.segments[k].label})"
        if self._progress is not None:
            fraction = k / len(self._sequence.segments)
            if self._progress(Progress(label, seconds, fraction)) is False:
                raise _Stopped(PlanStatus.CANCELLED, f"cancelled before {label}")
        if seconds > self._budget.seconds or self._iterations_left <= 0:
            raise _Stopped(PlanStatus.TIMEOUT, f"out of budget after {seconds:.3g} s, at {label}")

    def _fail(self, k: int, status: PlanStatus, reason: str) -> None:
        if k not in self._failures:
            self._failures[k] = _Failures(reason, status)
            return
        self._failures[k].count += 1
        if status is PlanStatus.TIMEOUT:
            self._failures[k].status = status

    def _seed(self) -> int:
        return int(self._rng.integers(2**32))


def gripper_target(segment: MoveGripper, scene: Scene, arm: str) -> Mapping[str, float]:
    """Values of the gripper joints at the end of a segment.

    Raises:
        InputError: fingers that cannot reach it.
    """
    placed = scene.arms[arm]
    if segment.position is not None:
        return gripper_values(placed.robot, segment.position)
    joint = only_gripper_joint(placed.robot)
    if segment.width is not None:
        return {joint: opening_value(placed.robot, segment.width)}
    assert segment.around is not None, "a segment has one of the three"
    if segment.around in scene.obstacles:
        thing = scene.obstacles[segment.around]
    else:
        held = scene.detach(segment.around)
        thing = held.obstacles[segment.around]
    return {joint: closing_value(placed, thing, segment.squeeze)}


def _why_no_goal(problem: Problem, checker: CollisionChecker, reason: str) -> str:
    """Why no configuration was found; if there are many alternatives, only for the first one."""
    count = max(len(goals) for goals in problem.goal.values())
    if count == 1:
        return reason
    first = Problem(problem.scene, problem.start, {arm: goals[0] for arm, goals in problem.goal.items()})
    found = GoalSearch(first, checker, 0).find()
    return f"of {count} goals, the first: {found.reason or reason}"


def _allowing(scene: Scene, segment: FreeMotion | StraightLine | MoveGripper) -> Scene:
    return replace(scene, allowed=scene.allowed | segment.allow) if segment.allow else scene


def _placed(scene: Scene, arms: tuple[str, ...], q: Array) -> Scene:
    """The scene with some arms at a composite configuration."""
    for name, own in scene.split(q, arms).items():
        if name in arms:
            scene = scene.with_configuration(name, own)
    return scene


def _to_configuration(problem: Problem, q: Array) -> Problem:
    """The problem with one configuration as its goal."""
    goals = {arm: JointGoal(own) for arm, own in problem.scene.split(q, problem.arms).items() if arm in problem.arms}
    return Problem(problem.scene, None, goals, arms=problem.arms)
