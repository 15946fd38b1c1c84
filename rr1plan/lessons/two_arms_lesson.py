"""Lesson "two_arms": four joints by slices, and two paths in a coordination diagram."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.colors import ListedColormap
from numpy.typing import ArrayLike

from rr1plan.checks import Array, counted
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.lessons.lesson import Lesson, LessonStep
from rr1plan.lessons.lesson_scenes import length_unit
from rr1plan.lessons.path_schedules import PairCurve, PathPair, fastest_curve, path_pair, unscheduled_curve
from rr1plan.lessons.picture_panels import pair_layers, picture_panel, slice_axes
from rr1plan.lessons.planar_outlines import view_data
from rr1plan.model.flat_arm import flat_arm
from rr1plan.planners import RrtConnect
from rr1plan.planners.shortcut import shorten
from rr1plan.planning import Budget
from rr1plan.playback.arm_colors import arm_color
from rr1plan.playback.cspace.cspace_grid import compute_grid, joint_symbol
from rr1plan.playback.cspace.cspace_torus import wrapped_pieces
from rr1plan.playback.outlines import silhouette
from rr1plan.playback.viewer.page_arrays import pack_bytes
from rr1plan.playback.viewer.page_document import view_document
from rr1plan.scene import Scene
from rr1plan.scene.model_library import load_scene
from rr1plan.scene.problem import Problem
from rr1plan.scene.subscene import subscene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rr1plan.playback.viewer.page_document import Document
    from rr1plan.playback.viewer.view_options import Panel, ViewOptions

_INK, _SOFT, _BLOCKED, _ACCENT, _START, _GOAL = "#22262b", "#667080", "#c3cad5", "#e4500e", "#2f66c8", "#14855a"
_OBSTACLE = "#6b9b5e"
_PICTURE = 240  # cells of a slice in the figure
_SEED = 0
_GRAY = ListedColormap([_BLOCKED])

# A path of each arm that is free without the other arm.
PATHS: dict[str, tuple[ArrayLike, ArrayLike]] = {
    "take_turns": ([[1.2, -2.5], [0.0, -0.7], [-1.2, 2.5]], [[1.5, -2.2], [-0.3, -0.8], [-1.5, 2.2]]),
    "back_up": (
        [[-0.6, 0.0], [0.6, 0.0]],
        [[1.6, -2.4], [0.5, 0.0], [1.6, -2.4], [-1.6, -2.4], [-0.5, 0.0], [-1.6, -2.4]],
    ),
    "swap_sides": ([[0.2, 0.0], [-0.2, 0.0]], [[0.2, 0.0], [-0.2, 0.0]]),
}
_OWN = "own"  # the paths of a teacher's own query
_TITLES = {"take_turns": "Take turns", "back_up": "Back up", "swap_sides": "Swap sides", _OWN: "Your paths"}
# Content of each step: paths, schedule, time [s], and the picture to which a small window scrolls.
_SHOWN = {
    "slices": ("take_turns", "right_first", 0.0, ".slice"),
    "moving": ("take_turns", "right_first", 2.6, ".slice"),
    "diagram": ("take_turns", "at_once", 2.4, ".diagram"),
    "orders": ("take_turns", "right_first", 0.0, ".diagram"),
    "back_up": ("back_up", "back_up", 0.0, ".diagram"),
    "barrier": ("swap_sides", "at_once", 0.0, ".diagram"),
    "joint": ("swap_sides", "joint", 0.0, ".diagram"),
}


class _Schedule(NamedTuple):
    """A motion of both arms: a curve in the diagram, or configurations of both arms off their paths."""

    name: str
    title: str
    text: str
    tone: str
    curve: PairCurve | None
    joint: Array | None = None
    times: Array | None = None

    @property
    def duration(self) -> float:
        """Arrival time of the last arm [s]."""
        if self.curve is not None:
            return self.curve.duration
        assert self.times is not None
        return float(self.times[-1])


class TwoArmsLesson(Lesson):
    """Two 2R arms: slices of four joints, coordination diagrams, and a query that no order of the arms solves."""

    name = "two_arms"

    def __init__(self, scene: Scene | None, problem: Problem | None) -> None:
        if problem is not None:
            self._take_query(problem)
            return
        if scene is not None:
            raise InputError(
                "lesson 'two_arms' is about a query of two arms, expected a problem: rp.Problem(scene, starts, goals)"
            )
        self.scene = load_scene("planar2r_pair")
        self.arms: tuple[str, str] = ("left", "right")
        self.pairs = {name: path_pair(self.scene, *zip(self.arms, paths, strict=True)) for name, paths in PATHS.items()}
        self.schedules = {
            "take_turns": _turns(self.pairs["take_turns"]),
            "back_up": _backing(self.pairs["back_up"]),
            "swap_sides": _swap(self.scene, self.pairs["swap_sides"]),
        }
        self.steps = tuple(LessonStep(*step) for step in _steps(self.pairs, self.schedules))
        self._shown: dict[str, tuple[str, str, float, str]] = _SHOWN

    def _take_query(self, problem: Problem) -> None:
        """Use a teacher's own query: a path of each arm, planned without the other arm, and their schedules."""
        scene, arms = problem.scene, problem.arms
        flat = [name for name in scene.arms if flat_arm(scene.arms[name]) is not None]
        if len(scene.arms) != 2 or len(arms) != 2 or len(flat) != 2:
            raise InputError(
                "lesson 'two_arms' needs a scene of two arms, each of two joints in a horizontal plane, and goals for "
                f"both; this one has {counted(len(scene.arms), 'arm')}, {len(flat)} of them such, "
                f"and {len(arms)} with a goal"
            )
        self.scene, self.arms, self._aspect = scene, (arms[0], arms[1]), 0.9
        pair = path_pair(scene, *((name, _path_alone(problem, name)) for name in self.arms))
        schedules = _schedules(scene, pair)
        self.pairs, self.schedules = {_OWN: pair}, {_OWN: schedules}
        self.steps = tuple(LessonStep(*step) for step in _own_steps(pair, schedules))
        first, best = schedules[0], min(schedules, key=lambda schedule: (schedule.tone == "bad", schedule.duration))
        self._shown = {
            "slices": (_OWN, best.name, 0.0, ".slice"),
            "moving": (_OWN, best.name, 0.4 * best.duration, ".slice"),
            "diagram": (_OWN, first.name, 0.4 * first.duration, ".diagram"),
            "schedules": (_OWN, best.name, 0.0, ".diagram"),
        }

    # ---- the page --------------------------------------------------------------------------

    def _page(self, options: ViewOptions) -> tuple[Document, tuple[Panel, ...]]:
        checker = CollisionChecker(self.scene)
        arms = [self._arm(checker, name, k) for k, name in enumerate(self.arms)]
        data = {
            "arms": arms,
            "columnsOfBoth": [0, 1, 2, 3],
            "scenarios": [self._scenario(name) for name in self.pairs],
            **view_data(self.scene),
        }
        panel = picture_panel("pair", "Two arms, four joints", ("slice_raster.js",), data)
        return view_document(self.scene, options=options), (panel,)

    def _data(self) -> dict[str, tuple[str, str, float, str]]:
        return self._shown

    def _arm(self, checker: CollisionChecker, name: str, number: int) -> dict[str, object]:
        other = self.arms[1 - number]
        layers = {other: arm_color(1 - number), **dict.fromkeys(self.scene.obstacles, _OBSTACLE)}
        return {
            "name": name,
            "color": arm_color(number),
            "layers": [{"name": n, "color": c, "kind": "thing"} for n, c in layers.items()],
            "layerOf": pair_layers(checker, name, list(layers)),
            **slice_axes(self.scene, name),
        }

    def _scenario(self, name: str) -> dict[str, object]:
        pair = self.pairs[name]
        return {
            "name": name,
            "title": _TITLES[name],
            "shape": list(pair.blocked.shape),
            "blocked": pack_bytes(np.packbits(pair.blocked.ravel(), bitorder="little")),
            "lengths": [np.round(row, 6).tolist() for row in pair.lengths],
            "configurations": [np.round(q, 6).tolist() for q in pair.configurations],
            "schedules": [_schedule_data(schedule) for schedule in self.schedules[name]],
        }

    # ---- the figure ------------------------------------------------------------------------

    def _draw(self, figure: Figure) -> None:
        pictures = figure.subplots(2, 3 if len(self.pairs) > 1 else 2).ravel().tolist()
        first = next(iter(self.pairs))
        pair = self.pairs[first]
        curve = next((s.curve for s in reversed(self.schedules[first]) if s.curve is not None), unscheduled_curve(pair))
        now = curve.places[int(np.searchsorted(curve.times, 0.4 * curve.duration))]
        q = [rows[0] for rows in pair.at(now[None])]
        self._draw_workspace(pictures[0], q)
        for k in range(2):
            self._draw_slice(pictures[1 + k], k, pair, q)
        for axes, name in zip(pictures[3:], self.pairs, strict=True):
            _draw_diagram(axes, self.scene, self.pairs[name], self.schedules[name], now if name == first else None)
            axes.set_title(_TITLES[name].lower(), loc="left")
        handles = {
            line.get_label(): line
            for axes in pictures[3:]
            for line in axes.get_lines()
            if not line.get_label().startswith("_")
        }
        figure.legend(handles=list(handles.values()), loc="outside lower center", ncols=5, frameon=False, fontsize=12)

    def _draw_workspace(self, axes: Axes, configurations: Sequence[Array]) -> None:
        for k, (name, q) in enumerate(zip(self.arms, configurations, strict=True)):
            arm = self.scene.arms[name]
            for link, T in arm.robot.link_poses(q).items():
                for g in arm.robot.link(link).collisions:
                    corners = silhouette(g.shape, arm.base @ T @ g.pose)
                    axes.fill(*corners.T, color=arm_color(k), alpha=0.85, linewidth=0)
            x, y = arm.base[:2, 3].tolist()
            axes.annotate(name, (x, y), xytext=(0, -26), textcoords="offset points", ha="center", color=arm_color(k))
        for obstacle in self.scene.obstacles.values():
            for g in obstacle.geometries:
                axes.fill(*silhouette(g.shape, obstacle.pose @ g.pose).T, color=_OBSTACLE, linewidth=0)
        axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
        axes.margins(0.08)
        axes.set_title("workspace", loc="left")
        axes.spines[["top", "right"]].set_visible(False)

    def _draw_slice(self, axes: Axes, k: int, pair: PathPair, configurations: Sequence[Array]) -> None:
        """The slice of arm k with the other arm fixed, and its path."""
        name, other = self.arms[k], self.arms[1 - k]
        grid = compute_grid(self.scene.with_configuration(other, configurations[1 - k]), name, resolution=_PICTURE)
        for layer, color in {other: arm_color(1 - k), **dict.fromkeys(self.scene.obstacles, _OBSTACLE)}.items():
            if layer in grid.layers:
                axes.contourf(*grid.axes, grid.layers[layer].T.astype(float), levels=(0.5, 1.5), colors=(color,))
        path = pair.configurations[k]
        for piece in wrapped_pieces(path, grid):
            axes.plot(*piece.T, color="white", linewidth=5)
            axes.plot(*piece.T, color=_INK, linewidth=2)
        for q, color in ((path[0], _START), (path[-1], _GOAL), (configurations[k], arm_color(k))):
            axes.plot(*grid.wrapped(q), "o", color=color, markersize=10, markeredgecolor="white", markeredgewidth=1.5)
        symbols = [joint_symbol(self.scene.arms[name].robot, joint) for joint in grid.joint_names]
        first, second = (length_unit([turns]).strip() for turns in grid.turns)
        axes.set(xlim=grid.ranges[0], ylim=grid.ranges[1], box_aspect=1)
        axes.set(xlabel=f"{symbols[0]} of {name} [{first}]", ylabel=f"{symbols[1]} [{second}]")
        axes.set_title(f"slice: {other} stands still", loc="left")


