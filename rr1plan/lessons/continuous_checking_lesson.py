"""Lesson "continuous_checking": why samples prove nothing about an edge, and how distances do."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rr1plan.checks import Array, counted
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.lessons.edge_intervals import EdgeInterval, halve_edge, is_proven_free, sample_edge
from rr1plan.lessons.lesson import Lesson, LessonStep
from rr1plan.lessons.mathml import math, sub
from rr1plan.lessons.picture_panels import picture_panel
from rr1plan.lessons.planar_outlines import planar_data, view_data
from rr1plan.model.flat_arm import flat_arm
from rr1plan.playback.cspace.configuration_space import cspace
from rr1plan.playback.cspace.cspace_figure import fit_names
from rr1plan.playback.cspace.cspace_lines import ObstacleName, write_name
from rr1plan.playback.cspace.cspace_page import page_parts
from rr1plan.playback.cspace.reach_outline import reach_of
from rr1plan.playback.outlines import silhouette
from rr1plan.scene import Scene
from rr1plan.scene.model_library import load_problems
from rr1plan.scene.problem import JointGoal, Problem

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rr1plan.playback.viewer.page_document import Document
    from rr1plan.playback.viewer.view_options import Panel, ViewOptions

_INK, _SOFT, _FREE, _OPEN, _TOUCH, _SAMPLE = "#22262b", "#667080", "#14855a", "#e08a00", "#c2255c", "#2f66c8"
_STEP = float(np.radians(12.0))
_LETTER = 0.05  # height of a name, as a share of the longer side of the workspace shown
_BEYOND = 1.3  # of the reach, within which the figure shows obstacles
_TITLES = {"through": "Through the plate", "grazing": "Grazing it", "just_past": "Just past it", "far": "Far away"}

_BOUND = math("bound", "=", "∑", sub("ℓ", "j"), "|", "Δ", sub("θ", "j"), "|", "/", "2")

_STEPS = (
    (
        "steps",
        "A fixed step misses what fits between two samples",
        "<p>The edge from <b>begin</b> to <b>end</b> is checked at steps of at most 12°: nine "
        "configurations, all free. Between two of them the arm goes through the plate. Many planners check edges like "
        "that, and most of the time nothing happens.</p><p>Move the slider. What decides is not the plate, which is "
        "4 mm thick, but the length of edge on which arm and plate overlap: the width of both over the distance from "
        "the joint.</p>",
    ),
    (
        "small_steps",
        "No step is small enough for all edges",
        "<p>Here the arm's tip touches the corner of the plate by less than a millimeter. A step of 1° needs 105 "
        "samples and finds nothing; the part in contact is 0.6° long. Bend the elbow a little more and it gets "
        "shorter still, down to nothing. So a fixed step is a wager: a coarse one misses contacts, a fine one "
        "costs time on every edge, also on those that are far from everything.</p>",
    ),
    (
        "bound",
        "A distance proves an interval",
        f"""<p>A joint that turns by {math("Δ", "θ")} moves no point of a link farther than {math("ℓ", "Δ", "θ")}, with
        the lever {math("ℓ")}: the largest distance of the link from the joint's axis. From the middle of this edge to
        its ends the links therefore move by no more than {_BOUND}, and stay within the colored outlines. If the
        distance at the middle exceeds that, the whole edge is free, after <b>one</b> distance. The dashed diamond has
        all configurations that this distance proves.</p>""",
    ),
    (
        "halving",
        "Halve what is not proven",
        "<p>Close to obstacles the first interval is too long: the bound exceeds the distance. Each half has "
        "half the bound and another distance. Press <b>Run</b>, or step with <kbd>.</kbd> and "
        "<kbd>,</kbd>: proven intervals stay long where there is room and get short only beside obstacles. This "
        "is <i>adaptive bisection</i>.</p><p>Below, the curve is the true distance, which is not known "
        "in advance. The boxes sink below it.</p>",
    ),
    (
        "contact",
        "Long intervals first",
        "<p>The same search on the edge through the plate. Intervals are checked level by level, so "
        "configurations are spread over the whole edge early, and a contact is soon hit: after 10 distances this "
        "one is decided. One configuration in contact is proof that the edge is not free.</p>",
    ),
    (
        "grazing",
        "The answer has no gap",
        "<p>The grazing edge, on which 105 samples missed the contact. Bisection continues only where it is "
        "tight, and ends in the contact after 17 distances. Drag the ends of the edge and try to deceive it. "
        "Below a distance of one micrometer nothing can be proven; such an edge is rejected.</p>",
    ),
    (
        "advancing",
        "Or advance as far as the distance allows",
        "<p><i>Conservative advancement</i> uses the same bound from the beginning on: each distance says how far "
        "the arm may go before the next check. It finds the <i>first</i> contact, which bisection does "
        "not. Beside obstacles its steps get short; bisection uses each distance in both directions from the "
        "middle.</p><p>In rr1plan <code>edge_is_free</code> halves, eight intervals at a time, and "
        "<code>first_contact</code> returns the first contact of an edge.</p>",
    ),
)

# For a user's edge: its first step, and the steps that state no numbers.
_OWN_STEP = (
    "steps",
    "A fixed step misses what fits between two samples",
    "<p>The edge from <b>begin</b> to <b>end</b> is checked at fixed steps. Move the slider: if parts of the "
    "edge are in contact, a coarse step may miss them all. Which step is enough depends on the edge, and is not "
    "known in advance.</p>",
)
_SLIDING = "<p>A prismatic joint moves every point as far as the joint itself: its lever is 1.</p>"
_GENERAL = ("bound", "halving", "advancing")


class ContinuousCheckingLesson(Lesson):
    """Edges near a thin plate, checked at fixed steps, by halving and by advancing."""

    name = "continuous_checking"

    def __init__(self, scene: Scene | None, problem: Problem | None) -> None:
        problems = {_TITLES[k]: v for k, v in load_problems("planar2r_plate").items()} if scene is None else {}
        if problem is not None:
            problems = {"Your query": problem}
        if not problems:
            raise InputError(
                "lesson 'continuous_checking' is about an edge: give a problem with a start and a goal in joint values"
            )
        self.edges = {name: (p.start, _goal(p)) for name, p in problems.items()}
        self.scene = next(iter(problems.values())).scene
        self.checker = CollisionChecker(self.scene)
        if self.checker.nq != 2:
            raise InputError(f"the scene has {counted(self.checker.nq, 'joint')}, expected one arm of two joints")
        if not self.checker.pairs:
            raise InputError("lesson 'continuous_checking' is about distances; add an obstacle")
        self._outlines = planar_data(self.checker)
        self._own = problem is not None
        steps = _STEPS if problem is None else (_OWN_STEP, *(step for step in _STEPS if step[0] in _GENERAL))
        self._straight = [
            self.scene.arms[arm].robot.joint(name).kind == "prismatic"
            for arm in self.checker.arms
            for name in self.scene.arms[arm].robot.joint_names
        ]
        more = {"bound": _SLIDING} if any(self._straight) else {}
        self.steps = tuple(LessonStep(name, title, text + more.get(name, "")) for name, title, text in steps)

    def _page(self, options: ViewOptions) -> tuple[Document, tuple[Panel, ...]]:
        picture = cspace(self.scene)
        document, base = page_parts(picture, options=options)
        columns = {
            key: base.data[key] for key in ("columns", "joints", "low", "high", "periodic", "size", "layers", "labels")
        }
        names = list(self.edges)
        keys = ["through", "grazing", "just_past", "far"] if not self._own else names
        presets = [
            {"name": key, "title": name, "start": q0.tolist(), "goal": q1.tolist()}
            for key, (name, (q0, q1)) in zip(keys, self.edges.items(), strict=True)
        ]
        data = {**columns, **self._outlines, "presets": presets, **view_data(self.scene)}
        return document, (picture_panel("edge", "Configuration space", ("planar_distance.js",), data),)

    # ---- the figure ------------------------------------------------------------------------

    def _draw(self, figure: Figure) -> None:
        left, right = figure.subplots(1, 2, gridspec_kw={"width_ratios": (1.0, 1.25)})
        names = list(self.edges)
        self._draw_samples(left, *self.edges[names[0]])
        chosen = self.edges[names[min(2, len(names) - 1)]]
        self._draw_intervals(right, *chosen)
        fit_names(figure, {left: self._write_names(left)})

    @property
    def _step(self) -> tuple[float, str]:
        """The longest step of the samples [rad or m], that of the page at first, and its text."""
        if not all(self._straight):
            return _STEP, f"{_STEP:.2g}" if any(self._straight) else f"{np.degrees(_STEP):.0f}°"
        limits = self.checker.limits
        step = _STEP * float((limits.upper - limits.lower).max())
        return step, f"{step:.3g} m"

    def _draw_samples(self, axes: Axes, q0: Array, q1: Array) -> None:
        step, size = self._step
        found = sample_edge(self.checker, q0, q1, step)
        for obstacle in self.scene.obstacles.values():
            for g in obstacle.geometries:
                axes.fill(*silhouette(g.shape, obstacle.pose @ g.pose).T, color=g.color or _SOFT, zorder=3)
        for s, free in zip(found.fractions, found.free, strict=True):
            self._draw_arm(axes, q0 + s * (q1 - q0), _SAMPLE if free else _TOUCH, 0.45)
        words = "all free" if found.passes else f"{int((~found.free).sum())} in contact"
        axes.set_title(f"steps of at most {size}: {len(found.free)} samples, {words}", loc="left")
        low, high = self._window(axes)
        axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        axes.spines[["top", "right"]].set_visible(False)

    def _window(self, axes: Axes) -> tuple[Array, Array]:
        """Lower left and upper right corner of the workspace shown [m], which ends near the arm's reach."""
        arm = self.scene.arms[self.checker.arms[0]]
        flat = flat_arm(arm)
        assert flat is not None
        reach = reach_of(flat, arm.robot.limits)
        low = np.maximum(axes.dataLim.min, reach.center - _BEYOND * reach.radius)
        high = np.minimum(axes.dataLim.max, reach.center + _BEYOND * reach.radius)
        return low - 0.05 * (high - low), high + 0.05 * (high - low)

    def _write_names(self, axes: Axes) -> dict[str, ObstacleName]:
        """The names of obstacles, each on a part of its obstacle, or above or below it if all are too thin."""
        from matplotlib.colors import to_hex

        letter = _LETTER * max(axes.viewLim.size)
        names = {}
        for name, obstacle in self.scene.obstacles.items():
            parts = [silhouette(g.shape, obstacle.pose @ g.pose) for g in obstacle.geometries]
            thick = [bool(np.ptp(corners[:, 1]) >= letter) for corners in parts]
            wide = [corners.mean(axis=0) for corners, fits in zip(parts, thick, strict=True) if fits]
            beside = [corners.mean(axis=0) + np.array([0.0, y]) for y in (letter, -letter) for corners in parts]
            color = obstacle.geometries[0].color or _SOFT
            names[name] = write_name(axes, name, wide or beside, to_hex(color) if wide else "#ffffff")
        return names

    def _draw_arm(self, axes: Axes, q: Array, color: str, alpha: float) -> None:
        name = self.checker.arms[0]
        arm = self.scene.arms[name]
        for link, T in arm.robot.link_poses(q).items():
            for g in arm.robot.link(link).collisions:
                axes.fill(
                    *silhouette(g.shape, arm.base @ T @ g.pose).T, color=color, alpha=alpha, linewidth=0, zorder=2
                )

    def _draw_intervals(self, axes: Axes, q0: Array, q1: Array) -> None:
        intervals = halve_edge(self.checker, q0, q1)
        s = np.linspace(0.0, 1.0, 400)
        curve = np.array([self.checker.clearance(q0 + x * (q1 - q0)) for x in s])
        most = 1.15 * float(curve.max())
        for interval in intervals:
            _draw_box(axes, interval, most)
        axes.plot(s, curve, color=_INK, linewidth=2.4, label="distance", zorder=5)
        free = sum(i.verdict == "free" for i in intervals)
        end = "free" if is_proven_free(intervals) else "not free"
        tried, proven = counted(len(intervals), "distance"), counted(free, "interval")
        axes.set_title(f"halving: {tried}, {proven} proven, {end}", loc="left")
        axes.set(xlabel="along the edge", ylabel="distance, motion bound [m]", xlim=(0, 1), ylim=(0, most))
        axes.spines[["top", "right"]].set_visible(False)
        axes.fill([], [], color=_FREE, alpha=0.35, label="motion bound, proven free")
        axes.fill([], [], facecolor="none", edgecolor=_OPEN, linestyle="--", label="motion bound, to be halved")
        axes.figure.legend(loc="outside lower center", frameon=False, ncols=3, fontsize=12)


