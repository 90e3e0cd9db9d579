"""The server of the page: who reaches it, and what it passes on."""

import asyncio
import queue
import socket
from collections.abc import Iterator
from contextlib import closing
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import pytest
from page_client import said, visited
from tornado.httpclient import AsyncHTTPClient, HTTPClientError, HTTPRequest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.drive.server import LARGEST_MESSAGE, Server


@pytest.fixture
def heard() -> "queue.Queue[dict[str, Any] | None]":
    return queue.Queue()


@pytest.fixture
def server(tmp_path: Path, heard: "queue.Queue[Any]") -> Iterator[Server]:
    (tmp_path / "report.html").write_text("the report")
    (tmp_path / "exam.json").write_text("{}")
    (tmp_path / "secret.html").write_text("not linked")
    with closing(Server("<p>page", tmp_path, heard.put)) as server:
        yield server


def got(address: str, **headers: str) -> int | str:
    """Return the body of a page, or the status that refuses it."""

    async def fetch() -> int | str:
        try:
            answer = await AsyncHTTPClient().fetch(HTTPRequest(address, headers=headers, follow_redirects=False))
        except HTTPClientError as error:
            return error.code
        return answer.body.decode()

    return asyncio.run(fetch())


def test_nothing_is_reachable_without_the_secret_and_nothing_but_the_page_and_its_links_with_it(server: Server) -> None:
    assert got(server.address) == "<p>page"
    assert got(f"{server.address}report.html") == "the report"
    root = server.address.removesuffix("/").rpartition("/")[0]
    others = ["/", "/report.html", "/socket", "/wrong/", "/wrong/report.html"]
    assert {path: got(f"{root}{path}") for path in others} == dict.fromkeys(others, 404)
    hidden = ["exam.json", "secret.html", "replays/../exam.json", "%2e%2e/exam.json", "view.html", ""][:-1]
    assert {name: got(f"{server.address}{name}") for name in hidden} == dict.fromkeys(hidden, 404)


def test_a_refused_request_is_not_logged_with_the_secret(server: Server, caplog: pytest.LogCaptureFixture) -> None:
    assert got(f"{server.address}replays/../exam.json") == 404
    assert caplog.text == ""


def test_another_name_of_the_host_is_refused_so_that_no_page_of_the_web_gets_in(server: Server) -> None:
    port = server.address.split(":")[2].split("/")[0]
    assert got(server.address, Host=f"localhost:{port}") == "<p>page"
    assert got(server.address, Host=f"evil.example:{port}") == 404
    assert got(server.address, Host="127.0.0.1") == 404


def test_a_socket_of_another_origin_is_refused(server: Server) -> None:
    async def connect(origin: str) -> None:
        async with visited(server.address, Origin=origin):
            pass

    own = server.address.rpartition("/")[0].rpartition("/")[0]
    asyncio.run(connect(own))
    for origin in ("http://evil.example", "http://127.0.0.1:1", "null"):
        with pytest.raises(HTTPClientError, match="403"):
            asyncio.run(connect(origin))


def test_it_listens_on_the_loopback_alone_and_a_taken_port_is_refused(server: Server, tmp_path: Path) -> None:
    assert server.address.startswith("http://127.0.0.1:")
    port = int(server.address.split(":")[2].split("/")[0])
    socket.create_server(("127.0.0.2", port)).close()  # taken where a server listens on every address
    with pytest.raises(InvalidInput, match=f"port {port} of this machine: .*; choose another, or 0"):
        Server("", tmp_path, print, port)


def test_messages_arrive_on_both_sides_and_a_page_that_comes_later_gets_the_latest(
    server: Server, heard: "queue.Queue[Any]"
) -> None:
    async def talk() -> list[Any]:
        async with visited(server.address) as first, visited(server.address) as second:
            assert await said(first) is None, "one page at a time: the newest"
            await second.write_message('{"ready": true}')
            server.send("frame", time=1.0, curvttc=float("inf"), people=[(1.0, float("nan"))])
            found = [await said(second)]
            server.send("result", outcome="goal")
            server.send("episode", name="1:1")
            server.send("frame", time=0.0)
            found += [await said(second) for _ in range(3)]
        async with visited(server.address) as later:
            return [*found, await said(later), await said(later)]

    found = asyncio.run(talk())
    assert found[0] == {"type": "frame", "time": 1.0, "curvttc": None, "people": [[1.0, None]]}
    assert [each["type"] for each in found] == ["frame", "result", "episode", "frame", "episode", "frame"]
    assert heard.get(timeout=30.0) == {"ready": True}
    assert [heard.get(timeout=30.0) for _ in range(2)] == [None, None], "a page is closed; one that is replaced is not"


@pytest.mark.parametrize(("length", "status"), [(LARGEST_MESSAGE, 404), (LARGEST_MESSAGE + 1, 400)])
def test_a_request_with_a_longer_body_than_a_message_is_refused_before_the_body_is_read(
    server: Server, length: int, status: int
) -> None:
    host, path = server.address.removeprefix("http://").split("/", 1)
    connection = HTTPConnection(host, timeout=60.0)
    connection.putrequest("POST", f"/{path}none")
    connection.putheader("Content-Length", str(length))
    connection.endheaders(b"x" * length if status == 404 else None)
    assert connection.getresponse().status == status
    connection.close()


@pytest.mark.parametrize("text", ["no JSON", "[1]", "[" * 4000, "x" * (LARGEST_MESSAGE + 1)])
def test_a_page_that_says_what_is_no_message_is_shut_out_and_the_server_lives(
    server: Server, heard: "queue.Queue[Any]", text: str
) -> None:
    async def talk() -> None:
        async with visited(server.address) as connection:
            await connection.write_message(text)
            assert await said(connection) is None

    asyncio.run(talk())
    assert heard.get(timeout=30.0) is None
    assert got(server.address) == "<p>page"
