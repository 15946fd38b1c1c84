"""One self-contained HTML page: Meshcat's viewer, our page around it, and the document.

The page must not load anything: its content security policy lists the hashes of its own scripts and nothing else, so
neither requests nor scripts injected through names in a file can run. Only a page that plans by itself may compile
WebAssembly and start a worker, which runs the script of the planner. Data is embedded in
`<script type="application/json">` with every "<" escaped.
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from collections.abc import Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path as FilePath
from typing import Any

from rr1plan.checks import finite_array
from rr1plan.errors import BackendError, InputError, MissingPackageError
from rr1plan.kernels.wasm_core import core_script
from rr1plan.playback.viewer.live_page import LiveAccess
from rr1plan.playback.viewer.page_arrays import plain_value
from rr1plan.playback.viewer.page_asset import page_asset
from rr1plan.playback.viewer.page_document import Document
from rr1plan.playback.viewer.page_planner import page_modules
from rr1plan.playback.viewer.view_options import Panel, ViewOptions, checked_options

_PLANNER_SCRIPTS = ("math.js", "referee.js", "planner.js", "many_arms_planner.js", "background_planner.js")
_SCRIPTS = (
    "shapes.js", "bodies.js", "tool_paths.js", "spheres.js", "world.js", "multisampling.js", "stage.js", "pace.js",
    "player.js", "conflicts.js", "keys.js", "controls.js", "overlays.js", "side_by_side.js", "drawing.js",
    "plot_curves.js", "plots.js", "pointer_pick.js", "differential_ik.js", "dragging.js", "plan_card.js",
    "jogging.js", "scene_stages.js", "editing.js", "live.js", "printing.js", "main.js",
)  # fmt: skip
_STYLES = ("page.css", "plots.css", "editing.css")


def page_html(document: Document, options: ViewOptions | None = None, *, live: LiveAccess | None = None) -> str:
    """The page as text.

    Args:
        document: The result of `view_document`.
        options: The panels, the first view, and whether the motion runs; title and spheres are in the document.
        live: The program that the page follows; None for a page by itself.

    Raises:
        InputError: data that JSON cannot represent.
        MissingPackageError: Meshcat is not installed.
        BackendError: Meshcat is installed without its viewer.
    """
    options = checked_options(options)
    panels = options.panels
    plans = plans_by_itself(document)
    scripts = [_planner_script(), _meshcat(), *_page_scripts(panels)]
    settings = {
        "live": None if live is None else live._asdict(),
        "view": options.view,
        "play": options.play,
        "sideBySide": options.side_by_side,
        "panels": [{"name": p.name, "data": p.data} for p in panels],
        "modules": page_modules() if plans else None,
    }
    slots = {
        "TITLE": html.escape(document["title"]),
        "POLICY": html.escape(_policy(scripts, live, plans)),
        "STYLE": growing_lengths("".join(map(page_asset, _STYLES)) + "".join(_sealed(p.css, "style") for p in panels)),
        "PANELS": "".join(_panel_html(p) for p in panels),
        "DOCUMENT": json_for_html(document),
        "SETTINGS": json_for_html(settings),
        "PLANNER": scripts[0],
        "MESHCAT": scripts[1],
        "SCRIPTS": "\n".join(f"<script>{script}</script>" for script in scripts[2:]),
    }
    return re.sub(r"\{\{([A-Z]+)\}\}", lambda m: slots[m.group(1)], page_asset("page.html"))


def plans_by_itself(document: Document) -> bool:
    """Whether the page of a document carries the planners' kernels."""
    return "missing" not in (document.get("planner") or {"missing": ""})


def planner_script() -> str:
    """The page's planner as a separate script, which defines `loadPlanner`."""
    return "\n".join([_core_script(), *map(page_asset, _PLANNER_SCRIPTS)])


def _core_script() -> str:
    """The binding of the kernels as a function `loadCore`, because in a page it is not a module."""
    return f"const loadCore = (() => {{\n{core_script().replace('export async', 'async')}\nreturn load;\n}})();\n"


def embed_html(text: str, height: int = 600) -> str:
    """A page in a sandboxed frame for notebooks, which browsers do not draw while it is scrolled out of view.

    All of it is ASCII, because the encoding of the document around it may be another one, or be guessed by the browser.
    """
    source = html.escape(text).encode("ascii", "xmlcharrefreplace").decode()
    style = f"width:100%;height:{int(height)}px;border:0;border-radius:8px"
    return f'<iframe srcdoc="{source}" sandbox="allow-scripts allow-downloads" style="{style}"></iframe>'


