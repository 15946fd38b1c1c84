"""How values draw themselves in notebooks."""

from __future__ import annotations

from importlib import import_module


class NotebookView:
    """A value that notebooks show drawn: its page, or curves of a trajectory. Elsewhere its text is shown."""

    def _repr_html_(self) -> str | None:
        # By name and only when it is drawn: pages stand above the values that they show.
        drawing = import_module("rr1plan.playback.viewer.notebook_html")
        html: str | None = drawing.notebook_html(self)
        return html
