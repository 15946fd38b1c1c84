"""Figures as files, and their common style."""

from __future__ import annotations

import io
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path as FilePath
from threading import RLock
from typing import TYPE_CHECKING, NamedTuple

from rr1plan.checks import positive_number
from rr1plan.errors import InputError
from rr1plan.files.file_access import check_writable, write_bytes
from rr1plan.thread_locks import per_process

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.text import Text

_WIDEST = 100.0  # [inch]
_LONGEST = 60  # name [characters]
FIGURE_SUFFIXES = (".png", ".svg", ".pdf")
# The same figure gives the same bytes.
_NO_DATES: dict[str, dict[str, object]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
# All threads share Matplotlib's settings and its parsers of text.
_drawing = per_process(sys.modules[__name__], "_drawing", RLock)


class Look(NamedTuple):
    """Colors of a figure besides those of arms.

    Args:
        paper: The background.
        ink: Lines and text.
        soft: Secondary text and lines.
        faint: Rows and grids.
        blocked: Blocked cells of a coordination diagram.
        conflict: Collisions and other conflicts.
        rim: Edges of bars in colors of arms, some of which are as dark as the dark background.
    """

    paper: str
    ink: str
    soft: str
    faint: str
    blocked: str
    conflict: str
    rim: str


# Names may contain "$", which would otherwise start a formula; and the same figure gives the same bytes.
PLAIN_TEXT: dict[str, object] = {"text.parse_math": False, "svg.hashsalt": "rr1plan"}

_LIGHT = Look("#ffffff", "#22262b", "#667080", "#e9edf1", "#c9ced6", "#d1003f", "#ffffff")
_DARK = Look("#161b22", "#eef1f4", "#9aa5b3", "#262d37", "#4a5361", "#ff5c86", "#9aa5b3")


def shortened(name: str) -> str:
    """A name for a legend or an axis, of at most 60 characters."""
    return name if len(name) <= _LONGEST else f"{name[: _LONGEST - 1]}…"


def break_lines(text: Text, room: float) -> None:
    """Break a long text into lines.

    Matplotlib's own wrapping reads "$" in names as formulas.

    Args:
        text: The text, upright or along its axis.
        room: Length of a line, as a share of the figure's.
    """
    figure, words = text.figure, text.get_text()
    assert figure is not None
    box, frame = text.get_window_extent(), figure.bbox
    share = max(box.width / frame.width, box.height / frame.height)
    if share > room:
        # Lines of the same number of letters differ in length.
        text.set_text(textwrap.fill(words, max(8, int(0.92 * len(words) * room / share))))


def look_of(dark: bool) -> Look:
    """The colors of a light or a dark figure."""
    return _DARK if dark else _LIGHT


def style_of(look: Look) -> dict[str, object]:
    """Settings of matplotlib: text that is readable from the last row when the figure fills a slide."""
    return {
        "font.family": "DejaVu Sans",
        "font.size": 13,
        "axes.titlesize": 15,
        "axes.labelsize": 13,
        **PLAIN_TEXT,
        "axes.edgecolor": look.soft,
        "axes.labelcolor": look.ink,
        "text.color": look.ink,
        "xtick.color": look.soft,
        "ytick.color": look.soft,
        "hatch.linewidth": 0.6,
    }


@contextmanager
def drawing(style: Mapping[str, object]) -> Iterator[None]:
    """Matplotlib with the settings of a style; other threads that draw our figures wait.

    Args:
        style: The settings, restored at the end.
    """
    from matplotlib import rc_context

    with _drawing, rc_context(dict(style)):
        yield


def keep_tick_sizes(figure: Figure) -> None:
    """Store the sizes of the labels of ticks in their axes.

    When a figure is drawn, after its settings are restored, Matplotlib chooses ticks for labels of the usual size.
    """
    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        for label in axis.get_ticklabels()[:1]:
            axis.set_tick_params(labelsize=label.get_fontsize())


def check_width(width: float) -> float:
    """A figure's width [inch].

    Raises:
        InputError: not above zero, or above 100.
    """
    number = positive_number("width", width)
    if number > _WIDEST:
        raise InputError(f"width is {number:g} inches, expected at most {_WIDEST:g}")
    return number


def save_figure(file: str | FilePath, draw: Callable[[], Figure], dpi: int = 150) -> FilePath:
    """Draw a figure and write it atomically in the format given by the file's suffix.

    Args:
        file: The file.
        draw: Makes the figure.
        dpi: Dots per inch of a PNG.

    Raises:
        InputError: another suffix, or a file that cannot be written.
    """
    target = check_writable(file, *FIGURE_SUFFIXES)
    kind = target.suffix.lower()[1:]
    figure = draw()
    buffer = io.BytesIO()
    with drawing(PLAIN_TEXT):
        figure.savefig(buffer, format=kind, dpi=dpi, metadata=_NO_DATES.get(kind, {}))
    return write_bytes(target, buffer.getvalue())
