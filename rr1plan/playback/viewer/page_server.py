"""A small web server of our own, in a thread, that only this machine can reach.

It never speaks to anything but pages it served itself: it listens on 127.0.0.1, refuses a Host
that is not that address (a foreign name that resolves here), and a websocket from another
origin. A page that reads slowly gets the newest configuration and misses older ones.
"""

from __future__ import annotations

import asyncio
import json
import logging
import os
import socket
import threading
from collections.abc import Callable
from time import monotonic
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from rr1plan.checks import whole_number
from rr1plan.errors import BackendError, InputError

logger = logging.getLogger(__name__)

_ADDRESS = "127.0.0.1"
_FIRST_PORT = 7000
_PORTS_TRIED = 50
_PATIENCE = 5.0  # [s] for the thread to start or end
_LONGEST_MESSAGE = 10_000  # of a page


class PageServer:
    """Serves one page and tells all who look at it what changed.

    Args:
        page: Called with the document's version; gives the HTML.
        port: First port to try; the next free one is taken. None: 7000.
        hear: Called with what a page has sent, as parsed from JSON.

    Raises:
        InputError: an invalid port.
        BackendError: no free port.
    """

    def __init__(
        self, page: Callable[[int], str], port: int | None = None, hear: Callable[[object], None] | None = None
    ) -> None:
        self._page = page
        self._hear = hear
        self.listener, self.port = _bind(_FIRST_PORT if port is None else port)
        self._hosts = {f"{name}:{self.port}" for name in (_ADDRESS, "localhost")}
        self._clients: set[_Updates] = set()
        self.visits = 0  # pages that have been opened so far
        self.last_sign = 0.0  # [s] of the monotonic clock, when a page was last asked for or went away
        self._loop = asyncio.new_event_loop()
        self._started = threading.Event()
        self._lock = threading.Lock()
        self._version = 0
        self._document = ""
        self._frame: bytes | None = None
        self._thread = threading.Thread(target=self._run, name=f"rr1plan-page-{self.port}", daemon=True)
        self._thread.start()
        self._started.wait(_PATIENCE)

    @property
    def url(self) -> str:
        """Address of the page, for browsers of this machine."""
        return f"http://{_ADDRESS}:{self.port}/"

    @property
    def pages(self) -> int:
        """Number of connected pages."""
        return len(self._clients)

    @property
    def running(self) -> bool:
        """The server answers."""
        return self._thread.is_alive()

    def set_document(self, document: dict[str, Any]) -> None:
        """Replace what the pages show."""
        with self._lock:
            self._version += 1
            self._frame = None
            message = {"type": "document", "version": self._version, "value": document}
            self._document = json.dumps(message, allow_nan=False)
            text = self._document
        self._in_thread(lambda: self._tell(text))

    def set_frame(self, frame: bytes) -> None:
        """Show a configuration (float64, little endian) on all pages."""
        with self._lock:
            self._frame = frame
        self._in_thread(self._spread)

    def update_panel(self, name: str, data: dict[str, Any]) -> None:
        """Put new entries into the data of a panel of all pages.

        Raises:
            InputError: data that JSON cannot hold.
        """
        try:
            text = json.dumps({"type": "panels", "value": {name: data}}, allow_nan=False)
        except (TypeError, ValueError, RecursionError) as error:
            raise InputError(f"the page cannot hold this data: {error}") from error
        self._in_thread(lambda: self._tell(text))

    def hear(self, message: str | bytes) -> None:
        """Pass on what a page has sent; what cannot be read is logged."""
        if self._hear is None:
            return
        try:
            self._hear(json.loads(message[:_LONGEST_MESSAGE]))
        except Exception:  # a callback of the caller's own must not end the server
            logger.exception("a message of a page could not be handled")

    def command(self, name: str, value: float | None = None) -> None:
        """Tell all pages to play, pause, seek or change speed."""
        with self._lock:
            self._frame = None
        self._in_thread(lambda: self._tell(json.dumps({"type": name, "value": value})))

    def close(self) -> None:
        """Say goodbye to the pages and end the thread; more than once is fine."""
        if self._thread.is_alive():
            self._in_thread(lambda: self._loop.create_task(self._end()))
            self._thread.join(_PATIENCE)

    # ---- in the server's thread --------------------------------------------------------

    def _in_thread(self, act: Callable[[], Any]) -> None:
        try:
            self._loop.call_soon_threadsafe(act)
        except RuntimeError as error:
            raise InputError("the viewer is closed; call show again") from error

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        routes = [("/", _Page, {"server": self}), ("/updates", _Updates, {"server": self})]
        application = Application(routes, log_function=_log, websocket_ping_interval=20)
        self._http = HTTPServer(application)
        self._http.add_socket(self.listener)
        self._loop.call_soon(self._started.set)
        try:
            self._loop.run_forever()
        finally:
            self._loop.close()

    async def _end(self) -> None:
        self._tell(json.dumps({"type": "end"}))
        self._http.stop()
        for client in tuple(self._clients):
            client.close()
        await asyncio.wait_for(self._http.close_all_connections(), _PATIENCE / 2)
        await self._loop.shutdown_asyncgens()
        others = [task for task in asyncio.all_tasks(self._loop) if task is not asyncio.current_task()]
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)
        self._loop.stop()

    def _tell(self, text: str) -> None:
        for client in tuple(self._clients):
            client.tell(text)

    def _spread(self) -> None:
        for client in tuple(self._clients):
            client.spread()

    def html(self) -> str:
        """The page as it is now."""
        text = self._page(self._version)
        self.last_sign = monotonic()
        return text

    def check_host(self, host: str) -> bool:
        """Whether a request was meant for this server."""
        return host in self._hosts

    def welcome(self, client: _Updates, version: str) -> None:
        """Take in a page: it gets the document if it has an older one, and the newest configuration."""
        self._clients.add(client)
        self.visits += 1
        with self._lock:
            late = version != str(self._version)
            document, frame = self._document, self._frame
        if late:
            client.tell(document)
        if frame is not None:
            client.spread()

    def dismiss(self, client: _Updates) -> None:
        """Forget a page."""
        self._clients.discard(client)
        self.last_sign = monotonic()

    def newest(self) -> bytes | None:
        """The configuration to show now."""
        with self._lock:
            return self._frame


