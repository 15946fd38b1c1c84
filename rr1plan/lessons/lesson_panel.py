"""Panels of lessons, from files in `page`."""

from __future__ import annotations

from collections.abc import Sequence

from rr1plan.playback.viewer.page_asset import page_asset
from rr1plan.playback.viewer.view_options import Panel

_PACKAGE = "rr1plan.lessons"


def lesson_panel(name: str, title: str, data: object, scripts: Sequence[str] = ()) -> Panel:
    """A panel whose content, style and script are the files `page/<name>_panel.html`, `.css` (if any) and `.js`.

    Args:
        name: Name of the panel.
        title: Its headline.
        data: Data for its script.
        scripts: Files in `page` that its script needs.
    """
    html, css, own = (
        page_asset(f"{name}_panel.{kind}", _PACKAGE, optional=kind == "css") for kind in ("html", "css", "js")
    )
    script = "\n".join([*(page_asset(file, _PACKAGE) for file in scripts), own])
    return Panel(name, title, html=html, css=css, script=script, data=data)
