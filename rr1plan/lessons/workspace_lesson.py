"""Lesson "workspace": the points that the tool reaches, and in how many ways."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.patches import Patch
from numpy.typing import ArrayLike, NDArray

from rr1plan.lessons.lesson import Lesson, LessonStep
from rr1plan.lessons.lesson_scenes import refuse_problem, require_flat_arm, two_link_scene
from rr1plan.lessons.mathml import math, sub
from rr1plan.model.flat_arm import FlatArm
from rr1plan.playback.cspace.configuration_space import CSpace, cspace
from rr1plan.playback.cspace.cspace_figure import fit_names
from rr1plan.playback.cspace.cspace_grid import LIMITS
from rr1plan.playback.cspace.cspace_torus import draw_torus
from rr1plan.playback.cspace.cspace_workspace import draw_workspace
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TURN = 2.0 * np.pi
# Colors of regions reached in two ways and in one; safe for red-green color blindness, and one is hatched.
TWICE, ONCE = "#9dbfe8", "#f6c98f"
_PIXELS = 420  # of the map in the figure


class WorkspaceLesson(Lesson):
    """The workspace of a planar arm: the annulus, joint limits, obstacles."""

    name = "workspace"

    def __init__(self, scene: Scene | None, problem: Problem | None) -> None:
        refuse_problem(self.name, problem)
        self.scene = two_link_scene() if scene is None else scene
        name, self.arm = require_flat_arm(self.name, self.scene)
        self.picture = cspace(self.scene)
        limited = bool(self.picture.grid.layers.get(LIMITS, np.False_).any())
        self.steps = _steps(self.arm, tuple(self.scene.arms[name].q.tolist()), limited)

    def _data(self) -> Any:
        return {"colors": [TWICE, ONCE], "limits": LIMITS}

    def _draw(self, figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        names = {left: draw_workspace(left, self.picture)}
        x, y = (np.linspace(low, high, _PIXELS) for low, high in (left.get_xlim(), left.get_ylim()))
        counts = solution_counts(self.picture, self.arm, np.stack(np.meshgrid(x, y), axis=-1))
        left.contourf(
            x, y, counts, levels=(0.5, 1.5, 2.5), colors=(ONCE, TWICE), hatches=("//", None), alpha=0.75, zorder=1
        )
        left.set_title("workspace", loc="left")
        names[right] = draw_torus(right, self.picture)
        handles = [
            Patch(facecolor=TWICE, label="reached in two ways"),
            # Without a color of the edge PDFs omit the stripes.
            Patch(facecolor=ONCE, edgecolor="black", linewidth=0.0, hatch="//", label="in one way"),
            Patch(facecolor="#eef1f5", label="not at all"),
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
        fit_names(figure, names)


def solution_counts(
    picture: CSpace, arm: FlatArm, points: ArrayLike, ignore: tuple[str, ...] = ()
) -> NDArray[np.int64]:
    """Number of ways in which the tool reaches points of the plane, from the cells of the configuration space.

    Args:
        picture: The configuration space.
        arm: The arm.
        points: Positions [m], shape (..., 2).
        ignore: Layers to ignore, e.g. "joint limits" or an obstacle.

    Returns:
        Numbers 0, 1 or 2, shape (...).
    """
    grid = picture.grid
    blocked = np.zeros(grid.free.shape, dtype=np.bool_)
    for name, mask in grid.layers.items():
        if name not in ignore:
            blocked |= mask
    q = arm.solutions(points)
    cells, inside = [], np.isfinite(q).all(axis=-1)
    for axis, centers in enumerate(grid.axes):
        step = float(centers[1] - centers[0])
        low, value = float(centers[0]) - 0.5 * step, np.nan_to_num(q[..., axis])
        if grid.turns[axis]:
            value = low + (value - low) % _TURN
        index = np.floor((value - low) / step).astype(int)
        inside &= (index >= 0) & (index < len(centers))
        cells.append(np.clip(index, 0, len(centers) - 1))
    return np.asarray((inside & ~blocked[cells[0], cells[1]]).sum(axis=-1))


def _steps(arm: FlatArm, q: tuple[float, ...], limited: bool) -> tuple[LessonStep, ...]:
    return (
        LessonStep(
            "reach",
            "What the tool can reach",
            f"""{_reach(arm)}
            <p>Drag the tool along the boundary. Where it cannot follow the pointer, it stays as near as
            possible.</p>""",
            q,
        ),
        LessonStep("solutions", "How many solutions does a point have?", _solutions(arm), q),
        LessonStep(
            "limits",
            "Joint limits remove solutions",
            _limits(arm, limited),
            q,
        ),
        LessonStep(
            "obstacles",
            "So do obstacles",
            """<p>A solution in which a link touches an obstacle does not count either. An obstacle therefore removes
            more of the workspace than its own area: it has a <b>shadow</b>, which no link can pass.</p>
            <p>Reached in two ways, in one, or in none: the boundaries are images of the boundaries in the
            configuration space.</p>""",
            q,
        ),
        LessonStep(
            "question",
            "Reachable does not mean connected",
            """<p>A point counts here if the arm can <i>stand</i> there. Whether it can <i>get</i> there from where it
            is now depends on how the free configurations are connected.</p>
            <p>Find two colored points between which the arm cannot move. The lesson <i>Configuration space</i>
            shows why.</p>""",
            q,
        ),
    )


def _reach(arm: FlatArm) -> str:
    """The first paragraph about the workspace of an arm, with its formula."""
    a, c = (abs(bar) for bar in arm.bars)
    first, second, slide = sub("l", 1), sub("l", 2), sub("d", 2)
    match arm.kinds:
        case "RR":
            bounds = math("|", first, "−", second, "|", "≤", "r", "≤", first, "+", second)
            return f"""<p>Two links of lengths {math(first)} = {a:g} m and {math(second)} = {c:g} m. Stretched, the
            tool is farthest from the base; folded, it is nearest. The points between these distances are the
            <b>workspace</b>, an annulus: {bounds}, here {abs(a - c):.3g} m ≤ {math("r")} ≤ {a + c:.3g} m.</p>"""
        case "RP":
            return f"""<p>A sleeve of {math(first)} = {a:g} m that turns, and a rod that slides out of it by
            {math(slide)}. The <b>workspace</b> is the set of points that the tool reaches, an annulus:
            {math("r", "=", first, "+", slide)}, between its smallest and its largest value.</p>"""
        case "PR":
            return f"""<p>A carriage that slides, and a link of {math(second)} = {c:g} m that turns on it. The
            <b>workspace</b> is the set of points that the tool reaches: all circles of this radius around positions
            of the carriage.</p>"""
        case _:
            return """<p>A gantry: a beam that slides, and a tool that slides along it. The <b>workspace</b> is the
            set of points that the tool reaches, a rectangle, and the coordinates of the tool are those of the
            joints.</p>"""


def _limits(arm: FlatArm, limited: bool) -> str:
    """The text about joint limits."""
    if not limited:
        return """<p>Joint limits block margins of the configuration space, and a solution in them does not count. No
            configuration in this picture is lost to limits: revolute joints turn without limits here, and the travel
            of sliding joints is the picture’s range.</p>"""
    if arm.kinds in ("RP", "PP"):
        return """<p>Joint limits block the gray margins of the configuration space. Points whose solution is there are
            not reached.</p>"""
    return """<p>Joint limits block the gray margins of the configuration space. Points with one solution there are
            reached <b>once</b>, points with both there never.</p>
            <p>Drag the tool from blue to striped and press <kbd>E</kbd>: the arm would leave its limits.</p>"""


def _solutions(arm: FlatArm) -> str:
    """The text about inverse kinematics without limits and obstacles."""
    other = """<p>The hollow ring in the configuration space is the other solution. Press <kbd>E</kbd> to go there: the
            tool does not move.</p>"""
    first, second = (abs(bar) for bar in arm.bars)
    middle = " With links of equal length the tool reaches the base: there every θ<sub>1</sub> is a solution."
    middle = middle if np.isclose(first, second, rtol=1e-9) else ""
    match arm.kinds:
        case "RR":
            return f"""<p>A point inside the annulus has <b>two</b> solutions, with the elbow on the left or on the
            right. On the boundaries the two coincide: the arm is straight or folded, it is
            <b>singular</b>.{middle}</p>{other}"""
        case "RP":
            return """<p>A direction and a distance determine both joints, so a point has <b>one</b> solution. The
            second solution of the equations points backwards, with a negative distance: most rods cannot do
            that.</p>"""
        case "PR":
            return f"""<p>The carriage can be on the left of a point or on its right: <b>two</b> solutions, if its
            travel is long enough. With the link at a right angle to the rail the two coincide, and the arm is
            <b>singular</b>.</p>{other}"""
        case _:
            return """<p>Each coordinate belongs to one joint, so every point has <b>one</b> solution, and the arm
            is never singular, which makes gantries easy to program.</p>"""