class _Page(RequestHandler):
    """The page itself."""

    def initialize(self, server: PageServer) -> None:
        self.server = server

    def prepare(self) -> None:
        if not self.server.check_host(self.request.host):
            raise HTTPError(403)

    def get(self) -> None:
        self.set_header("Cache-Control", "no-store")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Referrer-Policy", "no-referrer")
        self.finish(self.server.html())


class _Updates(WebSocketHandler):
    """Messages to one page."""

    def initialize(self, server: PageServer) -> None:
        self.server = server
        self.sending = False
        self.wanted = False

    def prepare(self) -> None:
        if not self.server.check_host(self.request.host):
            raise HTTPError(403)

    def check_origin(self, origin: str) -> bool:
        return origin.startswith("http://") and self.server.check_host(origin.removeprefix("http://"))

    def open(self, *_args: str, **_kwargs: str) -> None:
        self.server.welcome(self, self.get_query_argument("version", ""))

    def on_message(self, message: str | bytes) -> None:
        """A page has sent something."""
        self.server.hear(message)

    def on_close(self) -> None:
        self.server.dismiss(self)

    def tell(self, text: str) -> None:
        try:
            self.write_message(text)
        except WebSocketClosedError:
            self.server.dismiss(self)

    def spread(self) -> None:
        """Send the newest configuration, now or when the one on its way has arrived."""
        self.wanted = True
        if not self.sending:
            self.sending = True
            asyncio.get_running_loop().create_task(self._send())

    async def _send(self) -> None:
        try:
            while self.wanted:
                self.wanted = False
                frame = self.server.newest()
                if frame is not None:
                    await self.write_message(frame, binary=True)
        except WebSocketClosedError:
            self.server.dismiss(self)
        finally:
            self.sending = False


def _bind(port: int) -> tuple[socket.socket, int]:
    whole_number("port", port, 0, 65535)
    for candidate in [0] if port == 0 else [*range(port, min(port + _PORTS_TRIED, 65536)), 0]:
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            if os.name == "posix":  # elsewhere it would let two servers share a port
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
