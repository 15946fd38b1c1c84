"""Pages, pictures, videos and 3-D models that `view` and `play` write."""

from __future__ import annotations

import tempfile
from argparse import Namespace
from pathlib import Path
from typing import Any

import rr1plan as rp
from rr1plan.cli.console import Console, progress_callback
from rr1plan.files.file_access import check_writable
from rr1plan.motion_plan import MotionPlan
from rr1plan.sequences.sequence_plan import SequencePlan
from rr1plan.sequences.sequence_replay import SequenceReplay

_VIEW_FILES = {"html": "page", "png": "picture", "video": "video", "glb": "3-D model"}


def check_files(options: Namespace) -> bool:
    """Whether the options name files instead of a live page.

    Raises:
        InputError: a file has another suffix or cannot be written.
        MissingPackageError: a package or the browser for a picture or a video is not installed.
    """
    asked = {name: file for name in _VIEW_FILES if (file := getattr(options, name)) is not None}
    for name, file in asked.items():
        _CHECKS[name](file)
    return bool(asked)


def check_page(file: str) -> None:
    """Reject the file of a page that cannot be written.

    Raises:
        InputError: another suffix, or a file that cannot be written.
    """
    check_writable(file, ".html")


def check_video(file: str) -> None:
    """Reject a video that cannot be made, before anything else is computed or written.

    Raises:
        InputError: another suffix, or a file that cannot be written.
        MissingPackageError: a package or the browser is not installed.
    """
    from rr1plan.playback.viewer.page_capture import require_browser
    from rr1plan.playback.viewer.video_files import FASTEST, require_encoder

    suffix = check_writable(file, *FASTEST).suffix.lower()
    require_browser()
    require_encoder(suffix)


def _check_picture(file: str) -> None:
    from rr1plan.playback.viewer.page_capture import require_browser

    check_writable(file, ".png")
    require_browser()


def _check_model(file: str) -> None:
    check_writable(file, ".glb")


_CHECKS = {"html": check_page, "png": _check_picture, "video": check_video, "glb": _check_model}


def write_files(
    scene: rp.Scene,
    motion: MotionPlan | SequencePlan | None,
    options: Namespace,
    look: rp.ViewOptions | None,
    console: Console,
) -> None:
    """Write the files requested from `view`, of a motion or of a scene alone."""
    what: Any = scene if motion is None else motion
    if any(file is not None for file in (options.html, options.png, options.video)):
        _write_page(scene, motion, options, look, console)
    if options.glb is not None:
        with console.progress("writing the 3-D model"):
            rp.save_glb(options.glb, what)
    for name, text in _VIEW_FILES.items():
        if getattr(options, name) is not None:
            console.say(f"{text}: {getattr(options, name)}")
    written = {text: getattr(options, name) for name, text in _VIEW_FILES.items()}
    console.result({"files": {text: file for text, file in written.items() if file is not None}})


def _write_page(
    scene: rp.Scene,
    motion: MotionPlan | SequencePlan | None,
    options: Namespace,
    look: rp.ViewOptions | None,
    console: Console,
) -> None:
    """Write the page of a scene or a motion, and the picture and the video of it that are requested."""
    with tempfile.TemporaryDirectory(prefix="rr1plan-page-") as folder:
        target = Path(folder) / "page.html" if options.html is None else options.html
        page = rp.save_html(target, scene, options=look) if motion is None else motion.save_html(target, options=look)
        if options.png is not None:
            with console.progress("taking a picture"):
                rp.screenshot(options.png, page, size=_size(options), time=options.time, bare=options.bare)
        if options.video is not None:
            film(page, options, console)


def write_replay(
    motion: MotionPlan | SequencePlan, replay: rp.Replay | rp.SequenceReplay, options: Namespace, console: Console
) -> dict[str, str]:
    """Write the page of a motion and its simulation, and a video: of both side by side, or of the simulation alone.

    Returns the files.
    """
    both: Any = motion.save_html
    look = rp.ViewOptions(side_by_side=options.side_by_side)
    files = {}
    if options.html is not None:
        files["page"] = str(both(options.html, replay=replay, options=look))
        console.say(f"page: {files['page']}")
    if options.video is None:
        return files
    with tempfile.TemporaryDirectory(prefix="rr1plan-page-") as folder:
        target = Path(folder) / "page.html"
        if options.side_by_side or isinstance(replay, SequenceReplay):
            page = both(target, replay=replay, options=look)
        else:
            page = rp.save_html(target, motion.scene, replay=replay)
        film(page, options, console)
    console.say(f"video: {options.video}")
    return {**files, "video": options.video}


def film(page: Any, options: Namespace, console: Console, **how: Any) -> None:
    """Write the video of a page, or of a value that has one."""
    with console.progress("filming") as advance:
        rp.save_video(
            options.video,
            page,
            size=_size(options),
            fps=options.fps,
            speed=options.speed,
            bare=options.bare,
            progress=progress_callback(advance),
            **how,
        )


def _size(options: Namespace) -> tuple[int, int]:
    width, height = options.size
    return width, height
