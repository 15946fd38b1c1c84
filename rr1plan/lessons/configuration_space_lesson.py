"""Lesson "configuration_space": the arm as a point among the images of the obstacles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rr1plan.lessons.lesson import Lesson, LessonStep
from rr1plan.lessons.lesson_scenes import polygon_scene, refuse_problem, require_flat_arm
from rr1plan.lessons.mathml import math, sub
from rr1plan.lessons.torus_picture import draw_torus_surface
from rr1plan.playback.cspace.configuration_space import cspace
from rr1plan.playback.cspace.cspace_figure import fit_names
from rr1plan.playback.cspace.cspace_grid import CSpaceGrid
from rr1plan.playback.cspace.cspace_torus import draw_torus
from rr1plan.playback.cspace.cspace_workspace import draw_workspace
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class ConfigurationSpaceLesson(Lesson):
    """The configuration space of two joints: images of obstacles, overlaps, seams, the torus."""

    name = "configuration_space"
    _aspect = 0.4

    def __init__(self, scene: Scene | None, problem: Problem | None) -> None:
        refuse_problem(self.name, problem)
        self.scene = polygon_scene() if scene is None else scene
        arm, _ = require_flat_arm(self.name, self.scene)
        self.picture = cspace(self.scene)
        self.steps = _steps(self.picture.grid, tuple(self.scene.arms[arm].q.tolist()))

    def _data(self) -> Any:
        thrown = {name: int(mask.sum()) for name, mask in self.picture.grid.layers.items()}
        obstacles = [name for name in thrown if name in self.scene.obstacles and thrown[name]]
        return {"largest": max(obstacles, key=thrown.__getitem__, default=None)}

    def _draw(self, figure: Figure) -> None:
        closes = all(self.picture.grid.periodic)
        left, middle, *right = figure.subplots(1, 3 if closes else 2)
        names = {left: draw_workspace(left, self.picture), middle: draw_torus(middle, self.picture, note=False)}
        for axes in right:
            draw_torus_surface(axes, self.picture)
        fit_names(figure, names)


def _steps(grid: CSpaceGrid, q: tuple[float, ...]) -> tuple[LessonStep, ...]:
    symbols = [sub("θ" if turns else "d", k + 1) for k, turns in enumerate(grid.turns)]
    pair = math("(", symbols[0], ",", symbols[1], ")")
    straight = "remains straight, because no joint turns" if not any(grid.turns) else "is not straight in the other"
    steps = [
        LessonStep(
            "point",
            "An arm is a point",
            f"""<p>Two numbers {pair} determine the position of every point of the arm. Together they are its
            <b>configuration</b>: one point in the square on the right, the <b>configuration space</b>.</p>
            <p>Drag the point and watch the arm; drag the tool and watch the point. A straight line in one picture
            {straight}.</p>""",
            q,
        ),
        LessonStep(
            "image",
            "An obstacle has an image",
            """<p>A configuration is forbidden if a link touches an obstacle. All configurations in which it touches
            <i>this</i> one are the obstacle’s image. The arm has width, the point has none: the image accounts for
            it.</p>
            <p>Move the arm until it touches an obstacle: the point enters the image of the same color.</p>""",
            q,
        ),
        LessonStep(
            "shapes",
            "Any shape, and exact",
            """<p>Discs, boxes and polygons, also concave ones: an image requires only the distance between two solids.
            Every cell of this picture was decided at its center; where a distance proves that nothing changes in a
            whole block of cells, the block was decided at once.</p>
            <p>Lay the outer link along a side of an obstacle: its contact jumps from one corner to the next, which
            makes a kink in the boundary of the image.</p>""",
            q,
        ),
        LessonStep(
            "overlaps",
            "Overlaps",
            """<p>Where two images overlap (stripes of both colors), the arm touches two obstacles at once. Obstacles
            that do not touch each other can have images that do: together they may close a passage.</p>
            <p>The free configurations are those outside all images.</p>""",
            q,
        ),
    ]
    if grid.turns[0]:
        around = (
            f""" (A second link more than twice as long as the first can touch an obstacle from every
            {math(symbols[0])}: its blob goes all around.)"""
            if grid.turns[1]
            else ""
        )
        strip = LessonStep(
            "strip",
            "Strips and blobs",
            f"""<p>If the <i>first</i> link touches an obstacle, the value of the second joint does not matter, and the
            image is a strip along the axis of {math(symbols[1])}. If only the second link touches, then for each
            {math(symbols[0])} only some {math(symbols[1])} are blocked: the image is a blob.</p>
            <p>Obstacles near the base therefore have strips, and far ones have blobs.{around}</p>""",
            q,
        )
        steps.insert(2, strip)
    if any(grid.periodic):
        both = all(grid.periodic)
        closed = "Both angles" if both else "The angle"
        edges = "left and right, bottom and top" if both else "the dashed edges"
        shape = (
            "Glue both pairs and the square becomes a <b>torus</b>"
            if both
            else "Glue them and the square becomes a <b>cylinder</b>"
        )
        steps.append(
            LessonStep(
                "seams",
                "The edges meet",
                f"""<p>{closed} can turn without limits: π and −π are the same. Edges with the same arrows, {edges}, are
            therefore the same configurations. {shape}.</p>
            <p>Turn a joint across the seam: the point leaves on one side and enters on the other, while the arm moves
            continuously.</p>""",
                q,
            )
        )
    return tuple(steps)
