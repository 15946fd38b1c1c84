"""Panels of lessons next to the configuration space."""

from __future__ import annotations

from rr1plan.playback.viewer.page_asset import page_asset
from rr1plan.playback.viewer.view_options import Panel


def lesson_panel(name: str, title: str, data: object) -> Panel:
    """A panel whose content, style and script are the files `page/<name>_panel.html`, `.css` and `.js`."""
    html, css, script = (page_asset(f"{name}_panel.{kind}", "rr1plan.lessons") for kind in ("html", "css", "js"))
    return Panel(name, title, html=html, css=css, script=script, data=data)