def _draw_diagram(axes: Axes, scene: Scene, pair: PathPair, schedules: Sequence[_Schedule], now: Array | None) -> None:
    """The diagram of two paths with its schedules, and the current positions of both arms."""
    one, two = pair.lengths
    inner = np.where(pair.blocked[1:-1, 1:-1], 1.0, np.nan)
    axes.pcolormesh(one, two, inner.T, cmap=_GRAY, shading="flat", rasterized=True)
    styles = {"at_once": (_SOFT, ":")} | {
        f"{name}_first": (arm_color(k), line) for k, (name, line) in enumerate(zip(pair.arms, ("-", "--"), strict=True))
    }
    for schedule in schedules:
        if schedule.curve is not None:
            color, line = styles.get(schedule.name, (_ACCENT, "-"))
            axes.plot(
                *schedule.curve.places.T, color=color, linestyle=line, linewidth=2.6, label=schedule.title.lower()
            )
    if now is not None:
        axes.plot(*now, "o", color=_INK, markersize=10, markeredgecolor="white", markeredgewidth=2, zorder=5)
    labels = []
    for name in pair.arms:
        robot = scene.arms[name].robot
        unit = length_unit([robot.joint(joint).kind != "prismatic" for joint in robot.joint_names])
        labels.append(f"path of {name}{unit and f' [{unit.strip()}]'}")
    axes.set(xlim=(0, one[-1]), ylim=(0, two[-1]), xlabel=labels[0], ylabel=labels[1], box_aspect=1)


