"""`cspace`: the workspace and the configuration space of two joints, side by side.

The picture every course on motion planning begins with: the arm among its obstacles on the left,
each obstacle's image in the torus of joint angles on the right, and the same path in both.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from rr1plan.checks import Array, Value, counted, file_path, of_kind, read_only
from rr1plan.errors import InputError
from rr1plan.kinematics import Kinematics, solve_ik
from rr1plan.planning import PlanResult, SearchTree
from rr1plan.playback.cspace_grid import CSpaceGrid, compute_grid
from rr1plan.problem import JointGoal, PoseGoal, Problem
from rr1plan.scene import Scene


@dataclass(frozen=True, eq=False, repr=False)
class CSpace(Value):
    """A configuration space with a question and its answer drawn into it.

    Args:
        grid: Cells, layers and components.
        start: Where the query starts [rad], shape (2,), or None.
        goals: Configurations that reach the goal (both elbow solutions), each (2,).
        path: Waypoints of the answer [rad], shape (k, 2), or None.
        tree: What the planner explored, or None.
    """

    grid: CSpaceGrid
    start: Array | None = None
    goals: tuple[Array, ...] = ()
    path: Array | None = None
    tree: SearchTree | None = None

    @property
    def reachable_goals(self) -> tuple[bool, ...]:
        """For each goal configuration, whether it is in the start's component of free space on the grid."""
        if self.start is None:
            return tuple(False for _ in self.goals)
        return tuple(self.grid.connected(self.start, goal) for goal in self.goals)

    @property
    def proves_no_path(self) -> bool:
        """The start is free on the grid and no goal configuration is in its component."""
        return self.start is not None and bool(self.goals) and not any(self.reachable_goals)

    def figure(self, width: float = 13.0) -> Any:
        """A matplotlib figure: workspace left, configuration space right."""
        from rr1plan.playback.cspace_figure import draw

        return draw(self, width)

    def save_png(self, file: str | FilePath, dpi: int = 150) -> FilePath:
        """Write the picture as PNG, atomically."""
        from rr1plan.playback.cspace_figure import save

        return save(self, file_path(file), "png", dpi)

    def save_svg(self, file: str | FilePath) -> FilePath:
        """Write the picture as SVG, for slides, atomically."""
        from rr1plan.playback.cspace_figure import save

        return save(self, file_path(file), "svg", 150)

    def save_html(self, file: str | FilePath, **options: Any) -> FilePath:
        """Write one offline page: the arm in 3-D and the configuration space, linked by sliders and clicks."""
        from rr1plan.playback.cspace_page import save_page

        return save_page(self, file, **options)

    def show(self, **options: Any) -> Any:
        """Open the same page live and print its address; end a script with `show().wait()`."""
        from rr1plan.playback.cspace_page import show_page

        return show_page(self, **options)

    def __str__(self) -> str:
        grid = self.grid
        count = grid.free.size
        lines = [
            f"configuration space of {grid.joint_names[0]} and {grid.joint_names[1]}: "
            f"{grid.free.shape[0]} x {grid.free.shape[1]} cells, {grid.free.sum() / count:.1%} free, "
            f"{counted(grid.components, 'component')} of free space"
        ]
        lines += [f"  {name}: {mask.sum() / count:.1%} of the cells" for name, mask in grid.layers.items()]
        for k, (goal, reachable) in enumerate(zip(self.goals, self.reachable_goals, strict=True), 1):
            where = f"goal {k} ({goal[0]:+.3f}, {goal[1]:+.3f})"
            if not grid.component_of(goal):
                lines.append(f"  {where}: not free ({', '.join(grid.why_not_free(goal))})")
            else:
                lines.append(f"  {where}: {'same component as' if reachable else 'cut off from'} the start")
        if self.proves_no_path:
            lines.append("  no path exists on this grid: start and goal lie in different components")
        return "\n".join(lines)


def cspace(
    scene: Scene,
    problem: Problem | None = None,
    result: PlanResult | None = None,
    *,
    arm: str | None = None,
    joints: tuple[str, str] | None = None,
    resolution: int = 360,
    progress: Callable[[float], None] | None = None,
) -> CSpace:
    """The configuration space of an arm with two joints (or of two joints of a bigger one).

    Args:
        scene: The scene.
        problem: A query to draw into it: its start and all configurations that reach its goal.
        result: The planner's answer to that query: its path and, if it kept one, its tree.
        arm: The arm (default: the problem's, or the only one).
        joints: Two of its planning joints (default: the first two). A problem and a result can be drawn
            only when the arm has no other planning joints.
        resolution: Cells along each axis; every cell is checked with Coal.
        progress: Called with the fraction done, 0 to 1.

    Returns:
        A value that draws itself: `save_png`, `save_svg`, `save_html`, `show`.

    Raises:
        UnknownNameError: no such arm or joint.
        InputError: not two joints, a resolution below 8, or a problem with other columns.
    """
    of_kind("scene", scene, Scene)
    of_kind("problem", problem, Problem, optional=True)
    of_kind("result", result, PlanResult, optional=True)
    if problem is not None:
        _check_problem(problem, arm, joints)
        arm = problem.arms[0]
    grid = compute_grid(scene, arm, joints, resolution, progress)
    if problem is None:
        return CSpace(grid)
    path = None if result is None or result.path is None else result.path.waypoints
    return CSpace(
        grid,
        read_only(np.array(problem.start)),
        goal_solutions(problem),
        path,
        None if result is None else result.tree,
    )


def _check_problem(problem: Problem, arm: str | None, joints: tuple[str, str] | None) -> None:
    if len(problem.arms) != 1 or problem.nq != 2:
        raise InputError(f"the problem has {problem.nq} columns, only one with two can be drawn in the plane")
    if arm is not None and arm != problem.arms[0]:
        raise InputError(f"arm is {arm!r}, but the problem moves {problem.arms[0]!r}")
    known = problem.scene.arms[problem.arms[0]].robot.joint_names
    if joints is not None and tuple(joints) != known:
        raise InputError(f"joints is {joints!r}, but the problem's columns are {known!r}")


def goal_solutions(problem: Problem) -> tuple[Array, ...]:
    """Every configuration (2,) that reaches the goal of a two-joint problem, in collision or not.

    A joint goal is drawn with its twin that puts the tool in the same place (the other elbow).
    """
    arm = problem.arms[0]
    kinematics = Kinematics(problem.scene, problem.arms)
    robot = problem.scene.arms[arm].robot
    found: list[Array] = []
    for goal in problem.goal[arm]:
        if isinstance(goal, JointGoal):
            found.append(np.array(goal.q))
        else:
            found += list(solve_ik(kinematics, goal, arm, rng=0).solutions)
    if len(found) == 1 and isinstance(problem.goal[arm][0], JointGoal):
        tool = kinematics.pose(found[0], f"{arm}/{robot.tool}")[:3, 3]
        twins = solve_ik(kinematics, PoseGoal(robot.tool, tool), arm, rng=0).solutions
        found += [q for q in twins if np.abs(np.angle(np.exp(1j * (q - found[0])))).max() > 1e-3]
    return tuple(read_only(np.array(q)) for q in found)
