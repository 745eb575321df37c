"""The view's server, by a real websocket: pixels to the bit, and nothing for whoever has no token."""

from __future__ import annotations

import argparse
import json
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from patience import WAIT_S, wait_until
from watching import Page, bucket, fetch, frame, watch

from wdpm.cluster.display import SlaveSeen
from wdpm.images.image import Image, load
from wdpm.scenes.errors import SettingsError
from wdpm.view import server
from wdpm.view.address import ViewAddress, view_address
from wdpm.view.live import LiveView

pytestmark = [pytest.mark.sockets, pytest.mark.processes]


class Stops:
    """Counts how often a page stopped the render."""

    count = 0

    def __call__(self) -> None:
        self.count += 1


@pytest.fixture
def stops() -> Stops:
    return Stops()


@pytest.fixture
def view(stops: Stops) -> Iterator[LiveView]:
    view = LiveView(ViewAddress(), "a box", passes=True, stop=stops)
    yield view
    view.close("done")


def want(*layers: tuple[str, str]) -> dict[str, object]:
    return {"kind": "want", "layers": [list(layer) for layer in layers]}


def test_a_page_that_comes_late_sees_all_and_then_what_changes(view: LiveView) -> None:
    view.begin(frame(300, 20))
    view.bucket(bucket(0, 0, 300, 10, 0.5))

    async def look(page: Page) -> None:
        await page.until(lambda: bool(page.status))
        assert page.status["pictures"] == {"a": {"image": 1, "width": 300, "height": 20, "layers": ["beauty", "cell"]}}
        assert [slave["cells"] for slave in page.status["slaves"]] == [[0], [1]]
        await page.socket.send_json(want(("a", "beauty")))
        await page.until(lambda: ("a", "beauty") in page.layers and not np.isnan(page.layers["a", "beauty"]).any())
        np.testing.assert_array_equal(page.layers["a", "beauty"][:10], bucket(0, 0, 300, 10, 0.5).layers["beauty"])
        view.bucket(bucket(0, 10, 300, 10, 0.25))
        await page.until(lambda: page.layers["a", "beauty"][19, 299, 2] == 0.25)
        np.testing.assert_array_equal(page.layers["a", "beauty"][10:], bucket(0, 10, 300, 10, 0.25).layers["beauty"])
        assert ("a", "cell") not in page.layers

    watch(view.url, look)


def test_a_page_hears_how_it_ends_and_has_the_last_pixels(view: LiveView, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "FAREWELL_S", WAIT_S)
    view.begin(frame(32, 8))

    async def look(page: Page) -> None:
        await page.until(lambda: bool(page.status))
        await page.socket.send_json(want(("a", "beauty")))
        await page.until(lambda: ("a", "beauty") in page.layers)
        view.bucket(bucket(0, 0, 32, 8, 2.0))
        shutting = threading.Thread(target=view.close, args=("stopped",))
        shutting.start()
        await page.until(lambda: page.status["ended"] == "stopped")
        assert page.layers["a", "beauty"][7, 31, 2] == 2.0
        shutting.join()

    watch(view.url, look)


def test_a_browser_that_goes_is_not_missed(view: LiveView) -> None:
    view.begin(frame(64, 64))

    async def leave(page: Page) -> None:
        await page.until(lambda: bool(page.status))
        await page.socket.send_json(want(("a", "beauty")))

    watch(view.url, leave)
    wait_until(lambda: not view._server.watched, "its end", lambda: view.bucket(bucket(0, 0, 64, 64, 1.0)))


