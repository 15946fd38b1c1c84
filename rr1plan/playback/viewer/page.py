"""One HTML page, whole in itself: Meshcat's viewer, our page around it, and the document.

The page may not load anything from anywhere: its content security policy names the hashes of
its own scripts and nothing else, so neither a request nor a script smuggled in by a name in a
file can run. Data stands in `<script type="application/json">` with every "<" escaped.
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path as FilePath
from typing import Any

from rr1plan.checks import check_text, finite_array, items_of, of_kind, shown, true_or_false, whole_number
from rr1plan.errors import BackendError, InputError, MissingPackageError
from rr1plan.playback.viewer.camera import check_view
from rr1plan.playback.viewer.document import Document

_SCRIPTS = (
    "math.js", "shapes.js", "ways.js", "spheres.js", "world.js", "stage.js", "player.js", "controls.js", "live.js",
    "main.js",
)  # fmt: skip


@dataclass(frozen=True)
class Panel:
    """Something of your own beside the 3-D view, e.g. a picture of the configuration space.

    Args:
        name: A name unique on the page; letters, digits and "-".
        title: Headline of the panel.
        html: What stands in the panel.
        css: Style rules.
        script: JavaScript statements, run once with three names in reach: `viewer` (see
            `page/main.js` for what it offers), `root` (the panel's element), `data`.
        data: Anything JSON can hold; `pack` puts arrays in.
        width: Width of the column of panels [px].

    Raises:
        InputError: a name with other characters.
    """

    name: str
    title: str
    html: str = ""
    css: str = ""
    script: str = ""
    data: Any = None
    width: int = 420

    def __post_init__(self) -> None:
        for name in ("name", "title", "html", "css", "script"):
            check_text(f"panel {name}", getattr(self, name))
        whole_number("panel width", self.width, 1, 10_000)
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9-]*", self.name):
            raise InputError(f"panel name is {shown(self.name)}, expected letters, digits and '-'")


def page_html(
    document: Document,
    panels: Sequence[Panel] = (),
    *,
    live: bool = False,
    version: int = 0,
    view: Any = None,
    play: bool = True,
) -> str:
    """The page as text.

    Args:
        document: What `view_document` made.
        panels: Panels beside the 3-D view.
        live: The page asks the server it came from for updates.
        version: Of the document, so that the server knows whether the page has the newest.
        view: Where it is looked at from first, see `check_view`; None takes the document's choice.
        play: The motion runs from the start.

    Raises:
        InputError: two panels of one name, data JSON cannot hold, or a view that is none.
        MissingPackageError: Meshcat is not installed.
        BackendError: Meshcat is there without its viewer.
    """
    panels = items_of("panels", panels, "Panel")
    for panel in panels:
        of_kind("one of the panels", panel, Panel)
    names = [panel.name for panel in panels]
    if len(set(names)) != len(names):
        raise InputError(f"panels are named {names}, expected names unique on the page")
    scripts = [_meshcat(), _script(panels)]
    settings = {
        "live": live,
        "version": version,
        "view": check_view(view),
        "play": true_or_false("play", play),
        "panels": [{"name": p.name, "data": p.data} for p in panels],
    }
    slots = {
        "TITLE": html.escape(document["title"]),
        "POLICY": html.escape(_policy(scripts, live)),
        "STYLE": _asset("page.css") + "".join(_sealed(p.css, "style") for p in panels),
        "PANELS": "".join(_panel_html(p) for p in panels),
        "DOCUMENT": json_for_html(document),
        "SETTINGS": json_for_html(settings),
        "MESHCAT": scripts[0],
        "SCRIPT": scripts[1],
    }
    return re.sub(r"\{\{([A-Z]+)\}\}", lambda m: slots[m.group(1)], _asset("page.html"))


def embed_html(text: str, height: int = 600) -> str:
    """A page inside a notebook's page."""
    style = f"width:100%;height:{int(height)}px;border:0;border-radius:8px"
    return f'<iframe srcdoc="{html.escape(text)}" style="{style}"></iframe>'


def json_for_html(value: Any) -> str:
    """JSON that can stand inside a script element whatever the strings in it are.

    Raises:
        InputError: a value JSON cannot hold, NaN and infinity included.
    """
    try:
        text = json.dumps(value, allow_nan=False, separators=(",", ":"), ensure_ascii=True)
    except (TypeError, ValueError) as error:
        raise InputError(f"the page cannot hold this data: {error}") from error
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def check_size(size: Any) -> tuple[int, int]:
    """A picture's width and height [px] as whole numbers between 16 and 8192.

    Raises:
        InputError: anything else.
    """
    width, height = (int(v) for v in finite_array("size", size, (2,)))
    if not (16 <= width <= 8192 and 16 <= height <= 8192):
        raise InputError(f"size is {width} x {height}, expected 16 to 8192 pixels each way")
    return width, height


@cache
def _asset(name: str) -> str:
    return (files("rr1plan.playback.viewer") / "page" / name).read_text(encoding="utf-8")


@cache
def _meshcat() -> str:
    """Meshcat's own viewer, as its package ships it (its licences stand in the page's head)."""
    # Found, not imported: the Python package would bring ZeroMQ and IPython along.
    found = find_spec("meshcat")
    if found is None or found.origin is None:
        raise MissingPackageError("meshcat", "the 3-D page")
    script = FilePath(found.origin).parent / "viewer" / "dist" / "main.min.js"
    try:
        return _sealed(script.read_text(encoding="utf-8"), "script")
    except OSError as error:
        raise BackendError(f"the package meshcat has no viewer at {script}; try to install it again") from error


def _script(panels: Sequence[Panel]) -> str:
    parts = [_asset(name) for name in _SCRIPTS]
    mounts = [f"mounts[{json.dumps(p.name)}] = function (viewer, root, data) {{\n{p.script}\n}};" for p in panels]
    body = "\n".join([*parts[:-1], *mounts, parts[-1]])
    return _sealed(f"(function () {{\n'use strict';\nconst mounts = {{}};\n{body}\n}})();\n", "script")


def _sealed(text: str, element: str) -> str:
    """Text that cannot close the element it stands in."""
    if re.search(rf"</{element}", text, re.IGNORECASE):
        raise InputError(f"a {element} of the page contains '</{element}', expected it to be written otherwise")
    return text


def _panel_html(panel: Panel) -> str:
    head = f"<h2>{html.escape(panel.title)}</h2>"
    width = f"--panel-width:{int(panel.width)}px"
    return f'<section class="panel" id="panel-{panel.name}" style="{width}">{head}{panel.html}</section>'


def _policy(scripts: Sequence[str], live: bool) -> str:
    hashes = [base64.b64encode(hashlib.sha256(s.encode("utf-8")).digest()).decode("ascii") for s in scripts]
    allowed = " ".join(f"'sha256-{h}'" for h in hashes)
    connect = "'self'" if live else "'none'"
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; "
        f"img-src data: blob:; connect-src {connect}; base-uri 'none'; form-action 'none'"
    )
