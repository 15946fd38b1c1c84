"""One headless Chromium for all tests of a module."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from rr1plan.playback.viewer.page_capture import find_browser, open_browser, wait_until

_READY = "Boolean(window.RR1 && RR1.ready)"


# No longer than a module: as long as it runs, nothing else of this thread can use asyncio.
@pytest.fixture(scope="module")
def browser(needs_browser: None) -> Iterator[Any]:
    with open_browser((960, 640)) as context:
        yield context


@pytest.fixture(scope="session")
def needs_browser() -> None:
    if find_browser() is None:
        pytest.skip("no Chromium on this machine")
    pytest.importorskip("playwright", reason="playwright is not installed")


NO_WEBGL = """
    const usual = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
        return kind.includes("webgl") ? null : usual.call(this, kind, ...more);
    };
"""


# Draws the 3-D view without shadows and reflections, in few pixels: a frame takes a fraction of the time.
PLAIN = """
    addEventListener("DOMContentLoaded", () => {
        if (!window.RR1) return;
        const plain = { ...RR1.pace.levels.at(-1), rich: false, shadows: "none", ghosts: true };
        Object.assign(RR1.pace, { full: plain, levels: [plain], level: 0 });
    });
"""


class Tab:
    """A page of the browser that remembers every request and complaint."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.requests: list[str] = []
        self.complaints: list[str] = []
        page.on("request", lambda r: self.requests.append(r.url))
        page.on("pageerror", lambda e: self.complaints.append(str(e)))
        page.on("console", lambda m: self.complaints.append(m.text) if m.type == "error" else None)
        page.on("dialog", lambda d: (self.complaints.append(f"dialog {d.message}"), d.dismiss()))

    def draw_plainly(self) -> None:
        """Pages that are opened from now on draw their 3-D view as fast as they can."""
        self.page.add_init_script(PLAIN)

    def disable_webgl(self) -> None:
        """Pages that are opened from now on get no WebGL."""
        self.page.add_init_script(NO_WEBGL)

    def ask(self, expression: str, argument: Any = None) -> Any:
        return self.page.evaluate(expression, argument)

    def open(self, page: Path | str, ready: str = _READY) -> None:
        """Open a file or an address and wait until the page is ready."""
        self.page.goto(page.as_uri() if isinstance(page, Path) else page)
        wait_until(self.page, ready)

    def picture(self) -> np.ndarray:
        """The pixels of the next frames as they stand, shape (height, width, 3)."""
        frames = self.ask("RR1.frames")
        wait_until(self.page, f"RR1.frames > {frames} + 2")
        return np.asarray(Image.open(io.BytesIO(self.page.screenshot())).convert("RGB"), dtype=int)

    def bare_picture(self) -> np.ndarray:
        """The same without the cards."""
        self.ask("document.body.classList.add('bare')")
        pixels = self.picture()
        self.ask("document.body.classList.remove('bare')")
        return pixels


@pytest.fixture(scope="module")
def plain() -> bool:
    """Whether the module's pages draw their 3-D view plainly: those of modules that do not look at it."""
    return False


@pytest.fixture
def tab(browser: Any, plain: bool) -> Iterator[Tab]:
    with new_tab(browser, plain) as made:
        yield made


@pytest.fixture(scope="module")
def shared_tab(browser: Any, plain: bool) -> Iterator[Tab]:
    with new_tab(browser, plain) as made:
        yield made


@contextmanager
def new_tab(browser: Any, plain: bool) -> Iterator[Tab]:
    """A tab, which is closed afterwards."""
    made = Tab(browser.new_page())
    if plain:
        made.draw_plainly()
    yield made
    made.page.close()


@pytest.fixture(scope="module")
def opened(shared_tab: Tab, page_file: Path) -> Tab:
    """The page of the module's `page_file`."""
    shared_tab.open(page_file)
    return shared_tab
