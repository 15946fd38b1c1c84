"""Lesson "no_path": start and goal are free, no path connects them, and that is proven."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.colors import to_rgba
from matplotlib.patches import Patch

from rr1plan.errors import InputError
from rr1plan.lessons.lesson import Lesson, LessonStep
from rr1plan.lessons.lesson_scenes import require_flat_arm
from rr1plan.planners import RrtConnect
from rr1plan.planning import Budget
from rr1plan.playback.cspace.configuration_space import CSpace, cspace
from rr1plan.playback.cspace.cspace_colors import end_tints
from rr1plan.playback.cspace.cspace_decomposition import Decomposition
from rr1plan.playback.cspace.cspace_figure import fit_names, swatch
from rr1plan.playback.cspace.cspace_torus import draw_torus
from rr1plan.playback.cspace.cspace_workspace import draw_workspace
from rr1plan.playback.viewer.page_arrays import pack_array
from rr1plan.scene import Scene
from rr1plan.scene.model_library import load_problems
from rr1plan.scene.problem import Problem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Of the planner's unsuccessful search: short edges [rad or m] show the explored region.
_RANGE, _ITERATIONS = 0.15, 1500
FULL, REACHED = "#3c4450", "#9dbfe8"


class NoPathLesson(Lesson):
    """Components of free space, and a proof by certified cells that no path connects two of them."""

    name = "no_path"

    def __init__(self, scene: Scene | None, problem: Problem | None) -> None:
        if problem is None:
            if scene is not None:
                raise InputError(
                    "lesson 'no_path' is about a query; give a problem in your scene (on the command line: --query)"
                )
            problem = load_problems("planar2r_no_path")["no_way"]
        self.scene = problem.scene
        require_flat_arm(self.name, self.scene)
        self.picture = cspace(self.scene, problem)
        picture = self.picture
        ends_free = picture.goals and not picture.start_blocked_by and not any(picture.goals_blocked_by)
        if not picture.proves_no_path or picture.decomposition is None or not ends_free:
            raise InputError(
                f"lesson 'no_path' needs free ends that no path joins, and a proof of it; here: {picture.verdict}"
            )
        self.cells = picture.decomposition
        result = RrtConnect(range=_RANGE, tree=True).plan(problem, budget=Budget(10.0, _ITERATIONS), rng=0)
        self.picture = self.picture.with_result(result)
        self.steps = _steps(self.picture, self.cells)

    def _data(self) -> Any:
        cells = self.cells
        return {
            "size": cells.resolution,
            "lower": cells.lower.tolist(),
            "upper": cells.upper.tolist(),
            "kinds": pack_array(np.where(cells.full, 1, np.where(cells.reached, 2, 0)), "u4"),
            "colors": {"full": FULL, "reached": REACHED},
        }

    def _draw(self, figure: Figure) -> None:
        # Without the trees, which would hide the cells.
        picture, cells = replace(self.picture, tree=None), self.cells
        left, right = figure.subplots(1, 2)
        drawn = {left: draw_workspace(left, picture), right: draw_torus(right, picture)}
        (x0, y0), (x1, y1) = cells.lower, cells.upper
        blocked = np.zeros((*cells.full.shape, 4))
        blocked[cells.full] = to_rgba(FULL, 0.7)
        over = {"origin": "lower", "aspect": "auto", "interpolation": "nearest", "zorder": 1.5}
        right.imshow(blocked.transpose(1, 0, 2), extent=(x0, x1, y0, y1), **over)
        tints = [swatch(color, k) for k, color in enumerate(end_tints(picture).values())]
        names = ["joined to the start", *["joined to the goal"] * (len(tints) - 1)]
        handles = [*tints, Patch(facecolor=FULL, alpha=0.8)]
        labels = [*names, f"cells proven to be blocked, {cells.resolution} × {cells.resolution}"]
        figure.legend(handles, labels, loc="outside lower center", ncols=len(handles), frameon=False)
        fit_names(figure, drawn)


def _steps(picture: CSpace, cells: Decomposition) -> tuple[LessonStep, ...]:
    assert picture.start is not None
    start = tuple(picture.start.tolist())
    parts, size = picture.grid.components, cells.resolution
    around = (
        """The square is misleading: its dashed edges meet, so a path may leave on one side and re-enter on the other.
        The obstacles that separate start and goal form a closed ring around the reachable region, also across the
        seams.</p><p>One image that goes around the torus does not separate it: it leaves an annulus in one piece.
        Two that go around it the same way do."""
        if any(picture.grid.periodic)
        else """No joint turns across a seam here, so the rectangle is the whole space. The obstacles and the joint
        limits form a closed ring around the reachable region."""
    )
    return (
        LessonStep(
            "ends",
            "Both ends are free",
            """<p>The arm stands at the start and touches nothing. Click the star: at the goal it touches nothing
            either. Inverse kinematics, a collision check and a look at the workspace find no fault.</p>
            <p>Is there a motion from one to the other?</p>""",
            start,
        ),
        LessonStep(
            "by-hand",
            "Try it by hand",
            """<p>Drag the point from the start to the star without entering a color. The two sliders and the tool
            move the arm too.</p>
            <p>Where do you get stuck, and which obstacles stop you?</p>""",
            start,
        ),
        LessonStep(
            "components",
            "Free space has components",
            f"""<p>Configurations that a path can connect form a <b>component</b>. Here free space has {parts} of them,
            one tint each. Start and goal are in different ones.</p>
            <p>A path cannot change its component: it is a connected set, and the components are not connected.</p>""",
            start,
        ),
        LessonStep(
            "seams",
            "Nor around the torus" if any(picture.grid.periodic) else "Nor along the limits",
            f"<p>{around}</p>",
            start,
        ),
        LessonStep(
            "planner",
            "A planner can only give up",
            """<p>RRT-Connect grew a tree from the start and one from the goal. Each fills its component, and they
            never meet. Press <i>Grow</i>.</p>
            <p>Such planners are <b>probabilistically complete</b>: if there is a path with some clearance, the
            probability that they find one tends to 1. If there is none, they run until their budget ends, and that
            proves nothing.</p>""",
            start,
        ),
        LessonStep(
            "proof",
            "Cells prove it",
            f"""<p>Cut the square into {size} × {size} cells. A dark cell is <b>blocked as a whole</b>: one link is so
            deep in one obstacle that they touch in every configuration of the cell. This is a bound, not a sample.</p>
            <p>Light cells are all cells that can be reached from the start without crossing a dark one, also across
            corners. No goal is among them. So <b>no path exists</b>, at any resolution.</p>""",
            start,
        ),
    )
