"""Dataclasses to frames and back. docs/protocol.md is the norm; this is the only code that packs or unpacks.

The first frame is a msgpack header: magic, protocol version, name of the message, its fields in order. An array stands
in the header as [dtype, shape]; its bytes follow in frames of their own, which neither side copies. What a field may
hold is derived from its type hint, so a message needs no code of its own; what hints cannot say is in `checks`. A
received message is checked through and through before anyone sees it: whatever is wrong with it is a ProtocolError.
Nothing is ever unpickled.
"""

from __future__ import annotations

import functools
import math
import operator
import types
import typing
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.messages import checks
from wdpm.cluster.messages.protocol import PROTOCOL
from wdpm.scenes.errors import ProtocolError

MAGIC = b"wdpm"

HEADER_BYTES = 4 << 20
"""Longest header. The largest there are name some thousand textures."""

FRAME_BYTES = HEADER_BYTES
"""Longest frame. Larger arrays span several: a receiver's socket refuses longer frames before it reads them, so that
whoever has not even shown a key has little to fill memory with."""

MOST_FRAMES = 1 << 16
"""Frames of a message. The largest there are send some thousand textures, two frames each."""

STRANGER_BYTES = 16 << 10
"""Longest header of someone who has not been welcomed: Hello and PeerHello are some hundred bytes, and have no arrays.
A header of small things takes a thousand times its bytes in memory, and its share of the time to make them."""

_MOST_ITEMS = 1 << 17
"""Items of one list of a header. The longest there are name the holder of every cell."""

_MOST_TEXT = 1 << 16
"""Bytes of one text of a header."""

ARRAY_DIMENSIONS = 4
DTYPES = frozenset({"<f4", "<f8", "<i4", "<i8", "|u1"})
PLAIN_DEPTH = 6
"""Deepest nesting of data that no schema describes: statistics."""

Frame = bytes | bytearray | memoryview


def encode(message: Any) -> list[Frame]:
    """Frames of a message. Those of arrays share the arrays' memory, so these must not be written to any more.

    Raises:
        ProtocolError: a field does not hold what its type hint says.
    """
    arrays: list[np.ndarray[Any, Any]] = []
    values = _pack(type(message), message, type(message).__name__, arrays)
    header = msgpack.packb([MAGIC, PROTOCOL, type(message).__name__, values], use_bin_type=True)
    return [header, *(frame for array in arrays for frame in _split(array))]


def decode(frames: Sequence[Frame], expected: Mapping[str, type], *, stranger: bool = False) -> Any:
    """The message that frames hold; its arrays are read-only views of the frames where they can be.

    Args:
        expected: messages that may come here, by name.
        stranger: whether the sender has not been welcomed yet: then the message is one short header.

    Raises:
        ProtocolError: anything at all is wrong.
    """
    if not frames:
        raise ProtocolError("a message without frames")
    most = most_frames(stranger)
    if len(frames) > most:
        raise ProtocolError(f"a message of more than {most} frames{' before it was welcomed' if stranger else ''}")
    name, values = _header(frames[0], STRANGER_BYTES if stranger else HEADER_BYTES)
    if name not in expected:
        raise ProtocolError(f"message {name!r} is not known here; expected one of {', '.join(sorted(expected))}")
    reader = _Frames(frames[1:])
    message = _unpack(expected[name], values, name, reader)
    reader.finish()
    return message


def most_frames(stranger: bool) -> int:
    """Frames that a message may have."""
    return 1 if stranger else MOST_FRAMES


def by_name(union: Any) -> dict[str, type]:
    """The messages of a union type, by name."""
    return {member.__name__: member for member in typing.get_args(union)}


