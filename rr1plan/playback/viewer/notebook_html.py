"""The HTML of values in notebooks: a page in a sandboxed frame, or a figure."""

from __future__ import annotations

from rr1plan.errors import MissingPackageError, NoPlanError
from rr1plan.playback.trajectory_figure import trajectory_svg
from rr1plan.playback.viewer.html_page import embed_html, page_html
from rr1plan.playback.viewer.page_content import page_content
from rr1plan.trajectory import Trajectory


def notebook_html(value: object) -> str | None:
    """The HTML representation of a value in a notebook; None if its text is more useful, as for a failed plan.

    Args:
        value: A trajectory, or any argument of `page_content`.
    """
    if isinstance(value, Trajectory):
        return f'<div style="max-width:960px;overflow-x:auto">{trajectory_svg(value)}</div>'
    try:
        return embed_html(page_html(*page_content(value)))
    except (NoPlanError, MissingPackageError):
        return None
