"""`Lesson`: pictures and pages of all lessons."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from rr1plan.files.file_access import check_writable
from rr1plan.lessons.lesson_content import LessonContent
from rr1plan.lessons.lesson_content import LessonStep as LessonStep
from rr1plan.playback.figure_files import check_width, drawing, keep_tick_sizes, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rr1plan.playback.viewer.live_viewer import Viewer
    from rr1plan.playback.viewer.page_document import Document
    from rr1plan.playback.viewer.view_options import ViewOptions


class Lesson(LessonContent):
    """A lesson with its computed content, as figures and pages; `lesson` creates one.

    Attributes:
        name: Its name.
        scene: Its arms and obstacles.
        steps: Its steps in order.
    """

    # ---- pictures ------------------------------------------------------------------------

    def figure(self, *, width: float = 13.0) -> Figure:
        """The lesson's picture for slides, as a Matplotlib figure.

        Args:
            width: Its width [inch], at most 100.

        Raises:
            InputError: another width.
        """
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        from rr1plan.playback.cspace.cspace_figure import STYLE

        width = check_width(width)
        with drawing(STYLE):
            figure = Figure(figsize=(width, self._aspect * width), layout="constrained", facecolor="white")
            FigureCanvasAgg(figure)
            self._draw(figure)
            keep_tick_sizes(figure)
        return figure

    def save(self, file: str | FilePath) -> FilePath:
        """Write it atomically in the format given by the suffix: .png, .svg, .pdf (pictures) or .html (the page).

        Raises:
            InputError: another suffix, or a file that cannot be written.
            MissingPackageError: a page, and Meshcat is not installed.
        """
        formats = {".png": self.save_png, ".svg": self.save_svg, ".pdf": self.save_pdf, ".html": self.save_html}
        target = check_writable(file, *formats)
        return formats[target.suffix.lower()](target)

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

    def save_pdf(self, file: str | FilePath) -> FilePath:
        """Write the picture as PDF, atomically.

        Raises:
            InputError: a name that does not end in .pdf, or a file that cannot be written.
        """
        return self._save_figure(file, ".pdf")

    def _save_figure(self, file: str | FilePath, suffix: str) -> FilePath:
        return save_figure(check_writable(file, suffix), self.figure)

    # ---- pages ---------------------------------------------------------------------------

    def save_html(self, file: str | FilePath, *, options: ViewOptions | None = None) -> FilePath:
        """Write the lesson as one offline page: workspace left, panels right, the steps below the workspace.

        Buttons and the keys ← and → move between the steps. A page opened with `#step=3` begins at the third one.

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
