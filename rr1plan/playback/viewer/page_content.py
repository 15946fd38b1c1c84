"""The representation of a value on a page: one contract for notebooks, pictures, videos and 3-D models."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from rr1plan.checks import shown
from rr1plan.errors import InputError
from rr1plan.playback.viewer.page_document import Document, view_document
from rr1plan.playback.viewer.view_options import ViewOptions, checked_options
from rr1plan.robot import Robot
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem

KINDS = "a scene, a robot, a problem, a motion, a sequence plan or a C-space"


@runtime_checkable
class HasPage(Protocol):
    """A motion, a sequence plan, a C-space or a viewer: values of higher layers that have a page."""

    def page_content(self, options: ViewOptions | None = None) -> tuple[Document, ViewOptions]:
        """The document of its page, and the options with its panels."""
        ...


def page_content(value: object, options: ViewOptions | None = None) -> tuple[Document, ViewOptions]:
    """The document of a value's page, and its options with all panels.

    Args:
        value: A scene, a robot, a problem, a motion, a sequence plan or a C-space.
        options: How the page looks (default: `ViewOptions()`).

    Raises:
        InputError: anything else.
        NoPlanError: a plan without a motion.
    """
    if isinstance(value, HasPage) and not isinstance(value, type):
        return value.page_content(options)
    problem = value if isinstance(value, Problem) else None
    match value:
        case Scene():
            scene = value
        case Problem():
            scene = value.scene
        case Robot():
            scene = Scene(name=value.name).with_arm("arm", value)
        case _:
            raise InputError(f"{shown(value)} has no page, expected {KINDS}")
    return view_document(scene, problem=problem, options=options), checked_options(options)
