"""The lessons by name."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from rr1plan.checks import known_name, of_kind
from rr1plan.errors import InputError
from rr1plan.lessons.lesson_titles import LESSONS
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem
from rr1plan.scene.scene_differences import check_same_scene

if TYPE_CHECKING:
    from rr1plan.lessons.lesson import Lesson


def lesson_names() -> tuple[str, ...]:
    """The names of the lessons, in the order of a course."""
    return tuple(LESSONS)


def lesson(name: str, scene: Scene | None = None, problem: Problem | None = None) -> Lesson:
    """A lesson about its default arm and obstacles, or about yours.

    Args:
        name: One of `lesson_names()`.
        scene: Your scene (default: the problem's, or the lesson's own); for most lessons with one arm of two joints,
            e.g. a `planar_arm`.
        problem: Your query in that scene, for lessons that have one; for "two_arms" a query of two such arms.

    Returns:
        A value with the methods `show` and `save`, by suffix a page (.html) or a picture (.png, .svg, .pdf).

    Raises:
        UnknownNameError: no such lesson.
        InputError: a scene or a problem that the lesson cannot use; the message states the requirements.
    """
    kind, _ = LESSONS[known_name("lesson", name, LESSONS)]
    if isinstance(scene, Problem):
        raise InputError(f"a problem is not the scene of a lesson: pass it as lesson({name!r}, problem=...)")
    of_kind("scene", scene, Scene, optional=True)
    of_kind("problem", problem, Problem, optional=True)
    if problem is not None and scene is not None:
        check_same_scene("the problem", problem.scene, scene, (), "give its own, or leave out scene")
    made: Lesson = getattr(import_module(f"rr1plan.lessons.{name}_lesson"), kind)(
        problem.scene if problem is not None else scene, problem
    )
    return made
