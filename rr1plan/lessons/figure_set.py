"""All figures at once: those of the lessons, and the pictures of the README."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from rr1plan.checks import check_callback, known_name, shown
from rr1plan.errors import CancelledError, InputError, MissingPackageError
from rr1plan.files.file_access import make_folder
from rr1plan.lessons.lesson_catalog import lesson, lesson_names
from rr1plan.pipeline import plan_motion
from rr1plan.planners import RrtConnect
from rr1plan.planning import Budget
from rr1plan.playback.cspace.configuration_space import cspace
from rr1plan.playback.viewer import screenshot
from rr1plan.progress import Progress, ProgressCallback
from rr1plan.scene.model_library import load_problems, load_scene
from rr1plan.scene.problem import PoseGoal, Problem

if TYPE_CHECKING:
    from rr1plan.lessons.lesson import Lesson
    from rr1plan.playback.cspace.configuration_space import CSpace

_SIZE = (1280, 720)  # of the picture of a page [px]


def figure_names() -> tuple[str, ...]:
    """Names of the figures: "first_motion" and "planar2r_path", those of the README, and the lessons."""
    return (*_README, *lesson_names())


def save_figures(
    folder: str | FilePath, names: Sequence[str] | None = None, *, progress: ProgressCallback | None = None
) -> dict[str, tuple[FilePath, ...]]:
    """Write the figures of the lessons and the pictures of the README into a folder.

    The figures "workspace", "configuration_space" and "no_path" have the content of figures 1.3, 1.5 and 1.6 of the
    thesis in which RR1's digital twin was built.

    Args:
        folder: The folder; it is created if it does not exist.
        names: Some of `figure_names()` (default: all; "first_motion" only if the extra `video` and a browser are
            installed).
        progress: Called before each figure; False cancels.

    Returns:
        The files of each figure, a PNG and, except for "first_motion", an SVG.

    Raises:
        UnknownNameError: no such figure.
        InputError: a folder or a file that cannot be written, or no names.
        MissingPackageError: "first_motion" is named, and there is no browser.
        CancelledError: `progress` returned False.
    """
    check_callback("progress", progress)
    if names is not None and (isinstance(names, str) or not isinstance(names, Sequence) or not names):
        raise InputError(f"names is {shown(names)}, expected some of {', '.join(figure_names())}")
    wanted = figure_names() if names is None else tuple(known_name("figure", name, figure_names()) for name in names)
    target = make_folder(folder, f"{wanted[0]}.png")
    began, files = time.perf_counter(), {}
    for i, name in enumerate(wanted):
        now = Progress(name, time.perf_counter() - began, i / len(wanted))
        if progress is not None and progress(now) is False:
            raise CancelledError(f"cancelled: the progress callback returned False before figure {name!r}")
        try:
            files[name] = _README[name](target / name) if name in _README else _save_both(lesson(name), target / name)
        except MissingPackageError:
            if names is not None:
                raise
    return files


def _save_both(drawn: Lesson | CSpace, stem: FilePath) -> tuple[FilePath, ...]:
    return drawn.save_png(stem.with_suffix(".png")), drawn.save_svg(stem.with_suffix(".svg"))


def _planar2r_path(stem: FilePath) -> tuple[FilePath, ...]:
    problem = next(iter(load_problems("planar2r_path").values()))
    # Short edges show how the tree grew.
    planner = RrtConnect(range=0.15, tree=True)
    result = planner.plan(problem, budget=Budget(iterations=1500), rng=14)
    return _save_both(cspace(problem.scene, problem, result=result), stem)


def _first_motion(stem: FilePath) -> tuple[FilePath, ...]:
    goal = PoseGoal("tool", [-0.30, 0.25, 0.20])
    motion = plan_motion(Problem(load_scene("rr1_table"), start="home", goal=goal), rng=0)
    assert motion.trajectory is not None  # a shipped scene, a fixed seed
    return (screenshot(stem.with_suffix(".png"), motion, size=_SIZE, time=0.5 * motion.trajectory.duration),)


_README: dict[str, Callable[[FilePath], tuple[FilePath, ...]]] = {
    "first_motion": _first_motion,
    "planar2r_path": _planar2r_path,
}