def _turns(pair: PathPair) -> tuple[_Schedule, ...]:
    left, right = (fastest_curve(pair, first=name) for name in pair.arms)
    if left is None or right is None:
        raise InputError("the arms cannot take turns on these paths")
    return (
        _Schedule(
            "at_once",
            "Both at once",
            "Neither waits: the curve leads through the blocked region.",
            "bad",
            unscheduled_curve(pair),
        ),
        _Schedule("left_first", "Left first", _words("Right waits until left has left the middle", left), "good", left),
        _Schedule(
            "right_first", "Right first", _words("Left waits until right has left the middle", right), "good", right
        ),
    )


def _words(text: str, curve: PairCurve) -> str:
    return f"{text}. Both are there after {curve.duration:.1f} s."


def _backing(pair: PathPair) -> tuple[_Schedule, ...]:
    curve = fastest_curve(pair, back_up=True)
    if curve is None:
        raise InputError("the arms do not get past each other on these paths")
    text = _words("Left makes room, goes back on its path to make room again, and then goes on", curve)
    return (
        _Schedule("at_once", "Both at once", "Neither waits, and they touch.", "bad", unscheduled_curve(pair)),
        _Schedule("back_up", "Back up", text, "good", curve),
    )


def _swap(scene: Scene, pair: PathPair) -> tuple[_Schedule, ...]:
    together = _together(scene, pair)
    if together is None:
        raise InputError("the arms do not pass each other")
    return (
        _Schedule(
            "at_once", "Both at once", "The blocked region reaches from side to side.", "bad", unscheduled_curve(pair)
        ),
        together,
    )


