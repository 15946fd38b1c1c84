"""The HTML of values in notebooks: a sealed page in a frame, or a figure."""

from __future__ import annotations

from rr1plan.errors import MissingPackageError, NoPlanError
from rr1plan.playback.trajectory_figure import trajectory_svg
from rr1plan.playback.viewer.html_page import embed_html, page_html
from rr1plan.playback.viewer.page_content import page_content
from rr1plan.trajectory import Trajectory


def notebook_html(value: object) -> str | None:
    """What a notebook shows in the place of a value; None where its text says more, as for a plan that failed.

    Args:
        value: A trajectory, or what `page_content` takes.
    """
    if isinstance(value, Trajectory):
        return f'<div style="max-width:960px">{trajectory_svg(value)}</div>'
    try:
        return embed_html(page_html(*page_content(value)))
    except (NoPlanError, MissingPackageError):
        return None
