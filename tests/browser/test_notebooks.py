"""Notebooks: values draw themselves when cells run, and in the exported page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import rr1plan as rp
from rr1plan.playback.viewer.page_capture import wait_until

nbformat = pytest.importorskip("nbformat", reason="nbformat is not installed")
nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed")
nbconvert = pytest.importorskip("nbconvert", reason="nbconvert is not installed")
pytest.importorskip("ipykernel", reason="ipykernel is not installed")

NOTEBOOK = Path(__file__).parent.parent.parent / "examples" / "notebook.ipynb"
FRAMES = ("\nscene", "\nmotion", "resolution=90)", "\nviewer")  # ends of the cells that draw a page
MORE = (
    "rp.show(scene, options=rp.ViewOptions(quiet=True)).url, viewer.url",
    # Of a plan that failed the text says more than a picture.
    "rp.plan_motion(rp.Problem(scene, [0.6, 0.0], [1.2, -0.4]), rng=0)",
    "rp.lesson('no_path')",
)
# What a webview of VS Code allows with `notebook.experimental.enableCsp`; without that setting it allows more.
VSCODE = (
    "default-src 'none'; script-src https://*.vscode-cdn.net 'unsafe-inline' 'unsafe-eval'; style-src 'unsafe-inline'; "
    "img-src https: http: data:; font-src https:; connect-src https:; child-src https: data:"
)


@pytest.fixture(scope="module")
def ran() -> Any:
    """The example, with some more cells, after all have run in a kernel of their own."""
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    notebook.cells += [nbformat.v4.new_code_cell(text) for text in MORE]
    nbclient.NotebookClient(notebook, timeout=120, kernel_name="python3").execute()
    return notebook


@pytest.fixture(scope="module")
def exported(ran: Any) -> str:
    return str(nbconvert.HTMLExporter().from_notebook_node(ran)[0])


def outputs(ran: Any, ending: str) -> dict[str, str]:
    """Output of the cell with this ending."""
    (cell,) = [cell for cell in ran.cells if cell.cell_type == "code" and cell.source.endswith(ending)]
    return {kind: text for out in cell.outputs for kind, text in out.get("data", {}).items()}


def test_the_example_is_stored_without_outputs() -> None:
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(notebook)
    assert not any(cell.outputs or cell.execution_count for cell in notebook.cells if cell.cell_type == "code")


def test_values_are_drawn_and_have_their_text_too(ran: Any) -> None:
    for ending in (*FRAMES, "'no_path')"):
        drawn = outputs(ran, ending)["text/html"]
        assert drawn.startswith("<iframe srcdoc=")
        assert 'sandbox="allow-scripts allow-downloads"' in drawn
    assert "<svg" in outputs(ran, "motion.trajectory")["text/html"]
    assert outputs(ran, "\nmotion")["text/plain"].startswith("MotionPlan(")
    assert set(outputs(ran, "rng=0)")) == {"text/plain"}
    assert "invalid_start" in outputs(ran, "rng=0)")["text/plain"]


def test_viewers_of_a_notebook_are_at_one_port(ran: Any) -> None:
    one, other = eval(outputs(ran, "viewer.url")["text/plain"])
    assert one.removesuffix("2/") == other


@pytest.mark.browser
@pytest.mark.parametrize(
    "policy", [pytest.param("", id="jupyter", marks=pytest.mark.drawn), pytest.param(VSCODE, id="vscode")]
)
def test_the_exported_notebook_shows_live_pages(exported: str, policy: str, tab: Any, tmp_path: Path) -> None:
    page = tmp_path / "notebook.html"
    meta = f'<head><meta http-equiv="Content-Security-Policy" content="{policy}">'
    page.write_text(exported.replace("<head>", meta, 1) if policy else exported, encoding="utf-8")
    tab.page.route("https://**", lambda route: route.abort())  # what nbconvert's template wants from the network
    tab.page.goto(page.as_uri(), wait_until="domcontentloaded")
    elements = tab.page.query_selector_all("iframe")
    assert len(elements) == len(FRAMES) + 1
    frames = {}
    for name, element in zip((*FRAMES, "lesson"), elements, strict=True):
        element.scroll_into_view_if_needed()
        frames[name] = frame = element.content_frame()
        wait_until(frame, "Boolean(window.RR1 && RR1.ready && RR1.planner) && RR1.frames > 5")
        frame.evaluate("RR1.pause()")
        if tab.drawn:
            picture = tmp_path / "frame.png"
            element.screenshot(path=picture)
            red, _, blue = np.moveaxis(np.asarray(Image.open(picture).convert("RGB"), dtype=int), -1, 0)
            assert ((red > 170) & (blue < 0.6 * red)).sum() > 200
        # Sealed: neither the notebook nor the network.
        assert (
            frame.evaluate("(() => { try { return String(parent.document.title); } catch (e) { return e.name; } })()")
            == "SecurityError"
        )
        assert frame.evaluate("fetch('https://example.org/').then(() => 'answered', () => 'refused')") == "refused"
    motion = frames["\nmotion"]
    motion.evaluate("RR1.seek(RR1.player.end)")
    np.testing.assert_allclose(motion.evaluate("Array.from(RR1.q)"), [1.2, -0.4], atol=1e-6)
    assert motion.evaluate("RR1.editing.plan().then((answer) => answer.certified)")
    assert (
        frames["resolution=90)"]
        .evaluate("RR1.lesson.edits.update().then(() => document.querySelector('.verdict').textContent)")
        .startswith("Start and goal")
    )
    assert frames["\nviewer"].evaluate("RR1.stage.tiles().length") == 2
    local = [url for url in tab.requests if not url.startswith(("https://", "file:", "data:", "about:", "blob:"))]
    assert not [url for url in local if "/updates" not in url]


def test_what_has_no_page_says_so() -> None:
    with pytest.raises(rp.InputError, match="has no page, expected a scene"):
        rp.save_glb("a.glb", 3)
    with pytest.raises(rp.InputError, match="file name is 3"):
        rp.screenshot("a.png", 3)


@pytest.mark.browser
def test_curves_are_readable_in_a_narrow_cell(tab: Any, planar2r: rp.Robot, tmp_path: Path) -> None:
    names = rp.Scene().with_arm("arm", planar2r).joint_names()
    curves = rp.Trajectory.from_samples(names, [0.0, 1.0], [[0.0, 0.0], [0.1, 0.1]])
    page = tmp_path / "cell.html"
    page.write_text(f"<!DOCTYPE html><meta charset=utf-8><div style='width:300px'>{curves._repr_html_()}</div>")
    tab.page.goto(page.as_uri())
    heights = "[...document.querySelectorAll('svg g[id^=text_]')].map((text) => text.getBoundingClientRect().height)"
    assert min(tab.ask(heights)) > 6.0
    assert tab.ask("document.querySelector('svg').parentElement.clientWidth") == 300  # it scrolls there
