"""A configuration space of two joints with a query and its result: the data of pictures, pages and verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import (
    Array,
    Value,
    check_callback,
    counted,
    items_of,
    of_kind,
    read_only,
    shown,
)
from rr1plan.collision import CollisionChecker
from rr1plan.collision.contact_cells import JointPlane
from rr1plan.errors import InputError
from rr1plan.model import Kinematics, solve_ik
from rr1plan.planning import PlanResult, SearchTree
from rr1plan.playback.cspace.cspace_decomposition import Decomposition, decompose
from rr1plan.playback.cspace.cspace_grid import LIMITS, CSpaceGrid, compute_grid, two_joints, whole_configurations
from rr1plan.playback.cspace.cspace_raster import layer_of
from rr1plan.playback.cspace.cspace_targets import CellTargets, off_by
from rr1plan.playback.search_trees import DrawnTree, drawn_tree
from rr1plan.progress import ProgressCallback, fraction_callback
from rr1plan.scene import Scene
from rr1plan.scene.problem import Goal, JointGoal, Problem

_MOST_SOLUTIONS = 16  # drawn of each goal
_SAME = 1e-3  # a path reaches the goals within this distance of its end [rad or m]
_EXACT = 1e-6  # a path whose ends are this near to those of the query answers it [rad or m]


@dataclass(frozen=True, eq=False, repr=False)
class CSpaceQuery(Value):
    """A configuration space with a query and its result.

    Args:
        grid: Cells, layers and components.
        start: Start of the query [rad or m], shape (2,), or None.
        goals: Configurations that reach the goal, each (2,): those of joint goals, and those that inverse kinematics
            found for goals of position.
        path: Waypoints of the result [rad or m], shape (k, 2), or None. The path is checked: see `path_fault`.
        tree: The tree that the planner explored, or None.
        goal_names: Name of each goal (default: "goal", or "goal 1" and so on).
        targets: The goals as given in the query (default: `goals`).
        unreached: For each target without a configuration: its name and the reason.
    """

    grid: CSpaceGrid
    start: Array | None = None
    goals: tuple[Array, ...] = ()
    path: Array | None = None
    tree: SearchTree | None = None
    goal_names: tuple[str, ...] = ()
    targets: tuple[Goal, ...] = ()
    unreached: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if len(self.goal_names) != len(self.goals):
            object.__setattr__(self, "goal_names", _numbered("goal", len(self.goals)))
        if not self.targets:
            object.__setattr__(self, "targets", tuple(JointGoal(goal) for goal in self.goals))

    def __repr__(self) -> str:
        grid = self.grid
        cells = " x ".join(str(n) for n in grid.free.shape)
        asked = "" if self.start is None else f", {counted(len(self.goals), 'goal')}"
        answer = "" if self.path is None else ", a path"
        joints = " x ".join(grid.joint_names)
        return f"{type(self).__name__}({grid.scene.name!r}, {joints}, {cells} cells{asked}{answer})"

    # ---- the question --------------------------------------------------------------------

    @cached_property
    def start_blocked_by(self) -> tuple[str, ...]:
        """Names of the layers that block the start, empty if it is free. Decided exactly, not by the grid cell."""
        return () if self.start is None else self._blocked_by(self.start)

    @cached_property
    def goals_blocked_by(self) -> tuple[tuple[str, ...], ...]:
        """Like `start_blocked_by`, for each goal."""
        return tuple(self._blocked_by(goal) for goal in self.goals)

    def _blocked_by(self, q: Array) -> tuple[str, ...]:
        scene, arm = self.grid.scene, self.grid.arm
        checker, full = CollisionChecker(scene, (arm,)), whole_configurations(self.grid, q)
        names = [layer_of(scene, (contact.a, contact.b), arm) for contact in checker.contacts(full)]
        return tuple(dict.fromkeys(names + [LIMITS] * (not checker.within_limits(full))))

    # ---- the answer ----------------------------------------------------------------------

    @cached_property
    def path_fault(self) -> str:
        """Why the path does not answer the query, in words; empty if it does, or without a path or a query."""
        grid, q = self.grid, self.path
        if q is None or self.start is None or not self.targets:
            return ""
        if off_by(q[:1], self.start, np.array(grid.turns)).max() > _EXACT:
            return "it does not begin at the start"
        checker = CollisionChecker(grid.scene, (grid.arm,))
        names = grid.scene.arms[grid.arm].robot.joint_names
        columns = (names.index(grid.joint_names[0]), names.index(grid.joint_names[1]))
        plane = JointPlane(checker.model, whole_configurations(grid, self.start), columns)
        targets = CellTargets(plane, grid.scene, grid.arm, self.targets)
        if not targets.may_hold(q[-1:], np.full(2, _EXACT)).all():
            return "it does not end at a goal"
        path = whole_configurations(grid, q)
        if not all(checker.within_limits(point) for point in path):
            return "it leaves the joint limits"
        return "" if checker.path_is_free(path) else "it is not free"

    @property
    def found(self) -> bool:
        """There is a path from the start to a goal, certified free."""
        return self.path is not None and self.start is not None and not self.path_fault

    @property
    def reachable_goals(self) -> tuple[bool, ...]:
        """For each goal, whether the path ends there, or the goal is in the start's free component on the grid."""
        if self.start is None:
            return tuple(False for _ in self.goals)
        return tuple(self._ends_at(goal) or self.grid.connected(self.start, goal) for goal in self.goals)

    def _ends_at(self, goal: Array) -> bool:
        if self.path is None or not self.found:
            return False
        return bool(off_by(self.path[-1], goal, np.array(self.grid.turns)).max() < _SAME)

    @cached_property
    def decomposition(self) -> Decomposition | None:
        """The cells that were certified in the search for a proof that no path exists; None if there was no search.

        There is no search without a query, with a path that answers it, with a start that is not free, or for slices of
        larger arms.
        """
        grid = self.grid
        whole = grid.scene.arms[grid.arm].robot.joint_names == grid.joint_names
        if not whole or self.found or self.start is None or not self.targets or self.start_blocked_by:
            return None
        return decompose(grid.scene, grid.arm, self.start, self.targets, self.goals)

    @property
    def proves_no_path(self) -> bool:
        """Whether it is proven, at any resolution of the picture, that no path leads from the start to a goal.

        Either cells that are blocked as a whole separate them, or no configuration reaches the goal, or the goals are
        configurations that are not free. False if the path answers the query, or if the query is open.
        """
        if self.start is None or self.found or not self.targets:
            return False
        if self.start_blocked_by:
            return True
        joint_goals = all(isinstance(target, JointGoal) for target in self.targets)
        if joint_goals and all(self.goals_blocked_by):
            return True
        return self.decomposition is not None and self.decomposition.proves_no_path

    def with_result(self, result: PlanResult) -> Self:
        """A copy with a planner's result for the query: its path and, if it kept one, its tree."""
        of_kind("result", result, PlanResult)
        path = None if result.path is None else result.path.waypoints
        found = replace(self, path=path, tree=result.tree)
        if path is None and "decomposition" in self.__dict__:
            found.__dict__["decomposition"] = self.decomposition
        return found

    @cached_property
    def drawn_tree(self) -> DrawnTree | None:
        """The tree as drawn in pictures and pages, thinned if it is huge; None if there is none, or it has no edges."""
        if self.tree is None or len(self.tree.edges) == 0:
            return None
        return drawn_tree(self.tree, self.start, self.goals)


