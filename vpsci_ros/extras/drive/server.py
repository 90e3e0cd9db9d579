"""The page and its WebSocket, served to this machine alone at an address with a secret.

Bound to the loopback. Whatever does not name the secret in its path, or names another host (DNS rebinding), gets 404; a
WebSocket of another origin is refused. One page at a time: a second one takes the place of the first.
"""

import asyncio
import contextlib
import hmac
import json
import math
import secrets
import socket
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPServerRequest
from tornado.routing import Matcher, Rule
from tornado.web import Application, RequestHandler, StaticFileHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from vpsci_ros.errors import InvalidInput, VpsciError, in_words

LOOPBACK = "127.0.0.1"
FILES = r"((?:report|view|replays/[\w-]+)\.html)"  # of the exam's folder, that the page links to
LARGEST_MESSAGE = 4096  # [bytes] from the page
_KEPT = ("episode", "frame", "result", "end")  # types of message whose latest a page gets when it comes
_HEADERS = {"Referrer-Policy": "no-referrer", "X-Content-Type-Options": "nosniff", "X-Frame-Options": "DENY",
            "Cross-Origin-Resource-Policy": "same-origin", "Cache-Control": "no-store"}  # fmt: skip


class Server:
    """Serves a page in its own thread, until `close`.

    :param page: HTML.
    :param folder: in which the files lie that the page links to, see `FILES`.
    :param received: called with each message of the page, a dict, and with None when a page goes; in that thread.
    :param port: 0: a free one.
    :ivar address: of the page, with the secret.
    :raises InvalidInput: the port is not free.
    """

    def __init__(
        self, page: str, folder: Path, received: Callable[[dict[str, Any] | None], None], port: int = 0
    ) -> None:
        try:
            self._listening = socket.create_server((LOOPBACK, port))
        except OSError as error:
            raise InvalidInput(f"port {port} of this machine: {in_words(error)}; choose another, or 0") from None
        self._listening.setblocking(False)
        self._page, self._folder, self._received = page, folder, received
        self._secret, port = secrets.token_urlsafe(24), self._listening.getsockname()[1]
        self._hosts = [f"{name}:{port}" for name in (LOOPBACK, "localhost")]
        self.address = f"http://{self._hosts[0]}/{self._secret}/"
        self._socket: _Socket | None = None
        self._latest: dict[str, str] = {}
        self._loop = asyncio.new_event_loop()
        self._stop, started = asyncio.Event(), threading.Event()
        self._thread = threading.Thread(target=lambda: self._loop.run_until_complete(self._serve(started)), daemon=True)
        self._thread.start()
        if not started.wait(10.0):
            raise VpsciError("the server of the page has not started within 10 s")

    @property
    def visited(self) -> bool:
        """Whether the page is open."""
        return self._socket is not None

    def send(self, kind: str, **values: Any) -> None:
        """Send a message to the page if it is open; numbers that are not finite become null.

        A page that comes later gets the latest of each kind, and after an `episode` nothing from before it.
        """
        text = json.dumps({"type": kind} | {name: _finite(value) for name, value in values.items()}, allow_nan=False)
        self._loop.call_soon_threadsafe(self._send, kind, text)

    def close(self) -> None:
        """Stop the server."""
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(10.0)

    async def _serve(self, started: threading.Event) -> None:
        own = Application(
            [
                (r"/[^/]+/", _Index, {"page": self._page}),
                (r"/[^/]+/socket", _Socket, {"server": self}),
                (rf"/[^/]+/{FILES}", _File, {"path": str(self._folder)}),
            ],
            log_function=_unsaid,
            websocket_max_message_size=LARGEST_MESSAGE,
            websocket_ping_interval=5.0,
        )
        answers = Application([Rule(_Ours(self._secret, self._hosts), own)], log_function=_unsaid)
        server = HTTPServer(answers, max_body_size=LARGEST_MESSAGE)
        server.add_socket(self._listening)
        started.set()
        await self._stop.wait()
        server.stop()
        if self._socket is not None:
            self._socket.close()
        await server.close_all_connections()

    def _send(self, kind: str, text: str) -> None:
        if kind == "episode":
            self._latest = {}
        if kind in _KEPT:
            self._latest[kind] = text
        if self._socket is not None:
            self._socket.say(text)

    def came(self, socket: "_Socket") -> None:
        """Replace the socket of the page by a new one."""
        before, self._socket = self._socket, socket
        if before is not None:
            before.close(reason="the page was opened elsewhere")
        for kind in _KEPT:
            if kind in self._latest:
                socket.say(self._latest[kind])

    def heard(self, socket: "_Socket", text: str | bytes) -> None:
        """Handle a message of the page; close the socket if it is no JSON object."""
        try:
            message = json.loads(text)
        except (ValueError, RecursionError):
            message = None
        if not isinstance(message, dict):
            socket.close(reason="expected a JSON object")
        else:
            self._received(message)

    def went(self, socket: "_Socket") -> None:
        """Forget a socket that is closed."""
        if self._socket is socket:
            self._socket = None
            self._received(None)


def _unsaid(_: RequestHandler) -> None:
    """Log nothing of a request: its path has the secret."""


class _Ours(Matcher):
    """Matches requests that name the secret and this host."""

    def __init__(self, secret: str, hosts: list[str]) -> None:
        self._secret, self._hosts = secret.encode(), hosts

    def match(self, request: HTTPServerRequest) -> dict[str, Any] | None:
        given = request.path.split("/")[1].encode() if request.path.startswith("/") else b""
        return {} if hmac.compare_digest(given, self._secret) and request.host in self._hosts else None


class _Index(RequestHandler):
    def initialize(self, page: str) -> None:
        self._page = page

    def set_default_headers(self) -> None:
        for name, value in _HEADERS.items():
            self.set_header(name, value)

    def get(self) -> None:
        self.finish(self._page)


class _File(StaticFileHandler):
    def set_extra_headers(self, path: str) -> None:
        for name, value in _HEADERS.items():
            self.set_header(name, value)


class _Socket(WebSocketHandler):
    """The page's socket; tornado refuses those whose Origin is another than the Host, which `_Ours` has checked."""

    def initialize(self, server: Server) -> None:
        self._server = server

    def open(self, *args: str, **kwargs: str) -> None:
        self._server.came(self)

    def on_message(self, message: str | bytes) -> None:
        self._server.heard(self, message)

    def on_close(self) -> None:
        self._server.went(self)

    def say(self, text: str) -> None:
        with contextlib.suppress(WebSocketClosedError):  # `on_close` comes later
            self.write_message(text).add_done_callback(lambda done: done.cancelled() or done.exception())


def _finite(value: Any) -> Any:
    """Return a value as JSON has it: numbers that are not finite become None."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {name: _finite(each) for name, each in value.items()}
    return [_finite(each) for each in value] if isinstance(value, (list, tuple)) else value
