"""Lesson "planning": planners step by step, in the configuration space and in the workspace."""

from __future__ import annotations

from functools import cached_property
from html import escape
from textwrap import fill
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rr1plan.checks import Array
from rr1plan.lessons.lesson import Lesson, LessonStep
from rr1plan.lessons.lesson_panel import lesson_panel
from rr1plan.lessons.lesson_scenes import length_digits, length_scale, length_unit, require_query
from rr1plan.lessons.search.lattice_search import search_lattice
from rr1plan.lessons.search.roadmap_growth import grow_prm
from rr1plan.lessons.search.search_record import BLOCKED, EDGE, EVENTS, REFUSED, SearchRecord
from rr1plan.lessons.search.search_space import SearchSpace
from rr1plan.lessons.search.tree_growth import grow_rrt, grow_rrt_connect, grow_rrt_star
from rr1plan.model import Kinematics
from rr1plan.playback.cspace.configuration_space import cspace
from rr1plan.playback.cspace.cspace_torus import layer_image, wrapped_pieces
from rr1plan.playback.viewer.page_arrays import pack_array
from rr1plan.scene import Scene
from rr1plan.scene.model_library import load_problems
from rr1plan.scene.problem import Problem

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

    from rr1plan.playback.viewer.view_options import Panel

# Colors of the planners, in the order of the lesson; safe for red-green color blindness, and lines differ in dashes.
COLORS = {
    "Dijkstra": "#7a8594",
    "A*": "#22262b",
    "RRT": "#d55e00",
    "RRT-Connect": "#0072b2",
    "RRT*": "#a3428f",
    "PRM": "#00805c",
}
_DASHES: dict[str, object] = {
    "Dijkstra": (0, (1, 1.2)),
    "A*": "-",
    "RRT": (0, (5, 1.5)),
    "RRT-Connect": "-.",
    "RRT*": "-",
}
_STEPS = (0.15, 0.3, 0.6, 1.2)  # times the scale of lengths
_BIASES = (0.0, 0.05, 0.3)
_CELLS = (48, 36, 24)
_SEED = 1
_SEEDS = 10  # for medians
_DENSE = 80.0  # factor between the ends of an axis with room for three labels per decade


class Variant(NamedTuple):
    """A planner with its options.

    Args:
        planner: Its name.
        step: Longest edge, or the longer side of a lattice's cell [rad or m].
        bias: Share of samples that are the goal, None for planners without a bias.
        record: The recorded search.
    """

    planner: str
    step: float
    bias: float | None
    record: SearchRecord


