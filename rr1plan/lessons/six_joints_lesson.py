"""Lesson "six_joints": the picture of two joints for an arm with six."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.patches import Patch
from numpy.typing import NDArray

from rr1plan.checks import Array, counted
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.lessons.free_share import free_share
from rr1plan.lessons.inverse_solutions import InverseSolution, inverse_solutions, self_motion
from rr1plan.lessons.lesson import Lesson, LessonStep
from rr1plan.lessons.lesson_scenes import refuse_problem
from rr1plan.lessons.mathml import math, root
from rr1plan.lessons.picture_panels import pair_layers, picture_panel
from rr1plan.playback.cspace.cspace_colors import HATCHES, ink_on, layer_colors, layer_patterns
from rr1plan.playback.cspace.cspace_figure import swatch
from rr1plan.playback.cspace.cspace_grid import LIMITS, CSpaceGrid, compute_grid, joint_symbol
from rr1plan.playback.viewer.page_document import view_document
from rr1plan.scene import Scene
from rr1plan.scene.model_library import load_scene
from rr1plan.scene.problem import Problem

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rr1plan.playback.viewer.page_document import Document
    from rr1plan.playback.viewer.view_options import Panel, ViewOptions

_SELF = "self-collision"
_FREE, _TOUCH, _OPEN = "#14855a", "#c2255c", "#e08a00"
# Configurations of RR1 in the shipped scene: a tool pose with eight solutions; a self-motion with contacts.
_POSED, _TURNING = (0.21, 0.12, -0.43, -1.45, 2.19, -2.34), (-0.719, -0.057, -0.386, -0.358, 0.639, -0.315)
_AXES = {"x": "around x", "y": "around y", "z": "yaw (z)"}
_CELLS = 180  # of a slice in the figure
_SAMPLES = 10_000


class SixJointsLesson(Lesson):
    """An arm of six joints: slices, inverse solutions, self-motion, and the free share."""

    name = "six_joints"

    def __init__(self, scene: Scene | None, problem: Problem | None) -> None:
        refuse_problem(self.name, problem)
        self.scene = load_scene("rr1_table") if scene is None else scene
        if len(self.scene.arms) != 1:
            raise InputError(f"lesson 'six_joints' needs a scene with one arm, and this one has {len(self.scene.arms)}")
        (self.arm,) = self.scene.arms
        robot = self.scene.arms[self.arm].robot
        if robot.nq != 6:
            raise InputError(f"lesson 'six_joints' needs an arm of six joints, and arm {self.arm!r} has {robot.nq}")
        if not np.isfinite(robot.limits.upper - robot.limits.lower).all():
            raise InputError(f"lesson 'six_joints' needs joint limits, and arm {self.arm!r} has a joint without")
        own = np.array(self.scene.arms[self.arm].q)
        posed, turning = (np.array(q) if scene is None else own for q in (_POSED, _TURNING))
        self.checker = CollisionChecker(self.scene)
        self.solutions = inverse_solutions(self.scene, self.arm, posed)
        self.motions = {axis: self_motion(self.scene, self.arm, turning, axis=axis) for axis in "yxz"}
        self.turning = turning
        self.share = free_share(self.checker, _SAMPLES, rng=0)
        self.steps = _steps(self, tuple(own))

    # ---- the page --------------------------------------------------------------------------

    def _page(self, options: ViewOptions) -> tuple[Document, tuple[Panel, ...]]:
        robot = self.scene.arms[self.arm].robot
        grid = compute_grid(self.scene, resolution=8)
        colors = {name: color for name, color in layer_colors(grid).items() if name in self.scene.obstacles}
        colors[_SELF] = "#4a4f57"
        limits = robot.limits
        joints = [
            {
                "name": name.removesuffix("_joint"),
                "straight": robot.joint(name).kind == "prismatic",
                "symbol": joint_symbol(robot, name),
            }
            for name in robot.joint_names
        ]
        everything = {
            "joints": joints,
            "low": limits.lower.tolist(),
            "high": limits.upper.tolist(),
            "periodic": [False] * robot.nq,
        }
        data = {
            "pair": [0, 2],
            **{key: value[:2] for key, value in everything.items()},
            "all": everything,
            "arm": list(range(robot.nq)),
            "layers": [
                {"name": name, "color": color, "kind": "self" if name == _SELF else "thing"}
                for name, color in colors.items()
            ],
            "layerOf": pair_layers(self.checker, self.arm, list(colors)),
            "solutions": [_solution_data(solution) for solution in self.solutions],
            "motions": {axis: self._motion_data(axis) for axis in self.motions},
        }
        panel = picture_panel("slices", "Six joints", ("slice_raster.js",), data)
        return view_document(self.scene, options=options), (panel,)

    def _motion_data(self, axis: str) -> dict[str, object]:
        rows = self.motions[axis]
        nearest = int(np.argmin(np.linalg.norm(rows - self.turning, axis=1)))
        return {
            "title": _AXES[axis],
            "rows": np.round(rows, 5).tolist(),
            "free": self.checker.are_free(rows).tolist(),
            "begin": nearest / max(len(rows) - 1, 1),
        }

    # ---- the figure ------------------------------------------------------------------------

    def _draw(self, figure: Figure) -> None:
        plots = figure.subplots(2, 3).ravel()
        robot = self.scene.arms[self.arm].robot
        posed = np.array(self.solutions[0].q)
        straight = [joint.kind == "prismatic" for joint in map(robot.joint, robot.joint_names)]
        symbols = [joint_symbol(robot, name) for name in robot.joint_names]
        handles: dict[str, Patch] = {}
        # One pair of joints at several values of another joint; then other pairs.
        lower, upper = robot.limits.lower, robot.limits.upper
        views = [((0, 2), 4, lower[4] + share * (upper[4] - lower[4])) for share in (0.2, 0.5, 0.8)]
        views += [((1, 2), 4, posed[4]), ((2, 4), 4, posed[4])]
        for axes, ((i, j), other, value) in zip(plots, views, strict=False):
            q = posed.copy()
            q[other] = value
            scene = self.scene.with_configuration(self.arm, q)
            grid = compute_grid(scene, self.arm, (robot.joint_names[i], robot.joint_names[j]), resolution=_CELLS)
            for name, patch in _draw_slice(axes, grid).items():
                handles.setdefault(name, patch)
            axes.set(xlim=(lower[i], upper[i]), ylim=(lower[j], upper[j]))
            labels = [f"{symbols[k]} [{'m' if straight[k] else 'rad'}]" for k in (i, j)]
            axes.set(xlabel=labels[0], ylabel=labels[1])
            if (i, j) == (0, 2):
                shown = f"{value:.2g} m" if straight[other] else f"{np.degrees(value):.0f}°"
                axes.set_title(f"{symbols[other]} = {shown}".replace("-", "−"), loc="left")
        self._draw_share(plots[5])
        figure.legend(handles=list(handles.values()), loc="outside lower center", ncols=8, frameon=False, fontsize=12)

    def _draw_share(self, axes: Axes) -> None:
        """The estimate over the number of samples, with its confidence interval."""
        counts = np.unique(np.round(np.geomspace(20, 2_000, 12)).astype(int))
        rows = [free_share(self.checker, int(n), rng=0) for n in counts]
        axes.fill_between(
            counts, [r.low for r in rows], [r.high for r in rows], color="#2f66c8", alpha=0.2, linewidth=0
        )
        axes.plot(counts, [r.share for r in rows], color="#2f66c8", linewidth=2)
        lowest = 0.5 if min(r.low for r in rows) > 0.5 else 0.0
        axes.set(xscale="log", ylim=(lowest, 1.0), xlabel="samples", ylabel="free share")
        axes.set_xticks([100, 1000], ["100", "1000"])
        axes.spines[["top", "right"]].set_visible(False)
        axes.set_box_aspect(1)


def _draw_slice(axes: Axes, grid: CSpaceGrid) -> dict[str, Patch]:
    """Draw one slice; returns the legend symbols of its layers."""
    handles, patterns = {}, layer_patterns(grid)
    for name, color in layer_colors(grid).items():
        mask: NDArray[np.bool_] = grid.layers[name]
        if mask.any() and name != LIMITS:
            hatch = HATCHES[patterns[name]]
            drawn = axes.contourf(*grid.axes, mask.T.astype(float), levels=(0.5, 1.5), colors=(color,), hatches=[hatch])
            drawn.set(edgecolor=ink_on(color), linewidth=0.0)
            handles[name] = swatch(color, patterns[name], label=name)
    axes.set_box_aspect(1)
    return handles


def _solution_data(solution: InverseSolution) -> dict[str, object]:
    state = "free" if solution.is_valid else "contact" if solution.within_limits else "limits"
    touching = ", ".join(f"{a} and {b}" for a, b in solution.touching)
    text = {"free": "free", "contact": f"in contact: {touching}", "limits": "outside the joint limits"}[state]
    return {"q": np.round(solution.q, 9).tolist(), "state": state, "text": text}


def _moving(motions: dict[str, Array]) -> str:
    """How many joints a rotation of the tool about each of its axes moves."""
    joints = {axis: counted(int((np.ptp(rows, axis=0) > 1e-4).sum()), "joint") for axis, rows in motions.items()}
    return "Here a rotation " + ", ".join(f"about {axis} moves {joints[axis]}" for axis in sorted(joints))


def _steps(lesson: SixJointsLesson, home: tuple[float, ...]) -> tuple[LessonStep, ...]:
    solutions, share = lesson.solutions, lesson.share
    inside = [s for s in solutions if s.within_limits]
    valid = [s for s in inside if s.is_valid]
    years = 360.0**6 * 50e-6 / (365.25 * 86400)
    return (
        LessonStep(
            "slices",
            "A point in six dimensions",
            """<p>This arm has six joints: a configuration is a point in a box of six dimensions, and obstacles are
            bodies in this box. What can be drawn is a <b>slice</b>: two joints move, four are fixed. In the slice
            everything is as in the lessons on two joints. Click into it, and choose other joints above.</p>
            <p>Drag an obstacle or a link of the arm: the images follow.</p>""",
            home,
        ),
        LessonStep(
            "others",
            "Every other joint changes the picture",
            """<p>Move the slider of a joint that is not in the slice, the wrist for instance. Images of obstacles move,
            grow, tear and vanish: they are cuts through one body in six dimensions, as a plane cuts an apple.</p>
            <p>Two free parts that look separate here may be connected through the four joints that are not drawn.
            <b>A slice proves nothing about connections.</b></p>""",
            home,
        ),
        LessonStep(
            "many",
            "Why nobody fills the grid",
            f"""<p>There are 15 pairs of joints, and for each pair a slice for every value of four others. At 360 cells
            per joint two joints have 129,600 cells, which takes the page a few milliseconds. Six joints have
            360⁶ = 2.2 · 10¹⁵; at 50 µs each that is {years:,.0f} years.</p>
            <p>So planners for six joints never compute the configuration space. They check single configurations and
            edges, and store the results as a tree or a roadmap.</p>""",
            home,
        ),
        LessonStep(
            "solutions",
            f"One pose, {counted(len(solutions), 'solution')}",
            f"""<p>The elbow of a 2R arm has two sides. A six-axis arm has shoulder, elbow and wrist to turn over:
            this pose of the tool has {counted(len(solutions), "solution")}: {len(inside)} within the joint limits,
            {len(valid)} also free of contact. Keys <kbd>1</kbd> to <kbd>{min(len(solutions), 9)}</kbd> go to
            them: the tool does not move.</p>
            <p>Each dot is drawn at its two joints, but lies in another slice. A planner that takes all of them as goals
            finds shorter paths, and finds one where a single goal would be walled off.</p>""",
        ),
        LessonStep(
            "self_motion",
            "One condition less, and the arm can move",
            f"""<p>If the tool may turn about one of its axes, six joints have five conditions, and the solutions form
            <b>curves</b>: the arm moves, but the tool keeps its position. {_moving(lesson.motions)}:
            in many arms the last axis is the tool’s z axis. Where the curve is dashed, the arm is in contact.</p>
            <p>The velocities of such a motion lie in the null space of the Jacobian's five rows.</p>""",
        ),
        LessonStep(
            "measure",
            "What can be measured",
            f"""<p>How much of the configuration space is free? Check random configurations and count. After
            {math("n")} samples the error is about {
                math(root("p", "(", "1", "−", "p", ")", "/", "n"))
            }, in <b>any</b> number of dimensions. Press
            <b>Sample 500</b> until the interval is narrow enough; four times the samples halve it.</p>
            <p>10,000 samples in Python give {100 * share.share:.1f} % ({100 * share.low:.1f} to {
                100
                * share.high:.1f} %). That says how often a sample is free, not whether a narrow passage exists.</p>""",
        ),
        LessonStep(
            "survives",
            "What survives",
            """<ul><li>Configurations, free or not; the exact test of one, and of a whole edge.</li>
            <li>Paths as curves, and trees and roadmaps of them.</li>
            <li>Inverse solutions as goals, null motions as freedom.</li></ul>
            <p>What does not: the map, the components by eye, and the proof that there is <i>no</i> path. With two
            joints a grid gives it; with six a planner that finds nothing has proven nothing.</p>""",
            home,
        ),
    )
