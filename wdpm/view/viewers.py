"""Whoever looks: a websocket each, its wants, and what it has not been sent yet. All of it on the server's loop."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from aiohttp import web

from wdpm.view.picture import Picture, Rectangle
from wdpm.view.tiles import pack_tile, tiles_of

STATUS_S = 0.5
"""Between one status and the next: often enough for a clock that counts seconds."""

Want = tuple[str, str]
"""A picture, "a" or "b", and one of its layers."""


class Viewer:
    """One page that is open.

    What it is to be sent is remembered as places, and read when the socket takes more: a page that cannot keep up gets
    the latest pixels, less often.

    Args:
        pictures: by their names, "a" and perhaps "b".
        status: what else the page shows, as JSON has it.
    """

    def __init__(
        self, socket: web.WebSocketResponse, pictures: Mapping[str, Picture], status: Callable[[], dict[str, Any]]
    ) -> None:
        self._socket = socket
        self._pictures = pictures
        self._status = status
        self._wants: frozenset[Want] = frozenset()
        self._waiting: dict[tuple[Want, Rectangle], None] = {}
        self._wake = asyncio.Event()
        self._status_at = 0.0

    def want(self, wants: Iterable[Want]) -> None:
        """What to send from now on, all of its pixels first."""
        self._wants = frozenset(wants)
        self._waiting = {}
        for source, layer in sorted(self._wants):
            for place in tiles_of(*self._pictures[source].size):
                self._waiting[(source, layer), place] = None
        self._wake.set()

    def changed(self, places: Iterable[Rectangle]) -> None:
        """Pixels of picture "a" are others now."""
        for place in places:
            for want in self._wants:
                if want[0] == "a":
                    self._waiting[want, place] = None
        self._wake.set()

    def hurry(self) -> None:
        """Send a status now."""
        self._status_at = 0.0
        self._wake.set()

    async def send(self) -> None:
        """Send what waits, as fast as the page takes it, for as long as it is there."""
        while not self._socket.closed:
            now = time.monotonic()
            if now >= self._status_at:
                self._status_at = now + STATUS_S
                await self._socket.send_json(self._status())
            elif self._waiting:
                want, place = next(iter(self._waiting))
                del self._waiting[want, place]
                await self._send_tile(want, place)
            else:
                self._wake.clear()
                await self._sleep(self._status_at - now)

    async def flush(self) -> None:
        """Send what waits, and a last status."""
        while self._waiting and not self._socket.closed:
            want, place = next(iter(self._waiting))
            del self._waiting[want, place]
            await self._send_tile(want, place)
        if not self._socket.closed:
            await self._socket.send_json(self._status())

    async def _sleep(self, seconds: float) -> None:
        try:
            await asyncio.wait_for(self._wake.wait(), seconds)
        except TimeoutError:
            return  # the next status is due

    async def _send_tile(self, want: Want, place: Rectangle) -> None:
        source, layer = want
        image, layers = self._pictures[source].now
        if layer in layers:
            pixels = layers[layer][place.y0 : place.y1, place.x0 : place.x1]
            await self._socket.send_bytes(pack_tile(source, image, layer, place, pixels))