def _draw_box(axes: Axes, interval: EdgeInterval, most: float) -> None:
    """The bound of an interval as a box, and the distance at its middle."""
    x, y = [interval.begin, interval.end, interval.end, interval.begin], [0.0, 0.0, interval.bound, interval.bound]
    if interval.verdict == "free":
        axes.fill(x, y, color=_FREE, alpha=0.3, linewidth=0, zorder=3)
        axes.fill(x, y, facecolor="none", edgecolor=_FREE, linewidth=1.0, zorder=4)
    elif interval.bound < most:
        axes.fill(x, y, facecolor="none", edgecolor=_OPEN, linestyle="--", linewidth=1.0, zorder=2)
    color = {"free": _FREE, "halved": _OPEN}.get(interval.verdict, _TOUCH)
    axes.plot(
        interval.middle, max(interval.distance, 0.0), "o", color=color, markeredgecolor="white", markersize=6, zorder=6
    )


def _goal(problem: Problem) -> Array:
    """The goal in joint values.

    Raises:
        InputError: it is a pose.
    """
    goals = [goal for goals in problem.goal.values() for goal in goals]
    if len(problem.arms) != 1 or not isinstance(goals[0], JointGoal):
        raise InputError(
            "lesson 'continuous_checking' is about an edge: the problem needs one arm and a goal in joint values"
        )
    return goals[0].q
