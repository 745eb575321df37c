"""A TCP proxy that does to connections what networks do: delay, throttle, cut, forget and swallow without a word."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
import time
from types import TracebackType
from typing import Self

_CHUNK = 4096
"""Bytes that are carried in one go; connections take turns."""

_WAIT_S = 100.0
"""For its own thread: it may be slow, but must not hang."""

_BUFFER = 64 << 10
"""What the proxy itself holds of a connection: the rest waits at the sender, as it does before a slow link."""


class TcpProxy:
    """A link to a listener at tcp://HOST:PORT, on a thread of its own while it is open.

    Args:
        target: where it leads.
        bytes_per_s: of each direction, for all connections together; None for no bound.
        delay_s: of every byte, one way.
        frozen: whether a connection, by its number from 0, carries nothing, though nobody hears so: half-open.

    Attributes:
        endpoint: where others reach the target.
        opened: connections so far.
    """

    def __init__(
        self,
        target: str,
        *,
        bytes_per_s: float | None = None,
        delay_s: float = 0.0,
        frozen: frozenset[int] = frozenset(),
    ) -> None:
        host, _, port = target.removeprefix("tcp://").rpartition(":")
        self._target = (host, int(port))
        self._bytes_per_s, self._delay_s, self._frozen = bytes_per_s, delay_s, frozen
        self.opened = 0
        self._halted = False
        self._swallowed: set[tuple[int, bool]] = set()  # numbers of connections, and whether it is what goes there
        self._cut_until = 0.0
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        self.endpoint = f"tcp://127.0.0.1:{self._listener.getsockname()[1]}"
        self._writers: set[asyncio.StreamWriter] = set()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def cut(self, seconds: float = 0.0) -> None:
        """Break every connection; new ones may be made, after that time [s]."""
        self._cut_until = time.monotonic() + seconds
        asyncio.run_coroutine_threadsafe(self._abort(), self._loop).result(_WAIT_S)

    def freeze(self) -> None:
        """Carry nothing any more, on no connection, and tell nobody."""
        self._halted = True

    def swallow(self, *numbers: int, there: bool) -> None:
        """Take what comes over these connections, and throw it away: whoever sends it sees that it was taken.

        Args:
            numbers: of connections, from 0.
            there: whether what goes to the target, or what comes from it.
        """
        self._swallowed |= {(number, there) for number in numbers}

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        asyncio.run_coroutine_threadsafe(self._end(), self._loop).result(_WAIT_S)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(_WAIT_S)
        self._loop.close()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._links = (asyncio.Lock(), asyncio.Lock())
        self._server = self._loop.run_until_complete(
            asyncio.start_server(self._connected, sock=self._listener, limit=_BUFFER)
        )
        self._loop.run_forever()

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        number, self.opened = self.opened, self.opened + 1
        if time.monotonic() < self._cut_until:
            writer.transport.abort()
            return
        self._writers.add(writer)
        if number in self._frozen:
            return
        try:
            there, back = await asyncio.open_connection(*self._target, limit=_BUFFER)
        except ConnectionError:  # nobody listens there any more
            writer.transport.abort()
            return
        self._writers.add(back)
        await asyncio.gather(
            self._carry(reader, back, self._links[0], (number, True)),
            self._carry(there, writer, self._links[1], (number, False)),
        )

    async def _carry(
        self,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
        link: asyncio.Lock,
        way: tuple[int, bool],
    ) -> None:
        with contextlib.suppress(ConnectionError, asyncio.CancelledError):
            while data := await reader.read(_CHUNK):
                if way in self._swallowed:
                    continue
                while self._halted:
                    await asyncio.sleep(0.02)
                if self._bytes_per_s is not None:
                    async with link:
                        await asyncio.sleep(len(data) / self._bytes_per_s)
                if self._delay_s:
                    self._loop.call_later(self._delay_s, writer.write, data)
                else:
                    writer.write(data)
                    await writer.drain()
        self._loop.call_later(self._delay_s, writer.close)

    async def _abort(self) -> None:
        for writer in self._writers:
            writer.transport.abort()
        self._writers.clear()

    async def _end(self) -> None:
        self._server.close()
        await self._abort()
        others = asyncio.all_tasks() - {asyncio.current_task()}
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)
