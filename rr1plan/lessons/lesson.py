"""`Lesson`: what all lessons have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, ClassVar

from numpy.typing import ArrayLike

from rr1plan.checks import check_text, finite_array
from rr1plan.files.file_access import check_writable
from rr1plan.lessons.lesson_catalog import LESSONS
from rr1plan.notebook_view import NotebookView
from rr1plan.playback.figure_files import check_width, save_figure
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rr1plan.playback.viewer.live_viewer import Viewer
    from rr1plan.playback.viewer.page_document import Document
    from rr1plan.playback.viewer.view_options import Panel, ViewOptions


@dataclass(frozen=True)
class LessonStep:
    """One step of a lesson: a few short paragraphs and what they are about.

    Args:
        name: A name unique in the lesson, which the lesson's script refers to.
        title: Its headline.
        text: Its paragraphs as HTML; formulas in MathML.
        q: The configuration that the page shows when the step is entered [rad or m]: all columns of the scene; None
            leaves the arms where they are.

    Raises:
        InputError: not text, or not numbers.
    """

    name: str
    title: str
    text: str
    q: ArrayLike | None = None

    def __post_init__(self) -> None:
        for field in ("name", "title", "text"):
            check_text(f"step {field}", getattr(self, field))
        if self.q is not None:
            object.__setattr__(self, "q", tuple(finite_array("step q", self.q, (None,)).tolist()))


class Lesson(NotebookView, ABC):
    """A lesson with its computed content; `lesson` makes one.

    Subclasses set `name`, `scene` and `steps`, and define `_page` and `_draw`.

    Attributes:
        name: Its name.
        scene: The arms and obstacles it is about.
        steps: Its steps in order.
    """

    name: ClassVar[str]
    _aspect: float = 0.56  # of the figure: height / width
    scene: Scene
    steps: tuple[LessonStep, ...]

    @abstractmethod
    def __init__(self, scene: Scene | None, problem: Problem | None) -> None:
        """Compute what is shown; None stands for the lesson's own."""

    @abstractmethod
    def _page(self, options: ViewOptions) -> tuple[Document, tuple[Panel, ...]]:
        """The document of the page, and the panels beside the workspace."""

    @abstractmethod
    def _draw(self, figure: Figure) -> None:
        """Draw the picture for slides into an empty figure."""

    def _data(self) -> Any:
        """What the lesson's script finds in `data.own`: anything JSON can hold."""
        return None

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.scene.name!r}, {len(self.steps)} steps)"

    @property
    def title(self) -> str:
        """Its title."""
        return LESSONS[self.name][1]

    # ---- pictures ------------------------------------------------------------------------

    def figure(self, *, width: float = 13.0) -> Figure:
        """The lesson's picture for slides, as a Matplotlib figure.

        Args:
            width: Its width [inch], at most 100.

        Raises:
            InputError: another width.
        """
        from matplotlib import rc_context
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        from rr1plan.playback.cspace.cspace_figure import STYLE

        width = check_width(width)
        with rc_context(STYLE):
            figure = Figure(figsize=(width, self._aspect * width), layout="constrained", facecolor="white")
            FigureCanvasAgg(figure)
            self._draw(figure)
        return figure

    def save_png(self, file: str | FilePath) -> FilePath:
        """Write the picture as PNG, 1950 pixels wide, atomically.

        Raises:
            InputError: a name that does not end in .png, or a file that cannot be written.
        """
        return self._save_figure(file, ".png")

    def save_svg(self, file: str | FilePath) -> FilePath:
        """Write the picture as SVG, atomically.

        Raises:
            InputError: a name that does not end in .svg, or a file that cannot be written.
        """
        return self._save_figure(file, ".svg")

    def _save_figure(self, file: str | FilePath, suffix: str) -> FilePath:
        return save_figure(check_writable(file, suffix), self.figure)

    # ---- pages ---------------------------------------------------------------------------

    def save_html(self, file: str | FilePath, *, options: ViewOptions | None = None) -> FilePath:
        """Write the lesson as one offline page: workspace left, panels right, the steps below the workspace.

        Buttons and the keys ← and → walk the steps. A page opened with `#step=3` begins at the third one.

        Args:
            file: The file, replaced in one step.
            options: How the page looks (default: `ViewOptions()`).

        Raises:
            InputError: a file that cannot be written.
            MissingPackageError: Meshcat is not installed.
        """
        from rr1plan.lessons.lesson_page import save_page

        return save_page(self, file, options)

    def page_content(self, options: ViewOptions | None = None) -> tuple[Document, ViewOptions]:
        """The document of the page, and its options with the lesson's panels."""
        from rr1plan.lessons.lesson_page import page_parts

        return page_parts(self, options)

    def show(self, *, options: ViewOptions | None = None) -> Viewer:
        """Open the same page live and print its address; end a script with `show().wait()`.

        Args:
            options: As in `save_html`.

        Raises:
            BackendError: no free port.
            MissingPackageError: Meshcat is not installed.
        """
        from rr1plan.lessons.lesson_page import show_page

        return show_page(self, options)
