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
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any, NamedTuple

import msgpack
import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.batch import Batch
from wdpm.cluster.messages import checks, short_bitmaps
from wdpm.cluster.messages.batch_frames import pack_batch, unpack_batch
from wdpm.cluster.messages.frames import Frame, Frames, split
from wdpm.cluster.messages.protocol import PROTOCOL
from wdpm.scenes.errors import ProtocolError
from wdpm.scenes.model.textures import Bitmap

MAGIC = b"wdpm"

HEADER_BYTES = 4 << 20
"""Longest header. The largest there are name some thousand textures."""

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


def encode(message: Any) -> list[Frame]:
    """Frames of a message. Those of arrays share the arrays' memory, so these must not be written to any more.

    Raises:
        ProtocolError: a field does not hold what its type hint says.
    """
    arrays: list[np.ndarray[Any, Any]] = []
    kind: Any = type(message)
    values = _codec_of(kind).pack(message, kind.__name__, arrays)
    header = msgpack.packb([MAGIC, PROTOCOL, kind.__name__, values], use_bin_type=True)
    return [header, *(frame for array in arrays for frame in split(array))]


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
    reader = Frames(frames[1:])
    message = _codec_of(expected[name]).unpack(values, name, reader)
    reader.finish()
    return message


def most_frames(stranger: bool) -> int:
    """Frames that a message may have."""
    return 1 if stranger else MOST_FRAMES


def by_name(union: Any) -> dict[str, type]:
    """The messages of a union type, by name."""
    return {member.__name__: member for member in typing.get_args(union)}


def prepare(hint: Any) -> None:
    """Find out ahead how values of a type hint go over the wire, and all that these are made of."""
    found: set[Any] = set()
    left = [hint]
    while left:
        each = left.pop()
        if each in found:
            continue
        found.add(each)
        if isinstance(each, type) and is_dataclass(each):
            left += _hints(each).values()
        elif not _is_array(each):
            left += typing.get_args(each)
        if each is not Ellipsis:
            _codec_of(each)


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


def _elements(shape: Sequence[int]) -> int:
    """Elements of an array, were none of its lengths 0: NumPy refuses shapes whose other lengths are too large."""
    return math.prod(max(length, 1) for length in shape)


def _dtype_of(hint: Any) -> np.dtype[Any] | None:
    """Element type of an NDArray hint; None for NDArray[Any], which may be any of DTYPES."""
    arguments = typing.get_args(hint)
    scalar = typing.get_args(arguments[1])[0] if typing.get_origin(hint) is np.ndarray else arguments[0]
    return None if scalar in (Any, np.generic) else np.dtype(scalar).newbyteorder("<")


def _array_packer(hint: Any) -> Packer:
    dtype = _dtype_of(hint)

    def pack(value: Any, where: str, arrays: list[np.ndarray[Any, Any]]) -> Any:
        if not isinstance(value, np.ndarray):
            raise ProtocolError(f"{where} is a {type(value).__name__}; expected an array")
        if dtype is not None and value.dtype != dtype:
            raise ProtocolError(f"{where} is {value.dtype}; expected {dtype}")
        name = value.dtype.str
        if name not in DTYPES or value.ndim > ARRAY_DIMENSIONS:
            raise ProtocolError(f"{where} is {value.dtype} of {value.ndim} dimensions, which the wire does not carry")
        arrays.append(np.ascontiguousarray(value))
        return [name, list(value.shape)]

    return pack


def _array_unpacker(hint: Any) -> Unpacker:
    expected = _dtype_of(hint)
    names = DTYPES if expected is None else {name for name in DTYPES if np.dtype(name) == expected}

    def unpack(value: Any, where: str, frames: Frames) -> np.ndarray[Any, Any]:
        if not isinstance(value, list) or len(value) != 2:
            raise ProtocolError(f"{where} is not [dtype, shape]")
        name, shape = value
        if not isinstance(name, str) or name not in names:
            raise ProtocolError(f"{where} is {name!r}; expected {expected or sorted(DTYPES)}")
        if not isinstance(shape, list) or len(shape) > ARRAY_DIMENSIONS:
            raise ProtocolError(f"{where}: {shape!r} is no shape")
        if not all(type(length) is int and length >= 0 for length in shape) or _elements(shape) >= 2**40:
            raise ProtocolError(f"{where}: {shape!r:.80} is no shape")
        return frames.array(np.dtype(name), tuple(shape), where)

    return unpack


# Values, by their type hints. What a hint says is found out once: a message has some thirty values, and a cluster
# without copies sends thousands of messages a second. Threads may ask for the first time together: what is kept is made
# whole before anyone sees it.

Packer = Callable[[Any, str, "list[np.ndarray[Any, Any]]"], Any]
"""(value, where it stands, arrays of the message so far) -> what stands in the header."""