def test_browsers_that_take_nothing_do_not_hold_up_the_end(view: LiveView, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tabs that sleep: the system still has their connections, and nobody reads what comes."""
    monkeypatch.setattr(server, "FAREWELL_S", 0.2)
    view.begin(frame(1024, 1024))
    view.bucket(bucket(0, 0, 1024, 1024, 0.5))
    with ExitStack() as stack:
        for _ in range(3):
            stack.enter_context(asleep(view.url))
        wait_until(lambda: len(view._server._viewers) == 3, "the pages")
        closing = threading.Thread(target=view.close, args=("done",))
        closing.start()
        closing.join(WAIT_S)
        assert not closing.is_alive()


def asleep(url: str) -> socket.socket:
    """A browser that asks for an image, and reads no more."""
    place = urlsplit(url)
    browser = socket.socket()
    browser.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    browser.connect((place.hostname, place.port))
    browser.sendall(
        f"GET {place.path}socket HTTP/1.1\r\nHost: {place.netloc}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
    )
    assert b" 101 " in browser.recv(64)
    asked = json.dumps(want(("a", "beauty"))).encode()
    assert len(asked) < 126
    browser.sendall(bytes([0x81, 0x80 | len(asked), 0, 0, 0, 0]) + asked)  # a text, masked by zeros
    return browser


def test_what_a_page_asks_for_is_done(view: LiveView, stops: Stops) -> None:
    async def ask(page: Page) -> None:
        await page.socket.send_json({"kind": "enough"})
        await page.until(lambda: page.status.get("enough", False))
        assert stops.count == 0
        await page.socket.send_json({"kind": "stop"})
        await page.until(lambda: "stopped from the page" in page.status["notes"])

    watch(view.url, ask)
    assert view.enough
    assert stops.count == 1


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        ("{", "no JSON"),
        ("[1]", "no object"),
        ('{"kind": "shout"}', "unknown kind of message 'shout': expected want, stop, enough"),
        ('{"kind": "want", "layers": [["a"]]}', "no list of"),
        ('{"kind": "want", "layers": [["z", "beauty"]]}', "no picture 'z'"),
    ],
)
def test_nonsense_is_refused_in_a_line(view: LiveView, stops: Stops, message: str, reason: str) -> None:
    async def ask(page: Page) -> None:
        await page.socket.send_str(message)
        await page.until(lambda: bool(page.refused))
        assert reason in page.refused[0]

    watch(view.url, ask)
    assert (stops.count, view.enough) == (0, False)


@pytest.mark.parametrize("path", ["", "wrong/", "wrong/socket", "main.js", "../", "wrong/now.exr"])
def test_without_the_token_there_is_nothing(view: LiveView, path: str) -> None:
    root = view.url.rsplit("/", 2)[0]
    status, body, _ = fetch(f"{root}/{path}")
    assert status == 403
    assert body == b"wrong address: open the whole one that wdpm printed, token included\n"


def test_the_last_slash_of_the_address_may_be_missing(view: LiveView) -> None:
    assert fetch(view.url.removesuffix("/"))[:2] == fetch(view.url)[:2]


def test_pages_of_other_sites_may_not_look(view: LiveView) -> None:
    assert fetch(view.url + "now.exr", Origin="http://elsewhere.example")[0] == 403


def test_the_page_needs_nothing_from_elsewhere(view: LiveView) -> None:
    for name in ("", "main.js", "pixels.js", "stage.js", "panel.js", "view.css"):
        status, body, headers = fetch(view.url + name)
        assert status == 200
        assert b"//cdn" not in body
        assert b"https://" not in body
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert headers["Referrer-Policy"] == "no-referrer"
    assert fetch(view.url + "../../etc/passwd")[0] == 403
    assert fetch(view.url + "other.js")[0] == 404


def test_what_is_shown_can_be_saved(view: LiveView, tmp_path: Path) -> None:
    assert fetch(view.url + "now.exr")[0] == 409
    view.begin(frame(32, 8))
    view.bucket(bucket(0, 0, 32, 8, 2.0))
    status, body, _ = fetch(view.url + "now.exr")
    assert status == 200
    file = tmp_path / "now.exr"
    file.write_bytes(body)
    np.testing.assert_array_equal(load(file).pixels, bucket(0, 0, 32, 8, 2.0).layers["beauty"])


def test_another_image_can_be_compared(stops: Stops) -> None:
    other = Image({"beauty": np.full((4, 6, 3), 0.5, np.float32)})
    view = LiveView(ViewAddress(), "a box", beside=other, stop=stops)

    async def look(page: Page) -> None:
        await page.until(lambda: bool(page.status))
        assert page.status["pictures"]["b"]["layers"] == ["beauty"]
        await page.socket.send_json(want(("b", "beauty")))
        await page.until(lambda: ("b", "beauty") in page.layers)
        np.testing.assert_array_equal(page.layers["b", "beauty"], other.pixels)

    try:
        watch(view.url, look)
    finally:
        view.close("done")


def test_a_port_that_is_taken_is_one_line(view: LiveView) -> None:
    with pytest.raises(SettingsError, match="the port is taken; give another by --view-at HOST:PORT") as caught:
        LiveView(view._server.address, "another")
    assert "\n" not in str(caught.value)


def test_an_address_of_nobody_is_told_without_python_s_words_for_it() -> None:
    with pytest.raises(
        SettingsError, match=r"cannot listen at 192\.0\.2\.1:7118: cannot assign requested address; give"
    ):
        LiveView(ViewAddress("192.0.2.1", 7118), "elsewhere")


def test_addresses() -> None:
    assert view_address("7118") == ViewAddress("127.0.0.1", 7118)
    assert view_address("[::1]:0") == ViewAddress("::1", 0)
    assert view_address("[::1]:0").url("t") == "http://[::1]:0/t/"
    assert [view_address(text).is_loopback for text in ("localhost:1", "127.0.0.2:1", "0.0.0.0:1", "host:1")] == [
        True,
        True,
        False,
        False,
    ]
    for name in ("a..b:1", "x" * 70 + ":1"):  # as no name service can be asked for them
        with pytest.raises(argparse.ArgumentTypeError, match="can be no name of a machine"):
            view_address(name)


class SlowMean:
    """A mean whose error takes a while to work out."""

    spp = 4

    def __init__(self) -> None:
        self.asked = 0

    def layers(self) -> dict[str, np.ndarray]:
        return {"noise": np.zeros((8, 32, 3), np.float32)}

    def relative_error(self) -> tuple[float, float, float]:
        self.asked += 1
        time.sleep(0.02)
        return 0.5, 0.25, 1.0


def test_the_error_is_worked_out_no_more_often_than_costs_allow(view: LiveView) -> None:
    mean = SlowMean()
    view.begin(frame(32, 8))
    for _ in range(100):
        view.pass_done(mean)
    assert mean.asked == 1
    assert "noise" in view._picture.layers
    assert view._state()["errors"][0][1:] == [4.0, 0.5, 0.25, 1.0]


def test_a_page_tells_who_holds_what_and_who_is_lost(view: LiveView) -> None:
    """A slave that joins in the middle of a frame is known as soon as it brings a bucket."""
    view.begin(frame(300, 20))
    view.slaves(
        [
            SlaveSeen("here, process 1", 4, True, False, 2**30, 1.5, 10.0, 20.0),
            SlaveSeen("there, process 2", 0, False, True),
        ]
    )
    view.bucket(replace(bucket(0, 0, 300, 10, 0.5), slave=2))
    view.end([{"slave": 2, "busy_s": 3.0}])

    async def look(page: Page) -> None:
        await page.until(lambda: bool(page.status))
        here, there, late = page.status["slaves"]
        assert (here["cells"], here["holds"], here["whole"], here["lost"]) == ([0], 4, True, False)
        assert here["now"] == {"memory": 2**30, "cores": 1.5, "sent": 10.0, "received": 20.0}
        assert (there["lost"], there["now"]) == (True, None)
        assert (late["name"], late["buckets"], late["figures"]) == ("slave 2", 1, {"busy_s": 3.0})

    watch(view.url, look)