def _together(scene: Scene, pair: PathPair) -> _Schedule | None:
    """Both arms planned in their four joints at once, each at 1 rad/s or slower; None if no path is found."""
    starts, goals = ({name: q[k] for name, q in zip(pair.arms, pair.configurations, strict=True)} for k in (0, -1))
    problem = Problem(scene, starts, goals)
    result = RrtConnect().plan(problem, budget=Budget(iterations=200_000), rng=_SEED)
    if result.path is None:
        return None
    path = shorten(result.path, scene, rng=_SEED)
    steps = np.diff(path.waypoints, axis=0)
    fastest = np.maximum(np.linalg.norm(steps[:, :2], axis=1), np.linalg.norm(steps[:, 2:], axis=1))
    times = np.concatenate([[0.0], np.cumsum(fastest)])
    text = f"Planned in all four joints at once: the arms make room for each other, and pass. {times[-1]:.1f} s."
    return _Schedule("joint", "Plan both together", text, "good", None, np.array(path.waypoints), times)


# ---- a teacher's own query -------------------------------------------------------------------


def _path_alone(problem: Problem, name: str) -> Array:
    """Waypoints of an arm's path among the obstacles, without the other arm."""
    alone = subscene(problem.scene, {name: problem.start[problem.columns[name]]})
    start = alone.arms[name].q
    result = RrtConnect().plan(
        Problem(alone, start, {name: problem.goal[name]}), budget=Budget(iterations=200_000), rng=_SEED
    )
    if result.path is None:
        raise InputError(f"arm {name!r} gets no path, even without the other arm: {result.reason}")
    if (result.path.waypoints == start).all():
        raise InputError(f"arm {name!r} is at its goal, expected paths of both arms")
    return np.array(shorten(result.path, alone, rng=_SEED).waypoints)