def _header(frame: Frame, most_bytes: int) -> tuple[str, Any]:
    if len(frame) > most_bytes:
        raise ProtocolError(f"a header of {len(frame)} bytes; at most {most_bytes} are taken")
    try:
        header = msgpack.unpackb(
            frame,
            raw=False,
            strict_map_key=True,
            max_array_len=_MOST_ITEMS,
            max_map_len=_MOST_ITEMS,
            max_str_len=_MOST_TEXT,
            max_bin_len=len(MAGIC),
            max_ext_len=0,
        )
    except (ValueError, msgpack.UnpackException, RecursionError) as error:
        # msgpack's own errors, and UnicodeDecodeError, are ValueErrors.
        raise ProtocolError(f"the header is not msgpack ({error})") from None
    if not isinstance(header, list) or len(header) != 4 or header[0] != MAGIC:
        raise ProtocolError("this is not a message of wdpm")
    _, version, name, values = header
    if version != PROTOCOL:
        raise ProtocolError(f"protocol {version!r} where {PROTOCOL} is spoken; install the same wdpm on both machines")
    if not isinstance(name, str):
        raise ProtocolError(f"the name of a message is a {type(name).__name__}")
    return name, values


# Arrays.


def _split(array: np.ndarray[Any, Any]) -> Iterator[memoryview]:
    """Frames of an array; none for an empty one."""
    if array.nbytes:
        whole = array.reshape(-1).view(np.uint8).data
        for start in range(0, array.nbytes, FRAME_BYTES):
            yield whole[start : start + FRAME_BYTES]


class _Frames:
    """Array frames, taken one after another."""

    def __init__(self, frames: Sequence[Frame]) -> None:
        self._frames = frames
        self._next = 0

    def array(self, dtype: np.dtype[Any], shape: tuple[int, ...], where: str) -> np.ndarray[Any, Any]:
        size = math.prod(shape) * dtype.itemsize
        taken: list[Frame] = []
        for start in range(0, size, FRAME_BYTES):
            expected = min(FRAME_BYTES, size - start)
            if self._next == len(self._frames):
                raise ProtocolError(f"{where}: its frame is missing")
            frame = self._frames[self._next]
            if len(frame) != expected:
                raise ProtocolError(f"{where}: a frame of {len(frame)} bytes; {dtype} {shape} takes {expected}")
            self._next += 1
            taken.append(frame)
        if len(taken) == 1:
            return np.frombuffer(taken[0], dtype).reshape(shape)
        whole = np.empty(size, np.uint8)
        for index, frame in enumerate(taken):
            whole[index * FRAME_BYTES : index * FRAME_BYTES + len(frame)] = np.frombuffer(frame, np.uint8)
        return whole.view(dtype).reshape(shape)

    def finish(self) -> None:
        if self._next != len(self._frames):
            raise ProtocolError(f"{len(self._frames) - self._next} frames too many")


def _elements(shape: Sequence[int]) -> int:
    """Elements of an array, were none of its lengths 0: NumPy refuses shapes whose other lengths are too large."""
    return math.prod(max(length, 1) for length in shape)


@functools.cache
def _dtype_of(hint: Any) -> np.dtype[Any] | None:
    """Element type of an NDArray hint; None for NDArray[Any], which may be any of DTYPES."""
    arguments = typing.get_args(hint)
    scalar = typing.get_args(arguments[1])[0] if typing.get_origin(hint) is np.ndarray else arguments[0]
    return None if scalar in (Any, np.generic) else np.dtype(scalar).newbyteorder("<")


def _pack_array(hint: Any, value: Any, where: str, arrays: list[np.ndarray[Any, Any]]) -> Any:
    if not isinstance(value, np.ndarray):
        raise ProtocolError(f"{where} is a {type(value).__name__}; expected an array")
    dtype = _dtype_of(hint)
    if dtype is not None and value.dtype != dtype:
        raise ProtocolError(f"{where} is {value.dtype}; expected {dtype}")
    if value.dtype.str not in DTYPES or value.ndim > ARRAY_DIMENSIONS:
        raise ProtocolError(f"{where} is {value.dtype} of {value.ndim} dimensions, which the wire does not carry")
    arrays.append(np.ascontiguousarray(value))
    return [value.dtype.str, list(value.shape)]


def _unpack_array(hint: Any, value: Any, where: str, frames: _Frames) -> np.ndarray[Any, Any]:
    if not isinstance(value, list) or len(value) != 2:
        raise ProtocolError(f"{where} is not [dtype, shape]")
    name, shape = value
    expected = _dtype_of(hint)
    if not isinstance(name, str) or name not in DTYPES or (expected is not None and np.dtype(name) != expected):
        raise ProtocolError(f"{where} is {name!r}; expected {expected or sorted(DTYPES)}")
    if not isinstance(shape, list) or len(shape) > ARRAY_DIMENSIONS:
        raise ProtocolError(f"{where}: {shape!r} is no shape")
    if not all(type(length) is int and length >= 0 for length in shape) or _elements(shape) >= 2**40:
        raise ProtocolError(f"{where}: {shape!r:.80} is no shape")
    return frames.array(np.dtype(name), tuple(shape), where)


