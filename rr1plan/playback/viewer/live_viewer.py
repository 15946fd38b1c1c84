"""A page that follows the running program."""

from __future__ import annotations

import os
import sys
import threading
import webbrowser
from collections.abc import Callable, Mapping
from dataclasses import replace
from time import monotonic
from types import TracebackType
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import (
    FARTHEST,
    check_callback,
    finite_array,
    finite_number,
    known_name,
    of_kind,
    positive_number,
)
from rr1plan.errors import InputError
from rr1plan.path import Path
from rr1plan.playback.simulation.replay import Replay
from rr1plan.playback.viewer.html_page import embed_html, page_html
from rr1plan.playback.viewer.live_page import LiveAccess
from rr1plan.playback.viewer.page_document import Document, view_document
from rr1plan.playback.viewer.page_server import serve_page
from rr1plan.playback.viewer.view_options import Panel, ViewOptions, checked_options
from rr1plan.report import Report
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem
from rr1plan.trajectory import Trajectory

_RELOAD = 2.0  # [s] after its last browser has disconnected, a page counts as closed rather than reloading
_TICK = 0.1  # [s] between two checks of the open pages

SliderCallback = Callable[[str, float], None]


class Viewer:
    """A live page. `show` creates one; as a context manager it closes the page at the end.

    Args:
        scene, trajectory, path, problem, report, replay, options: As in `save_html`.

    Raises:
        UnknownNameError: a column that is not a joint of the scene.
        InputError: data JSON cannot hold.
        BackendError: no free port.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        trajectory: Trajectory | None = None,
        path: Path | None = None,
        problem: Problem | None = None,
        report: Report | None = None,
        replay: Replay | None = None,
        options: ViewOptions | None = None,
    ) -> None:
        of_kind("scene", scene, Scene, method="show")
        document = view_document(
            scene, trajectory=trajectory, path=path, problem=problem, report=report, replay=replay, options=options
        )
        self._open(scene, document, checked_options(options))

    def _open(self, scene: Scene, document: Document, options: ViewOptions) -> None:
        """Serve a document."""
        self._scene = scene
        self._document = document
        self._options = options
        self._ended = threading.Event()
        page_html(document, options)
        self._on_slider: SliderCallback | None = None
        self._server, self._page = serve_page(self._html, self._hear, options.port)
        self._page.set_document(document)

    @property
    def url(self) -> str:
        """Address of the page, for browsers of this machine."""
        return self._page.url

    @property
    def options(self) -> ViewOptions:
        """The options of the page."""
        return self._options

    @property
    def pages(self) -> int:
        """Number of connected pages."""
        return self._page.pages

    @property
    def closed(self) -> bool:
        """Whether the page is no longer served."""
        return not self._server.has(self._page)

    def page_content(self, options: ViewOptions | None = None) -> tuple[Document, ViewOptions]:
        """The document that the pages show, and the given options or theirs."""
        return self._document, self._options if options is None else checked_options(options)

    def load(
        self,
        scene: Scene,
        *,
        trajectory: Trajectory | None = None,
        path: Path | None = None,
        problem: Problem | None = None,
        report: Report | None = None,
        replay: Replay | None = None,
        options: ViewOptions | None = None,
    ) -> None:
        """Show another scene or motion on the same page; the arguments are those of `save_html`.

        Of the options only the title, the spheres, the motion to compare and the tree are used; the others remain those
        with which the page was opened.

        Raises:
            UnknownNameError: a column that is not a joint of the scene.
            InputError: the viewer is closed, or a motion as a whole: its scene and its trajectory are two arguments.
        """
        if isinstance(getattr(scene, "scene", None), Scene) and hasattr(type(scene), "trajectory"):
            raise InputError(
                f"scene is of type {type(scene).__name__}, expected Scene; pass its attributes: "
                "load(motion.scene, trajectory=motion.trajectory)"
            )
        opened = self._options
        options = replace(checked_options(options), planner=opened.planner, clearances=opened.clearances)
        document = view_document(
            scene, trajectory=trajectory, path=path, problem=problem, report=report, replay=replay, options=options
        )
        self._exchange(scene, document)

    def _exchange(self, scene: Scene, document: Document, panels: tuple[Panel, ...] = ()) -> None:
        """Send another document to the pages, and the data of the given panels to the panels of the same names."""
        known = {panel.name: panel for panel in (*self._options.panels, *panels)}
        data = {panel.name: panel.data for panel in panels}
        self._page.set_document({**document, "panels": data} if data else document)
        self._scene, self._document = scene, document
        self._options = replace(self._options, panels=tuple(known.values()))

    def update(self, q: ArrayLike | Mapping[str, str | ArrayLike]) -> None:
        """Set the configuration of the arms at once; pages show the latest one.

        Args:
            q: Configuration of all arms of the scene [rad or m], shape (nq,), or a mapping from arm
                to its configuration or a configuration's name (the others stay as the scene has them).

        Raises:
            UnknownNameError: no such arm or configuration.
            InputError: wrong shape, not finite, or the viewer is closed.
        """
        if isinstance(q, Mapping):
            configurations = {
                n: self._scene.arm(n).robot.configuration(v, f"configuration of {n!r}") for n, v in q.items()
            }
            parts = (configurations.get(name, arm.q) for name, arm in self._scene.arms.items())
            q = np.concatenate([np.zeros(0), *parts])
        values = finite_array("q", q, (len(self._document["columns"]),))
        self._page.set_frame(values.astype("<f8").tobytes())

    def update_panel(self, name: str, data: Mapping[str, object]) -> None:
        """Put new entries into the data of a panel, whose script is notified by `viewer.on("data", ...)`.

        Args:
            name: The panel.
            data: As that of a `Panel`.

        Raises:
            UnknownNameError: the page has no such panel.
            InputError: data that JSON cannot represent, or the viewer is closed.
        """
        known_name("panel", name, [panel.name for panel in self._options.panels])
        of_kind("data", data, Mapping)
        self._page.update_panel(name, dict(data))

    def on_slider(self, callback: SliderCallback | None) -> None:
        """Register a callback for sliders of joints on a page, moved by the mouse or the arrow keys.

        Args:
            callback: Called with the joint ("arm/joint") and the value [rad or m], in the thread of the page's server;
                None removes it.

        Raises:
            InputError: an argument that is not callable.
        """
        check_callback("callback", callback)
        self._on_slider = callback

    def _hear(self, message: object) -> None:
        """Pass on the motion of a slider; pages send no other messages."""
        columns = self._document["columns"]
        match message:
            case {"type": "slider", "column": int(column), "value": int(value) | float(value)}:
                if 0 <= column < len(columns) and abs(value) <= FARTHEST and self._on_slider is not None:
                    self._on_slider(columns[column], float(value))
            case _:
                pass

    def play(self) -> None:
        """Start the clock of the motion."""
        self._page.command("play")

    def pause(self) -> None:
        """Stop the clock."""
        self._page.command("pause")

    def seek(self, t: float) -> None:
        """Show the motion at a time [s].

        Args:
            t: The time [s], on the clock of the motion.

        Raises:
            InputError: not a finite number.
        """
        self._page.command("seek", finite_number("t", t))

    def set_speed(self, speed: float) -> None:
        """Set the playback speed as a multiple of real time.

        Raises:
            InputError: not a number above zero.
        """
        self._page.command("speed", positive_number("speed", speed))

    def wait(self, timeout: float | None = None) -> bool:
        """Keep the program alive until the page has been opened and closed again, or Ctrl-C, or `close`.

        If several pages are open, wait until the last one is closed. Reloading a page does not close it.

        Args:
            timeout: Longest wait [s]; None waits without a limit.

        Returns:
            False on timeout.

        Raises:
            InputError: a timeout that is not a number >= 0.
        """
        if timeout is not None and finite_number("timeout", timeout) < 0.0:
            raise InputError(f"timeout is {timeout}, expected a time >= 0 [s]")
        began = monotonic()
        visits_before = self._page.visits - self.pages
        try:
            while True:
                now = monotonic()
                opened = self._page.visits > visits_before
                if opened and not self.pages and now - self._page.last_sign > _RELOAD:
                    return True
                left = _TICK if timeout is None else began + timeout - now
                if self._ended.wait(max(0.0, min(_TICK, left))):
                    return True
                if left <= 0.0:
                    return False
        except KeyboardInterrupt:
            return True

    def close(self) -> None:
        """Stop serving the page; may be called more than once."""
        self._page.close()
        self._ended.set()

    def __enter__(self) -> Viewer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Viewer {'closed' if self.closed else self.url}>"

    def _repr_html_(self) -> str:
        """In a notebook: the page, which follows the program if it can reach it, and is static otherwise."""
        return embed_html(self._html(self._page.access(from_elsewhere=True)))

    def _html(self, access: LiveAccess) -> str:
        return page_html(self._document, self._options, live=access)


_SomeViewer = TypeVar("_SomeViewer", bound=Viewer)


def show(
    scene: Scene,
    *,
    trajectory: Trajectory | None = None,
    path: Path | None = None,
    problem: Problem | None = None,
    report: Report | None = None,
    replay: Replay | None = None,
    options: ViewOptions | None = None,
) -> Viewer:
    """Open a live page in the browser of this machine, and print its address.

    The page is served as long as the program runs: end a script with `show(...).wait()`. No browser is opened without a
    screen, or from a notebook, which displays the viewer itself.

    Args:
        scene: As in `save_html`.
        trajectory: As in `save_html`.
        path: As in `save_html`.
        problem: As in `save_html`.
        report: As in `save_html`.
        replay: As in `save_html`.
        options: As in `save_html`.

    Raises:
        UnknownNameError: a column that is not a joint of the scene.
        InputError: data JSON cannot hold.
        BackendError: no free port.
        MissingPackageError: Meshcat is not installed.
    """
    return announced(
        Viewer(scene, trajectory=trajectory, path=path, problem=problem, report=report, replay=replay, options=options)
    )


def announced(viewer: _SomeViewer) -> _SomeViewer:
    """A viewer whose address is printed and opened in a browser, unless its options say `quiet`."""
    if not viewer.options.quiet:
        print(f"page: {viewer.url}", flush=True)  # noqa: T201  (a script has no other way to say where its page is)
        open_in_browser(viewer.url)
    return viewer


def open_in_browser(url: str) -> None:
    """Open a page in a browser if there is a screen, but not from a notebook."""
    # Without a screen, Python would start a browser inside the terminal.
    has_screen = sys.platform in ("win32", "darwin") or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if has_screen and "ipykernel" not in sys.modules:
        webbrowser.open(url)
