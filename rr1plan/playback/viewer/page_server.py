"""A small web server in a thread, which only this machine can reach.

It serves its own pages only: it listens on 127.0.0.1, and rejects a Host header other than that address (a foreign name
that resolves to it) and WebSockets from other origins without the page's token. A page that reads slowly gets the
latest configuration and misses older ones.

Live pages share one server, whose thread runs while it has a page: the first is at "/", others at "/2/", "/3/", ...
"""

from __future__ import annotations

import asyncio
import atexit
import logging
import os
import socket
import sys
import threading
from collections.abc import Callable
from itertools import count
from weakref import WeakSet

from tornado.httpserver import HTTPServer
from tornado.iostream import IOStream
from tornado.web import Application, HTTPError, RequestHandler

from rr1plan.checks import whole_number
from rr1plan.errors import BackendError, InputError
from rr1plan.playback.viewer.live_page import LiveAccess, LivePage, PageHandler, UpdatesHandler
from rr1plan.thread_locks import per_process

logger = logging.getLogger(__name__)

_ADDRESS = "127.0.0.1"
_FIRST_PORT = 7000
_PORTS_TRIED = 50
_PING = 10.0  # [s] between pings, at which pages notice that the program answers
_PATIENCE = 5.0  # [s] for the thread to start or end
_lock = per_process(sys.modules[__name__], "_lock", threading.RLock)  # guards the set of pages
_servers: WeakSet[PageServer] = WeakSet()


class _ConnectionServer(HTTPServer):
    """An HTTP server that adds each new connection to a set, `streams`."""

    streams: WeakSet[IOStream]

    def handle_stream(self, stream: IOStream, address: tuple[object, ...]) -> None:
        """Serve a new connection."""
        self.streams.add(stream)
        super().handle_stream(stream, address)


class PageServer:
    """Serves pages at one port of this machine.

    Args:
        port: First port to try; the next free one is taken.

    Raises:
        InputError: an invalid port.
        BackendError: no free port.
    """

    def __init__(self, port: int) -> None:
        self.listener, self.port = _bind(port)
        self._hosts = {f"{name}:{self.port}" for name in (_ADDRESS, "localhost")}
        self._pages: dict[int, LivePage] = {}
        self._streams: WeakSet[IOStream] = WeakSet()
        self._ended = False
        self._loop = asyncio.new_event_loop()
        self._started = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"rr1plan-page-{self.port}", daemon=True)
        self._thread.start()
        self._started.wait(_PATIENCE)
        _servers.add(self)

    @property
    def running(self) -> bool:
        """Whether the server is running."""
        return not self._ended and self._thread.is_alive()

    def add(self, html: Callable[[LiveAccess], str], hear: Callable[[object], None] | None = None) -> LivePage:
        """Add a page at the first free number; see `LivePage`."""
        with _lock:
            number = next(i for i in count(1) if i not in self._pages)
            url = f"http://{_ADDRESS}:{self.port}/" + ("" if number == 1 else f"{number}/")

            def run(act: Callable[[], object]) -> None:
                if not self.has(page):
                    raise InputError("the viewer is closed; call show again")
                self._loop.call_soon_threadsafe(act)

            page = LivePage(url, html, hear, run, lambda: self._remove(number, page))
            self._pages[number] = page
        return page

    def has(self, page: LivePage) -> bool:
        """Whether a page is served."""
        return self.running and page in self._pages.values()

    def close(self) -> None:
        """Remove all pages, which ends the thread."""
        for page in tuple(self._pages.values()):
            page.close()

    def forget(self) -> None:
        """Close the sockets in a forked process, which has no thread of the server: its parent keeps its own."""
        for held in [self.listener, *(stream.socket for stream in self._streams)]:
            held.close()

    def _remove(self, number: int, page: LivePage) -> None:
        """Remove a page, and end the thread with the last one; may be called repeatedly."""
        with _lock:
            if not self.has(page):
                return
            self._loop.call_soon_threadsafe(page.end)
            del self._pages[number]
            self._ended = not self._pages
        if self._ended:
            self._loop.call_soon_threadsafe(lambda: self._loop.create_task(self._end()))
            self._thread.join(_PATIENCE)

    # ---- in the server's thread --------------------------------------------------------

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        find = {"find": self._find}
        routes = [(r"/(?:(\d+)/)?", PageHandler, find), (r"/(?:(\d+)/)?updates", UpdatesHandler, find)]
        application = Application(routes, log_function=_log, websocket_ping_interval=_PING)
        self._http = _ConnectionServer(application)
        self._http.streams = self._streams
        self._http.add_socket(self.listener)
        self._loop.call_soon(self._started.set)
        try:
            self._loop.run_forever()
        finally:
            self._loop.close()

    def _find(self, host: str, number: str | None) -> LivePage | None:
        """The page with a number, if the request was addressed to this server."""
        if host not in self._hosts:
            raise HTTPError(403)
        return self._pages.get(1 if number is None else int(number))

    async def _end(self) -> None:
        self._http.stop()
        await asyncio.wait_for(self._http.close_all_connections(), _PATIENCE / 2)
        await self._loop.shutdown_asyncgens()
        others = [task for task in asyncio.all_tasks(self._loop) if task is not asyncio.current_task()]
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)
        self._loop.stop()


class _Shared:
    """The server of all pages without a chosen port."""

    server: PageServer | None = None


def serve_page(
    html: Callable[[LiveAccess], str], hear: Callable[[object], None] | None, port: int | None = None
) -> tuple[PageServer, LivePage]:
    """Serve a page.

    Args:
        html: Returns the text of the page.
        hear: Called with messages from browsers.
        port: First port to try, with a separate server for this page; None: the shared server, at 7000 or the next free
            port.

    Raises:
        InputError: an invalid port.
        BackendError: no free port.
    """
    if port is not None:
        server = PageServer(port)
        return server, server.add(html, hear)
    with _lock:
        if _Shared.server is None or not _Shared.server.running:
            _Shared.server = PageServer(_FIRST_PORT)
        return _Shared.server, _Shared.server.add(html, hear)


def _bind(port: int) -> tuple[socket.socket, int]:
    whole_number("port", port, 0, 65535)
    for candidate in [0] if port == 0 else [*range(port, min(port + _PORTS_TRIED, 65536)), 0]:
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            if os.name == "posix":  # on other systems it would let two servers share a port
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.setblocking(False)
            listener.bind((_ADDRESS, candidate))
            listener.listen(128)
        except OSError:
            listener.close()
            continue
        return listener, int(listener.getsockname()[1])
    raise BackendError(f"no free port on {_ADDRESS} from {port} on")


def _log(handler: RequestHandler) -> None:
    logger.debug("%s %s %d", handler.request.method, handler.request.uri, handler.get_status())


def _forget_servers() -> None:
    """Leave the port and the browsers to the parent of a forked process; otherwise they would outlive the parent."""
    for server in tuple(_servers):
        server.forget()


def _end_pages() -> None:
    """Inform the browsers that the program ends, as after `LivePage.close`."""
    for server in tuple(_servers):
        server.close()


atexit.register(_end_pages)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_servers)