# Values, by their type hints.


_known_hints: dict[Any, dict[str, Any]] = {}


def _hints(cls: Any) -> dict[str, Any]:
    """Type hints of a dataclass's fields, in order."""
    known = _known_hints.get(cls)
    if known is None:
        hints = typing.get_type_hints(cls)
        known = _known_hints[cls] = {field.name: hints[field.name] for field in fields(cls)}
    return known


@functools.cache
def _is_array(hint: Any) -> bool:
    # From NumPy 2.5 on, with Python 3.12 and newer, NDArray is an alias that stays one when it is subscripted.
    return typing.get_origin(hint) in (np.ndarray, NDArray)


@functools.cache
def _members(hint: Any) -> tuple[Any, ...]:
    """Alternatives of a union; empty for any other hint."""
    union = typing.get_origin(hint) in (typing.Union, types.UnionType)
    return typing.get_args(hint) if union else ()


def _pack(hint: Any, value: Any, where: str, arrays: list[np.ndarray[Any, Any]]) -> Any:
    if _is_array(hint):
        return _pack_array(hint, value, where, arrays)
    if members := _members(hint):
        return _pack_union(members, value, where, arrays)
    if hint is Any:
        return _plain(value, where)
    if isinstance(hint, type) and is_dataclass(hint):
        if type(value) is not hint:
            raise ProtocolError(f"{where} is a {type(value).__name__}; expected {hint.__name__}")
        return [_pack(h, getattr(value, name), f"{where}.{name}", arrays) for name, h in _hints(hint).items()]
    if isinstance(hint, type) and issubclass(hint, Enum):
        if not isinstance(value, hint):
            raise ProtocolError(f"{where} is {value!r}; expected a {hint.__name__}")
        return value.value
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is tuple:
        items = _tuple_hints(arguments, value, where)
        return [_pack(h, item, f"{where}[{index}]", arrays) for index, (h, item) in enumerate(items)]
    if origin in (dict, Mapping):
        if not isinstance(value, Mapping):
            raise ProtocolError(f"{where} is a {type(value).__name__}; expected a mapping")
        return {
            _pack(arguments[0], key, where, arrays): _pack(arguments[1], item, f"{where}[{key!r}]", arrays)
            for key, item in value.items()
        }
    return _pack_scalar(hint, value, where)


def _pack_union(members: tuple[Any, ...], value: Any, where: str, arrays: list[np.ndarray[Any, Any]]) -> Any:
    if value is None and type(None) in members:
        return None
    others = [member for member in members if member is not type(None)]
    if len(others) == 1:
        return _pack(others[0], value, where, arrays)
    for member in others:
        if type(value) is member:
            return [member.__name__, _pack(member, value, where, arrays)]
    raise ProtocolError(f"{where} is a {type(value).__name__}; expected {' or '.join(m.__name__ for m in others)}")


def _pack_scalar(hint: Any, value: Any, where: str) -> Any:
    """NumPy's scalars become Python's on the way."""
    try:
        if hint is bool and isinstance(value, bool | np.bool_):
            return bool(value)
        if hint is int and not isinstance(value, bool | np.bool_):
            return _whole(operator.index(value), where)
        if hint is float and isinstance(value, float | int | np.floating) and not isinstance(value, bool):
            return float(value)
        if hint is str and isinstance(value, str):
            return str(value)
    except TypeError:
        pass  # operator.index: not an integer; reported below like the others
    raise ProtocolError(f"{where} is {value!r}; expected {getattr(hint, '__name__', hint)}")


def _whole(value: int, where: str) -> int:
    if not -(2**63) <= value < 2**63:
        raise ProtocolError(f"{where} is {value}, which 64 bits do not hold")
    return value