def _numbered(name: str, count: int) -> tuple[str, ...]:
    return (name,) if count == 1 else tuple(f"{name} {k}" for k in range(1, count + 1))


_Query = TypeVar("_Query", bound=CSpaceQuery)


def compute_query(
    kind: type[_Query],
    scene: Scene,
    problem: Problem | None = None,
    *,
    result: PlanResult | None = None,
    arm: str | None = None,
    joints: Sequence[str] | None = None,
    at: str | ArrayLike | None = None,
    resolution: int = 360,
    progress: ProgressCallback | None = None,
) -> _Query:
    """A query of class `kind` with its cells and goal configurations; for other arguments and errors see `cspace`."""
    of_kind("scene", scene, Scene)
    of_kind("problem", problem, Problem, optional=True)
    of_kind("result", result, PlanResult, optional=True)
    check_callback("progress", progress)
    if problem is None and result is not None:
        raise InputError("a result is drawn with its problem; give it, too: cspace(scene, problem, result=result)")
    if problem is not None:
        problem = problem.in_scene(scene)
        _check_problem(problem, arm, joints)
        arm = problem.arms[0]
    if at is not None:
        arm = scene.only_arm(arm)
        scene = _slice_scene(scene, arm, two_joints(scene, arm, joints), at)
    grid = compute_grid(scene, arm, joints, resolution, fraction_callback("cspace", progress))
    if problem is None:
        return kind(grid)
    goals, unreached = goals_by_name(problem)
    picture = kind(
        grid,
        read_only(np.array(problem.start)),
        tuple(goals.values()),
        goal_names=tuple(goals),
        targets=problem.goal[problem.arms[0]],
        unreached=unreached,
    )
    return picture if result is None else picture.with_result(result)


