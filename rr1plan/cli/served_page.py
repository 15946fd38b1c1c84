"""Live pages of `view`, `lesson` and `mirror`."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace

import rr1plan as rp
from rr1plan.cli.console import Console
from rr1plan.cli.exit_codes import OK
from rr1plan.playback.viewer.live_viewer import open_in_browser


def live_options(options: Namespace, look: rp.ViewOptions | None = None) -> rp.ViewOptions:
    """The options of a live page whose address `announce` prints."""
    return replace(look or rp.ViewOptions(), port=options.port, quiet=True)


def announce(viewer: rp.Viewer, options: Namespace, console: Console, end: str) -> None:
    """Print the address of a live page and how to end it, and open it in a browser unless the options forbid that."""
    console.say(f"page: {viewer.url}  ({end})")
    if not options.no_browser:
        open_in_browser(viewer.url)


def serve(viewer: rp.Viewer, options: Namespace, console: Console) -> int:
    """Keep a live page until it is closed."""
    with viewer:
        announce(viewer, options, console, "close it or press Ctrl-C to end")
        console.result({"url": viewer.url})
        viewer.wait()
    return OK
