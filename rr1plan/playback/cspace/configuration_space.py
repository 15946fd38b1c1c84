"""`cspace`: the workspace and the configuration space of two joints, side by side.

The picture with which every course on motion planning begins: the arm among its obstacles on the left, each obstacle's
image on the torus of joint angles on the right, and the same path in both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from rr1plan.checks import whole_number
from rr1plan.files.file_access import check_writable
from rr1plan.notebook_view import NotebookView
from rr1plan.planning import PlanResult
from rr1plan.playback.cspace.cspace_query import CSpaceQuery, compute_query
from rr1plan.playback.figure_files import check_width, save_figure
from rr1plan.progress import ProgressCallback
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem
from rr1plan.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rr1plan.playback.viewer.live_viewer import Viewer
    from rr1plan.playback.viewer.page_document import Document
    from rr1plan.playback.viewer.view_options import ViewOptions


@dataclass(frozen=True, eq=False, repr=False)
class CSpace(CSpaceQuery, NotebookView):
    """The configuration space of two joints with a query and its result, as figures and pages.

    `cspace` computes one.

    Attributes:
        grid: Cells, layers and components.
        start: Start of the query [rad or m], shape (2,), or None.
        goals: Configurations that reach the goal [rad or m], each (2,).
        path: Waypoints of the result [rad or m], shape (k, 2), or None.
        tree: The tree that the planner explored, or None.
    """

    @property
    def verdict(self) -> str:
        """The result of the query in a sentence: what is proven, what was found, what is open."""
        from rr1plan.playback.cspace.cspace_verdict import verdict

        return verdict(self)

    # ---- pictures ------------------------------------------------------------------------

    def figure(self, *, width: float = 13.0) -> Figure:
        """A matplotlib figure: workspace left, configuration space right.

        Args:
            width: Its width [inch], at most 100.

        Raises:
            InputError: another width.
        """
        from rr1plan.playback.cspace.cspace_figure import draw

        return draw(self, check_width(width))

    def save(self, file: str | FilePath) -> FilePath:
        """Write it atomically in the format given by the suffix: .png, .svg, .pdf (pictures) or .html (the page).

        Raises:
            InputError: another suffix, or a file that cannot be written.
        """
        formats = {".png": self.save_png, ".svg": self.save_svg, ".pdf": self.save_pdf, ".html": self.save_html}
        target = check_writable(file, *formats)
        return formats[target.suffix.lower()](target)

    def save_png(self, file: str | FilePath, *, dpi: int = 150) -> FilePath:
        """Write the picture as PNG, atomically.

        Args:
            file: The file, 13 inches wide.
            dpi: Dots per inch, 10 to 1200.

        Raises:
            InputError: a name that does not end in .png, or a file that cannot be written.
        """
        return self._save_figure(file, "png", whole_number("dpi", dpi, 10, 1200))

    def save_svg(self, file: str | FilePath) -> FilePath:
        """Write the picture as SVG, for slides, atomically.

        Raises:
            InputError: a name that does not end in .svg, or a file that cannot be written.
        """
        return self._save_figure(file, "svg")

    def save_pdf(self, file: str | FilePath) -> FilePath:
        """Write the picture as PDF, for papers, atomically.

        Raises:
            InputError: a name that does not end in .pdf, or a file that cannot be written.
        """
        return self._save_figure(file, "pdf")

    def _save_figure(self, file: str | FilePath, kind: str, dpi: int = 150) -> FilePath:
        return save_figure(check_writable(file, f".{kind}"), self.figure, dpi)

    def save_html(
        self, file: str | FilePath, *, trajectory: Trajectory | None = None, options: ViewOptions | None = None
    ) -> FilePath:
        """Write one offline page: the arm in 3-D and the configuration space, linked by sliders and clicks.

        Args:
            file: The file, replaced in one step.
            trajectory: The timed motion to play; None plays the path at a steady speed.
            options: How the page looks (default: `ViewOptions()`).

        Raises:
            InputError: the trajectory moves other joints than the two shown, or a file that cannot be written.
            MissingPackageError: Meshcat is not installed.
        """
        from rr1plan.playback.cspace.cspace_page import save_page

        return save_page(self, file, trajectory=trajectory, options=options)

    def page_content(self, options: ViewOptions | None = None) -> tuple[Document, ViewOptions]:
        """The document of the page, and its options with the panel of the configuration space."""
        from rr1plan.playback.cspace.cspace_page import page_parts
        from rr1plan.playback.viewer.view_options import with_panel

        document, panel = page_parts(self, options=options)
        return document, with_panel(options, panel)

    def show(
        self,
        *,
        trajectory: Trajectory | None = None,
        options: ViewOptions | None = None,
    ) -> Viewer:
        """Open the same page live and print its address; end a script with `show().wait()`.

        Args:
            trajectory: The timed motion to play; None plays the path at a steady speed.
            options: As in `save_html`.

        Raises:
            InputError: the trajectory moves other joints than the two shown.
            BackendError: no free port.
            MissingPackageError: Meshcat is not installed.
        """
        from rr1plan.playback.cspace.cspace_viewer import show_page

        return show_page(self, trajectory=trajectory, options=options)

    def __str__(self) -> str:
        from rr1plan.playback.cspace.cspace_verdict import describe

        return describe(self)


def cspace(
    scene: Scene,
    problem: Problem | None = None,
    *,
    result: PlanResult | None = None,
    arm: str | None = None,
    joints: Sequence[str] | None = None,
    at: str | ArrayLike | None = None,
    resolution: int = 360,
    progress: ProgressCallback | None = None,
) -> CSpace:
    """The configuration space of an arm with two joints (or of two joints of a larger arm).

    Args:
        scene: The scene.
        problem: A query to draw: its start and all configurations that reach its goal.
        result: The planner's result for that query: its path and, if it kept one, its tree.
        arm: The arm (default: the problem's, or the only one).
        joints: Two of its planning joints (default: the first two). A problem and a result can be drawn
            only when the arm has no other planning joints.
        at: Values of the arm's other joints: a configuration's name or its numbers [rad or m], shape (nq,); those of
            the two joints are ignored (default: the arm's configuration in the scene).
        resolution: Cells along each axis, 8 to 2000; a cell is free if its center is.
        progress: Called periodically; False cancels.

    Returns:
        A value with the methods `show` and `save`, by suffix a page (.html) or a picture (.png, .svg, .pdf).

    Raises:
        UnknownNameError: no such arm, joint or configuration.
        InputError: not two joints, a resolution outside 8 to 2000, a problem with other columns, a result without its
            problem, or `at` of another length, beyond a limit, or for an arm without other joints.
        CancelledError: `progress` returned False.
    """
    return compute_query(
        CSpace, scene, problem, result=result, arm=arm, joints=joints, at=at, resolution=resolution, progress=progress
    )