class PlanningLesson(Lesson):
    """Six planners on the same query."""

    name = "planning"

    def __init__(self, scene: Scene | None, problem: Problem | None) -> None:
        problem = require_query(self.name, scene, problem) or load_problems("planar2r_path")["over_the_seam"]
        self.problem, self.scene = problem, problem.scene
        self.picture = cspace(problem.scene, problem)
        self.scale = length_scale(self.picture.grid)
        self.variants = _variants(problem, self.scale)
        self.steps = _steps(self)

    @property
    def unit(self) -> str:
        """The unit of path lengths, with a space before it; none if one joint turns and the other one slides."""
        return length_unit(self.picture.grid.turns)

    def variant(self, planner: str) -> Variant:
        """A planner with its default options."""
        usual = [v for v in self.variants if v.planner == planner and v.bias in (None, 0.05)]
        return min(usual, key=lambda v: abs(v.step - self.usual[planner]))

    @property
    def usual(self) -> dict[str, float]:
        """The default step of each planner [rad or m]."""
        return {name: sorted({v.step for v in self.variants if v.planner == name})[k] for name, k in _USUAL.items()}

    def length(self, record: SearchRecord) -> str:
        """The length of a path with its unit."""
        return f"{record.cost:.{length_digits(self.scale)}f}{self.unit}"

    @property
    def without_path(self) -> str:
        """What is known about the query if no planner finds a path with its default options, else an empty text."""
        found = any(self.variant(planner).record.found for planner in COLORS)
        return "" if found else f"No planner found a path. {self.picture.verdict}"

    @cached_property
    def effect(self) -> Array:
        """For RRT, each step and bias: medians over seeds of edges checked and of path length, shape (4, 3, 2)."""
        table = np.empty((len(_STEPS), len(_BIASES), 2))
        for i, step in enumerate(self.scale * share for share in _STEPS):
            for k, bias in enumerate(_BIASES):
                runs = [grow_rrt(self.problem, step=step, goal_bias=bias, rng=seed) for seed in range(_SEEDS)]
                table[i, k] = np.median([[run.edges_checked[-1], run.cost] for run in runs], axis=0)
        return table

    # ---- the page ------------------------------------------------------------------------

    def _panels(self) -> tuple[Panel, ...]:
        kinematics = Kinematics(self.scene, self.problem.arms)
        search = lesson_panel(
            "search",
            "Search",
            {
                "kinds": list(EVENTS),
                "colors": COLORS,
                "usual": self.usual,
                "unit": self.unit,
                "scale": self.scale,
                "variants": [_row(variant, kinematics, length_digits(self.scale, 5)) for variant in self.variants],
            },
            ("walk.js",),
        )
        return (search,)

    # ---- the figure ----------------------------------------------------------------------

    def _draw(self, figure: Figure) -> None:
        grid = figure.add_gridspec(2, 4, width_ratios=(1, 1, 1, 1.25))
        for k, planner in enumerate(COLORS):
            self._draw_search(figure.add_subplot(grid[k // 3, k % 3]), self.variant(planner))
        self._draw_race(figure.add_subplot(grid[0, 3]))
        self._draw_effect(figure.add_subplot(grid[1, 3]))

    def _draw_search(self, axes: Axes, variant: Variant) -> None:
        """The configuration space with a planner's edges and rejected edges."""
        from matplotlib.collections import LineCollection

        space, record = self.picture.grid, variant.record
        extent = (*space.ranges[0], *space.ranges[1])
        image = 1.0 - 0.55 * (1.0 - layer_image(space))
        axes.imshow(image, origin="lower", extent=extent, interpolation="nearest", aspect="auto")
        color = COLORS[variant.planner]
        lines = [piece for a, b in _edges(record) for piece in wrapped_pieces(_joined(space, a, b), space)]
        axes.add_collection(LineCollection(lines, colors=color, linewidths=0.6, alpha=0.8))
        events = [event for step in record.steps for event in step]
        rejected = np.array([event.point for event in events if event.kind in (REFUSED, BLOCKED)])
        if len(rejected):
            axes.plot(*np.array([space.wrapped(q) for q in rejected]).T, "x", color=color, ms=2.2, mew=0.5, alpha=0.55)
        if record.path is not None:
            for piece in wrapped_pieces(record.path, space):
                axes.plot(*piece.T, color="white", lw=4.2)
                axes.plot(*piece.T, color="#22262b", lw=2.2)
        for q, marker, size in ((self.problem.start, "o", 8), (self.picture.goals[0], "*", 14)):
            axes.plot(*space.wrapped(q), marker, color="#22262b", mec="white", ms=size, zorder=5)
        axes.set(xlim=extent[:2], ylim=extent[2:], xticks=[], yticks=[], box_aspect=1)
        cost = self.length(record) if record.found else "no path"
        axes.set_title(f"{variant.planner}: {record.edges_checked[-1]} edges, {cost}", fontsize=11, loc="left")

    def _draw_race(self, axes: Axes) -> None:
        """Length of the best path over the edges checked."""
        for planner, color in COLORS.items():
            record = self.variant(planner).record
            if record.found:
                found = np.isfinite(record.costs)
                checks, costs = record.edges_checked[found], record.costs[found]
                axes.step(checks, costs, where="post", color=color, lw=2, ls=_DASHES.get(planner, (0, (4, 1, 1, 1))))
                axes.plot(checks[0], costs[0], "o", color=color, ms=6, label=planner)
        axes.set_title("length of the best path", fontsize=12, loc="left")
        if self.without_path:
            _write(axes, self.without_path)
            return
        axes.set(xscale="log", xlabel="edges checked", ylabel=f"path [{self.unit.strip() or '-'}]")
        _plain_ticks(axes.xaxis)
        axes.legend(fontsize=9, frameon=False, ncols=2)
        axes.spines[["top", "right"]].set_visible(False)

    def _draw_effect(self, axes: Axes) -> None:
        """Edges that RRT checks over its step, for each bias."""
        axes.set_title(f"RRT, medians of {_SEEDS} seeds", fontsize=12, loc="left")
        # Searches without a path end with their last sample, so that their edges say nothing about step and bias.
        if not any(variant.record.found for variant in self.variants if variant.planner == "RRT"):
            _write(axes, "RRT found no path, whatever its step and bias.")
            return
        if not self.effect[..., 0].any():
            _write(axes, "RRT checked no edges: the start is the goal.")
            return
        steps = [self.scale * share for share in _STEPS]
        for k, (bias, marker, dashes) in enumerate(zip(_BIASES, "osD", ("-", "--", ":"), strict=True)):
            label = f"goal bias {100 * bias:g} %"
            axes.plot(steps, self.effect[:, k, 0], marker=marker, ls=dashes, color="#22262b", ms=5, label=label)
        axes.set(xscale="log", yscale="log", xlabel=f"step [{self.unit.strip() or '-'}]", ylabel="edges checked")
        _plain_ticks(axes.yaxis)
        axes.set_xticks(steps, [f"{step:.3g}" for step in steps], minor=False)
        axes.set_xticks([], minor=True)
        axes.legend(fontsize=9, frameon=False)
        axes.spines[["top", "right"]].set_visible(False)


def _write(axes: Axes, text: str) -> None:
    """A text in place of a plot."""
    axes.set_axis_off()
    axes.text(0.0, 0.95, fill(text, 36), fontsize=12, va="top", transform=axes.transAxes)


def _plain_ticks(axis: Axis) -> None:
    """Ticks of a logarithmic axis at 50, 100, 200 and so on, or only at powers of ten, as plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < _DENSE * low else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())


# Among the steps of each planner, the index of its default.
_USUAL = {"Dijkstra": 1, "A*": 1, "RRT": 1, "RRT-Connect": 1, "RRT*": 1, "PRM": 2}


def _variants(problem: Problem, scale: float) -> tuple[Variant, ...]:
    """Every planner with every choice of its options."""
    found: list[tuple[float, float | None, SearchRecord]] = []
    space = SearchSpace(problem)
    widest = float((space.upper - space.lower).max())
    for cells in _CELLS:
        side = widest / cells
        found += [(side, None, search_lattice(problem, cells=cells, weight=weight)) for weight in (0.0, 1.0)]
    for step in (scale * share for share in _STEPS):
        found += [(step, bias, grow_rrt(problem, step=step, goal_bias=bias, rng=_SEED)) for bias in _BIASES]
        found.append((step, None, grow_rrt_connect(problem, step=step, rng=_SEED)))
        if step > scale * _STEPS[0]:
            found.append((step, None, grow_rrt_star(problem, step=step, rng=_SEED)))
            found.append((step, None, grow_prm(problem, longest=step, rng=_SEED)))
    return tuple(Variant(record.planner, step, bias, record) for step, bias, record in found)


def _edges(record: SearchRecord) -> list[tuple[Array, Array]]:
    """The final edges, of a tree or of a roadmap."""
    parents: dict[int, int] = {}
    edges = []
    for event in (event for step in record.steps for event in step):
        if event.kind == EDGE:
            edges.append((event.parent, event.vertex))
        elif event.parent >= 0:
            parents[event.vertex] = event.parent
    edges += [(parent, vertex) for vertex, parent in parents.items()]
    return [(record.vertices[a], record.vertices[b]) for a, b in edges]


def _joined(space: Any, a: Array, b: Array) -> Array:
    """The two ends of an edge, the second shifted by whole turns to be nearest to the first."""
    turn = np.where(space.periodic, 2.0 * np.pi, np.inf)
    return np.array([a, b - np.where(space.periodic, 2.0 * np.pi * np.round((b - a) / turn), 0.0)])


def _row(variant: Variant, kinematics: Kinematics, digits: int) -> dict[str, object]:
    """A variant as data for the page: events in columns, points with the tool's positions, lengths with some digits."""
    record = variant.record
    events = [event for step in record.steps for event in step]
    points = np.array([(0.0, 0.0) if event.point is None else event.point for event in events])
    return {
        "planner": variant.planner,
        "step": variant.step,
        "bias": variant.bias,
        "ends": pack_array(np.cumsum([len(step) for step in record.steps]), "u4"),
        # Vertices are numbered from 1, so that 0 means none.
        "events": pack_array([(EVENTS.index(e.kind), e.vertex + 1, e.parent + 1) for e in events], "u4"),
        "points": pack_array(points),
        "pointTools": pack_array(_tools(points, kinematics)),
        "vertices": pack_array(record.vertices),
        "vertexTools": pack_array(_tools(record.vertices, kinematics)),
        "sides": record.sides.tolist(),
        "checks": pack_array(record.edges_checked, "u4"),
        "costs": [None if not np.isfinite(cost) else round(float(cost), digits) for cost in record.costs],
        "paths": [{"step": step, "points": np.round(path, digits).tolist()} for step, path in record.paths],
    }


def _tools(points: Array, kinematics: Kinematics) -> Array:
    return kinematics.poses_batch(points)[:, :3, 3] if len(points) else np.zeros((0, 3))


def _steps(lesson: PlanningLesson) -> tuple[LessonStep, ...]:
    names = ", ".join(escape(name) for name in lesson.problem.joint_names)
    counts = {planner: lesson.variant(planner).record for planner in COLORS}

    def outcome(planner: str) -> str:
        record = counts[planner]
        end = f"a path of {lesson.length(record)}" if record.found else "no path"
        return f"Here: {len(record.vertices)} vertices, {record.edges_checked[-1]} edges checked, {end}."

    none = f"<p>{escape(lesson.without_path)}</p>" if lesson.without_path else ""
    torus = ", here on the torus" if any(lesson.picture.grid.periodic) else ""
    texts = (
        (
            "question",
            "One query, six planners",
            f"""<p>Start (●) and goal (★) are two points of the configuration space of {names}; the colored areas
            are the obstacles’ images. A planner searches for a curve between them that stays in free space. No planner
            uses these areas: it can only <b>check an edge</b>, which is certified over its whole length.</p><p>Choose a
            planner, press <b>Grow</b> (P), or step with <kbd>,</kbd> and <kbd>.</kbd> A cross ✕ is a rejected sample or
            the far end of a rejected edge. The arm is shown at the newest one.</p>{none}""",
        ),
        (
            "dijkstra",
            "Dijkstra’s algorithm: cheapest first",
            f"""<p>The space is covered by a lattice, each point connected to its 8 neighbors. The open vertex with the
            least <b>cost so far</b> g is closed next: octagons grow around the start. When the goal is closed, its path
            is a shortest one <b>on this lattice</b>. {outcome("Dijkstra")}</p><p>The step slider changes the lattice:
            half the step, four times the vertices; in six joints 64 times. (Dijkstra 1959; LaValle 2.2)</p>""",
        ),
        (
            "astar",
            "A*: aimed at the goal",
            f"""<p>A* closes the vertex with the least g + h, where h is the distance to the goal{torus}. Because h
            never overestimates, the path is as short as Dijkstra’s, with fewer vertices closed. {outcome("A*")}</p>
            <p>(Hart, Nilsson, Raphael 1968; Choset, appendix H)</p>""",
        ),
        (
            "rrt",
            "RRT: pulled by samples",
            f"""<p>A random sample (+) pulls the <b>nearest</b> vertex by one step toward it; if that edge is free,
            a vertex is added. Vertices at the border of the tree have the largest Voronoi regions, so the tree grows
            fast into unexplored space. A few samples are the goal itself: the <b>goal bias</b>.
            {outcome("RRT")}</p><p>(LaValle 1998)</p>""",
        ),
        (
            "connect",
            "RRT-Connect: two trees",
            f"""<p>One tree takes a step toward the sample, the other then runs toward the new vertex until it meets
            it or an obstacle; then they change roles. Growing out of a narrow place is easier than finding the way into
            it. {outcome("RRT-Connect")}</p><p>(Kuffner, LaValle 2000). rr1plan’s default planner is a compiled
            version.</p>""",
        ),
        (
            "rrtstar",
            "RRT*: rewired",
            f"""<p>Among its neighbors a new vertex gets the parent that makes it <b>cheapest</b>, and becomes the
            parent of those that it makes cheaper. Almost surely the path converges to a shortest one, at the price of
            more edges. {outcome("RRT*")}</p><p>(Karaman, Frazzoli 2011)</p>""",
        ),
        (
            "prm",
            "PRM: a roadmap for many queries",
            f"""<p>Free samples are connected to their nearest neighbors, blocked ones (✕) are rejected. The roadmap
            does not depend on the query: another start and goal cost only their own edges and a graph search.
            {outcome("PRM")}</p> <p>(Kavraki, Švestka, Latombe, Overmars 1996)</p>""",
        ),
        (
            "race",
            "The same query: length over work",
            f"""<p>The chart shows the best path so far over the edges checked, which take most of a planner’s time.
            RRT and RRT-Connect end with their first path; RRT* and PRM improve it; a lattice search has no path until
            its last step. After planning, a path is shortened: see lesson “From path to motion”.</p>{none}""",
        ),
        (
            "options",
            "Step and bias",
            """<p>Move the sliders. <b>Short steps</b> creep: four times the edges for a quarter of the step. <b>Long
            steps</b> cross open space with few vertices, but more of them are rejected and the path has fewer
            corners to fit a narrow passage. <b>Bias</b> helps while the way to the goal is open; behind an obstacle
            it tries the same rejected edge again and again. Change one option at a time, and compare several seeds: one
            run proves nothing.</p>""",
        ),
    )
    return tuple(LessonStep(name, title, text) for name, title, text in texts)
