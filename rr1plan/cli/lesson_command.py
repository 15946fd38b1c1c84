"""`lesson`: pages and figures for the lecture hall."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

import rr1plan as rp
from rr1plan.checks import known_name
from rr1plan.cli.console import Console
from rr1plan.cli.exit_codes import OK
from rr1plan.cli.picture_files import check_video, film
from rr1plan.cli.scene_options import check_scene_name, named_query
from rr1plan.cli.served_page import live_options, serve
from rr1plan.errors import InputError
from rr1plan.files.file_access import check_writable
from rr1plan.lessons.lesson_titles import LESSONS
from rr1plan.scene.model_library import load_scene


def lesson(options: Namespace, console: Console) -> int:
    """List the lessons; or open one, or write its page and its figure."""
    if options.lesson is None:
        idle = sorted(options.given - {"--json", "--quiet"})
        if idle:
            raise InputError(f"{idle[0]} has no effect without a lesson; name one: {', '.join(LESSONS)}")
        console.table(("lesson", "title"), [(name, title) for name, (_, title) in LESSONS.items()])
        console.names(list(LESSONS))
        console.result([{"name": name, "title": title} for name, (_, title) in LESSONS.items()])
        return OK
    known_name("lesson", options.lesson, LESSONS)
    for file in filter(None, (options.html, options.figure)):
        check_writable(file)
    if options.video is not None:
        check_video(options.video)
    with console.progress(f"computing {options.lesson}"):
        made = rp.lesson(options.lesson, *_own(options))
    if options.html is None and options.figure is None and options.video is None:
        return serve(made.show(options=live_options(options)), options, console)
    files = {}
    if options.html is not None:
        files["page"] = made.save_html(options.html)
    if options.figure is not None:
        files["figure"] = made.save(options.figure)
    if options.video is not None:
        film(made, options, console, step=options.step)
        files["video"] = Path(options.video)
    for kind, file in files.items():
        console.say(f"{kind}: {file}")
    console.result({"lesson": options.lesson, "files": {kind: str(file) for kind, file in files.items()}})
    return OK


def figures(options: Namespace, console: Console) -> int:
    """Write the figures of the lessons and the pictures of the README."""
    with console.progress("figures") as advance:
        made = rp.save_figures(
            options.out, options.names or None, progress=lambda progress: advance(progress.fraction, progress.stage)
        )
    for files in made.values():
        console.say("  ".join(map(str, files)))
    if not options.names:
        for name in rp.figure_names():
            if name not in made:
                console.warn(f"{name} is left out: it takes a browser (pip install 'rr1plan[video]' and Chromium)")
    console.result({name: [str(file) for file in files] for name, files in made.items()})
    return OK


def _own(options: Namespace) -> tuple[rp.Scene | None, rp.Problem | None]:
    """The scene and the query named by the options."""
    if options.scene is not None:
        check_scene_name(options.scene)
    if options.query is not None:
        return None, named_query(options.scene, options.query)
    return (None if options.scene is None else load_scene(options.scene)), None