def _slice_scene(scene: Scene, arm: str, joints: Sequence[str], at: str | ArrayLike) -> Scene:
    """The scene with all joints of an arm at `at` except the two that the picture shows."""
    robot, q = scene.arms[arm].robot, np.array(scene.arms[arm].q)
    others = [i for i, name in enumerate(robot.joint_names) if name not in joints]
    if not others:
        raise InputError(f"option at has no effect: arm {arm!r} has no joints but {' and '.join(joints)}")
    q[others] = robot.configuration(at, "option at")[others]
    for i in others:
        lower, upper = robot.limits.lower[i], robot.limits.upper[i]
        if not lower <= q[i] <= upper:
            raise InputError(
                f"option at has joint {robot.joint_names[i]!r} at {q[i]:.6g}, expected {lower:.6g} to {upper:.6g}"
            )
    return scene.with_configuration(arm, q)


def _check_problem(problem: Problem, arm: str | None, joints: Sequence[str] | None) -> None:
    if len(problem.arms) != 1 or problem.nq != 2:
        raise InputError(
            f"the problem moves {counted(problem.nq, 'joint')} of {counted(len(problem.arms), 'arm')}, expected two of "
            "one arm; a slice of a larger configuration space takes the scene alone"
        )
    if arm is not None and arm != problem.arms[0]:
        raise InputError(f"arm is {shown(arm)}, but the problem moves {problem.arms[0]!r}")
    known = problem.scene.arms[problem.arms[0]].robot.joint_names
    asked = known if joints is None else items_of("joints", joints, "two names")
    if asked != known:
        raise InputError(
            f"the joints are {', '.join(map(str, asked))}, but the problem's columns are {', '.join(known)}"
        )


def goals_by_name(problem: Problem) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Configurations (2,) that reach the goal of a two-joint problem, in collision or not, by their names.

    A joint goal is its own configuration. For a goal of position (or pose, or region) they are the solutions of inverse
    kinematics, e.g. both elbows; if there are none, the goal's name and the reason are in the second result.
    """
    arm = problem.arms[0]
    kinematics = Kinematics(problem.scene, problem.arms)
    targets = problem.goal[arm]
    found: dict[str, Array] = {}
    unreached = []
    for name, target in zip(_numbered("goal", len(targets)), targets, strict=True):
        if isinstance(target, JointGoal):
            found[name] = read_only(np.array(target.q))
            continue
        answer = solve_ik(kinematics, target, rng=0, max_solutions=_MOST_SOLUTIONS)
        names = _numbered(f"{name}, IK", len(answer.solutions)) if len(answer.solutions) > 1 else (name,)
        found |= zip(names, answer.solutions, strict=False)
        unreached += [] if answer.found else [f"{name}: {answer.reason}"]
    return found, tuple(unreached)