Unpacker = Callable[[Any, str, Frames], Any]
"""(what stands in the header, where, frames of arrays) -> value."""


@functools.cache
def _hints(cls: Any) -> dict[str, Any]:
    """Type hints of a dataclass's fields, in order."""
    hints = typing.get_type_hints(cls)
    return {field.name: hints[field.name] for field in fields(cls)}


def _is_array(hint: Any) -> bool:
    # From NumPy 2.5 on, with Python 3.12 and newer, NDArray is an alias that stays one when it is subscripted.
    return typing.get_origin(hint) in (np.ndarray, NDArray)


def _members(hint: Any) -> tuple[Any, ...]:
    """Alternatives of a union; empty for any other hint."""
    union = typing.get_origin(hint) in (typing.Union, types.UnionType)
    return typing.get_args(hint) if union else ()


class Codec(NamedTuple):
    """How values of a type hint are packed, and unpacked and checked; ProtocolError where one is something else."""

    pack: Packer
    unpack: Unpacker


@functools.cache
def _codec_of(hint: Any) -> Codec:
    """How values of a type hint go over the wire, found out once."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if _is_array(hint):
        return Codec(_array_packer(hint), _array_unpacker(hint))
    if members := _members(hint):
        return Codec(_union_packer(members), _union_unpacker(members))
    if hint is Any:
        return Codec(both_ways := lambda value, where, _: _plain(value, where), both_ways)
    if hint is Batch:
        return Codec(pack_batch, unpack_batch)
    if hint is Bitmap:
        return Codec(_pack_bitmap, _unpack_bitmap)
    if isinstance(hint, type) and is_dataclass(hint):
        return Codec(_dataclass_packer(hint), _dataclass_unpacker(hint))
    if isinstance(hint, type) and issubclass(hint, Enum):
        return Codec(_enum_packer(hint), _enum_unpacker(hint))
    if origin is tuple:
        return Codec(_tuple_packer(arguments), _tuple_unpacker(arguments))
    if origin in (dict, Mapping):
        return Codec(_map_packer(*arguments), _map_unpacker(*arguments))
    return Codec(
        lambda value, where, _: _pack_scalar(hint, value, where),
        lambda value, where, _: _unpack_scalar(hint, value, where),
    )


def _pack_bitmap(value: Any, where: str, arrays: list[np.ndarray[Any, Any]]) -> Any:
    if type(value) is not Bitmap:
        raise ProtocolError(f"{where} is a {type(value).__name__}; expected Bitmap")
    return _codec_of(short_bitmaps.ShortBitmap).pack(short_bitmaps.shorten(value), where, arrays)


def _unpack_bitmap(value: Any, where: str, frames: Frames) -> Bitmap:
    bitmap = short_bitmaps.lengthen(_codec_of(short_bitmaps.ShortBitmap).unpack(value, where, frames), where)
    checks.check(bitmap, where)
    return bitmap


def _dataclass_packer(hint: type) -> Packer:
    @functools.cache
    def members() -> tuple[tuple[str, Packer], ...]:  # asked for late: a class may be of its own kind somewhere within
        return tuple((name, _codec_of(inner).pack) for name, inner in _hints(hint).items())

    def pack(value: Any, where: str, arrays: list[np.ndarray[Any, Any]]) -> Any:
        if type(value) is not hint:
            raise ProtocolError(f"{where} is a {type(value).__name__}; expected {hint.__name__}")
        return [of(getattr(value, name), f"{where}.{name}", arrays) for name, of in members()]

    return pack


def _enum_packer(hint: type[Enum]) -> Packer:
    def pack(value: Any, where: str, _: Any) -> Any:
        if not isinstance(value, hint):
            raise ProtocolError(f"{where} is {value!r}; expected a {hint.__name__}")
        return value.value

    return pack


def _tuple_packer(arguments: tuple[Any, ...]) -> Packer:
    if len(arguments) == 2 and arguments[1] is Ellipsis:
        each = _codec_of(arguments[0]).pack

        def pack_all(value: Any, where: str, arrays: list[np.ndarray[Any, Any]]) -> Any:
            return [each(item, f"{where}[{index}]", arrays) for index, item in enumerate(_sequence(value, where))]

        return pack_all

    def pack(value: Any, where: str, arrays: list[np.ndarray[Any, Any]]) -> Any:
        items = _tuple_hints(arguments, value, where)
        return [_codec_of(hint).pack(item, f"{where}[{index}]", arrays) for index, (hint, item) in enumerate(items)]

    return pack


def _map_packer(key_hint: Any, item_hint: Any) -> Packer:
    of_key, of_item = _codec_of(key_hint).pack, _codec_of(item_hint).pack

    def pack(value: Any, where: str, arrays: list[np.ndarray[Any, Any]]) -> Any:
        if not isinstance(value, Mapping):
            raise ProtocolError(f"{where} is a {type(value).__name__}; expected a mapping")
        return {of_key(key, where, arrays): of_item(item, f"{where}[{key!r}]", arrays) for key, item in value.items()}

    return pack


def _union_packer(members: tuple[Any, ...]) -> Packer:
    others = [member for member in members if member is not type(None)]
    optional, names = len(others) < len(members), " or ".join(member.__name__ for member in others)
    if len(others) == 1:
        only = _codec_of(others[0]).pack
        return lambda value, where, arrays: None if value is None and optional else only(value, where, arrays)

    def pack(value: Any, where: str, arrays: list[np.ndarray[Any, Any]]) -> Any:
        if value is None and optional:
            return None
        kind: Any = type(value)
        if kind in others:
            return [kind.__name__, _codec_of(kind).pack(value, where, arrays)]
        raise ProtocolError(f"{where} is a {type(value).__name__}; expected {names}")

    return pack


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


def _sequence(value: Any, where: str) -> Sequence[Any]:
    if not isinstance(value, tuple | list):
        raise ProtocolError(f"{where} is a {type(value).__name__}; expected a sequence")
    return value


def _tuple_hints(arguments: tuple[Any, ...], value: Any, where: str) -> Iterable[tuple[Any, Any]]:
    if len(_sequence(value, where)) != len(arguments):
        raise ProtocolError(f"{where} has {len(value)} items; expected {len(arguments)}")
    return zip(arguments, value, strict=True)


def _dataclass_unpacker(hint: type) -> Unpacker:
    @functools.cache
    def members() -> tuple[tuple[str, Unpacker], ...]:
        return tuple((name, _codec_of(inner).unpack) for name, inner in _hints(hint).items())

    def unpack(value: Any, where: str, frames: Frames) -> Any:
        of_fields = members()
        if not isinstance(value, list) or len(value) != len(of_fields):
            raise ProtocolError(f"{where} is not a list of {len(of_fields)} fields")
        arguments = [of(item, f"{where}.{name}", frames) for (name, of), item in zip(of_fields, value, strict=True)]
        unpacked = hint(*arguments)
        checks.check(unpacked, where)
        return unpacked

    return unpack


def _enum_unpacker(hint: type[Enum]) -> Unpacker:
    known = {(type(member.value), member.value): member for member in hint}  # True is no 1 here
    values = [member.value for member in hint]

    def unpack(value: Any, where: str, _: Any) -> Any:
        member = known.get((type(value), value)) if isinstance(value, Hashable) else None
        if member is None:
            raise ProtocolError(f"{where} is {value!r}; expected one of {values}")
        return member

    return unpack


def _tuple_unpacker(arguments: tuple[Any, ...]) -> Unpacker:
    if len(arguments) == 2 and arguments[1] is Ellipsis:
        each = _codec_of(arguments[0]).unpack

        def unpack_all(value: Any, where: str, frames: Frames) -> Any:
            items = _sequence(value, where)
            return tuple([each(item, f"{where}[{index}]", frames) for index, item in enumerate(items)])

        return unpack_all

    def unpack(value: Any, where: str, frames: Frames) -> Any:
        items = _tuple_hints(arguments, value, where)
        return tuple(
            _codec_of(hint).unpack(item, f"{where}[{index}]", frames) for index, (hint, item) in enumerate(items)
        )

    return unpack


def _map_unpacker(key_hint: Any, item_hint: Any) -> Unpacker:
    of_key, of_item = _codec_of(key_hint).unpack, _codec_of(item_hint).unpack

    def unpack(value: Any, where: str, frames: Frames) -> Any:
        if not isinstance(value, dict):
            raise ProtocolError(f"{where} is a {type(value).__name__}; expected a map")
        return {of_key(key, where, frames): of_item(item, f"{where}[{key!r}]", frames) for key, item in value.items()}

    return unpack


def _union_unpacker(members: tuple[Any, ...]) -> Unpacker:
    others = {member.__name__: member for member in members if member is not type(None)}
    optional, names = len(others) < len(members), " or ".join(others)
    if len(others) == 1:
        [only] = (_codec_of(member).unpack for member in others.values())
        return lambda value, where, frames: None if value is None and optional else only(value, where, frames)

    def unpack(value: Any, where: str, frames: Frames) -> Any:
        if value is None and optional:
            return None
        if not isinstance(value, list) or len(value) != 2:
            raise ProtocolError(f"{where} is not [name, fields]")
        member = others.get(value[0]) if isinstance(value[0], str) else None
        if member is None:
            raise ProtocolError(f"{where} is a {value[0]!r}; expected {names}")
        return _codec_of(member).unpack(value[1], where, frames)

    return unpack


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