def json_for_html(value: object) -> str:
    """JSON that is safe inside a script element, whatever its strings contain.

    Raises:
        InputError: a value that JSON cannot represent, including NaN and infinity.
    """
    try:
        text = json.dumps(value, allow_nan=False, separators=(",", ":"), ensure_ascii=True, default=plain_value)
    except (TypeError, ValueError) as error:
        raise InputError(f"the page cannot hold this data: {error}") from error
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def growing_lengths(style: str) -> str:
    """A style sheet whose lengths in px grow with the window, as tenths of the unit rem (see `page.css`).

    Strings, addresses and media queries, in which rem has another meaning, stay the same.
    """
    kept = r"""/\*.*?\*/|"[^"]*"|'[^']*'|url\([^)]*\)|@media[^{]*"""
    length = r"(?<![\w.#-])(-?)(\d*\.?\d+)px\b"
    return re.sub(
        f"{kept}|{length}",
        lambda m: m[0] if m[2] is None else f"{m[1]}{float(m[2]) / 10:.6g}rem",
        style,
        flags=re.DOTALL,
    )


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
def _meshcat() -> str:
    """Meshcat's own viewer, as its package ships it (its licenses are in the page's head)."""
    # Located, not imported: importing the Python package would load ZeroMQ and IPython.
    found = find_spec("meshcat")
    if found is None or found.origin is None:
        raise MissingPackageError("meshcat", "the 3-D page")
    script = FilePath(found.origin).parent / "viewer" / "dist" / "main.min.js"
    try:
        return _sealed(script.read_text(encoding="utf-8"), "script")
    except OSError as error:
        raise BackendError(f"the package meshcat has no viewer at {script}; try to install it again") from error


def _planner_script() -> str:
    """The planner, which the page and its worker run; its names are global, so that the page's own script has them."""
    return _sealed(f"'use strict';\n{_without_comments(planner_script())}\n", "script")


def _page_scripts(panels: Sequence[Panel]) -> list[str]:
    """The page's own script, one for each panel, and the last one, which starts the page.

    A syntax error in the script of a panel stops only that script, and their names are global, so that all have them.
    """
    *parts, start = [_without_comments(page_asset(name)) for name in _SCRIPTS]
    own = "\n".join(["const mounts = {};", *parts])
    mounts = [f"mounts[{json.dumps(p.name)}] = function (viewer, root, data) {{\n{p.script}\n}};" for p in panels]
    return [_sealed(f"'use strict';\n{script}\n", "script") for script in (own, *mounts, start)]


def _without_comments(script: str) -> str:
    """A script without comments and indentation, which are a third of it."""
    script = re.sub(r"^\s*(/\*\*.*?\*/|//[^\n]*)\n", "", script, flags=re.DOTALL | re.MULTILINE)
    return re.sub(r"^\s+", "", script, flags=re.MULTILINE)


def _sealed(text: str, element: str) -> str:
    """Text that cannot close the element that contains it."""
    if re.search(rf"</{element}", text, re.IGNORECASE):
        raise InputError(f"a {element} of the page contains '</{element}', expected it to be written otherwise")
    return text


def _panel_html(panel: Panel) -> str:
    head = f"<h2>{html.escape(panel.title)}</h2>"
    width = f"--panel-width:{panel.width / 10:g}rem"
    return f'<section class="panel" id="panel-{panel.name}" style="{width}">{head}{panel.html}</section>'


def _policy(scripts: Sequence[str], live: LiveAccess | None, plans: bool) -> str:
    hashes = [base64.b64encode(hashlib.sha256(s.encode("utf-8")).digest()).decode("ascii") for s in scripts]
    allowed = " ".join([*(f"'sha256-{h}'" for h in hashes), *(["'wasm-unsafe-eval'"] if plans else [])])
    workers = "blob:" if plans else "'none'"
    connect = "'none'" if live is None else live.address or "'self'"
    return (
        f"default-src 'none'; script-src {allowed}; worker-src {workers}; style-src 'unsafe-inline'; "
        f"img-src data: blob:; connect-src {connect}; base-uri 'none'; form-action 'none'"
    )
