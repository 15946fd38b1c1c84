"""One page that a server shows to any number of browsers: its content, and messages from the browsers.

Following the page or acting on it requires its token. The token is embedded in the page, which other websites cannot
read: the server rejects host names other than this machine's, and browsers isolate pages of different origins.
"""

from __future__ import annotations

import asyncio
import json
import logging
import secrets
import threading
from collections.abc import Callable
from time import monotonic
from typing import Any, NamedTuple

from tornado.web import HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from rr1plan.errors import InputError
from rr1plan.playback.viewer.page_arrays import plain_value
from rr1plan.thread_locks import per_process

logger = logging.getLogger(__name__)

_LONGEST_MESSAGE = 10_000  # from a page
_PROTOCOL = "rr1plan"  # the WebSocket subprotocol by which pages recognize this server; also in page/live.js


class LiveAccess(NamedTuple):
    """How a page connects to the program that it follows.

    Args:
        token: The page's token.
        version: Version of the document in the page, by which the server recognizes outdated pages.
        address: Address of the server of its updates; None: the server of the page itself.
    """

    token: str
    version: int
    address: str | None = None


class LivePage:
    """The content of a page, and the browsers that show it. `PageServer.add` creates one.

    Args:
        url: Address of the page, which ends in "/".
        html: Returns the text of the page for a given access.
        hear: Called with messages from browsers, parsed from JSON.
        run: Calls a function in the thread of the server; raises `InputError` if that thread has ended.
        end: Removes the page from its server.
    """

    def __init__(
        self,
        url: str,
        html: Callable[[LiveAccess], str],
        hear: Callable[[object], None] | None,
        run: Callable[[Callable[[], Any]], None],
        end: Callable[[], None],
    ) -> None:
        self.url = url
        self.token = secrets.token_urlsafe(16)
        self.close = end
        self._html = html
        self._hear = hear
        self._run = run
        self._clients: set[UpdatesHandler] = set()
        self.visits = 0  # browsers that have opened the page so far
        self.last_sign = 0.0  # [s] of the monotonic clock: last request for the page, or last disconnection
        self._lock = per_process(self, "_lock", threading.Lock)
        self._version = 0
        self._document = ""
        self._panels: dict[str, dict[str, object]] = {}  # updates of panels since the document was set
        self._frame: bytes | None = None
        self._commands: dict[str, str] = {}  # the latest ones of each kind, in order, since the document was set
        self._count = 0  # of all commands

    @property
    def pages(self) -> int:
        """Number of connected browsers."""
        return len(self._clients)

    def access(self, *, from_elsewhere: bool = False) -> LiveAccess:
        """The access of a page generated now, by the server or elsewhere, e.g. in a notebook."""
        address = self.url.replace("http", "ws", 1) + "updates" if from_elsewhere else None
        return LiveAccess(self.token, self._version, address)

    # ---- called by the program -----------------------------------------------------------

    def set_document(self, document: dict[str, Any]) -> None:
        """Replace what the page shows."""
        with self._lock:
            self._version += 1
            self._frame = None
            self._commands = {kind: text for kind, text in self._commands.items() if kind == "speed"}
            message = {"type": "document", "version": self._version, "value": document}
            self._document = text = json.dumps(message, allow_nan=False, default=plain_value)
            for name in document.get("panels", ()):  # new data, which earlier updates do not concern
                self._panels.pop(name, None)
        self._run(lambda: self.tell(text))

    def set_frame(self, frame: bytes) -> None:
        """Show a configuration (float64, little endian)."""
        with self._lock:
            self._frame = frame
        self._run(self._spread)

    def update_panel(self, name: str, data: dict[str, Any]) -> None:
        """Put new entries into the data of a panel, also on pages that are opened later.

        Raises:
            InputError: data that JSON cannot represent.
        """
        try:
            text = _panels_message({name: data})
        except (TypeError, ValueError, RecursionError) as error:
            raise InputError(f"the page cannot hold this data: {error}") from error
        with self._lock:
            self._panels.setdefault(name, {}).update(json.loads(text)["value"][name])
        self._run(lambda: self.tell(text))

    def command(self, name: str, value: float | None = None) -> None:
        """Play, pause, seek or change the speed in all browsers, also in those that open the page later."""
        kind = "run" if name in ("play", "pause") else name
        with self._lock:
            self._frame = None
            self._count += 1
            text = json.dumps({"type": name, "value": value, "count": self._count}, allow_nan=False)
            self._commands.pop(kind, None)
            self._commands[kind] = text
        self._run(lambda: self.tell(text))

    # ---- in the server's thread ----------------------------------------------------------

    def tell(self, text: str) -> None:
        """Send a message to all browsers."""
        for client in tuple(self._clients):
            client.tell(text)

    def _spread(self) -> None:
        for client in tuple(self._clients):
            client.spread()

    def end(self) -> None:
        """Close the connections to all browsers."""
        self.tell(json.dumps({"type": "end"}))
        for client in tuple(self._clients):
            client.close()

    def html(self) -> str:
        """The current text of the page."""
        text = self._html(self.access())
        self.last_sign = monotonic()
        return text

    def knows(self, token: str) -> bool:
        """Whether a token is valid for this page."""
        return secrets.compare_digest(token.encode(), self.token.encode())

    def welcome(self, client: UpdatesHandler, version: str, count: str) -> None:
        """Connect a browser: it gets the document if it has an older one, data of panels, commands and configuration.

        Args:
            client: The browser.
            version: The version of its document.
            count: Number of the latest command that it knows; if there are no newer ones, none is repeated.
        """
        self._clients.add(client)
        self.visits += 1
        with self._lock:
            late = version != str(self._version)
            document, frame = self._document, self._frame
            panels = _panels_message(self._panels) if self._panels else None
            commands = [] if count == str(self._count) else list(self._commands.values())
        if late:
            client.tell(document)
        if panels is not None:
            client.tell(panels)
        for command in commands:
            client.tell(command)
        if frame is not None:
            client.spread()

    def dismiss(self, client: UpdatesHandler) -> None:
        """Forget a browser."""
        if client in self._clients:
            self._clients.discard(client)
            self.last_sign = monotonic()

    def newest(self) -> bytes | None:
        """The configuration to show now."""
        with self._lock:
            return self._frame

    def hear(self, message: str | bytes) -> None:
        """Pass on a browser's message; unreadable messages are logged."""
        if self._hear is None:
            return
        try:
            self._hear(json.loads(message[:_LONGEST_MESSAGE]))
        except Exception:  # a user's callback must not end the server
            logger.exception("a message of a page could not be handled")


