"""Lesson "motion": shortcuts, blends, the phase plane, seven phases, and what a jerk limit costs."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.lessons.lesson import Lesson, LessonStep
from rr1plan.lessons.lesson_panel import lesson_panel
from rr1plan.lessons.lesson_scenes import length_digits, length_scale, length_unit, require_query
from rr1plan.lessons.mathml import math
from rr1plan.lessons.phase_plane import PathGrid, PhasePlane, fastest_motion, path_grid, signs_of
from rr1plan.lessons.search.shortcut_steps import Shortcut, record_shortcuts
from rr1plan.lessons.search.tree_growth import grow_rrt_connect
from rr1plan.lessons.seven_phases import PHASES, seven_phases
from rr1plan.path import Path, edge_lengths
from rr1plan.playback.cspace.configuration_space import cspace
from rr1plan.playback.cspace.cspace_torus import layer_image, wrapped_pieces
from rr1plan.playback.viewer.page_arrays import pack_array
from rr1plan.retiming import retime
from rr1plan.retiming.path_blends import clean
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene import Scene
from rr1plan.scene.model_library import load_problems
from rr1plan.scene.problem import Problem

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rr1plan.playback.viewer.view_options import Panel

_STEP, _SEED, _TRIES, _SHORTCUT_SEED = 0.4, 3, 60, 1
BLENDS = (0.0, 0.03, 0.1, 0.4)  # these and the step: times the scale of lengths
JERKS = (10.0, 20.0, 40.0, 80.0, 160.0, 320.0, 640.0, 1280.0)
"""Jerk limits that the last step compares [rad/s³ or m/s³]."""
# Colors of the path before and after shortcuts, of blends, the limit curve and braking; safe for color blindness.
RAW, SHORT, BLENDED, LIMIT, BRAKE = "#8b97a6", "#0072b2", "#d55e00", "#a3428f", "#00805c"


class MotionLesson(Lesson):
    """A path is shortened, smoothed and timed."""

    name = "motion"

    def __init__(self, scene: Scene | None, problem: Problem | None) -> None:
        problem = require_query(self.name, scene, problem) or load_problems("planar2r_path")["over_the_seam"]
        self.problem, self.scene = problem, problem.scene
        limits = problem.scene.limits(problem.arms)
        if not np.isfinite([limits.velocity, limits.acceleration, limits.jerk]).all():
            raise InputError("lesson 'motion' needs finite limits of velocity, acceleration and jerk")
        self.limits = limits
        self.picture = cspace(problem.scene, problem)
        self.scale = length_scale(self.picture.grid)
        raw = grow_rrt_connect(problem, step=self.scale * _STEP, rng=_SEED).path
        if raw is None:
            raise InputError(f"lesson 'motion' finds no path; try another goal. {self.picture.verdict}")
        self.raw = raw
        checker = CollisionChecker(problem.scene, problem.arms)
        self.shortcuts: tuple[Shortcut, ...] = record_shortcuts(checker, raw, tries=_TRIES, rng=_SHORTCUT_SEED)
        self.path = Path(problem.joint_names, self.shortcuts[-1].path)
        self.steps = _steps(self)

    @property
    def unit(self) -> str:
        """The unit of path lengths, with a space before it; none if one joint turns and the other one slides."""
        return length_unit(self.picture.grid.turns)

    @property
    def _first_unit(self) -> str:
        """The unit of the first joint, with a space before it."""
        return length_unit(self.picture.grid.turns[:1])

    @property
    def distances(self) -> tuple[float, float]:
        """The default and the largest distance of the first joint in the step about seven phases [rad or m]."""
        low, high = self.picture.grid.ranges[0]
        width = high - low
        return (min(1.2, 0.4 * width), min(3.0, width)) if self.picture.grid.turns[0] else (0.4 * width, width)

    @property
    def max_blend(self) -> float:
        """The largest blend of the lesson [rad or m]."""
        return self.scale * BLENDS[-1]

    @cached_property
    def grids(self) -> dict[float, PathGrid]:
        """The path on a grid, for each largest blend."""
        sizes = [self.scale * size for size in BLENDS]
        return {size: path_grid(self.path, self.scene, max_blend=size) for size in sizes}

    @cached_property
    def plane(self) -> PhasePlane:
        """The phase plane with the largest blends."""
        return fastest_motion(self.grids[self.max_blend], self.limits.velocity, self.limits.acceleration)

    @cached_property
    def durations(self) -> dict[str, Any]:
        """Durations [s] of `retime`: with a stop at every corner, with blends, and for each jerk limit."""
        smooth = []
        for jerk in JERKS:
            rows = (self.limits.lower, self.limits.upper, self.limits.velocity, self.limits.acceleration)
            limits = Limits(*rows, np.full(len(self.limits), jerk), self.limits.effort)
            name = self.problem.arms[0]
            arm = self.scene.arms[name]
            scene = Scene(name=self.scene.name).with_arm(name, arm.robot.with_limits(limits), arm.base, q=arm.q)
            smooth.append(retime(self.path, scene, method="ruckig").duration)
        stop = retime(self.path, self.scene, method="stop").duration
        blend = retime(self.path, self.scene, method="blend", max_blend=self.max_blend).duration
        return {"stop": stop, "blend": blend, "smooth": smooth}

    # ---- the page ------------------------------------------------------------------------

    def _panels(self) -> tuple[Panel, ...]:
        digits = length_digits(self.scale, 5)
        data = {
            "raw": np.round(clean(self.raw), digits).tolist(),
            "shortcuts": [
                {
                    "begin": np.round(c.begin, digits).tolist(),
                    "end": np.round(c.end, digits).tolist(),
                    "free": c.free,
                    "path": np.round(clean(c.path), digits).tolist(),
                }
                for c in self.shortcuts
            ],
            "blends": [
                {
                    "size": size,
                    "stops": list(grid.stops),
                    **{name: pack_array(getattr(grid, name), "f8") for name in ("s", "q", "begin", "end", "bend")},
                }
                for size, grid in self.grids.items()
            ],
            "velocity": self.limits.velocity.tolist(),
            "acceleration": self.limits.acceleration.tolist(),
            "jerk": float(self.limits.jerk[0]),
            "jerks": list(JERKS),
            "durations": self.durations,
            "phases": list(PHASES),
            "distances": list(self.distances),
            "scale": self.scale,
            "unit": self.unit,
            "first_unit": self._first_unit,
            "colors": {"raw": RAW, "short": SHORT, "blend": BLENDED, "limit": LIMIT, "brake": BRAKE},
        }
        return (lesson_panel("timing", "Motion", data),)

    # ---- the figure ----------------------------------------------------------------------

    def _draw(self, figure: Figure) -> None:
        grid = figure.add_gridspec(2, 3, width_ratios=(1.15, 1, 1))
        self._draw_paths(figure.add_subplot(grid[0, 0]))
        self._draw_plane(figure.add_subplot(grid[0, 1:]))
        self._draw_cost(figure.add_subplot(grid[1, 0]))
        parts = grid[1, 1:].subgridspec(2, 2)
        self._draw_phases([figure.add_subplot(parts[k // 2, k % 2]) for k in range(4)])

    def _draw_paths(self, axes: Axes) -> None:
        space = self.picture.grid
        extent = (*space.ranges[0], *space.ranges[1])
        image = 1.0 - 0.55 * (1.0 - layer_image(space))
        axes.imshow(image, origin="lower", extent=extent, interpolation="nearest", aspect="auto")
        rows = (
            (self.raw, RAW, "--", "planned"),
            (self.path.waypoints, SHORT, "-", "shortened"),
            (self.plane.grid.q, BLENDED, "-", "blended"),
        )
        for points, color, line, label in rows:
            for k, piece in enumerate(wrapped_pieces(points, space)):
                axes.plot(*piece.T, line, color=color, lw=2, label=None if k else label)
        axes.set(xlim=extent[:2], ylim=extent[2:], xticks=[], yticks=[], box_aspect=1)
        axes.set_title("path", fontsize=13, loc="left")
        # Below the map, any part of which may have a path.
        axes.legend(fontsize=9, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=3, frameon=False)

    def _draw_plane(self, axes: Axes) -> None:
        plane, s = self.plane, self.plane.grid.s
        ends = np.column_stack([s[:-1], s[1:]]).ravel()
        axes.plot(ends, plane.limit.ravel(), color=LIMIT, lw=1.8, ls="--", label="limit curve")
        axes.fill_between(ends, plane.limit.ravel(), plane.limit.max() * 1.1, color=LIMIT, alpha=0.12)
        for k, sign in enumerate(signs_of(plane.acceleration)):
            axes.plot(s[k : k + 2], plane.speed[k : k + 2], color=BRAKE if sign < 0.0 else BLENDED, lw=2.6)
        axes.plot([], [], color=BLENDED, lw=2.6, label="faster or steady")
        axes.plot([], [], color=BRAKE, lw=2.6, label="slower")
        switches = list(plane.switches)
        axes.plot(s[switches], plane.speed[switches], "o", color="#22262b", ms=5, label="switching points")
        axes.set(xlim=(0, s[-1]), ylim=(0, plane.limit.max() * 1.1))
        axes.set(xlabel=_label("s", self.unit), ylabel=_label("ṡ", self.unit, "/s"))
        axes.set_title(f"phase plane: {plane.duration:.2f} s", fontsize=13, loc="left")
        axes.legend(fontsize=9, loc="lower right", bbox_to_anchor=(1.01, 0.98), ncols=4, frameon=False)

    def _draw_phases(self, plots: list[Axes]) -> None:
        limits = [float(row[0]) for row in (self.limits.velocity, self.limits.acceleration, self.limits.jerk)]
        distance = self.distances[0]
        motion = seven_phases(distance, *limits)
        times = np.linspace(0.0, motion.duration, 600)
        states, ends = motion.state(times), np.concatenate([[0.0], np.cumsum(motion.durations)])
        unit = self._first_unit  # the limits are those of the first joint
        rows = (("position", ""), ("velocity", "/s"), ("acceleration", "/s²"), ("jerk", "/s³"))
        names = [_label(name, unit, rate) for name, rate in rows]
        for k, (axes, name) in enumerate(zip(plots, names, strict=True)):
            for count, phase in enumerate(np.flatnonzero(np.array(motion.durations) > 1e-9).tolist()):
                axes.axvspan(ends[phase], ends[phase + 1], color="#e9edf1" if count % 2 == 0 else "white", lw=0)
                if k == 0:
                    middle = 0.5 * (ends[phase] + ends[phase + 1])
                    axes.text(middle, 1.28 / 1.2 * distance, str(phase + 1), ha="center", va="bottom", fontsize=10)
            axes.plot(times, states[:, k], color="#22262b", lw=2)
            axes.set_title(name, fontsize=10, loc="left")
            axes.tick_params(labelsize=9)
            axes.set(xlim=(0, motion.duration))
        plots[0].set_ylim(-0.05 / 1.2 * distance, 1.25 * distance)
        for axes in plots[2:]:
            axes.set_xlabel("t [s]", fontsize=10)

    def _draw_cost(self, axes: Axes) -> None:
        found = self.durations
        axes.plot(JERKS, found["smooth"], "o-", color=SHORT, lw=2, label="stops, jerk limit (Ruckig)")
        axes.axhline(found["stop"], color="#22262b", ls="--", label="stops, no jerk limit")
        axes.axhline(found["blend"], color=BLENDED, ls="-.", label="blends, no jerk limit")
        axes.set(xscale="log", xlabel=_label("jerk limit", self.unit, "/s³"), ylabel="duration [s]", ylim=(0, None))
        axes.set_xticks([10, 100, 1000], ["10", "100", "1000"])
        axes.set_title("what a jerk limit costs", fontsize=13, loc="left")
        axes.legend(fontsize=9)
        axes.spines[["top", "right"]].set_visible(False)


def _label(name: str, unit: str, rate: str = "") -> str:
    """The label of an axis; without a unit if joints of both kinds are measured together."""
    return f"{name} [{unit.strip()}{rate}]" if unit else name


def _steps(lesson: MotionLesson) -> tuple[LessonStep, ...]:
    start = tuple(lesson.problem.start.tolist())
    before, after = (float(edge_lengths(q).sum()) for q in (lesson.raw, lesson.path.waypoints))
    taken = sum(shortcut.free for shortcut in lesson.shortcuts)
    a, j = float(lesson.limits.acceleration[0]), float(lesson.limits.jerk[0])
    found, unit = lesson.durations, lesson.unit
    long, short = (f"{length:.{length_digits(lesson.scale)}f}{unit}" for length in (before, after))
    jerk_unit = f"{unit}/s³" if unit else ""
    rows = (
        (
            "path",
            "What a planner returns",
            f"""<p>RRT-Connect computes a <b>path</b>: {len(clean(lesson.raw))} waypoints, joined by straight lines in
            joint space, certified free. It is jagged, {long} long, and has no time: how fast may the arm
            go, and what happens at the corners?</p><p>Drive it (D): with a stop at every corner it is slow.</p>""",
        ),
        (
            "shortcut",
            "Shortcuts",
            f"""<p>Choose two random points of the path. If the straight line between them is free, it replaces the part
            between them; if not (dotted, ✕), nothing changes. No try makes the path longer: {taken} of
            {len(lesson.shortcuts)} tries are taken, and {long} become {short}. Step through them with the
            slider.</p> <p>(Geraerts, Overmars 2007)</p>""",
        ),
        (
            "blend",
            "Blends",
            """<p>At a corner the direction jumps, so the speed has to be zero there. A <b>blend</b>, a parabola that
            touches both lines, removes the jump. It leaves the path a little, toward the inside of the corner, so
            it has to be certified; if it is not free, it is halved. The slider is the largest distance from a
            corner to its blend: zero means stops.</p><p>(after Kunz, Stilman 2012)</p>""",
        ),
        (
            "plane",
            "The phase plane",
            f"""<p>Along the path, only the speed ṡ at each s remains to be chosen. The limits of the joints,
            {math("|", "q′", "ṡ", "|", "≤", "v")} and
            {math("|", "q′", "s̈", "+", "q″", "ṡ", "²", "|", "≤", "a")}, exclude everything above the <b>limit
            curve</b>, which drops in every blend. The fastest motion accelerates as hard and brakes as late as
            possible; it changes between them at the <b>switching points</b> ●. (Bobrow 1985; TOPP-RA: Pham, Pham 2018;
            Lynch, Park 9.4)</p>""",
        ),
        (
            "limits",
            "What limits what",
            """<p>Move the limits. Halve the <b>velocity</b>: the plateaus on straight lines sink, and the motion takes
            up to twice as long. Halve the <b>acceleration</b>: the slopes get flatter, the valleys in the blends
            deeper. Click in the phase plane: the arm goes to that s.</p>""",
        ),
        (
            "phases",
            "Jerk: seven phases",
            f"""<p>Jumps of acceleration shake the arm. With a <b>jerk</b> limit, the fastest motion of one joint from
            rest to rest has up to seven phases of constant jerk: + 0 − 0 − 0 +. Dashed: without a jerk limit, three
            phases. If all seven occur, the limit costs exactly {math("a", "/", "j")}: here {a:g} / {j:g} = {a / j:.2g}
            s. Shorten the distance, and phases vanish. (Biagiotti, Melchiorri 2008; Ruckig: Berscheid, Kröger
            2021)</p>""",
        ),
        (
            "cost",
            "What a jerk limit costs",
            f"""<p>The whole path: with stops and no jerk limit {found["stop"]:.2f} s, with blends
            {found["blend"]:.2f} s. Ruckig connects states of rest, so the jerk-limited motion stops at every
            corner: at {JERKS[0]:g}{jerk_unit} {found["smooth"][0]:.2f} s, at {JERKS[-1]:g}{jerk_unit}
            {found["smooth"][-1]:.2f} s. Each straight line takes about a/j longer, and stops at corners cost more than
            the jerk limit.</p>""",
        ),
    )
    return tuple(LessonStep(name, title, text, start) for name, title, text in rows)
