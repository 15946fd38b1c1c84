"""The content that lessons define: steps, the document of the page, the picture."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from numpy.typing import ArrayLike

from rr1plan.checks import check_text, finite_array
from rr1plan.lessons.lesson_titles import LESSONS
from rr1plan.notebook_view import NotebookView
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rr1plan.playback.cspace.configuration_space import CSpace
    from rr1plan.playback.viewer.page_document import Document
    from rr1plan.playback.viewer.view_options import Panel, ViewOptions


@dataclass(frozen=True)
class LessonStep:
    """One step of a lesson: a few short paragraphs and the configuration to show.

    Args:
        name: A name unique in the lesson, which the lesson's script refers to.
        title: Its headline.
        text: Its paragraphs as HTML; formulas in MathML.
        q: The configuration that the page shows when the step is entered [rad or m]: all columns of the scene; None
            does not move the arms.

    Raises:
        InputError: a text or a configuration of another type.
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


class LessonContent(NotebookView, ABC):
    """The content of a lesson: its steps, the document of its page and its picture.

    Subclasses set `name`, `scene` and `steps`, set `picture` or define `_page`, and define `_draw`.

    Attributes:
        name: Its name.
        scene: Its arms and obstacles.
        steps: Its steps in order.
    """

    name: ClassVar[str]
    _aspect: float = 0.56  # of the figure: height / width
    scene: Scene
    picture: CSpace
    steps: tuple[LessonStep, ...]

    @abstractmethod
    def __init__(self, scene: Scene | None, problem: Problem | None) -> None:
        """Compute the content; None stands for the lesson's default."""

    def _page(self, options: ViewOptions) -> tuple[Document, tuple[Panel, ...]]:
        """The document of the page, and the panels next to the workspace: `picture` and those of `_panels`."""
        from rr1plan.playback.cspace.cspace_page import page_parts

        document, space = page_parts(self.picture, options=options)
        return document, (space, *self._panels())

    def _panels(self) -> tuple[Panel, ...]:
        """The panels below the configuration space."""
        return ()

    @abstractmethod
    def _draw(self, figure: Figure) -> None:
        """Draw the picture for slides into an empty figure."""

    def _data(self) -> Any:
        """The value of `data.own` for the lesson's script: anything that JSON can represent."""
        return None

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.scene.name!r}, {len(self.steps)} steps)"

    @property
    def title(self) -> str:
        """Its title."""
        return LESSONS[self.name][1]
