"""The page of a lesson: the viewer's page with the lesson's panels, and its steps below the workspace."""

from __future__ import annotations

import html
import os
from dataclasses import replace
from pathlib import Path as FilePath

from rr1plan.files.file_access import check_writable, write_text
from rr1plan.lessons.lesson_content import LessonContent
from rr1plan.playback.viewer.html_page import page_html
from rr1plan.playback.viewer.live_viewer import Viewer, announced
from rr1plan.playback.viewer.page_asset import page_asset
from rr1plan.playback.viewer.page_document import Document
from rr1plan.playback.viewer.view_options import Panel, ViewOptions, checked_options

_PACKAGE = "rr1plan.lessons"


def save_page(lesson: LessonContent, file: str | os.PathLike[str], options: ViewOptions | None) -> FilePath:
    """Write a lesson as one self-contained page; see `Lesson.save_html`."""
    return write_text(check_writable(file, ".html"), page_html(*page_parts(lesson, options)))


def show_page(lesson: LessonContent, options: ViewOptions | None) -> Viewer:
    """Open a lesson live in the browser of this machine; see `Lesson.show`."""
    return announced(_LessonViewer(lesson, options))


class _LessonViewer(Viewer):
    """A live page of a lesson."""

    def __init__(self, lesson: LessonContent, options: ViewOptions | None) -> None:
        document, options = page_parts(lesson, options)
        self._open(lesson.scene, document, options)


def page_parts(lesson: LessonContent, options: ViewOptions | None) -> tuple[Document, ViewOptions]:
    """The document of the page, and the options with all panels."""
    options = checked_options(options)
    document, panels = lesson._page(options)
    if options.title is None:
        document["title"] = lesson.title
    # The steps come last, so that their script finds the other panels.
    return document, replace(options, panels=(*panels, *options.panels, _steps_panel(lesson)))


def _steps_panel(lesson: LessonContent) -> Panel:
    articles = "".join(
        f'<article data-step="{html.escape(step.name)}" hidden><h3>{html.escape(step.title)}</h3>{step.text}</article>'
        for step in lesson.steps
    )
    return Panel(
        "steps",
        lesson.title,
        html=page_asset("lesson.html", _PACKAGE).replace("{{ARTICLES}}", articles),
        css=page_asset("lesson.css", _PACKAGE) + page_asset(f"{lesson.name}_lesson.css", _PACKAGE, optional=True),
        script=page_asset("lesson.js", _PACKAGE)
        + page_asset(f"{lesson.name}_lesson.js", _PACKAGE, optional=True)
        + "steps.begin();\n",
        data={"poses": [step.q for step in lesson.steps], "own": lesson._data()},
    )
