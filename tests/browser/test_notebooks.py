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

CELLS = (
    "import rr1plan as rp\n"
    "scene = rp.Scene(name='flat').with_arm('arm', rp.load_robot('planar2r'))\n"
    "scene = scene.with_obstacle('ball', rp.Sphere(0.1), [1.2, 0.9, 0.0])\n"
    "problem = rp.Problem(scene, [0.0, 0.3], [1.2, -0.4])\n"
    "motion = rp.plan_motion(problem, rng=0)\n"
    "assert motion",
    "motion",
    "motion.trajectory",
    "rp.cspace(scene, problem, resolution=40)",
    "viewer = rp.show(scene)\nviewer",
    "viewer.update([0.5, 0.25])\nrp.show(scene).url, viewer.url",
    # Of a plan that failed the text says more than a picture.
    "rp.plan_motion(rp.Problem(scene, [0.6, 0.0], [1.2, -0.4]), rng=0)",
)


@pytest.fixture(scope="module")
def ran() -> Any:
    """The notebook after all cells have run in a kernel of their own."""
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(text) for text in CELLS])
    nbclient.NotebookClient(notebook, timeout=120, kernel_name="python3").execute()
    return notebook


def outputs(ran: Any, cell: int) -> dict[str, str]:
    return {kind: text for out in ran.cells[cell].outputs for kind, text in out.get("data", {}).items()}


def test_values_are_drawn_and_have_their_text_too(ran: Any) -> None:
    for cell in (1, 3, 4):
        assert outputs(ran, cell)["text/html"].startswith("<iframe srcdoc=")
    assert "<svg" in outputs(ran, 2)["text/html"]
    assert outputs(ran, 1)["text/plain"].startswith("MotionPlan(")
    assert set(outputs(ran, 6)) == {"text/plain"}
    assert "invalid_start" in outputs(ran, 6)["text/plain"]


def test_viewers_of_a_notebook_are_at_one_port(ran: Any) -> None:
    one, other = eval(outputs(ran, 5)["text/plain"])
    assert one.removesuffix("2/") == other


@pytest.mark.browser
def test_the_exported_notebook_shows_the_arm(ran: Any, tab: Any, tmp_path: Path) -> None:
    page = tmp_path / "notebook.html"
    page.write_text(nbconvert.HTMLExporter().from_notebook_node(ran)[0], encoding="utf-8")
    tab.page.route("https://**", lambda route: route.abort())  # what nbconvert's template wants from the network
    tab.page.goto(page.as_uri(), wait_until="domcontentloaded")
    frames = tab.page.query_selector_all("iframe")
    assert len(frames) == 3
    for element in frames:
        element.scroll_into_view_if_needed()
        frame = element.content_frame()
        wait_until(frame, "Boolean(window.RR1 && RR1.ready) && RR1.frames > 5")
        frame.evaluate("RR1.pause()")
        picture = tmp_path / "frame.png"
        element.screenshot(path=picture)
        red, _, blue = np.moveaxis(np.asarray(Image.open(picture).convert("RGB"), dtype=int), -1, 0)
        assert ((red > 170) & (blue < 0.6 * red)).sum() > 200
    motion = frames[0].content_frame()
    motion.evaluate("RR1.seek(RR1.player.end)")
    np.testing.assert_allclose(motion.evaluate("Array.from(RR1.q)"), [1.2, -0.4], atol=1e-6)
    local = [url for url in tab.requests if not url.startswith(("https://", "file:", "data:", "about:", "blob:"))]
    assert not [url for url in local if "/updates" not in url]


def test_what_has_no_page_says_so() -> None:
    with pytest.raises(rp.InputError, match="has no page, expected a scene"):
        rp.save_glb("a.glb", 3)
    with pytest.raises(rp.InputError, match="file name is 3"):
        rp.screenshot("a.png", 3)
