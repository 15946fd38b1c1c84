"""Videos of the page: every frame is drawn at its own time of the motion, however long that takes."""

from __future__ import annotations

import base64
import io
import os
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from rr1plan.checks import check_callback, positive_number, true_or_false
from rr1plan.errors import InputError
from rr1plan.files.file_access import check_writable, write_bytes
from rr1plan.playback.viewer.html_page import check_size
from rr1plan.playback.viewer.page_capture import Page, opened_page, outside_event_loop, settle_page
from rr1plan.playback.viewer.video_files import FASTEST, SLOWEST, Picture, video_bytes
from rr1plan.progress import ProgressCallback, fraction_callback
from rr1plan.progress_bar import library_bar

_MOST_FRAMES = 20_000
# Shows a time at full quality, which pages of very many arms otherwise reach only some time after a motion. The page
# draws in its own callback of the next frame, before this one; in the frame after that the picture has been composed.
_DRAW = """(time) => {
  RR1.pause(); RR1.film.show(time); RR1.shownAt = -Infinity; RR1.redraw();
  return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done())));
}"""


def save_video(
    file: str | os.PathLike[str],
    page: Page,
    *,
    size: tuple[int, int] = (1280, 800),
    fps: float = 30.0,
    speed: float = 1.0,
    step: int | None = None,
    bare: bool = False,
    progress: ProgressCallback | None = None,
) -> FilePath:
    """A video of a motion or of the animation in a lesson: MP4, GIF or WebP, recorded by a headless browser.

    A frame is drawn at every multiple of `speed / fps` seconds of the motion, and one at its end, so a slow machine
    takes longer but produces the same video.

    Args:
        file: The file, whose name ends in .mp4, .gif or .webp; written atomically. GIF and WebP repeat.
        page: A page that `save_html` wrote, a live viewer, or a value that has a page: a motion, a sequence plan, a
            C-space with a path or a tree, whose growth is animated, or a lesson.
        size: Width and height [px]; even numbers for MP4.
        fps: Pictures per second: 0.01 to 120, in WebP to 60, in GIF to 50.
        speed: Multiple of real time.
        step: The step of a lesson, from 1 on; None: the first.
        bare: Without the cards around the picture.
        progress: Called after each frame; False cancels. Without it a bar is drawn on a terminal.

    Returns:
        The file.

    Raises:
        InputError: no such page, a page without a motion, another suffix, a file that cannot be written, an invalid
            size or rate, no such step, or more than 20,000 frames.
        NoPlanError: a plan without a motion.
        CancelledError: `progress` returned False.
        MissingPackageError: playwright, PyAV or a Chromium is not installed (extra `video`).
        BackendError: the browser does not start, or the page does not.
    """
    file = check_writable(file, *FASTEST)
    suffix = file.suffix.lower()
    fps, speed, size = positive_number("fps", fps), positive_number("speed", speed), check_size(size)
    if not SLOWEST <= fps <= FASTEST[suffix]:
        raise InputError(f"fps is {fps:g}, expected {SLOWEST:g} to {FASTEST[suffix]:g} in {suffix} files")
    if suffix == ".mp4" and (size[0] % 2 or size[1] % 2):
        raise InputError(f"size is {size[0]} x {size[1]}, expected even numbers of pixels for MP4")
    bare = true_or_false("bare", bare)
    check_callback("progress", progress)

    def film() -> bytes:
        with opened_page(page, size, bare, step) as tab, library_bar("filming") as advance:
            settle_page(tab)
            tell = advance if progress is None else fraction_callback("film", progress)
            return video_bytes(suffix, _PageFrames(tab, speed / fps, tell), fps)

    return write_bytes(file, outside_event_loop(film))


class _PageFrames:
    """Frames of a page's motion at a time step [s]."""

    def __init__(self, tab: Any, step: float, advance: Callable[[float], None] | None) -> None:
        from PIL import Image

        self._decode = Image.open
        start, end = tab.evaluate("[RR1.film.start, RR1.film.end]")
        if end <= start:
            raise InputError("the page has no motion, or one of 0 s, and nothing to film; try a picture (PNG) instead")
        count = int(np.ceil((end - start) / step - 1e-9)) + 1
        if count > _MOST_FRAMES:
            raise InputError(f"the video has {count} pictures, expected at most {_MOST_FRAMES}; lower fps, raise speed")
        self._times = np.minimum(start + step * np.arange(count), end).tolist()
        self._tab, self._advance = tab, advance
        self._session = tab.context.new_cdp_session(tab)

    def __len__(self) -> int:
        return len(self._times)

    def __getitem__(self, index: int) -> Picture:
        self._tab.evaluate(_DRAW, self._times[index])
        if self._advance is not None:
            self._advance((index + 1) / len(self))
        # PNG with little compression takes a third of the time.
        taken = self._session.send("Page.captureScreenshot", {"format": "png", "optimizeForSpeed": True})
        picture: Picture = np.asarray(self._decode(io.BytesIO(base64.b64decode(taken["data"]))).convert("RGB"))
        return picture
