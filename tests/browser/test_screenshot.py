"""Pictures of the page for slides and galleries."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np
import pytest
from PIL import Image

import rr1plan as rp
from rr1plan import save_html, screenshot
from rr1plan.playback.viewer import page_capture

pytestmark = pytest.mark.browser


@pytest.mark.usefixtures("needs_browser")
def test_a_picture_has_its_size_and_shows_something(planar2r: rp.Robot, tmp_path: FilePath) -> None:
    page = save_html(tmp_path / "page.html", rp.Scene().with_arm("arm", planar2r))
    file = screenshot(tmp_path / "page.png", page, size=(320, 240), bare=True)
    picture = np.asarray(Image.open(file).convert("RGB"), dtype=int)
    assert picture.shape == (240, 320, 3)
    orange = (picture[..., 0] > 170) & (picture[..., 2] < 0.6 * picture[..., 0])
    assert orange.sum() > 30


def test_a_missing_page_is_named(tmp_path: FilePath) -> None:
    with pytest.raises(rp.InputError, match="save_html"):
        screenshot(tmp_path / "page.png", tmp_path / "nowhere.html")


@pytest.mark.usefixtures("needs_browser")
def test_a_page_that_does_not_come_up_is_named(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "page.html").write_text("<p>not our page</p>")
    monkeypatch.setattr(page_capture, "_PATIENCE", 0.2)
    with pytest.raises(rp.BackendError, match="come up"):
        screenshot(tmp_path / "page.png", tmp_path / "page.html", size=(64, 64))


def test_a_missing_browser_is_named(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "page.html").write_text("")
    monkeypatch.setattr(page_capture, "find_browser", lambda: None)
    with pytest.raises(rp.MissingPackageError, match="'chromium'; install the system package chromium"):
        screenshot(tmp_path / "page.png", tmp_path / "page.html")


@pytest.mark.parametrize("size", [(0, 100), (100, 1e6), (100,), "big"])
def test_a_size_that_makes_no_sense_is_refused(size: object, tmp_path: FilePath) -> None:
    (tmp_path / "page.html").write_text("")
    with pytest.raises(rp.InputError, match="size"):
        screenshot(tmp_path / "page.png", tmp_path / "page.html", size=size)
