"""Pictures of the page, taken by a real browser without a window."""

from __future__ import annotations

import asyncio
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path as FilePath
from time import monotonic
from types import ModuleType
from typing import Any, TypeVar

from rr1plan.checks import file_path, finite_number, true_or_false, whole_number
from rr1plan.errors import BackendError, InputError, MissingPackageError
from rr1plan.files.file_access import check_writable, write_bytes, write_text
from rr1plan.playback.viewer.html_page import check_size, page_html
from rr1plan.playback.viewer.live_viewer import Viewer
from rr1plan.playback.viewer.page_content import HasPage, page_content
from rr1plan.robot import Robot
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem

_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
GET_BROWSER = "install the system package chromium, or Google Chrome"
# A browser without a graphics card and without network access.
_FLAGS = [
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
# Times printed with three digits may be this much after the end [s].
_MILLISECOND = 1e-3
# Chromium creates a socket in TMPDIR, and the path of a socket has at most 107 bytes.
_LONGEST_TEMPORARY_FOLDER = 60
_PATIENCE = 90.0  # [s] for a page to come up, drawn by a busy processor

Page = str | os.PathLike[str] | Viewer | HasPage | Scene | Robot | Problem
_T = TypeVar("_T")


def find_browser() -> str | None:
    """The file of a Chromium on this machine, or None."""
    return next((found for name in _BROWSERS if (found := shutil.which(name))), None)


def _load_playwright() -> ModuleType:
    try:
        return import_module("playwright.sync_api")
    except ImportError as error:
        raise MissingPackageError("playwright", "taking a picture of the page", "video") from error


def require_browser() -> str:
    """The file of a Chromium that takes pictures.

    Raises:
        MissingPackageError: playwright or a Chromium is not installed (extra `video`).
    """
    _load_playwright()
    binary = find_browser()
    if binary is None:
        raise MissingPackageError("chromium", "taking a picture of the page", advice=GET_BROWSER)
    return binary


def _browser_environment() -> dict[str, str | float | bool]:
    """This process's environment, with a temporary folder whose path is short enough for the browser's socket."""
    environment: dict[str, str | float | bool] = {**os.environ}
    if os.name == "posix" and len(tempfile.gettempdir()) > _LONGEST_TEMPORARY_FOLDER:
        environment["TMPDIR"] = "/tmp"
    return environment


@contextmanager
def open_browser(size: tuple[int, int] = (1280, 800)) -> Iterator[Any]:
    """A headless browser, as playwright's browser context; it is closed afterwards.

    Raises:
        MissingPackageError: playwright or a Chromium is not installed.
        BackendError: the browser does not start.
    """
    binary, playwright = require_browser(), _load_playwright()
    width, height = size
    with (
        tempfile.TemporaryDirectory(prefix="rr1plan-browser-", ignore_cleanup_errors=True) as folder,
        playwright.sync_playwright() as driver,
    ):
        try:
            context = driver.chromium.launch_persistent_context(
                folder,
                executable_path=binary,
                args=_FLAGS,
                viewport={"width": width, "height": height},
                env=_browser_environment(),
            )
        except playwright.Error as error:
            raise BackendError(f"{binary} does not start: {error}") from error
        context.set_default_timeout(1e3 * _PATIENCE)
        try:
            yield context
        finally:
            context.close()


def screenshot(
    file: str | os.PathLike[str],
    page: Page,
    *,
    size: tuple[int, int] = (1280, 800),
    time: float | None = None,
    step: int | None = None,
    bare: bool = False,
) -> FilePath:
    """A PNG of a page, for slides and galleries.

    Args:
        file: The picture to write.
        page: A page that `save_html` wrote, a live viewer, or a value that has a page: a scene, a robot, a problem, a
            motion, a sequence plan, a C-space or a lesson.
        size: Width and height [px].
        time: A time of the motion [s]; None: the start, as the page opens.
        step: The step of a lesson, from 1 on; None: the first.
        bare: Without the cards around the picture, which then shows the whole scene.

    Returns:
        The file.

    Raises:
        InputError: no such page, a picture whose name does not end in .png or that cannot be written, or an invalid
            size, time or step.
        NoPlanError: a plan without a motion.
        MissingPackageError: playwright or a Chromium is not installed (extra `video`).
        BackendError: the browser does not start, or the page does not.
    """
    file = check_writable(file, ".png")
    moment = None if time is None else finite_number("time", time)
    bare = true_or_false("bare", bare)

    def take() -> bytes:
        with opened_page(page, check_size(size), bare, step) as tab:
            settle_page(tab, moment, whole=bare)
            return bytes(tab.screenshot(type="png"))

    return write_bytes(file, outside_event_loop(take))


@contextmanager
def opened_page(page: Page, size: tuple[int, int], bare: bool = False, step: int | None = None) -> Iterator[Any]:
    """A page in a tab of a headless browser, as playwright's page.

    Args:
        page: As in `screenshot`.
        size: Width and height of the window [px].
        bare: Without the cards.
        step: The step of a lesson, from 1 on.

    Raises:
        InputError: no such page, or no such step.
        NoPlanError: a plan without a motion.
        MissingPackageError: playwright or a Chromium is not installed.
        BackendError: the browser does not start, or the page does not.
    """
    with tempfile.TemporaryDirectory(prefix="rr1plan-page-") as folder:
        if isinstance(page, Viewer):
            url = page.url
        elif isinstance(page, HasPage | Scene | Robot | Problem):
            url = _file_url(write_text(FilePath(folder) / "page.html", page_html(*page_content(page))))
        else:
            url = _file_url(page)
        with open_browser(size) as context:
            tab = context.pages[0]
            wishes = [*["bare"] * bare, *([] if step is None else [f"step={whole_number('step', step, 1, 99)}"])]
            open_page(tab, f"{url}#{'&'.join(wishes)}" if wishes else url)
            if step is not None:
                _check_step(tab, step)
            yield tab


def _check_step(page: Any, step: int) -> None:
    wait_until(page, "Boolean(window.RR1 && RR1.ready)")
    shown, count = page.evaluate("RR1.steps ? [RR1.steps.index + 1, RR1.steps.articles.length] : [0, 0]")
    if shown != step:
        steps = f"{count} steps" if count else "no steps, which only lessons have"
        raise InputError(f"step is {step}, but the page has {steps}")


def outside_event_loop(work: Callable[[], _T]) -> _T:
    """Do work that drives the browser; in another thread if this one runs an event loop, as in notebooks."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return work()
    with ThreadPoolExecutor(1) as threads:
        return threads.submit(work).result()


def open_page(page: Any, url: str) -> None:
    """Navigate to an address.

    Raises:
        BackendError: the page does not come up.
    """
    from playwright.sync_api import Error

    try:
        page.goto(url)
    except Error as error:
        raise BackendError(f"the page does not come up: {error}") from error


def settle_page(page: Any, time: float | None = None, *, whole: bool = False) -> None:
    """Wait until the page is ready, pause it at a time, frame the arms or the whole scene, and wait for the drawing.

    Raises:
        InputError: a time outside the motion.
        BackendError: the page does not come up.
    """
    wait_until(page, "Boolean(window.RR1 && RR1.ready)")
    if time is not None:
        _check_time(page, time)
    seek = "([t, whole]) => { RR1.pause(); RR1.seek(t === null ? RR1.player.start : t); RR1.look(null, whole); }"
    page.evaluate(seek, [time, whole])
    wait_until(page, "RR1.settled")
    frames = page.evaluate("RR1.frames")
    wait_until(page, f"RR1.frames > {frames} + 3")


def _check_time(page: Any, time: float) -> None:
    start, end = page.evaluate("[RR1.player.start, RR1.player.end]")
    if not start <= time <= end + _MILLISECOND:
        times = f"the times of its motion are {start:g} to {end:.3f} s" if end > start else "the page has no motion"
        raise InputError(f"time is {time:g} s, but {times}")


def wait_until(page: Any, expression: str) -> None:
    """Poll the page until a JavaScript expression is true (playwright's own method needs `eval`, which is forbidden).

    Raises:
        BackendError: it does not become true, or the page is gone.
    """
    from playwright.sync_api import Error

    end = monotonic() + _PATIENCE
    try:
        while not page.evaluate(expression):
            if monotonic() > end:
                raise BackendError(f"the page does not come up: waited {_PATIENCE:g} s for {expression}")
            page.wait_for_timeout(30)
    except Error as error:
        raise BackendError(f"the page does not come up: {error}") from error


def _file_url(file: str | os.PathLike[str]) -> str:
    found = file_path(file)
    if not found.is_file():
        raise InputError(f"there is no page {str(file)!r}; write it with save_html first")
    return found.resolve().as_uri()