def _schedules(scene: Scene, pair: PathPair) -> tuple[_Schedule, ...]:
    """Both at once, each arm first, backing up if neither order is possible, and both planned together."""
    at_once = unscheduled_curve(pair)
    if not pair.is_blocked(at_once):
        text = _words("The arms do not get in each other's way", at_once)
        return (_Schedule("at_once", "Both at once", text, "good", at_once),)
    text = "Neither waits: the curve leads through the blocked region."
    found = [_Schedule("at_once", "Both at once", text, "bad", at_once)]
    for name, other in (pair.arms, pair.arms[::-1]):
        curve = fastest_curve(pair, first=name)
        if curve is not None:
            text = _words(f"{other} waits until {name} has passed", curve)
            found.append(_Schedule(f"{name}_first", f"{name} first", text, "good", curve))
    if len(found) == 1:
        curve = fastest_curve(pair, back_up=True)
        if curve is not None:
            text = _words("Waiting is not enough: an arm goes back on its path to make room", curve)
            found.append(_Schedule("back_up", "Back up", text, "good", curve))
    together = _together(scene, pair)
    return (*found, *([] if together is None else [together]))


def _own_steps(pair: PathPair, schedules: Sequence[_Schedule]) -> list[tuple[str, str, str]]:
    found = "".join(
        f"<li><b>{escape(schedule.title)}</b>: "
        + (f"{schedule.duration:.1f} s" if schedule.tone == "good" else "they touch")
        + "</li>"
        for schedule in schedules
    )
    none = "" if any(schedule.tone == "good" for schedule in schedules) else "<p>No way was found.</p>"
    text = (
        "<p>From the lower left corner to the upper right one, without touching the blocked region: a level piece lets "
        f"{escape(pair.arms[1])} wait, an upright one {escape(pair.arms[0])}.</p><ul>{found}</ul>{none}"
    )
    return [*_first_steps(pair), ("schedules", "A schedule is a curve", text)]


def _schedule_data(schedule: _Schedule) -> dict[str, object]:
    curve = schedule.curve
    times = schedule.times if curve is None else curve.times
    return {
        "name": schedule.name,
        "title": schedule.title,
        "text": schedule.text,
        "tone": schedule.tone,
        "times": np.round(np.asarray(times), 6).tolist(),
        "places": None if curve is None else np.round(curve.places, 6).tolist(),
        "joint": None if schedule.joint is None else np.round(schedule.joint, 6).tolist(),
    }


