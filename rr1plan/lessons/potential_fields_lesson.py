"""Lesson "potential_fields": the goal attracts, obstacles repel, and descents end in local minima."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rr1plan.checks import Array
from rr1plan.errors import InputError
from rr1plan.lessons.lesson import Lesson, LessonStep
from rr1plan.lessons.lesson_panel import lesson_panel
from rr1plan.lessons.lesson_scenes import length_scale, length_unit, require_flat_arm, require_query
from rr1plan.lessons.mathml import fraction, math, power, row, sub
from rr1plan.lessons.potential_field import (
    FINER,
    MOVES,
    Indices,
    attraction,
    coarse_grid,
    descend,
    fill_minima,
    obstacle_distance,
    reached_share,
    repulsion,
    wave,
)
from rr1plan.playback.cspace.configuration_space import cspace
from rr1plan.playback.cspace.cspace_torus import layer_image, wrapped_pieces
from rr1plan.scene import Scene
from rr1plan.scene.model_library import load_problems
from rr1plan.scene.problem import JointGoal, Problem

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rr1plan.playback.viewer.view_options import Panel

GAINS = (0.0, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0)  # times the fourth power of the scale of lengths
REACHES = (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8)  # times that scale; offered if above the side of a cell
GAIN, REACH = 0.03, 0.4
_INK, _PATH = "#22262b", "#d55e00"
# A query in the scene of the lesson about planning: a descent that gets stuck, and a goal away from all obstacles.
_START, _GOAL = (-0.9, -2.6), (2.0, 2.7)


class PotentialFieldsLesson(Lesson):
    """Attractive and repulsive potentials, local minima, best-first search and the wave from the goal."""

    name = "potential_fields"
    _aspect = 0.4

    def __init__(self, scene: Scene | None, problem: Problem | None) -> None:
        problem = require_query(self.name, scene, problem) or _default_query()
        require_flat_arm(self.name, problem.scene)
        goal = problem.goal[problem.arms[0]][0]
        assert isinstance(goal, JointGoal)
        self.problem, self.scene, self.goal = problem, problem.scene, np.array(goal.q)
        self.picture = cspace(problem.scene, problem)
        self.grid = coarse_grid(self.picture.grid)
        for end, q in (("start", problem.start), ("goal", self.goal)):
            if not self.grid.free[self.grid.cell(q)]:
                raise InputError(
                    f"the cell of the {end} is not free; try another {end}, away from obstacles and limits"
                )
        self.distance = obstacle_distance(self.grid)
        self.scale = length_scale(self.picture.grid)
        self.gain = self.scale**4 * GAIN
        reaches = [self.scale * reach for reach in REACHES]
        self.reaches = [reach for reach in reaches if reach > self.grid.sides.max()] or reaches[-1:]
        # Within the distance of influence of an obstacle the goal would not be the lowest point.
        below = min(self.scale * REACH, float(self.distance[self.grid.cell(self.goal)]))
        self.reach = max((reach for reach in self.reaches if reach <= below), default=self.reaches[0])
        self.attractive = attraction(self.grid, self.goal)
        self.total = self.attractive + repulsion(self.distance, self.gain, self.reach)
        self.wave = wave(self.grid, self.goal)
        self.steps = _steps(self)

    # ---- the page ------------------------------------------------------------------------

    def _panels(self) -> tuple[Panel, ...]:
        data = {
            "finer": FINER,
            "moves": [list(move) for move in MOVES],
            "gains": [self.scale**4 * gain for gain in GAINS],
            "reaches": self.reaches,
            "usual": [self.gain, self.reach],
            "unit": length_unit(self.picture.grid.turns),
            "scale": self.scale,
        }
        return (lesson_panel("potential", "Potential field", data, ("walk.js",)),)

    # ---- the figure ----------------------------------------------------------------------

    def _draw(self, figure: Figure) -> None:
        plots = figure.subplots(1, 3)
        start = self.problem.start
        down, waved = descend(self.grid, self.total, start), descend(self.grid, self.wave, start)
        share = 100 * reached_share(self.grid, self.total, self.goal)
        top = float(self.attractive.max())
        self._draw_field(plots[0], self.attractive, top, descend(self.grid, self.attractive, start))
        plots[0].set_title("attractive potential", loc="left")
        self._draw_field(plots[1], self.total, top, down)
        plots[1].set_title(f"with repulsion: {share:.0f} % reach the goal", loc="left")
        self._draw_field(plots[2], self.wave, float(self.wave[np.isfinite(self.wave)].max()), waved)
        plots[2].set_title("wave from the goal", loc="left")

    def _draw_field(self, axes: Axes, values: Array, top: float, cells: Indices) -> None:
        space, shape = self.picture.grid, values.shape
        high = self.grid.low + self.grid.sides * shape
        extent = (self.grid.low[0], high[0], self.grid.low[1], high[1])
        axes.imshow(layer_image(space), origin="lower", extent=extent, interpolation="nearest", aspect="auto")
        shown = np.where(self.grid.free & np.isfinite(values), np.minimum(values, top), np.nan)
        centers = self.grid.centers()
        axes.contourf(centers[:, 0, 0], centers[0, :, 1], shown.T, levels=14, cmap="cividis")
        path = centers[tuple(cells.T)]
        path = np.where(self.grid.periodic, np.unwrap(path, axis=0), path)  # continues across the seams
        for piece in wrapped_pieces(path, space):
            axes.plot(*piece.T, color="white", lw=4.5)
            axes.plot(*piece.T, color=_PATH, lw=2.4)
        axes.plot(*space.wrapped(path[-1]), "X", color=_PATH, mec="white", ms=11, zorder=4)
        for q, marker, size in ((self.problem.start, "o", 9), (self.goal, "*", 16)):
            axes.plot(*space.wrapped(q), marker, color=_INK, mec="white", ms=size, zorder=5)
        axes.set(xlim=extent[:2], ylim=extent[2:], box_aspect=1)
        axes.locator_params(nbins=5)
        for axis, name, turns in zip((axes.xaxis, axes.yaxis), space.joint_names, space.turns, strict=True):
            axis.set_label_text(f"{name} [{'rad' if turns else 'm'}]")


def _default_query() -> Problem:
    return Problem(load_problems("planar2r_path")["over_the_seam"].scene, _START, JointGoal(_GOAL))


def _steps(lesson: PotentialFieldsLesson) -> tuple[LessonStep, ...]:
    grid, goal, start = lesson.grid, lesson.goal, lesson.problem.start
    down = descend(grid, lesson.total, start)
    ends = bool(grid.cell(goal) == tuple(down[-1].tolist()))
    share = 100 * reached_share(grid, lesson.total, goal)
    filled = fill_minima(grid, lesson.total, start, goal)
    connected = bool(np.isfinite(lesson.wave[grid.cell(start)]))
    free = int(grid.free.sum())
    torus = ", here around the torus if that is shorter" if any(grid.periodic) else ""
    attractive = math(sub("U", "att"), "=", fraction("1", "2"), power("d", 2))
    near = row("(", fraction("1", "ρ"), "−", fraction("1", "R"), ")")
    repulsive = math(sub("U", "rep"), "=", fraction("1", "2"), "η", power(near, 2))
    if ends:
        outcome = "It reaches the goal."
    elif lesson.reach > lesson.distance[grid.cell(goal)]:
        outcome = "It ends in a <b>local minimum</b>: an obstacle nearer than R pushes the arm away from the goal."
    else:
        outcome = "It ends in a <b>local minimum</b>: the goal pulls into an obstacle."
    filling = (
        f"From this start it visits {filled.visited:,} of {free:,} free cells."
        if len(filled.cells)
        else "From this start it visits every cell that is connected, and no goal is among them."
    )
    arrival = (
        "From every connected cell, also from this start, the descent arrives."
        if connected
        else "Here it does not come to the start: no path exists on this grid."
    )
    texts = (
        (
            "attraction",
            "The goal attracts",
            f"""<p>A planner searches; a <b>potential field</b> tells the arm at every configuration where to go. The
            goal is the lowest point of {attractive}, with the distance d to it{torus}. The arm moves downhill, along
            the negative gradient; here from cell to cell of a grid, always to the lowest neighbor.</p><p>Press
            <b>Descend</b> (space). Where an obstacle is in the way, the arm stops in front of it (×).</p>""",
        ),
        (
            "repulsion",
            "Obstacles repel",
            f"""<p>Each configuration that is nearer than R to an obstacle’s image, at the distance ρ, is pushed away:
            {repulsive}, and 0 beyond R, the distance of influence. It grows without bound at the obstacle, so a
            descent never touches one.</p><p>Move the sliders: the gain η makes the hills steeper, R makes them wider.
            (Khatib 1986, with distances in the workspace)</p>""",
        ),
        (
            "sum",
            "The sum, and where it ends",
            f"""<p>The arm follows the sum of both. {outcome} There attraction and repulsion cancel, and every neighbor
            is higher. Descend again, from other starts: drag the point ● of the start.</p><p>A descent needs the
            gradient at one point only, no map and no search. That makes it fast enough to react at every control
            step.</p>""",
        ),
        (
            "basins",
            "Basins of attraction",
            f"""<p>From the plain cells the descent ends at the goal: {share:.0f} % of the free ones with the default
            gains. From the striped cells it ends in a local minimum (×). Change gain and R, drag an obstacle: minima
            move, merge and split. In a space with holes the force always vanishes at some points other than the goal
            (Koditschek 1987).</p><p>If R exceeds the goal’s own distance to an obstacle, the lowest point moves off
            the goal, and no descent ends there.</p>""",
        ),
        (
            "fill",
            "Fill the minima",
            f"""<p><b>Best-first search</b> always continues at the lowest cell that it has seen. In a minimum it
            spreads like water until it overflows. {filling}</p><p>That is a search on a grid again: with two joints it
            has {grid.free.size:,} cells, with six {grid.free.shape[0]}⁶. Random walks out of minima work there
            (Barraquand, Latombe 1991), and so do the planners of the lesson “Planning step by step”.</p>""",
        ),
        (
            "wave",
            "A field without local minima",
            f"""<p>Let a <b>wave</b> run from the goal through the free cells; each gets the number of steps to the
            goal. Every cell with a number has a neighbor with a smaller one, so there is no minimum but the goal.
            {arrival}</p><p>Such a <b>navigation function</b> costs the whole grid, and its paths graze the obstacles.
            (LaValle 8.2; Choset 4.5)</p>""",
        ),
        (
            "use",
            "What potential fields are for",
            """<ul><li>Reacting: a controller that avoids what sensors see, at every control step, along a path that a
            planner has found.</li><li>Guiding: costs for search and optimization, as in CHOMP.</li></ul>
            <p>What they are not: a complete planner. A descent that stops has proven nothing, and gains that work for
            one query fail for the next. (Koren, Borenstein 1991; Siciliano 12.6; Lynch, Park 10.6)</p>""",
        ),
    )
    return tuple(LessonStep(name, title, text, tuple(start.tolist())) for name, title, text in texts)
