"""Stands in for tev: decodes packets as its source does (IpcPacket::IStream and interpretAs...), and keeps images."""

from __future__ import annotations

import socket
import struct
import threading
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from patience import WAIT_S


class Packet:
    """One packet, read field by field."""

    def __init__(self, data: bytes) -> None:
        (size,) = struct.unpack_from("<I", data)
        assert size == len(data), "Trying to read IPC packet with incorrect size."
        self._data = data
        self._at = 4

    def number(self, code: str) -> Any:
        (value,) = struct.unpack_from(f"<{code}", self._data, self._at)
        self._at += struct.calcsize(code)
        return value

    def text(self) -> str:
        end = self._data.index(b"\0", self._at)
        text = self._data[self._at : end].decode()
        self._at = end + 1
        return text

    def rest(self) -> bytes:
        return self._data[self._at :]


class Image:
    """An image of tev: its channels by name, each of shape [height, width]."""

    def __init__(self, width: int, height: int, channels: list[str]) -> None:
        self.channels: dict[str, NDArray[np.float32]] = {
            name: np.zeros((height, width), np.float32) for name in channels
        }


class TevServer:
    """Listens at a port of this machine.

    Args:
        packets: that it takes before it goes away; None for all.
        deaf: accepts the connection, and reads nothing.

    Attributes:
        gone: it has hung up.
    """

    def __init__(self, packets: int | None = None, *, deaf: bool = False) -> None:
        self.images: dict[str, Image] = {}
        self.opened: list[tuple[str, str]] = []
        self.updates = 0
        self._left = packets
        self._deaf = deaf
        self.gone = threading.Event()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._listener.getsockname()[1])
        self.address = f"127.0.0.1:{self.port}"
        self._connection: socket.socket | None = None
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self.failed: BaseException | None = None

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._thread.join(WAIT_S)
        assert not self._thread.is_alive(), "the connection was not closed"
        if self._connection is not None:
            self._connection.close()
        self._listener.close()
        if self.failed is not None:
            raise self.failed

    def _serve(self) -> None:
        self._connection, _ = self._listener.accept()
        if self._deaf:
            return
        try:
            while (data := self._read()) is not None:
                self._take(Packet(data))
                self._left = None if self._left is None else self._left - 1
                if self._left == 0:
                    break
        except BaseException as error:
            self.failed = error
        # Data that nobody read makes closing a reset, as when a program is killed.
        self._connection.close()
        self.gone.set()

    def _read(self) -> bytes | None:
        head = self._exactly(4)
        if head is None:
            return None
        body = self._exactly(struct.unpack("<I", head)[0] - 4)
        assert body is not None, "the connection ended within a packet"
        return head + body

    def _exactly(self, size: int) -> bytes | None:
        assert self._connection is not None
        data = bytearray()
        while len(data) < size:
            more = self._connection.recv(size - len(data))
            if not more:
                assert not data, "the connection ended within a packet"
                return None
            data += more
        return bytes(data)

    def _take(self, packet: Packet) -> None:
        kind, focus = packet.number("b"), packet.number("b")
        assert focus in (0, 1)
        {4: self._create, 6: self._update, 7: self._open}[kind](packet)

    def _open(self, packet: Packet) -> None:
        self.opened.append((packet.text(), packet.text()))

    def _create(self, packet: Packet) -> None:
        name, width, height, count = packet.text(), packet.number("i"), packet.number("i"), packet.number("i")
        self.images[name] = Image(width, height, [packet.text() for _ in range(count)])
        assert packet.rest() == b""

    def _update(self, packet: Packet) -> None:
        name, count = packet.text(), packet.number("i")
        channels = [packet.text() for _ in range(count)]
        x, y, width, height = (packet.number("i") for _ in range(4))
        offsets = [packet.number("q") for _ in range(count)]
        strides = [packet.number("q") for _ in range(count)]
        pixels = width * height
        needed = max(o + (pixels - 1) * s + 1 for o, s in zip(offsets, strides, strict=True))
        data = np.frombuffer(packet.rest(), "<f4")
        assert len(data) == needed
        for channel, offset, stride in zip(channels, offsets, strides, strict=True):
            plane = data[offset::stride][:pixels].reshape(height, width)
            self.images[name].channels[channel][y : y + height, x : x + width] = plane
        self.updates += 1