def _first_steps(pair: PathPair) -> list[tuple[str, str, str]]:
    one, two = (escape(name) for name in pair.arms)
    cells = " × ".join(str(n - 2) for n in pair.blocked.shape)
    return [
        (
            "slices",
            "Four joints make four dimensions",
            "<p>Two arms of two joints have one configuration space of <b>four</b> dimensions: a point of it "
            f"gives both. It cannot be drawn, but a <b>slice</b> can: {two} "
            f"is fixed, and {one} has a configuration space of two joints, in which {two} is "
            "an obstacle like all others.</p><p>Click into the slice, or walk with the arrow keys. "
            f"<b>{two}</b> shows the other slice.</p>",
        ),
        (
            "moving",
            "The other arm is an obstacle that moves",
            f"<p>Move the slider, or press <b>Run</b>: {two} moves along its path, and its image sweeps "
            f"through the configuration space of {one}. The same slice at another time is another picture; its "
            f"free components merge and split. A path of {one} is good if it is at a free point <i>at "
            "every time</i>.</p>",
        ),
        (
            "diagram",
            "Two paths make a square",
            "<p>With both paths given, only two numbers remain: the progress of each arm. Each point of the "
            "<b>coordination diagram</b> is one pair of configurations; it is blocked where the arms touch "
            f"(O’Donnell and Lozano-Pérez 1989). Drag the point: the arms follow.</p><p>The {cells} cells here "
            "are not sampled. A cell is free if the arms are proven not to touch anywhere on the two "
            "segments.</p>",
        ),
    ]


def _steps(pairs: dict[str, PathPair], schedules: dict[str, tuple[_Schedule, ...]]) -> tuple[tuple[str, str, str], ...]:
    left, right = (schedules["take_turns"][k].curve for k in (1, 2))
    assert left is not None
    assert right is not None
    return (
        *_first_steps(pairs["take_turns"]),
        (
            "orders",
            "A schedule is a curve",
            "<p>From the lower left corner to the upper right one, without touching the blocked region. Where "
            "the curve is level, right waits; where it is vertical, left waits. It may pass on either side: "
            f"below, left goes first ({left.duration:.1f} s); above, right does ({right.duration:.1f} s). No "
            "curve can be bent into one on the other side without crossing the region: the two orders are two "
            "classes of schedules.</p>",
        ),
        (
            "back_up",
            "Sometimes an arm must back up",
            "<p>The right arm reaches out low, folds, and reaches out high. Left swings from low to high. It has "
            "to be high for the first, low for the second, and high in the end: every curve that only rises runs "
            "into a dead end, whoever waits. The curve that gets through turns back to the left for a while: the "
            "left arm goes <b>back</b> on its path and comes again.</p>",
        ),
        (
            "barrier",
            "And sometimes no schedule exists",
            "<p>Both arms are stretched and swap sides. The blocked region is a barrier: whoever goes first, and "
            "whoever waits or backs up, the arms meet. These paths have no schedule.</p><p><b>Prioritized "
            "planning</b> plans one arm alone and the other around its motion (Erdmann and Lozano-Pérez 1987). "
            "It fails here in both orders: alone, the first arm takes the straight path, stays stretched, and "
            "cuts the other one's configuration space in two, at every time. Look at the slice.</p>",
        ),
        (
            "joint",
            "Plan both together",
            "<p>In the four joints of both arms there is a path: RRT-Connect finds it at once. Both arms make "
            "detours that neither needs when it is alone, and only a planner that moves both at the same time finds "
            "them. The price is dimension: four arms have eight, twelve RR1 "
            "seventy-two.</p><p>rr1plan therefore times paths of single arms where it can, and plans the few "
            "arms that are in each other's way together.</p>",
        ),
    )
