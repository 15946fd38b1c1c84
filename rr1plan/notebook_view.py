"""Drawing of values in notebooks."""

from __future__ import annotations

from importlib import import_module


class NotebookView:
    """A value that notebooks draw: as its page, or as curves for a trajectory. Elsewhere its text is shown."""

    def _repr_html_(self) -> str | None:
        # Imported by name and only for drawing: pages are in a layer above the values that they show.
        drawing = import_module("rr1plan.playback.viewer.notebook_html")
        html: str | None = drawing.notebook_html(self)
        return html