def _tuple_hints(arguments: tuple[Any, ...], value: Any, where: str) -> Iterable[tuple[Any, Any]]:
    if not isinstance(value, tuple | list):
        raise ProtocolError(f"{where} is a {type(value).__name__}; expected a sequence")
    if len(arguments) == 2 and arguments[1] is Ellipsis:
        return [(arguments[0], item) for item in value]
    if len(value) != len(arguments):
        raise ProtocolError(f"{where} has {len(value)} items; expected {len(arguments)}")
    return zip(arguments, value, strict=True)


def _unpack(hint: Any, value: Any, where: str, frames: _Frames) -> Any:
    if _is_array(hint):
        return _unpack_array(hint, value, where, frames)
    if members := _members(hint):
        return _unpack_union(members, value, where, frames)
    if hint is Any:
        return _plain(value, where)
    if isinstance(hint, type) and is_dataclass(hint):
        return _unpack_dataclass(hint, value, where, frames)
    if isinstance(hint, type) and issubclass(hint, Enum):
        for member in hint:
            if type(member.value) is type(value) and member.value == value:  # True is no 1 here
                return member
        raise ProtocolError(f"{where} is {value!r}; expected one of {[m.value for m in hint]}")
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is tuple:
        items = _tuple_hints(arguments, value, where)
        return tuple(_unpack(h, item, f"{where}[{index}]", frames) for index, (h, item) in enumerate(items))
    if origin in (dict, Mapping):
        if not isinstance(value, dict):
            raise ProtocolError(f"{where} is a {type(value).__name__}; expected a map")
        return {
            _unpack(arguments[0], key, where, frames): _unpack(arguments[1], item, f"{where}[{key!r}]", frames)
            for key, item in value.items()
        }
    return _unpack_scalar(hint, value, where)


def _unpack_dataclass(hint: type, value: Any, where: str, frames: _Frames) -> Any:
    hints = _hints(hint)
    if not isinstance(value, list) or len(value) != len(hints):
        raise ProtocolError(f"{where} is not a list of {len(hints)} fields")
    arguments = [
        _unpack(h, item, f"{where}.{name}", frames) for (name, h), item in zip(hints.items(), value, strict=True)
    ]
    unpacked = hint(*arguments)
    checks.check(unpacked, where)
    return unpacked


def _unpack_union(members: tuple[Any, ...], value: Any, where: str, frames: _Frames) -> Any:
    if value is None and type(None) in members:
        return None
    others = [member for member in members if member is not type(None)]
    if len(others) == 1:
        return _unpack(others[0], value, where, frames)
    if not isinstance(value, list) or len(value) != 2:
        raise ProtocolError(f"{where} is not [name, fields]")
    for member in others:
        if value[0] == member.__name__:
            return _unpack(member, value[1], where, frames)
    raise ProtocolError(f"{where} is a {value[0]!r}; expected {' or '.join(member.__name__ for member in others)}")


def _unpack_scalar(hint: Any, value: Any, where: str) -> Any:
    # Exact types: a bool is an int to Python, but not here.
    if hint not in (bool, int, float, str):
        raise TypeError(f"{where} has the type hint {hint}, which the wire does not know")
    if type(value) is not hint:
        raise ProtocolError(f"{where} is {value!r:.80}; expected {hint.__name__}")
    if hint is str:
        return printable(value)
    return _whole(value, where) if hint is int else value


def printable(text: str) -> str:
    """Text on one line without control characters: a terminal would take those of a stranger for orders."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else " " if c.isspace() else "\N{REPLACEMENT CHARACTER}" for c in text)


def _plain(value: Any, where: str, depth: int = PLAIN_DEPTH) -> Any:
    """Data that no schema describes: numbers, text, lists and maps by text."""
    if depth == 0:
        raise ProtocolError(f"{where} is nested more than {PLAIN_DEPTH} deep")
    if value is None or isinstance(value, bool | float):
        return value
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, int):
        return _whole(value, where)
    if isinstance(value, list | tuple):
        return [_plain(item, where, depth - 1) for item in value]
    if isinstance(value, Mapping) and all(isinstance(key, str) for key in value):
        return {printable(key): _plain(item, f"{where}[{key!r}]", depth - 1) for key, item in value.items()}
    raise ProtocolError(f"{where} is a {type(value).__name__}, which the wire does not carry")
