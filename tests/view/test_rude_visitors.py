"""Visitors who speak no HTTP, or are gone at once: no traceback of them comes between the lines of a render."""

from __future__ import annotations

import contextlib
import logging
import socket
import struct
import time
from collections.abc import Iterator
from urllib.parse import urlsplit

import pytest
from patience import WAIT_S, wait_until
from watching import Page, bucket, fetch, frame, watch

from wdpm.view import server
from wdpm.view.address import ViewAddress
from wdpm.view.live import LiveView

pytestmark = [pytest.mark.sockets, pytest.mark.processes]

OPENING = (
    "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
    "Sec-WebSocket-Version: 13\r\n"
)


@pytest.fixture
def view(caplog: pytest.LogCaptureFixture) -> Iterator[LiveView]:
    caplog.set_level(logging.INFO)
    view = LiveView(ViewAddress(), "a box", passes=True)
    view.begin(frame(32, 8))
    view.bucket(bucket(0, 0, 32, 8, 2.0))
    yield view
    view.close("done")
    assert not caplog.get_records("call")


def addressed(view: LiveView, request: bytes) -> bytes:
    place = urlsplit(view.url)
    return request.replace(b"PAGE", place.path.encode()).replace(b"HOST", place.netloc.encode())


def visit(view: LiveView, request: bytes) -> socket.socket:
    place = urlsplit(view.url)
    visitor = socket.create_connection((place.hostname, place.port), timeout=WAIT_S)
    visitor.sendall(addressed(view, request))
    return visitor


@pytest.mark.parametrize(
    ("request_line", "status"),
    [
        (b"OPTIONS * HTTP/1.1\r\nHost: HOST", 403),
        (b"CONNECT elsewhere.example:443 HTTP/1.1\r\nHost: elsewhere.example", 403),
        (b"GET /%ff%00 HTTP/1.1\r\nHost: HOST", 403),
        (b"GET / HTTP/1.1", 400),
        (b"GET nowhere HTTP/1.1\r\nHost: HOST", 400),
        (b"GET PAGE HTTP/1.1\r\nHost: HOST\r\nX-Long: " + b"x" * 100_000, 400),
        (b"POST PAGE HTTP/1.1\r\nHost: HOST\r\nContent-Length: 3\r\n\r\nabc", 405),
        (b"GET PAGEsocket HTTP/1.1\r\nHost: HOST", 400),
        (b"\x16\x03\x01\x02\x00\x01\x00", 400),  # a browser that tries https
    ],
    ids=lambda value: value[:20] if isinstance(value, bytes) else "",
)
def test_it_is_refused(view: LiveView, request_line: bytes, status: int) -> None:
    with visit(view, request_line + b"\r\n\r\n") as visitor:
        assert visitor.recv(16).split()[1] == str(status).encode()


@pytest.mark.parametrize("page", ["", "now.exr", "socket"])
def test_one_that_is_gone_at_once_is_not_missed(view: LiveView, page: str) -> None:
    request = f"GET PAGE{page} HTTP/1.1\r\nHost: HOST\r\n{OPENING if page == 'socket' else ''}\r\n".encode()
    for _ in range(5):
        visitors = [visit(view, b"") for _ in range(10)]
        view._server._loop.call_soon_threadsafe(time.sleep, 0.05)  # so that it finds them gone when it reads
        for visitor in visitors:
            visitor.sendall(addressed(view, request))
            # Closed without a goodbye: what is sent to it is an error.
            visitor.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            visitor.close()
    assert fetch(view.url)[0] == 200
    wait_until(lambda: not view._server.watched, "their end")


def test_brackets_without_end_are_no_json(view: LiveView) -> None:
    async def ask(page: Page) -> None:
        await page.socket.send_str("[" * 4000)
        await page.until(lambda: bool(page.refused))
        assert page.refused == ["a message is no JSON"]

    watch(view.url, ask)


def test_visitors_do_not_take_all_files_of_the_render(view: LiveView, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "most_connections", lambda: 3)
    visitors = []
    for number in range(6):
        visitors.append(visit(view, b""))
        wanted = min(number + 1, 3)
        wait_until(lambda wanted=wanted: len(view._server._runner.server.connections) == wanted, "the visitor")
    for visitor in visitors[3:]:
        with contextlib.suppress(ConnectionResetError):
            assert visitor.recv(1) == b""
    for visitor in visitors:
        visitor.close()
    wait_until(lambda: not view._server._runner.server.connections, "their end")
    assert fetch(view.url)[0] == 200
