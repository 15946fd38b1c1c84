"""One headless Chromium for all tests of a module."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from rr1plan.playback.viewer.page_capture import find_browser, open_browser, wait_until

_CONTRAST = Path(__file__).with_name("contrast.js").read_text(encoding="utf-8")
_READY = "Boolean(window.RR1 && RR1.ready)"


# One module only: while it runs, no other code in this thread can use asyncio.
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

# A canvas that is not even cleared is not copied into the page in every frame.
NO_DRAWING = """
    const drawing = ["drawArrays", "drawElements", "drawArraysInstanced", "drawElementsInstanced"];
    for (const name of ["clear", "blitFramebuffer", ...drawing]) WebGL2RenderingContext.prototype[name] = () => {};
"""


class Tab:
    """A page of the browser that records every request, error and warning; its own data (`blob:`) is no request.

    Args:
        page: The page.
        drawn: Whether WebGL draws, which takes most of the time without a graphics card; all else happens all the same.
    """

    def __init__(self, page: Any, *, drawn: bool = False) -> None:
        self.page, self.drawn = page, drawn
        if not drawn:
            page.add_init_script(NO_DRAWING)
        self.requests: list[str] = []
        self.complaints: list[str] = []
        page.on("request", lambda r: None if r.url.startswith("blob:") else self.requests.append(r.url))
        page.on("pageerror", lambda e: self.complaints.append(str(e)))
        page.on("console", lambda m: self.complaints.append(m.text) if m.type == "error" else None)
        page.on("dialog", lambda d: (self.complaints.append(f"dialog {d.message}"), d.dismiss()))

    def resize(self, width: int, height: int) -> None:
        """Give the window a size [px] and wait until an open page is laid out in it."""
        if self.page.viewport_size == {"width": width, "height": height}:
            return
        self.page.set_viewport_size({"width": width, "height": height})
        wait_until(self.page, f"innerWidth === {width} && innerHeight === {height}")
        if self.ask(_READY):
            self.next_frames()

    def disable_webgl(self) -> None:
        """Disable WebGL for pages that are opened later."""
        self.page.add_init_script(NO_WEBGL)

    def ask(self, expression: str, argument: Any = None) -> Any:
        return self.page.evaluate(expression, argument)

    def open(self, page: Path | str, ready: str = _READY, *, plays: bool = False) -> None:
        """Open a file or an address and wait until the page is ready, laid out and drawn.

        Args:
            page: The file or address.
            ready: A JavaScript expression that is true as soon as the page is ready.
            plays: Whether motions keep playing, as for readers; that takes a third of a processor.
        """
        self.page.goto(page.as_uri() if isinstance(page, Path) else page)
        wait_until(self.page, f"({ready}) && RR1.frames > 1")
        if not plays:
            self.ask("RR1.pause()")

    def wait_for_plan(self) -> None:
        """Wait until the page does not plan."""
        wait_until(self.page, "!RR1.editing.planning")

    def run_until(self, key: str, condition: str, seen: str = "null") -> Any:
        """Start an animation by its key, and stop it by the same key in the first frame in which a condition is true.

        All of it happens in the page: on a busy machine an animation may end before Python looks at it.

        Args:
            key: As in `KeyboardEvent.key`.
            condition: A JavaScript expression.
            seen: A JavaScript expression, maybe a promise, whose value is returned; computed before the stop.
        """
        return self.ask(
            f"""async (key) => {{
                const press = () => {{
                    const event = new KeyboardEvent("keydown", {{ key, bubbles: true, cancelable: true }});
                    document.activeElement.dispatchEvent(event);
                }};
                press();
                do await new Promise(requestAnimationFrame); while (!({condition}));
                const seen = await ({seen});
                press();
                return seen;
            }}""",
            key,
        )

    def record_texts(self) -> None:
        """Collect the texts that the page opened next draws on its canvases, in the page's variable `texts`."""
        self.page.add_init_script("""
            const usual = CanvasRenderingContext2D.prototype.fillText;
            window.texts = [];
            CanvasRenderingContext2D.prototype.fillText = function (text, ...more) {
                window.texts.push(text);
                usual.call(this, text, ...more);
            };
        """)

    def next_frames(self) -> None:
        """Wait for the next frames."""
        frames = self.ask("RR1.frames")
        wait_until(self.page, f"RR1.frames > {frames} + 2")

    def faint_texts(self) -> list[str]:
        """The texts with too little contrast, see `contrast.js`."""
        found: list[str] = self.ask(_CONTRAST)
        return found

    def picture(self) -> np.ndarray:
        """The pixels of the page after the next frames, shape (height, width, 3)."""
        assert self.drawn, "mark the test, or its module: pytest.mark.drawn"
        self.next_frames()
        return np.asarray(Image.open(io.BytesIO(self.page.screenshot())).convert("RGB"), dtype=int)

    def cspace_picture(self) -> np.ndarray:
        """The pixels of the configuration space's canvas, which needs no WebGL, shape (height, width, 3)."""
        png = self.page.locator("#panel-cspace canvas").screenshot()
        return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), dtype=int)

    def bare_picture(self) -> np.ndarray:
        """The pixels of the page without its cards, shape (height, width, 3)."""
        self.ask("document.body.classList.add('bare')")
        pixels = self.picture()
        self.ask("document.body.classList.remove('bare')")
        return pixels


def is_drawn(request: pytest.FixtureRequest) -> bool:
    """Whether the test, or the module of a module-scoped fixture, examines pixels of the 3-D view."""
    return request.node.get_closest_marker("drawn") is not None


@pytest.fixture
def tab(request: pytest.FixtureRequest, browser: Any) -> Iterator[Tab]:
    page = browser.new_page()
    yield Tab(page, drawn=is_drawn(request))
    page.close()


@pytest.fixture(scope="module")
def shared_tab(request: pytest.FixtureRequest, browser: Any) -> Iterator[Tab]:
    page = browser.new_page()
    yield Tab(page, drawn=is_drawn(request))
    page.close()


@pytest.fixture(scope="module")
def opened(shared_tab: Tab, page_file: Path) -> Tab:
    """The page of the module's `page_file`."""
    shared_tab.open(page_file)
    return shared_tab
