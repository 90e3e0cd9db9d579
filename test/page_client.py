"""A page without a browser: a client of its WebSocket."""

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from tornado.httpclient import HTTPRequest
from tornado.websocket import WebSocketClientConnection, websocket_connect


async def said(connection: WebSocketClientConnection) -> dict[str, Any] | None:
    """Return the next message; None: the socket is closed."""
    text = await asyncio.wait_for(connection.read_message(), 120.0)
    connection.ended = text is None  # nothing comes after it, and who reads on waits for ever
    return None if text is None else json.loads(text)


@asynccontextmanager
async def visited(address: str, **headers: str) -> AsyncIterator[WebSocketClientConnection]:
    """Yield the socket of the page at an address, closed at the end."""
    connection = await websocket_connect(HTTPRequest(address.replace("http", "ws", 1) + "socket", headers=headers))
    connection.ended = False
    try:
        yield connection
    finally:
        connection.close()
        while not connection.ended:  # what is still on its way, up to the server's close
            await said(connection)
