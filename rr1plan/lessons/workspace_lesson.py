"""Lesson "workspace": what the tool reaches, and in how many ways."""

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
from rr1plan.playback.cspace.cspace_grid import LIMITS
from rr1plan.playback.cspace.cspace_page import page_parts
from rr1plan.playback.cspace.cspace_torus import draw_torus
from rr1plan.playback.cspace.cspace_workspace import draw_workspace
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rr1plan.playback.viewer.page_document import Document
    from rr1plan.playback.viewer.view_options import Panel, ViewOptions

_TURN = 2.0 * np.pi
# Reached in two ways, in one; told apart without seeing red or green, and by hatching.
TWICE, ONCE = "#9dbfe8", "#f6c98f"
_PIXELS = 420  # of the map in the figure


class WorkspaceLesson(Lesson):
    """What the tool of a planar arm reaches: the annulus, joint limits, obstacles."""

    name = "workspace"

    def __init__(self, scene: Scene | None, problem: Problem | None) -> None:
        refuse_problem(self.name, problem)
        self.scene = two_link_scene() if scene is None else scene
        _, self.arm = require_flat_arm(self.name, self.scene)
        self.picture = cspace(self.scene)
        self.steps = _steps(self.arm)

    def _page(self, options: ViewOptions) -> tuple[Document, tuple[Panel, ...]]:
        document, panel = page_parts(self.picture, options=options)
        return document, (panel,)

    def _data(self) -> Any:
        return {"colors": [TWICE, ONCE], "limits": LIMITS}

    def _draw(self, figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        draw_workspace(left, self.picture)
        x, y = (np.linspace(low, high, _PIXELS) for low, high in (left.get_xlim(), left.get_ylim()))
        counts = solution_counts(self.picture, self.arm, np.stack(np.meshgrid(x, y), axis=-1))
        left.contourf(
            x, y, counts, levels=(0.5, 1.5, 2.5), colors=(ONCE, TWICE), hatches=("//", None), alpha=0.75, zorder=1
        )
        left.set_title("workspace", loc="left")
        draw_torus(right, self.picture)
        handles = [
            Patch(facecolor=TWICE, label="reached in two ways"),
            Patch(facecolor=ONCE, hatch="//", label="in one way"),
            Patch(facecolor="#eef1f5", label="not at all"),
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)


def solution_counts(
    picture: CSpace, arm: FlatArm, points: ArrayLike, ignore: tuple[str, ...] = ()
) -> NDArray[np.int64]:
    """In how many ways the tool reaches points of the plane, by the cells of the configuration space.

    Args:
        picture: The configuration space.
        arm: The arm.
        points: Positions [m], shape (..., 2).
        ignore: Layers that do not count, e.g. "joint limits" or an obstacle.

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


def _steps(arm: FlatArm) -> tuple[LessonStep, ...]:
    a, c = (abs(bar) for bar in arm.bars)
    first, second = sub("l", 1), sub("l", 2)
    reach = math("|", first, "−", second, "|", "≤", "r", "≤", first, "+", second)
    return (
        LessonStep(
            "annulus",
            "What the tool can reach",
            f"""<p>Two links of lengths {math(first)} = {a:g} m and {math(second)} = {c:g} m. Stretched, the tool is
            farthest from the base; folded, it is nearest. What lies between is the <b>workspace</b>, an annulus:
            {reach}, here {abs(a - c):.3g} m ≤ {math("r")} ≤ {a + c:.3g} m.</p>
            <p>Drag the tool along both rims. Where it cannot follow the pointer, it stays on the rim.</p>""",
            (0.5, 0.9),
        ),
        LessonStep(
            "elbows",
            "Two elbows for one point",
            """<p>A point inside the annulus is reached <b>twice</b>, with the elbow on the left or on the right. On
            the rims both solutions are one: the arm is straight or folded, it is singular.</p>
            <p>The hollow ring in the configuration space is the other solution. Press <kbd>E</kbd> to go there: the
            tool stays where it is.</p>""",
            (0.5, 0.9),
        ),
        LessonStep(
            "limits",
            "Joint limits take solutions away",
            """<p>A joint with limits forbids the gray margins of the configuration space. Points whose one solution
            is in there are reached <b>once</b>, points with both in there never.</p>
            <p>Drag the tool from blue to striped and press <kbd>E</kbd>: the arm would leave its limits.</p>""",
            (0.5, 0.9),
        ),
        LessonStep(
            "obstacles",
            "So do obstacles",
            """<p>A solution in which a link touches an obstacle does not count either. An obstacle therefore takes
            more of the workspace than its own area: it has a <b>shadow</b>, which no link passes.</p>
            <p>Reached in two ways, in one, or in none: the boundaries are images of the boundaries in the
            configuration space.</p>""",
            (0.5, 0.9),
        ),
        LessonStep(
            "question",
            "Reached is not yet attainable",
            """<p>A point counts here if the arm can <i>stand</i> there. Whether it can <i>get</i> there from where
            it is now depends on how the free configurations hang together.</p>
            <p>Find two blue points between which the arm cannot move with the elbow on the same side. The lesson
            <i>Configuration space</i> shows why.</p>""",
            (-0.5, -0.9),
        ),
    )
