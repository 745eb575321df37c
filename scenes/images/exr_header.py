"""The header of an EXR file, of its first part where it has several.

OpenEXR's own reader of headers for Python ends the process at names that are not UTF-8, and at values of other sizes
than they should have; so what is wanted of a header is read here.
"""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

MAGIC = b"\x76\x2f\x31\x01"

_LONGEST_NAME = 255

_CHANNEL = struct.Struct("<i4xii")
"""Behind the name of a channel: its type, whether it is linear, and how far its samples are apart."""


@dataclass
class ExrHeader:
    """What a header says.

    Attributes:
        channels: how far the samples of each are apart, in pixels, by name. Names that are no text are left out.
        size: width and height [pixels].
        texts: attributes that are texts, as their bytes.
    """

    channels: dict[str, tuple[int, int]] = field(default_factory=dict)
    size: tuple[int, int] = (0, 0)
    texts: dict[str, bytes] = field(default_factory=dict)


def read_exr_header(file: Path) -> ExrHeader:
    """Read it. Raises ValueError, which says how it is broken; OSError where the file cannot be read."""
    header = ExrHeader()
    with file.open("rb") as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            raise ValueError("it begins otherwise")
        stream.seek(4, 1)  # the version
        while name := _name(stream):
            kind, size = _name(stream), struct.unpack("<i", _exactly(stream, 4))[0]
            if kind in (b"chlist", b"box2i", b"string"):
                _take(header, _text(name), kind, _exactly(stream, size))
            else:
                stream.seek(max(size, 0), 1)
    if min(header.size) < 1:
        raise ValueError("it says no size")
    return header


def _take(header: ExrHeader, name: str, kind: bytes, value: bytes) -> None:
    if kind == b"string":
        header.texts[name] = value
    elif name == "dataWindow":
        left, top, right, bottom = _unpacked(struct.Struct("<4i"), value)
        header.size = (right - left + 1, bottom - top + 1)
    elif name == "channels":
        while value.strip(b"\0"):
            channel, _, value = value.partition(b"\0")
            _type, x, y = _unpacked(_CHANNEL, value[: _CHANNEL.size])
            value = value[_CHANNEL.size :]
            if text := _text(channel):
                header.channels[text] = (x, y)


def _unpacked(struct_: struct.Struct, value: bytes) -> tuple[int, ...]:
    if len(value) != struct_.size:
        raise ValueError("a value of its header has another size")
    return struct_.unpack(value)


def _text(name: bytes) -> str:
    """A name; nothing for what is no text."""
    try:
        return name.decode()
    except UnicodeDecodeError:
        return ""


def _exactly(stream: BinaryIO, size: int) -> bytes:
    if not 0 <= size <= os.fstat(stream.fileno()).st_size - stream.tell():
        raise ValueError("its header breaks off")
    return stream.read(size)


def _name(stream: BinaryIO) -> bytes:
    """Up to the next zero byte."""
    read = stream.read(_LONGEST_NAME + 1)
    name, zero, _ = read.partition(b"\0")
    if not zero:
        raise ValueError("its header breaks off" if len(read) <= _LONGEST_NAME else "a name in its header has no end")
    stream.seek(len(name) + 1 - len(read), 1)
    return name
