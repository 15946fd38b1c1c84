"""Candidates for the segments of a sequence: motions, changes of what an arm holds, and pauses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.errors import InputError
from rr1plan.motion_plan import MotionPlan
from rr1plan.path import Path
from rr1plan.pipeline import plan_motion
from rr1plan.planners.cartesian import CartesianPlanner
from rr1plan.planners.collision_messages import describe_collision
from rr1plan.planners.goal_configurations import GoalSearch, check_start, joint_goals
from rr1plan.planning import Planner, PlanStatus
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
from rr1plan.sequences.search_effort import SearchEffort, SearchStopped
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
# Further configurations if none of these is reached, and the share of iterations of each: a round with them takes less
# than twice as long.
_MOST_FURTHER, _FURTHER_SHARE = 32, 0.2
# Before a reason that says nothing about other configurations at the same pose.
_TO_CHOSEN = "to the configuration that was chosen, "


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
class FreeLeg:
    """A free motion to one configuration, planned after the segments that follow it.

    Args:
        number: Index of the segment.
        segment: The segment.
        problem: The motion.
        share: Share of the iterations of a motion in this round.
        chosen: Whether other configurations may reach the goal, too.
        motion: The plan, once there is one.
    """

    number: int
    segment: FreeMotion
    problem: Problem
    share: float = 1.0
    chosen: bool = False
    motion: MotionPlan | None = None

    @property
    def found(self) -> bool:
        """Whether it is planned and valid."""
        return self.motion is not None and self.motion.valid

    @property
    def failed(self) -> bool:
        """Whether planning it failed."""
        return self.motion is not None and not self.motion.valid

    @property
    def planned(self) -> PlannedSegment:
        """The planned segment; only once there is a motion."""
        assert self.motion is not None, "a leg is planned before the next choice"
        return PlannedSegment(self.segment, self.motion.trajectory, self.motion.trajectory.duration, self.motion)


class SegmentOptions:
    """The candidates for the segments of a sequence.

    Args:
        sequence: The sequence.
        planner: The planner of free motions.
        retiming: The retiming of all motions.
        effort: Budget of the search; failures are recorded there.
    """

    def __init__(self, sequence: Sequence, planner: str | Planner, retiming: str, effort: SearchEffort) -> None:
        self._segments, self._planner, self._retiming, self._effort = sequence.segments, planner, retiming, effort

    def of(self, k: int, scene: Scene) -> Iterator[tuple[PlannedSegment | FreeLeg, Scene]]:
        """The candidates for segment k in a scene, each with the scene after it.

        Raises:
            SearchStopped: the budget has ended, or the caller cancels.
        """
        self._effort.check(k)
        match self._segments[k]:
            case FreeMotion() as segment:
                yield from self._free_motions(k, segment, scene)
            case StraightLine() as segment:
                yield from self._straight_lines(k, segment, scene)
            case MoveGripper() as segment:
                moved = self._move_gripper(k, segment, scene)
                if moved is not None:
                    yield moved
            case Pause() as segment:
                if self._is_free_at_rest(k, scene):
                    yield PlannedSegment(segment, seconds=segment.seconds), scene
            case segment:
                changed = self._change(k, segment, scene)
                if changed is not None:
                    yield changed

    def plan_leg(self, leg: FreeLeg) -> bool:
        """Plan a free motion unless it has been planned already; False if there is none."""
        if leg.motion is None:
            leg.motion = self._plan(leg.number, leg.problem, self._planner, leg.share, chosen=leg.chosen)
        return leg.found

    # ---- free motions ------------------------------------------------------------------------

    def _free_motions(self, k: int, segment: FreeMotion, scene: Scene) -> Iterator[tuple[FreeLeg, Scene]]:
        goals = {arm: goals_of_links(scene, arm, own) for arm, own in goals_by_arm(segment, scene).items()}
        problem, seed = Problem(_allowing(scene, segment), None, goals), self._effort.seed()
        legs: list[FreeLeg] = []
        chosen = joint_goals(problem) is None
        for further in (False, True):
            # Where later segments failed, other configurations cost much and rarely help.
            if further and (not any(leg.failed for leg in legs) or any(leg.found for leg in legs)):
                return
            for q in self._candidates(k, problem, seed, further):
                share = _FURTHER_SHARE if further else 1.0
                legs.append(FreeLeg(k, segment, _to_configuration(problem, q), share, chosen))
                yield legs[-1], _placed(scene, problem.arms, q)

    def _candidates(self, k: int, problem: Problem, seed: int, further: bool) -> Array:
        """Free configurations at the goals, or further ones including copies a turn away; nearest first."""
        with checker_from_pool(problem.scene, problem.arms) as checker:
            blocked = check_start(problem, checker)
            if blocked:
                self._effort.fail(k, PlanStatus.INVALID_START, blocked)
                return problem.start[None][:0]
            search = GoalSearch(problem, checker, seed, max_per_goal=_MOST_PER_GOAL, max_composites=_MOST_CANDIDATES)
            found = search.find()
            if found.status is not None:
                self._effort.fail(k, found.status, _why_no_goal(problem, checker, found.reason))
            return search.more()[:_MOST_FURTHER] if further else found.configurations

    # ---- segments with given paths -----------------------------------------------------------

    def _straight_lines(self, k: int, segment: StraightLine, scene: Scene) -> Iterator[tuple[PlannedSegment, Scene]]:
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

    def _change(self, k: int, segment: Attach | Detach, scene: Scene) -> tuple[PlannedSegment, Scene] | None:
        try:
            change = resolved_change(segment, scene)
            after = changed_scene(scene, change)
        except InputError as error:
            self._effort.fail(k, PlanStatus.INFEASIBLE, str(error))
            return None
        for unchecked in self._unchecked_scenes(k, change, scene, after):
            if not self._is_free_at_rest(k, unchecked):
                return None
        return PlannedSegment(change), after

    def _unchecked_scenes(self, k: int, change: Attach | Detach, scene: Scene, after: Scene) -> Iterator[Scene]:
        """The scenes at segment k that no segment with a duration checks: releases at the end, changes only."""
        segments = self._segments
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
                self._effort.fail(k, PlanStatus.INFEASIBLE, f"collision: {describe_collision(checker, q)}")
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
            self._effort.fail(k, PlanStatus.INFEASIBLE, str(error))
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
            self._effort.fail(
                k, PlanStatus.INVALID_START, f"the start is in collision: {describe_collision(checker, start)}"
            )
            return None
        if not checker.edge_is_free(start, end):
            contact = checker.first_contact(start, end) if checker.is_free(end) else None
            where = end if contact is None else contact.q + 1e-3 * (end - start)
            self._effort.fail(k, PlanStatus.INFEASIBLE, f"collision: {describe_collision(checker, where)}")
            return None
        trajectory = retime(Path(columns, [start, end]), own, method=self._retiming, checker=checker)
        if 0.0 < trajectory.duration < segment.seconds:
            trajectory = trajectory.stretched(segment.seconds / trajectory.duration)
        return PlannedSegment(segment, trajectory, max(trajectory.duration, segment.seconds)), after

    def _plan(
        self, k: int, problem: Problem, planner: str | Planner, share: float = 1.0, *, chosen: bool = False
    ) -> MotionPlan:
        """Plan a motion within the rest of the budget, and record the reason for a failure."""
        self._effort.check(k)
        motion = plan_motion(
            problem,
            planner=planner,
            retiming=self._retiming,
            budget=self._effort.budget(share),
            rng=self._effort.seed(),
            progress=self._effort.progress,
        )
        self._effort.spend(motion.result.iterations)
        if motion.status is PlanStatus.CANCELLED:
            raise SearchStopped(PlanStatus.CANCELLED, motion.result.reason)
        if not motion.found:
            only = _TO_CHOSEN if chosen and motion.status is PlanStatus.INFEASIBLE else ""
            self._effort.fail(k, motion.status, f"{only}{motion.result.reason}")
        elif not motion.valid:
            self._effort.fail(k, PlanStatus.INFEASIBLE, motion.report.violations[0].message)
        return motion


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
    goals = {arm: JointGoal(q[columns]) for arm, columns in problem.columns.items()}
    return Problem(problem.scene, None, goals, arms=problem.arms)
