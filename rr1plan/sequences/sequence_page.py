"""Pages of sequences: held objects move with the hand, and a list of the stages leads to each."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from rr1plan.checks import true_or_false
from rr1plan.files.file_access import write_text
from rr1plan.playback.viewer import view_document
from rr1plan.playback.viewer.html_page import page_html
from rr1plan.playback.viewer.live_viewer import Viewer, open_viewer
from rr1plan.playback.viewer.page_document import Document, with_carried
from rr1plan.playback.viewer.view_options import Panel, ViewOptions, checked_options, with_panel

if TYPE_CHECKING:
    from rr1plan.sequences.sequence_plan import SequencePlan


def save_sequence_html(file: str | FilePath, plan: SequencePlan, options: ViewOptions | None = None) -> FilePath:
    """Write one self-contained page of a sequence; see `SequencePlan.save_html`."""
    document, options = _page_parts(plan, options)
    return write_text(file, page_html(document, options))


def show_sequence(
    plan: SequencePlan, *, options: ViewOptions | None, port: int | None, open_browser: bool, quiet: bool
) -> Viewer:
    """Open a live page of a sequence; see `SequencePlan.show`."""
    open_browser, quiet = true_or_false("open_browser", open_browser), true_or_false("quiet", quiet)
    document, options = _page_parts(plan, options)
    return open_viewer(_SequenceViewer(plan, document, options, port), open_browser, quiet)


class _SequenceViewer(Viewer):
    """A live page of a sequence."""

    def __init__(self, plan: SequencePlan, document: Document, options: ViewOptions, port: int | None) -> None:
        self._open(plan.scene, document, options, port)


def _page_parts(plan: SequencePlan, options: ViewOptions | None) -> tuple[Document, ViewOptions]:
    """The document of a page and its options, with the panel of the stages."""
    options = checked_options(options)
    document = view_document(plan.scene, trajectory=plan.trajectory, report=plan.report, options=options)
    return with_carried(document, _places(plan)), with_panel(options, _stage_panel(plan))


def _places(plan: SequencePlan) -> Mapping[str, list[dict[str, Any]]]:
    """Where each object that is attached or detached is: since when, at which link or in the world, and its pose."""
    first = plan.scene
    places: dict[str, list[dict[str, Any]]] = {name: [] for name in plan.carried_names}
    for stage, scene in [(None, first), *zip(plan.stages, plan.scenes(), strict=True)]:
        for name in plan.carried_names:
            held = scene.attachments.get(name)
            place = {
                "arm": None if held is None else held.arm,
                "link": None if held is None else held.link,
                "pose": (scene.obstacles[name] if held is None else held).pose,
            }
            last = places[name][-1] if places[name] else None
            if last is None or (last["arm"], last["link"]) != (place["arm"], place["link"]):
                places[name].append(place | {"from": plan.trajectory.start_time if stage is None else stage.begin})
    return places


def _stage_panel(plan: SequencePlan) -> Panel:
    """A list of the stages; a click goes to the beginning of one."""
    page = files("rr1plan.sequences") / "page"
    data = [{"label": s.label, "begin": s.begin, "end": s.end} for s in plan.stages]
    return Panel(
        "stages",
        "Sequence",
        html="<ol></ol>",
        css=(page / "stages.css").read_text(encoding="utf-8"),
        script=(page / "stages.js").read_text(encoding="utf-8"),
        data=data,
        width=290,
    )
