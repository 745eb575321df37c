"""A page without a browser: what it is sent, and frames to show."""

from __future__ import annotations

import asyncio
import json
import struct
from collections.abc import Awaitable, Callable
from typing import Any

import aiohttp
import numpy as np
from numpy.typing import NDArray
from patience import WAIT_S

from wdpm.cluster.display import Bucket, Frame


def read_tile(data: bytes) -> tuple[dict[str, Any], NDArray[np.float32]]:
    """Header and pixels of a binary message, as docs/view.md has it."""
    (length,) = struct.unpack("<I", data[:4])
    assert length % 4 == 0
    header = json.loads(data[4 : 4 + length])
    shape = (header["height"], header["width"], header["channels"])
    return header, np.frombuffer(data[4 + length :], "<f4").reshape(shape)


class Page:
    """A websocket to a view, and the layers that came over it.

    Attributes:
        status: the last that was told.
        refused: reasons of refusals.
        layers: (picture, layer) -> pixels, NaN where nothing came.
    """

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self.socket = socket
        self.status: dict[str, Any] = {}
        self.refused: list[str] = []
        self.layers: dict[tuple[str, str], NDArray[np.float32]] = {}

    async def until(self, condition: Callable[[], bool]) -> None:
        """Take in messages until something is so."""
        async with asyncio.timeout(WAIT_S):
            while not condition():
                message = await self.socket.receive()
                assert message.type in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY), message
                self._take(message)

    def _take(self, message: aiohttp.WSMessage) -> None:
        if message.type is aiohttp.WSMsgType.TEXT:
            told = json.loads(message.data)
            if told["kind"] == "status":
                self.status = told
            else:
                self.refused.append(told["reason"])
            return
        header, pixels = read_tile(message.data)
        size = self.status["pictures"][header["source"]]
        layer = self.layers.setdefault(
            (header["source"], header["layer"]),
            np.full((size["height"], size["width"], header["channels"]), np.nan, np.float32),
        )
        x, y = header["x"], header["y"]
        layer[y : y + header["height"], x : x + header["width"]] = pixels


def watch(url: str, do: Callable[[Page], Awaitable[None]]) -> None:
    """Open a page, and do something with it."""

    async def run() -> None:
        async with aiohttp.ClientSession() as session, session.ws_connect(url + "socket") as socket:
            await do(Page(socket))

    asyncio.run(run())


def fetch(url: str, **headers: str) -> tuple[int, bytes, dict[str, str]]:
    """Status, body and headers of an address."""

    async def run() -> tuple[int, bytes, dict[str, str]]:
        async with aiohttp.ClientSession() as session, session.get(url, headers=headers) as answer:
            return answer.status, await answer.read(), dict(answer.headers)

    return asyncio.run(run())


def frame(width: int, height: int, first_sample: int = 0, spp: int = 1) -> Frame:
    """Of two slaves with a cell each."""
    return Frame(
        width, height, {"beauty": 3, "cell": 1}, first_sample, spp, (0, 1), ("here, process 1", "there, process 2")
    )


def bucket(x0: int, y0: int, width: int, height: int, value: float) -> Bucket:
    """Pixels that tell where they are."""
    y, x = np.mgrid[y0 : y0 + height, x0 : x0 + width].astype(np.float32)
    beauty = np.stack([x / 100, y / 100, np.full_like(x, value)], axis=-1)
    cell = (x >= 8).astype(np.float32)
    return Bucket(x0, y0, {"beauty": beauty, "cell": cell}, slave=x0 // 16 % 2)