def _panels_message(panels: dict[str, dict[str, Any]]) -> str:
    return json.dumps({"type": "panels", "value": panels}, allow_nan=False, default=plain_value)


class PageHandler(RequestHandler):
    """The page itself."""

    def initialize(self, find: Callable[[str, str | None], LivePage | None]) -> None:
        """Take the function that finds a page by the host of a request and its number."""
        self.find = find

    def get(self, number: str | None = None) -> None:
        """Send the page, with headers that forbid other websites to frame or read it."""
        page = self.find(self.request.host, number)
        if page is None:
            raise HTTPError(404)
        self.set_header("Cache-Control", "no-store")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Referrer-Policy", "no-referrer")
        self.set_header("Cross-Origin-Resource-Policy", "same-origin")
        self.set_header("Content-Security-Policy", "frame-ancestors 'none'")
        self.finish(page.html())


class UpdatesHandler(WebSocketHandler):
    """Messages to and from one browser."""

    def initialize(self, find: Callable[[str, str | None], LivePage | None]) -> None:
        """Take the function that finds a page by the host of a request and its number."""
        self.find = find
        self.sending = False
        self.wanted = False

    def prepare(self) -> None:
        """Find the page; a browser of another origin needs its token."""
        page = self.find(self.request.host, self.path_args[0])
        if page is None:
            raise HTTPError(404)
        self.page = page
        self.trusted = page.knows(self.get_query_argument("token", ""))

    def check_origin(self, origin: str) -> bool:
        """Accept pages of this server, and others that have the token, e.g. in a notebook."""
        return self.trusted or origin == f"http://{self.request.host}"

    def select_subprotocol(self, subprotocols: list[str]) -> str | None:
        """Select the protocol of pages; browsers reject servers that do not."""
        return _PROTOCOL if _PROTOCOL in subprotocols else None

    def open(self, *_args: str, **_kwargs: str) -> None:
        """Connect the browser; one that shows a page of an earlier program has to reload."""
        if self.trusted:
            self.page.welcome(self, *(self.get_query_argument(name, "") for name in ("version", "count")))
        else:
            self.tell(json.dumps({"type": "reload"}))
            self.close()

    def on_message(self, message: str | bytes) -> None:
        """Pass on a message of the browser."""
        if self.trusted:
            self.page.hear(message)

    def on_pong(self, data: bytes) -> None:
        """Give the page a sign of life, as it does not learn of the pings that its browser answers."""
        self.tell("")

    def on_close(self) -> None:
        """Forget the browser."""
        self.page.dismiss(self)

    def tell(self, text: str) -> None:
        """Send a message."""
        try:
            self.write_message(text)
        except WebSocketClosedError:
            self.page.dismiss(self)

    def spread(self) -> None:
        """Send the latest configuration, now or when the previous one has been delivered."""
        self.wanted = True
        if not self.sending:
            self.sending = True
            asyncio.get_running_loop().create_task(self._send())

    async def _send(self) -> None:
        try:
            while self.wanted:
                self.wanted = False
                frame = self.page.newest()
                if frame is not None:
                    await self.write_message(frame, binary=True)
        except WebSocketClosedError:
            self.page.dismiss(self)
        finally:
            self.sending = False
